//! Gaussians that begin from outside: at places that something else than the density control has found.

use super::config::CloudConfig;
use super::driver::Views;
use super::refusal::refused;
use super::sky::{SkyPlace, SkySphere};
use super::start::{NewGaussian, Place, Start, round};
use crate::static_maps::StaticMaps;
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::rng::Rng;
use glam::DVec3;
use render_core::camera::Camera;

/// Stream of random numbers: which pixels.
const STREAM: u64 = 0x7265_6669_6c6c;

/// Pixels of a photo, as a step sees it.
#[derive(Clone, Debug)]
pub(crate) struct PhotoPixels {
    /// Without a lens.
    pub(crate) camera: Camera,
    /// Row-major indices, and the photo's colour of each.
    pub(crate) pixels: Vec<(usize, [f32; 3])>,
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
        let camera = self.target.camera;
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
        let mut erring = self.of_target(camera, pixels.into_iter());
        if let Some(plain) = self.pass.plain().filter(|plain| plain.len() == x.len()) {
            // A Gaussian begins in the colour that its tone makes that of the photo, about.
            for (i, rgb) in &mut erring.pixels {
                *rgb = [0, 1, 2].map(|c| (rgb[c] + plain[c * n + *i] - x[c * n + *i]).clamp(0.0, 1.0));
            }
        }
        erring
    }

    fn of_target(&self, camera: Camera, pixels: impl Iterator<Item = usize>) -> PhotoPixels {
        let n = self.target.colour.len() / 3;
        let counts = |i: &usize| self.target.weights.get().is_none_or(|w| w[*i] > 0.0);
        let colour = |i: usize| [0, 1, 2].map(|c| self.target.colour[c * n + i]);
        PhotoPixels { camera, pixels: pixels.filter(counts).map(|i| (i, colour(i))).collect() }
    }

    /// Masks of all photos that were found before the cloud begins.
    pub(crate) fn begin_with_masks(&mut self, maps: &StaticMaps) {
        if let Some(surveys) = &mut self.parts.surveys {
            surveys.begin_with(maps);
        }
    }

    /// Begin the first cloud anew at places, each as large as its neighbours are far.
    pub(crate) fn begin_at(&mut self, places: &[Place]) -> Result<(), SystemError> {
        let frame = self.parts.frame;
        let cloud = &mut self.parts.clouds[0];
        let room = places.len().min(cloud.training.cloud.max_splats);
        let start = Start::at_places(&places[..room], &frame, cloud.training.cloud.sh_degree).map_err(refused)?;
        cloud.begin(&start.cloud).map_err(refused)?;
        self.smooth_anew()
    }

    /// Whether Gaussians of the first cloud begin from outside after the next step, or later.
    pub(crate) fn takes_more(&self) -> bool {
        let density = &self.parts.clouds[0].training.density;
        density.refill() > 0.0 && self.position.of(self.steps) < density.schedule.densify_until
    }

    /// How many Gaussians of the first cloud begin from outside after step `step`.
    pub(crate) fn count_from_outside(&self, step: u64) -> usize {
        let cloud = &self.parts.clouds[0];
        cloud.count_from_outside(self.position.steps_done(step, cloud.training.density.schedule.densify_every))
    }

    /// Put Gaussians into the first cloud, at places, with a standard deviation of `pixels` pixels there.
    pub(crate) fn insert(&mut self, places: &[Place], pixels: f64) -> Result<(), SystemError> {
        let frame = self.parts.frame;
        let new: Vec<NewGaussian> = places
            .iter()
            .map(|place| NewGaussian {
                x: frame.to_internal(place.x).to_array(),
                size: pixels * place.pixel / frame.scale,
                rgb: place.rgb,
            })
            .collect();
        let cloud = &mut self.parts.clouds[0];
        let more = round(&new, cloud.training.cloud.sh_degree).map_err(refused)?;
        cloud.insert(&more).map_err(refused)?;
        self.smooth_anew()
    }

    /// A sphere for Gaussians of the sky around places of the first cloud.
    pub(crate) fn sky_around(&self, places: &[DVec3], data: &Dataset, count: usize) -> SkySphere {
        SkySphere::around(places, &self.parts.frame, data, count)
    }

    /// Put Gaussians of the sky into the first cloud, as many as there is room for.
    pub(crate) fn add_sky(&mut self, sphere: &SkySphere, places: &[SkyPlace]) -> Result<(), SystemError> {
        let frame = self.parts.frame;
        let cloud = &mut self.parts.clouds[0];
        let CloudConfig { sh_degree, max_splats, .. } = cloud.training.cloud;
        let room = max_splats.saturating_sub(cloud.parameters.len());
        let more = sphere.gaussians(places, &frame, sh_degree, room).map_err(refused)?;
        if more.is_empty() {
            return Ok(());
        }
        cloud.insert(&more).map_err(refused)?;
        self.smooth_anew()
    }

    /// Other Gaussians of the first cloud have other filters.
    fn smooth_anew(&mut self) -> Result<(), SystemError> {
        let cloud = &self.parts.clouds[0].parameters.gaussians;
        self.smoothing.as_mut().map_or(Ok(()), |smoothing| smoothing.measure(0, cloud).map_err(refused))
    }
}
