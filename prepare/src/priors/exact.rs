//! What a drawn scene knows of its photos: exact flow, disparity, and what moves.

use crate::error::PrepareError;
use crate::motion::Motion;
use scene_io::synthetic::{Drawn, Snapshot};
use scene_io::{BitMask, Disparity, Flow, Frame, ImageStore};

/// A drawn scene and its photos.
#[derive(Clone, Copy)]
pub(super) struct Exact<'a> {
    drawn: &'a Drawn,
    frames: &'a [Frame],
    photos: &'a ImageStore,
}

impl<'a> Exact<'a> {
    /// Indices are those of `frames`, which are drawn from `drawn`, and of `photos`, which have the size of the priors.
    pub(super) fn new(drawn: &'a Drawn, frames: &'a [Frame], photos: &'a ImageStore) -> Self {
        Self { drawn, frames, photos }
    }

    /// The scene when a photo was taken.
    fn at(&self, photo: usize) -> Result<Snapshot, PrepareError> {
        let frame = &self.frames[photo];
        frame.time.map(|time| self.drawn.at(time)).ok_or_else(|| not_drawn(frame, "has no time"))
    }

    /// Flow from a photo to another one, and back; not known where the other one does not show the same point.
    pub(super) fn flows(&self, from: usize, to: usize) -> Result<[Flow; 2], PrepareError> {
        let (here, there) = (self.at(from)?, self.at(to)?);
        let [a, b] = [from, to].map(|photo| self.photos.camera(photo));
        Ok([here.flow_to(a, &there, b).to_flow(), there.flow_to(b, &here, a).to_flow()])
    }

    /// Inverse depth along the optical axis, 1 / world unit; not known where nothing is seen.
    pub(super) fn disparity(&self, photo: usize) -> Result<Disparity, PrepareError> {
        let truth = self.at(photo)?.truth(self.photos.camera(photo));
        let (width, height) = (truth.width, truth.height);
        let at = |column: u32, row: u32| row as usize * width as usize + column as usize;
        let known = BitMask::from_fn(width, height, |column, row| truth.z[at(column, row)] > 0.0);
        let values = truth.z.iter().map(|z| if *z > 0.0 { (1.0 / z) as f32 } else { 0.0 }).collect();
        Ok(Disparity { width, height, values, known })
    }

    /// What moves at some time: a pixel counts if any of its rays met such a thing.
    pub(super) fn motion(&self, photo: usize) -> Result<Motion, PrepareError> {
        let (frame, camera) = (&self.frames[photo], self.photos.camera(photo));
        let truth = frame.read_moving()?.ok_or_else(|| not_drawn(frame, "does not know what moves"))?;
        let judged = BitMask::from_fn(camera.width, camera.height, |_, _| true);
        Ok(Motion { moving: truth.resized(camera.width, camera.height), judged })
    }
}

fn not_drawn(frame: &Frame, what: &str) -> PrepareError {
    PrepareError::input(&frame.name, what, "only photos of drawn scenes have exact priors")
}
