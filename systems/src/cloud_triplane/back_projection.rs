//! Pixels of a photo as points of the clouds' frame:
//!
//! ```text
//! A X + a = z (u, v, 1)                the rows `A a` of a camera; u, v: the pixel's centre, 0 to 1 along each side; z: its depth
//! X = A^-1 (z (u, v, 1) - a)
//! ```

use crate::cloud_reference::{CAMERA, Reference};
use glam::{DMat3, DVec3};

/// A pixel that shows a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shown {
    /// Of the clouds' frame.
    pub(super) x: [f32; 3],
    /// `2 srgb - 1`
    pub(super) rgb: [f32; 3],
}

/// The pixels of a photo of `side` whose depth is known, row by row; none where the camera is not known.
pub(super) fn shown(reference: &Reference, side: usize) -> Vec<Shown> {
    let Some(camera) = Inverse::of(&reference.camera) else { return Vec::new() };
    let pixels = reference.depth.iter().enumerate().filter(|(_, z)| **z > 0.0 && z.is_finite());
    let shown = pixels.map(|(i, z)| Shown {
        x: camera.place([i % side, i / side].map(|k| (k as f64 + 0.5) / side as f64), f64::from(*z)),
        rgb: [0, 1, 2].map(|c| reference.pixels[c * side * side + i]),
    });
    shown.filter(|shown| shown.x.iter().all(|x| x.is_finite())).collect()
}

/// A camera, from photos to places.
struct Inverse {
    inverse: DMat3,
    shift: DVec3,
}

impl Inverse {
    /// `None` for one that is not known.
    fn of(camera: &[f32; CAMERA]) -> Option<Self> {
        let row = |k: usize| DVec3::new(camera[k].into(), camera[k + 1].into(), camera[k + 2].into());
        let rows = DMat3::from_cols(row(0), row(4), row(8)).transpose();
        let shift = DVec3::new(camera[3].into(), camera[7].into(), camera[11].into());
        let determinant = rows.determinant();
        (determinant != 0.0 && determinant.is_finite()).then(|| Self { inverse: rows.inverse(), shift })
    }

    /// The place at depth `z` behind a point of the photo.
    fn place(&self, [u, v]: [f64; 2], z: f64) -> [f32; 3] {
        (self.inverse * (z * DVec3::new(u, v, 1.0) - self.shift)).as_vec3().to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud_reference::camera_rows;
    use splat_core::View;

    fn view() -> View {
        let turned = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]];
        View { r: turned, t: [0.1, -0.2, 3.0], f: [21.0, 19.0], c: [7.0, 5.5], size: [16, 12] }
    }

    #[test]
    fn a_pixel_is_where_its_camera_sees_it() {
        const SIDE: usize = 16;
        let camera = camera_rows(&view());
        let row = |k: usize, x: [f32; 3]| (0..3).map(|i| camera[k + i] * x[i]).sum::<f32>() + camera[k + 3];
        let depth: Vec<f32> = (0..SIDE * SIDE).map(|i| 1.0 + 0.01 * i as f32).collect();
        let pixels: Vec<f32> = (0..3 * SIDE * SIDE).map(|i| i as f32).collect();
        let reference = Reference { pixels, depth: depth.clone(), camera };
        let points = shown(&reference, SIDE);
        assert_eq!(points.len(), SIDE * SIDE);
        for (i, point) in points.iter().enumerate() {
            let z = row(8, point.x);
            let [u, v] = [row(0, point.x) / z, row(4, point.x) / z].map(|x| x * SIDE as f32 - 0.5);
            assert!((z - depth[i]).abs() < 1e-5 * z, "{i}: {z}");
            assert!((u - (i % SIDE) as f32).abs() < 1e-3 && (v - (i / SIDE) as f32).abs() < 1e-3, "{i}: {u} {v}");
            assert_eq!(point.rgb, [0, 1, 2].map(|c| (c * SIDE * SIDE + i) as f32));
        }
    }

    #[test]
    fn what_is_not_known_is_nowhere() {
        let known = Reference { pixels: vec![0.0; 12], depth: vec![1.0; 4], camera: camera_rows(&view()) };
        assert_eq!(shown(&known, 2).len(), 4);
        let of = |depth: Vec<f32>| shown(&Reference { depth, ..known.clone() }, 2).len();
        assert_eq!([of(vec![0.0, -1.0, f32::NAN, f32::INFINITY]), of(Vec::new()), of(vec![f32::MAX; 4])], [0, 0, 4]);
        assert!(shown(&known.clone().without_place(), 2).is_empty());
        assert!(shown(&Reference { camera: [0.0; CAMERA], ..known }, 2).is_empty());
    }
}
