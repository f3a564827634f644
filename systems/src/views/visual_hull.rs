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
/// Nothing is known of a place that fewer photos see.
const FEWEST: usize = 2;

/// The visual hull of some photos.
pub(crate) struct VisualHull {
    photos: Vec<(Prepared, Arc<Image>)>,
}

impl VisualHull {
    /// Some photos of a dataset, evenly spread.
    pub(crate) fn new(data: &Dataset) -> Result<Self, SceneError> {
        let count = data.len().min(PHOTOS);
        let photos = (0..count).map(|k| {
            let i = k * data.len() / count;
            Ok((data.view(i).camera.prepare(), data.image(i)?))
        });
        Ok(Self { photos: photos.collect::<Result<_, SceneError>>()? })
    }

    /// Mean colour of a place of the scene's frame over the photos that have it in the picture; `None` where one of them shows
    /// that nothing is there, or hardly any has it. Grey where there are no photos.
    pub(crate) fn colour_at(&self, x: DVec3) -> Option<[f32; 3]> {
        let (mut sum, mut count) = ([0.0_f32; 3], 0);
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
                return None;
            }
            for (sum, &c) in sum.iter_mut().zip(p) {
                *sum += f32::from(c) / 255.0;
            }
            count += 1;
        }
        if self.photos.is_empty() {
            return Some([0.5; 3]);
        }
        (count >= FEWEST.min(self.photos.len())).then(|| sum.map(|c| c / count as f32))
    }
}
