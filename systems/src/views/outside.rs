//! Gaussians that begin from outside: at places that something else than the density control has found.

use super::driver::{Views, refused};
use super::start::Start;
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::rng::Rng;
use glam::DVec3;
use render_core::camera::Camera;
use splat_core::Gaussians;

/// Stream of random numbers: which pixels.
const STREAM: u64 = 0x7265_6669_6c6c;
/// Opacity of those that are put in.
const OPACITY: f32 = 0.1;

/// Pixels of a photo, as a step sees it.
#[derive(Clone, Debug)]
pub(crate) struct PhotoPixels {
    /// Without a lens.
    pub(crate) camera: Camera,
    /// Row-major indices, and the photo's colour of each.
    pub(crate) pixels: Vec<(usize, [f32; 3])>,
}

/// A Gaussian to be: round, of one colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NewGaussian {
    /// The scene's frame.
    pub(crate) x: DVec3,
    /// Standard deviation, world units.
    pub(crate) size: f64,
    pub(crate) rgb: [f32; 3],
}

impl Views {
    /// About `count` pixels of all photos, at the size of the first step: as many of each, drawn evenly over it; those that do not count
    /// are left out.
    pub(crate) fn spread_pixels(&mut self, data: &Dataset, count: usize) -> Result<Vec<PhotoPixels>, SystemError> {
        let photos = data.len().max(1);
        let mut out = Vec::with_capacity(photos);
        for k in 0..data.len() {
            let share = (k + 1) * count / photos - k * count / photos;
            let shown = self.show_one(data, 0, |_| k)?;
            let n = shown.camera.width as usize * shown.camera.height as usize;
            let rng = Rng::new(self.parts.seed, STREAM).substream(k as u64);
            let at = |j: usize| ((j as f64 + f64::from(rng.uniform_at(j as u64))) / share as f64 * n as f64) as usize;
            let pixels = (0..share).map(|j| at(j).min(n - 1));
            out.push(self.of_target(shown.camera, pixels));
        }
        Ok(out)
    }

    /// At most `count` pixels of the last step's photo, drawn in proportion to their error; none where nothing was drawn of it.
    pub(crate) fn erring_pixels(&self, step: u64, count: usize) -> PhotoPixels {
        let camera = self.last_camera;
        let (x, y) = (self.pass.colour(), &self.target.colour[..]);
        let n = y.len() / 3;
        let drawn = if x.len() == y.len() { n } else { 0 };
        let weight = |i: usize| self.target.weights.get().map_or(1.0, |w| w[i]);
        let mut sum = 0.0;
        let sums: Vec<f64> = (0..drawn)
            .map(|i| {
                let error: f32 = (0..3).map(|c| (x[c * n + i] - y[c * n + i]).abs()).sum();
                sum += f64::from(weight(i) * if error.is_finite() { error } else { 0.0 });
                sum
            })
            .collect();
        let rng = Rng::new(self.parts.seed, STREAM).substream(u64::from(u32::MAX) + step);
        let at = |j: usize| (j as f64 + f64::from(rng.uniform_at(j as u64))) / count as f64 * sum;
        let mut pixels: Vec<usize> = (0..count).map(|j| sums.partition_point(|&s| s <= at(j))).collect();
        pixels.dedup();
        pixels.retain(|&i| i < drawn);
        self.of_target(camera, pixels.into_iter())
    }

    fn of_target(&self, camera: Camera, pixels: impl Iterator<Item = usize>) -> PhotoPixels {
        let n = self.target.colour.len() / 3;
        let counts = |i: &usize| self.target.weights.get().is_none_or(|w| w[*i] > 0.0);
        let colour = |i: usize| [0, 1, 2].map(|c| self.target.colour[c * n + i]);
        PhotoPixels { camera, pixels: pixels.filter(counts).map(|i| (i, colour(i))).collect() }
    }

    /// Begin the first cloud anew at places, each as large as its neighbours are far.
    pub(crate) fn begin_at(&mut self, places: &[(DVec3, [f32; 3])]) -> Result<(), SystemError> {
        let frame = self.parts.frame;
        let cloud = &mut self.parts.clouds[0];
        let room = places.len().min(cloud.training.cloud.max_splats);
        let start = Start::at_places(&places[..room], &frame, cloud.training.cloud.sh_degree).map_err(refused)?;
        cloud.begin(&start.cloud).map_err(refused)
    }

    /// This share of the Gaussians that come begins from outside.
    pub(crate) fn set_refill(&mut self, share: f64) {
        self.parts.clouds[0].refill = share;
    }

    /// Steps before which Gaussians are put in.
    pub(crate) fn refills_until(&self) -> u64 {
        self.parts.clouds[0].training.density.schedule.densify_until
    }

    /// How many Gaussians may be put into the first cloud after step `step`.
    pub(crate) fn refill(&self, step: u64) -> usize {
        self.parts.clouds[0].refill(step)
    }

    /// Put Gaussians into the first cloud.
    pub(crate) fn insert(&mut self, new: &[NewGaussian]) -> Result<(), SystemError> {
        let frame = self.parts.frame;
        let cloud = &mut self.parts.clouds[0];
        let n = new.len();
        let mut more = Gaussians::new(n, cloud.training.cloud.sh_degree).map_err(refused)?;
        more.logit.fill((OPACITY / (1.0 - OPACITY)).ln());
        for (k, one) in new.iter().enumerate() {
            let x = frame.to_internal(one.x);
            for axis in 0..3 {
                more.mean[axis * n + k] = x[axis] as f32;
                more.log_scale[axis * n + k] = (one.size / frame.scale).ln() as f32;
                more.dc[axis * n + k] = (one.rgb[axis] - 0.5) / splat_core::SH_0;
            }
        }
        cloud.insert(&more).map_err(refused)
    }
}
