//! Fog before a camera: opacity where the points say that nothing is.

use crate::data::View;
use crate::halt::Halt;
use crate::render::plain_query;
use crate::scene_points::nearest_point;
use crate::system::System;
use glam::DVec2;
use render_core::camera::Camera;
use render_core::ray::Ray;

/// Opacity nearer than this part of the nearest point's depth is fog.
const BEFORE: f64 = 0.9;
/// Pixels looked at along the longest side of a picture, and samples of a ray.
const PIXELS: u32 = 64;
const SAMPLES: usize = 192;
/// Points whose densities are asked for at a time.
const CHUNK: usize = 1 << 16;

/// Mean opacity nearer than nine tenths of the depth of the nearest point that a view shows (but for strays). `None` where it
/// shows too few.
#[must_use]
pub fn fog(system: &dyn System, view: &View, halt: &Halt) -> Option<f64> {
    let nearest = nearest_point(&view.camera, &view.points)?;
    before(system, &view.camera, view.time, BEFORE * nearest, halt)
}

/// Mean opacity, over the pixels of a picture, of all that lies nearer than `depth` along the axis of `camera`, world units.
///
/// Of a cloud: the picture of the Gaussians whose centres are nearer. Of a field: densities at 192 places of each ray,
/// from where the system begins to sample ([`System::first_sample`]) to `depth`, for some pixels spread evenly.
/// `None` for a picture without pixels.
#[must_use]
pub fn opacity_before(system: &dyn System, camera: &Camera, depth: f64, time: f64) -> Option<f64> {
    before(system, camera, time, depth, &Halt::NEVER)
}

fn before(system: &dyn System, camera: &Camera, time: f64, depth: f64, halt: &Halt) -> Option<f64> {
    match system.render_before(camera, depth, &plain_query([0.0; 3], 0.0)) {
        Some(opacity) => mean(&opacity),
        None => mean(&along_rays(system, camera, time, depth, halt)),
    }
}

fn mean(opacity: &[f32]) -> Option<f64> {
    (!opacity.is_empty()).then(|| opacity.iter().copied().map(f64::from).sum::<f64>() / opacity.len() as f64)
}

/// Opacity before `depth` of some rays, by their densities; of fewer once `halt` is raised.
fn along_rays(system: &dyn System, camera: &Camera, time: f64, depth: f64, halt: &Halt) -> Vec<f32> {
    let step = camera.width.max(camera.height).div_ceil(PIXELS).max(1);
    let axis = camera.optical_axis();
    let pixels = (step / 2..camera.height).step_by(step as usize);
    let pixels = pixels.flat_map(|y| (step / 2..camera.width).step_by(step as usize).map(move |x| (x, y)));
    let rays: Vec<(Ray, f64, f64)> = pixels
        .filter_map(|(x, y)| {
            let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))?;
            let (start, end) = (system.first_sample(&ray), depth / ray.d.dot(axis).max(1e-6));
            Some((ray, start, end.max(start)))
        })
        .collect();
    let mut out = Vec::with_capacity(rays.len());
    for rays in rays.chunks(CHUNK / SAMPLES) {
        if halt.raised() {
            break;
        }
        let points: Vec<[f64; 3]> = rays
            .iter()
            .enumerate()
            .flat_map(|(r, (ray, start, end))| {
                // Neighbouring rays look at different places of the same interval.
                let shift = (r as f64 * 0.618_033_988_749_894_9).fract();
                (0..SAMPLES).map(move |k| {
                    let t = start + (end - start) * (k as f64 + shift) / SAMPLES as f64;
                    (ray.o + ray.d * t).to_array()
                })
            })
            .collect();
        let mut densities = vec![0.0; points.len()];
        system.density(&points, time, &mut densities);
        for ((_, start, end), densities) in rays.iter().zip(densities.chunks_exact(SAMPLES)) {
            let dt = (end - start) / SAMPLES as f64;
            let depth: f64 = densities.iter().map(|&sigma| f64::from(sigma.max(0.0)) * dt).sum();
            out.push(-(-depth).exp_m1() as f32);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Dataset;
    use crate::system::{Layers, Query, SkipRow, StepStats, SystemError, Tensor, TensorMap};

    /// Density `sigma` for `z` in a range; nothing is sampled before `start`.
    struct Slab {
        z: [f64; 2],
        sigma: f32,
        start: f64,
    }

    impl System for Slab {
        fn name(&self) -> &'static str {
            "slab"
        }
        fn step(&mut self, _: &Dataset, _: u64) -> Result<StepStats, SystemError> {
            Ok(StepStats::default())
        }
        fn render(&self, rays: &[Ray], query: &Query) -> Layers {
            Layers::nothing(rays.len(), query)
        }
        fn density(&self, points: &[[f64; 3]], _: f64, out: &mut [f32]) {
            for (p, out) in points.iter().zip(out) {
                *out = if (self.z[0]..self.z[1]).contains(&p[2]) { self.sigma } else { 0.0 };
            }
        }
        fn first_sample(&self, _: &Ray) -> f64 {
            self.start
        }
        fn colour(&self, _: &[[f64; 3]], _: &[[f32; 3]], _: f64, out: &mut [[f32; 3]]) {
            out.fill([0.0; 3]);
        }
        fn bounds(&self) -> [[f64; 3]; 2] {
            [[-1.0; 3], [1.0; 3]]
        }
        fn state(&self) -> Vec<Tensor<'_>> {
            Vec::new()
        }
        fn load_state(&mut self, _: &TensorMap) -> Result<(), SystemError> {
            Ok(())
        }
        fn skips(&self) -> Vec<SkipRow> {
            Vec::new()
        }
        fn timings(&self) -> Vec<(&'static str, f64)> {
            Vec::new()
        }
        fn parameter_count(&self) -> usize {
            0
        }
        fn memory_bytes(&self) -> usize {
            0
        }
    }

    /// A camera at the origin that looks along z, of so narrow a view that all rays are nearly as long as the axis.
    fn camera() -> Camera {
        let pose = render_core::pose::Pose { r: glam::DMat3::IDENTITY, c: glam::DVec3::ZERO };
        Camera::pinhole(20, 10, 2000.0, 2000.0, 10.0, 5.0, pose)
    }

    #[test]
    fn fog_of_a_slab_is_its_optical_depth() {
        let slab = Slab { z: [0.5, 1.0], sigma: 0.8, start: 0.0 };
        let fog = |slab: &Slab, depth| opacity_before(slab, &camera(), depth, 0.0).unwrap();
        let want = |length: f64| 1.0 - (-0.8 * length).exp();
        // Sampled 192 times: a place more or less is 0.8 * 2 / 192.
        for (depth, length) in [(2.0, 0.5), (0.75, 0.25), (0.5, 0.0), (0.3, 0.0)] {
            assert!((fog(&slab, depth) - want(length)).abs() < 0.01, "{depth}");
        }
        // What lies before the first sample is never seen.
        assert!((fog(&Slab { start: 0.75, ..slab }, 2.0) - want(0.25)).abs() < 0.01);
        let slab = Slab { z: [0.5, 1.0], sigma: 0.8, start: 0.75 };
        assert!(fog(&slab, 0.7) == 0.0, "nothing is sampled before the depth");
        let wall = Slab { z: [0.1, 0.2], sigma: 1e6, start: 0.0 };
        assert!(fog(&wall, 1.0) > 0.999);
        let empty = Camera { width: 0, height: 0, ..camera() };
        assert_eq!(opacity_before(&wall, &empty, 1.0, 0.0), None);
    }
}
