//! What the kernels work on: a cloud at its start, cameras of its scene, and their photos at any size.

use crate::bench::Bench;
use crate::error::BenchError;
use crate::sections::scene::{Subject, begin, job};
use engine::train::{Schedule, Stop};
use field_core::rng::Rng;
use render_core::camera::Camera;
use scene_io::Image;
use splat_core::{Gaussians, RasterSettings, View};
use std::sync::Arc;

/// Cameras that times are means over.
const CAMERAS: usize = 10;
/// Gaussians of the larger cloud at each of the smaller one.
const COPIES: usize = 9;
/// Stream of random numbers.
const JITTER: u64 = 0x6a69_7474;

/// A cloud and who looks at it.
pub(super) struct Ground {
    pub(super) cloud: Gaussians,
    pub(super) rules: RasterSettings,
    cameras: Vec<Camera>,
    photos: Vec<Arc<Image>>,
}

/// A camera and what it should see.
pub(super) struct Shot {
    pub(super) view: View,
    /// `[3][rows][columns]`
    pub(super) truth: Vec<f32>,
}

impl Ground {
    /// The cloud that a training of the subject would begin with, in the scene's frame.
    pub(super) fn new(bench: &Bench, subject: &Subject) -> Result<Self, BenchError> {
        let (run, _, _folder) = begin(job(bench, subject, Schedule::new(Stop::Steps(0))))?;
        let Some(splats) = run.system.splats(&run.query()) else {
            return Err(BenchError::Part(format!("`{}` is not a system of Gaussians", run.system.name())));
        };
        let n = run.train.len();
        let chosen: Vec<usize> = (0..n.min(CAMERAS)).map(|k| k * n / n.min(CAMERAS)).collect();
        let photos = chosen.iter().map(|&i| run.train.image(i)).collect::<Result<_, _>>().map_err(BenchError::part)?;
        let cameras = chosen.iter().map(|&i| run.train.view(i).camera).collect();
        Ok(Self { cloud: splats.gaussians, rules: splats.rules, cameras, photos })
    }

    /// The cameras with so many times the pixels along each axis; photos are enlarged pixel by pixel.
    pub(super) fn shots(&self, scale: u32) -> Vec<Shot> {
        let shot = |(camera, photo): (&Camera, &Arc<Image>)| {
            let camera = camera.resized(camera.width * scale, camera.height * scale);
            Shot { view: view(&camera), truth: enlarged(photo, scale) }
        };
        self.cameras.iter().zip(&self.photos).map(shot).collect()
    }

    /// Each Gaussian nine times, moved by its own size, with a ninth of its volume.
    pub(super) fn larger_cloud(&self) -> Result<Gaussians, BenchError> {
        let (small, n) = (&self.cloud, self.cloud.len());
        let mut large = Gaussians::new(COPIES * n, small.degree()).map_err(BenchError::part)?;
        for ((_, to), (_, from)) in large.fields_mut().into_iter().zip(small.fields()) {
            for (to, from) in to.chunks_exact_mut((COPIES * n).max(1)).zip(from.chunks_exact(n.max(1))) {
                to.chunks_exact_mut(n).for_each(|copy| copy.copy_from_slice(from));
            }
        }
        let shrunk = (COPIES as f32).ln() / 3.0;
        let rng = Rng::new(0, JITTER);
        for (i, x) in large.mean.iter_mut().enumerate() {
            // Sizes at the start are the same along all axes.
            *x += large.log_scale[i].exp() * rng.normal_at(i as u64);
        }
        large.log_scale.iter_mut().for_each(|s| *s -= shrunk);
        Ok(large)
    }
}

fn view(camera: &Camera) -> View {
    let r = camera.pose.r.transpose().to_cols_array_2d();
    let size = [camera.width as usize, camera.height as usize];
    View::from_c2w(r, camera.pose.c.to_array(), [camera.fx, camera.fy], [camera.cx, camera.cy], size)
}

/// Planes of a photo, over white.
fn enlarged(photo: &Image, scale: u32) -> Vec<f32> {
    let (w, h) = (photo.width * scale, photo.height * scale);
    let mut out = Vec::with_capacity(3 * w as usize * h as usize);
    for c in 0..3 {
        for y in 0..h {
            out.extend((0..w).map(|x| {
                let p = photo.pixel(x / scale, y / scale);
                let alpha = p.get(3).map_or(1.0, |&a| f32::from(a) / 255.0);
                f32::from(p[c]) / 255.0 * alpha + 1.0 - alpha
            }));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_are_enlarged_pixel_by_pixel() {
        let photo = Image::rgba(2, 1, vec![255, 0, 0, 255, 0, 0, 0, 0]).unwrap();
        let planes = enlarged(&photo, 2);
        assert_eq!(planes[..8], [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], "red, and white where nothing is");
        assert_eq!(planes[8..16], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0]);
    }

    #[test]
    fn the_larger_cloud_has_nine_smaller_gaussians_at_each() {
        let mut cloud = Gaussians::new(3, 1).unwrap();
        cloud.log_scale.fill(-3.0);
        cloud.dc[1] = 0.7;
        let ground = Ground { cloud, rules: RasterSettings::DEFAULT, cameras: Vec::new(), photos: Vec::new() };
        let large = ground.larger_cloud().unwrap();
        assert!(large.check().is_ok() && large.len() == 27);
        // Nine ninths of the volume.
        assert!(large.log_scale.iter().all(|s| ((3.0 * (s + 3.0)).exp() - 1.0 / 9.0).abs() < 1e-5));
        assert!(large.mean.iter().all(|x| x.abs() < 6.0 * (-3.0_f32).exp()));
        assert_eq!(large.dc.iter().filter(|&&x| x == 0.7).count(), 9);
    }
}
