//! The visual hull: what photos say of a place before anything is reconstructed. Where one of them is transparent nothing is; elsewhere the
//! colours of the photos are the first guess.

use engine::data::Dataset;
use glam::DVec3;
use render_core::camera::Prepared;
use scene_io::{Image, SceneError};
use std::sync::Arc;

/// Photos that are asked, at most.
const PHOTOS: usize = 64;
/// A photo rules a place out where it is more transparent than this.
const TRANSPARENT: u8 = 32;
/// Where photos are of many times, a place that at least this share of them shows something at may hold something.
const SHOWN: f32 = 0.1;
/// Nothing is known of a place that fewer photos see.
const FEWEST: usize = 2;

/// The visual hull of some photos.
pub(crate) struct VisualHull {
    photos: Vec<(Prepared, Arc<Image>)>,
    /// The share of those that have a place in the picture which must show something there.
    shown: f32,
}

impl VisualHull {
    /// Some photos of a dataset, evenly spread.
    pub(crate) fn new(data: &Dataset) -> Result<Self, SceneError> {
        let count = data.len().min(PHOTOS);
        let photos = (0..count).map(|k| {
            let i = k * data.len() / count;
            Ok((data.view(i).camera.prepare(), data.image(i)?))
        });
        Ok(Self { photos: photos.collect::<Result<_, SceneError>>()?, shown: 1.0 })
    }

    /// The same of photos of many times: what one sees through may hold something in another.
    pub(crate) fn of_many_times(data: &Dataset) -> Result<Self, SceneError> {
        Ok(Self { shown: SHOWN, ..Self::new(data)? })
    }

    /// Mean colour of a place of the scene's frame over the photos that show something there; `None` where too many of them, or one of
    /// photos of a single time, show that nothing is there, or hardly any has it in the picture. Grey where there are no photos.
    pub(crate) fn colour_at(&self, x: DVec3) -> Option<[f32; 3]> {
        let (mut sum, mut count, mut nothing) = ([0.0_f32; 3], 0, 0);
        for (camera, image) in &self.photos {
            let Some(at) = camera.project(x) else { continue };
            if !(at.x >= 0.0 && at.y >= 0.0) {
                continue;
            }
            let (column, row) = (at.x as u32, at.y as u32);
            if column >= image.width || row >= image.height || !image.is_used(column, row) {
                continue;
            }
            let p = image.pixel(column, row);
            if p.len() == 4 && p[3] < TRANSPARENT {
                if self.shown == 1.0 {
                    return None;
                }
                nothing += 1;
                continue;
            }
            for (sum, &c) in sum.iter_mut().zip(p) {
                *sum += f32::from(c) / 255.0;
            }
            count += 1;
        }
        if self.photos.is_empty() {
            return Some([0.5; 3]);
        }
        let enough = count >= FEWEST.min(self.photos.len()) && count as f32 >= self.shown * (count + nothing) as f32;
        enough.then(|| sum.map(|c| c / count as f32))
    }
}
