//! The features of photos as training sees them, and as the photos are.

use crate::views::source;
use engine::data::Dataset;
use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::Camera;
use scene_io::Features;
use std::sync::Arc;

/// Features of each photo.
pub(crate) struct PhotoFeatures {
    photos: Vec<Arc<Features>>,
    /// Of each photo whose lens bends light, on the plane of its camera without a lens.
    flat: Vec<Option<Features>>,
    /// Of the largest photo.
    pixels: usize,
}

impl PhotoFeatures {
    /// Features `[views]`, one at least, all with vectors of one length.
    pub(crate) fn new(photos: Vec<Arc<Features>>, data: &Dataset) -> Self {
        let flat = photos
            .par_iter()
            .zip(data.views())
            .map(|(features, view)| (!view.camera.lens.is_pinhole()).then(|| on_plane(features, &view.camera)))
            .collect();
        let pixels = data.views().iter().map(|view| view.camera.width as usize * view.camera.height as usize).max();
        Self { photos, flat, pixels: pixels.unwrap_or(0) }
    }

    #[cfg(test)]
    pub(super) fn of_pinholes(photos: Vec<Arc<Features>>) -> Self {
        Self { flat: vec![None; photos.len()], photos, pixels: 0 }
    }

    /// Length of a vector.
    pub(super) fn channels(&self) -> usize {
        self.photos.first().map_or(0, |features| features.channels)
    }

    pub(super) fn of_photo(&self, view: usize) -> Option<&Features> {
        self.photos.get(view).map(|features| &**features)
    }

    /// As training sees the photo.
    pub(super) fn of_step(&self, view: usize) -> Option<&Features> {
        self.flat.get(view).and_then(Option::as_ref).or_else(|| self.of_photo(view))
    }

    /// Pixels of the largest photo.
    pub(super) fn pixels(&self) -> usize {
        self.pixels
    }

    pub(super) fn bytes(&self) -> usize {
        let flat = self.flat.iter().flatten();
        let all = self.photos.iter().map(|features| &**features).chain(flat);
        all.map(|features| size_of_val(&features.data[..])).sum()
    }
}

/// Features on the plane of a camera without a lens: of its cells' centres; 0 where the photo shows nothing.
fn on_plane(features: &Features, camera: &Camera) -> Features {
    let seen = camera.prepare();
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let cells = features.width * features.height;
    let mut out = Features { data: vec![0.0; features.data.len()], ..*features };
    let mut vector = vec![0.0; features.channels];
    for cell in 0..cells {
        let at = DVec2::new((cell % features.width) as f64 + 0.5, (cell / features.width) as f64 + 0.5);
        let at = at / DVec2::new(features.width as f64, features.height as f64);
        let Some(at) = source(&seen, camera, at * size) else { continue };
        features.sample(at.x / size.x, at.y / size.y, &mut vector);
        vector.iter().enumerate().for_each(|(c, x)| out.data[c * cells + cell] = *x);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::camera::{Lens, Pose};

    #[test]
    fn features_on_a_plane_are_those_of_the_photo_where_it_shows_the_same() {
        // The first channel is the column, the second the row, from the middle.
        let of = |x: usize, y: usize| [x as f32 - 4.0, y as f32 - 2.5];
        let data = (0..2).flat_map(|c| (0..54).map(move |i| of(i % 9, i / 9)[c])).collect();
        let features = Features { channels: 2, width: 9, height: 6, data };
        let pinhole = Camera::pinhole(90, 60, 80.0, 80.0, 45.0, 30.0, Pose::IDENTITY);
        let flat = on_plane(&features, &pinhole);
        assert!(flat.data.iter().zip(&features.data).all(|(a, b)| (a - b).abs() < 1e-5));
        let bent = Camera { lens: Lens::opencv5([-0.2, 0.0, 0.0, 0.0, 0.0]), ..pinhole };
        let flat = on_plane(&features, &bent);
        let (middle, edge) = (2 * 9 + 4, 2 * 9 + 8);
        assert!((flat.data[middle] - features.data[middle]).abs() < 1e-3);
        // A lens like a barrel draws what is at the edge of the plane further in.
        assert!(flat.data[edge] < features.data[edge] - 0.05, "{}", flat.data[edge]);
    }
}
