//! Depth as a stereo matcher would find it: in steps, noisy, wrong in places, missing in others.

use super::snapshot::{TissueHit, TissueSnapshot, flip};
use crate::DepthMap;
use crate::random::random;
use glam::{DVec2, DVec3};
use render_core::camera::Camera;
use render_core::ray::Ray;
use std::f64::consts::TAU;

/// A second camera to the right of the first, and what the matcher makes of the two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stereo {
    /// Distance between the cameras, mm.
    pub baseline: f64,
    /// Disparities are whole multiples of this, pixels; 0: of nothing.
    pub step: f64,
    /// Standard deviation of the disparity's error, pixels.
    pub noise: f64,
    /// Share of the pixels whose depth is that of something else, anywhere between the nearest and the farthest tissue.
    pub outliers: f64,
    /// Share of the pixels without depth, besides those that the second camera does not see.
    pub holes: f64,
    /// Whether what the second camera does not see is missing, as it is in truth.
    pub occlusion: StereoOcclusion,
}

/// What the matcher says about pixels that the second camera does not see.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StereoOcclusion {
    /// Nothing: there is no depth.
    Holes,
    /// The truth, which no real matcher knows.
    Known,
}

impl Default for Stereo {
    /// 5 mm apart; disparities in sixteenths of a pixel with errors of 0.05; 20 % outliers, 3 % holes.
    fn default() -> Self {
        Self {
            baseline: 5.0,
            step: 1.0 / 16.0,
            noise: 0.05,
            outliers: 0.2,
            holes: 0.03,
            occlusion: StereoOcclusion::Holes,
        }
    }
}

impl Stereo {
    /// Exact depth everywhere.
    pub const EXACT: Self =
        Self { baseline: 5.0, step: 0.0, noise: 0.0, outliers: 0.0, holes: 0.0, occlusion: StereoOcclusion::Known };

    /// Disparity, pixels, that a depth in mm comes out as: noise, then steps.
    fn matched(&self, disparity: f64, normal: f64) -> f64 {
        let noisy = disparity + self.noise * normal;
        if self.step > 0.0 { (noisy / self.step).round() * self.step } else { noisy }
    }
}

/// Side of the blobs that outliers and holes come in, pixels.
const BLOB: u32 = 3;

impl TissueSnapshot {
    /// What a matcher makes of frame `number` of a seed: z depth of what is seen (tool included), mm; 0 = missing.
    ///
    /// # Panics
    /// If the camera does not stand at the origin looking along -z, or its lens has no ray for a pixel.
    #[must_use]
    pub fn stereo(&self, camera: &Camera, stereo: &Stereo, seed: u64, number: usize) -> DepthMap {
        let prepared = camera.prepare();
        let (w, h) = (camera.width, camera.height);
        let places = (0..h).flat_map(|row| (0..w).map(move |column| (f64::from(column), f64::from(row))));
        let rays = places.filter_map(|(column, row)| prepared.ray(DVec2::new(column + 0.5, row + 0.5)));
        let hits: Vec<TissueHit> = rays.map(|ray| self.trace(&ray)).collect();
        self.match_hits(&hits, camera, stereo, seed, number)
    }

    /// [`TissueSnapshot::stereo`] of what is seen at the pixel centres.
    pub(super) fn match_hits(
        &self,
        hits: &[TissueHit],
        camera: &Camera,
        stereo: &Stereo,
        seed: u64,
        number: usize,
    ) -> DepthMap {
        let (w, h) = (camera.width, camera.height);
        let range = super::sheet::RANGE;
        let focal = camera.fx * stereo.baseline;
        let draw = |k: u64| random(seed ^ 0x5eed, 80_000 + (number as u64) * 0x0100_0000 + k);
        // Blobs are numbered before pixels; each has an offset of its own, so that they lie on no grid.
        let blob = |column: u32, row: u32, stream: u32| {
            let (across, shift) = (w / BLOB + 2, u64::from(stream));
            let (dx, dy) = ((draw(2 * shift) * f64::from(BLOB)) as u32, (draw(2 * shift + 1) * f64::from(BLOB)) as u32);
            let at = (row + dy) / BLOB * across + (column + dx) / BLOB;
            16 + 4 * u64::from(at) + shift
        };
        let pixels = 16 + 4 * u64::from((w / BLOB + 2) * (h / BLOB + 2));
        let z = |i: u32| -> f32 {
            let (column, row) = (i % w, i / w);
            let x = flip(hits[i as usize].x);
            let disparity = focal / x.z;
            let hidden = stereo.occlusion == StereoOcclusion::Holes
                && (f64::from(column) + 0.5 < disparity || self.hidden_from(x, stereo.baseline));
            if hidden || draw(blob(column, row, 0)) < stereo.holes {
                return 0.0;
            }
            if draw(blob(column, row, 1)) < stereo.outliers {
                let (near, far) = (focal / range[0], focal / range[1]);
                let wrong = far + (near - far) * draw(blob(column, row, 2));
                return (focal / stereo.matched(wrong, 0.0).max(1e-3)) as f32;
            }
            // Box and Muller; 1 - u is never 0.
            let (u, v) = (draw(pixels + 2 * u64::from(i)), draw(pixels + 2 * u64::from(i) + 1));
            let normal = (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos();
            if stereo.noise == 0.0 && stereo.step == 0.0 {
                return x.z as f32;
            }
            (focal / stereo.matched(disparity, normal).max(1e-3)) as f32
        };
        DepthMap { width: w, height: h, z: (0..w * h).map(z).collect() }
    }

    /// Does the tool stand between a point, in the camera's axes, and a second camera to the right?
    fn hidden_from(&self, x: DVec3, baseline: f64) -> bool {
        let eye = DVec3::X * baseline;
        let away = x - eye;
        self.tool.hit(&Ray { o: eye, d: away.normalize() }).is_some_and(|(t, _)| t < away.length() - 1e-6)
    }
}
