//! Ha-NeRF, and its ablations Ha-NeRF(A) (appearance alone) and Ha-NeRF(T) (occluders alone).
//!
//! Chen, Zhang, Li, Chen, Feng, Wang, Wang, "Hallucinated Neural Radiance Fields in the Wild", 2022, section 3.
//!
//! The appearance of a photo is encoded by a network, so that a photo that was not trained on has one, too
//! (`encoder`). Now and then a lattice of a photo's pixels is rendered with the code of another photo, in
//! which the encoder should find that code again (view consistency; on the hash grid alone).
//!
//! Occluders are found in the plane of the photo: a network (`VisibilityMap`) predicts how far each pixel is left out, `m` in
//! 0 to 1, which has a price:
//!
//! ```text
//! L = (1 - m) |C - Y|^2 + 2 lambda m^2        at best  m = min(1, |C - Y|^2 / (4 lambda))
//! ```
//!
//! (squares are means over channels: twice the loss of [`losses::visibility`], so that a pixel which counts costs what it does
//! elsewhere). `lambda` falls over the first steps: while the scene is not there yet nothing fits it, and all would be left out.
//! On the hash grid what is not left out costs the scene a robust error (`kernel`), as the network needs its time to find
//! occluders; the network learns from the square.
//!
//! The published networks learn from one lattice of one photo in a step, as published. The hash grid learns from random pixels
//! of all photos and free codes, which the encoder learns to predict: docs/decisions/0015-ha-nerf-on-a-fast-field.md.

mod visibility_map;

use super::choice::FieldKind;
use super::nerf_w::{CHARBONNIER, CODES, HASH_GRID_CODES, SQUARED};
use super::planning::{Build, Planning};
use crate::appearance::AppearanceModel;
use crate::appearance::config::{CodeConfig, ConsistencyConfig, PhotoEncoderConfig};
use crate::appearance::encoder::Encoder;
use crate::claims::Claim;
use crate::limits::{MOST, above_0, within};
use crate::occluders::OccluderModel;
use crate::occluders::none::NoOccluders;
use crate::occluders::pixel_error::{KernelConfig, kernel_loss};
use crate::photo_model::{Outcome, PhotoAndRender, Pixel, PixelBar};
use engine::data::Batch;
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::conv::EncoderConfig;
use losses::kernel::Kernel;
use losses::visibility::SizeSchedule;
use serde::{Deserialize, Serialize};
use visibility_map::VisibilityMap;

/// `ha-nerf-a`: the encoder of appearance alone.
pub(crate) const HA_NERF_A: Claim = Claim {
    name: "ha-nerf-a",
    paper: "Chen et al., 2022",
    differs: "The field learns with free codes and the encoder, whose input has tones besides, learns to predict them; errors cost \
              Charbonnier 0.05, weights of view consistency are doubled, ngp's field. `--field mlp` learns through the \
              published encoder, without view consistency.",
    mark: "free codes, Charbonnier",
};

/// `ha-nerf-t`: the visibility map alone.
pub(crate) const HA_NERF_T: Claim = Claim {
    name: "ha-nerf-t",
    paper: "Chen et al., 2022",
    differs: "The scene's errors cost Charbonnier 0.05 instead of their square and the visibility network is 2 x 64, on ngp's \
              field. `--field mlp` has published networks and squares.",
    mark: "Charbonnier, small network",
};

/// `ha-nerf`: both.
pub(crate) const HA_NERF: Claim = Claim {
    name: "ha-nerf",
    paper: "Chen et al., 2022",
    differs: "The field learns with free codes and the encoder, whose input has tones besides, learns to predict them; errors cost \
              Charbonnier 0.05, weights of view consistency are doubled, the visibility network is 2 x 64, ngp's field. \
              `--field mlp`: published encoder, networks and squares, without view consistency.",
    mark: "free codes, Charbonnier",
};

/// Settings of the visibility map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisibilityConfig {
    /// Length of a photo's code.
    pub visibility_dims: usize,
    /// Octaves of a pixel's place.
    pub visibility_octaves: usize,
    /// Width of the network's hidden layers.
    pub visibility_width: usize,
    /// Number of the network's hidden layers.
    pub visibility_depth: usize,
    /// Learning rate of the network, relative to that of the field's networks.
    pub visibility_lr: f32,
    /// Learning rate of the codes, relative to that of the field's networks.
    pub visibility_code_lr: f32,
    /// `lambda`, the price of leaving pixels out. A pixel is left out entirely from the squared error of four times this on.
    pub mask_size: f32,
    /// That price in the first step.
    pub mask_size_start: f32,
    /// The step from which on the price is `mask_size`.
    pub mask_size_steps: u64,
}

impl VisibilityConfig {
    /// As published; the schedule of the price as released.
    pub const PUBLISHED: Self = Self {
        visibility_dims: 128,
        visibility_octaves: 10,
        visibility_width: 256,
        visibility_depth: 4,
        visibility_lr: 1.0,
        visibility_code_lr: 1.0,
        mask_size: 6e-3,
        mask_size_start: 5e-2,
        mask_size_steps: 2121,
    };

    /// On the hash grid (`docs/decisions/0015-ha-nerf-on-a-fast-field.md`).
    pub const HASH_GRID: Self = Self {
        visibility_dims: 32,
        visibility_width: 64,
        visibility_depth: 2,
        visibility_lr: 0.1,
        visibility_code_lr: 0.5,
        mask_size_steps: 500,
        ..Self::PUBLISHED
    };

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        above_0("visibility_lr", self.visibility_lr, MOST)?;
        above_0("visibility_code_lr", self.visibility_code_lr, MOST)?;
        above_0("mask_size", self.mask_size, MOST)?;
        above_0("mask_size_start", self.mask_size_start, MOST)?;
        within("visibility_dims", self.visibility_dims, 1..=512)?;
        within("visibility_octaves", self.visibility_octaves, 0..=16)?;
        within("visibility_width", self.visibility_width, 1..=1024)?;
        within("visibility_depth", self.visibility_depth, 1..=16)
    }

    /// `lambda` by step: exponential, then constant.
    fn schedule(&self) -> SizeSchedule {
        let (start, floor) = (f64::from(self.mask_size_start), f64::from(self.mask_size));
        // The exponential meets the constant at the last step of the fall.
        let rate = if start > floor { (start / floor).ln() / self.mask_size_steps.max(1) as f64 } else { 0.0 };
        SizeSchedule { start, rate, floor }
    }
}

/// The encoder on the hash grid: a prediction has an error in each number of a code, so there are few, held nearer to 0.
const HASH_GRID_ENCODED: CodeConfig = CodeConfig { appearance_dims: 6, code_size: 3e-2, ..HASH_GRID_CODES };

/// The encoder as published (section 3.1).
fn published() -> PhotoEncoderConfig {
    PhotoEncoderConfig {
        encoder_side: 128,
        encoder_channels: EncoderConfig::published().channels,
        encoder_lr: 1.0,
        encoder_tilts: vec![],
        lattices: 1,
        lattice: 32,
        encoder_photos: 12,
    }
}

/// The encoder on the hash grid (`docs/decisions/0015-ha-nerf-on-a-fast-field.md`).
fn hash_grid() -> PhotoEncoderConfig {
    PhotoEncoderConfig {
        encoder_side: 32,
        encoder_channels: EncoderConfig::small().channels,
        encoder_lr: 0.2,
        encoder_tilts: vec![-10.0, 0.0, 10.0],
        lattices: 0,
        ..published()
    }
}

/// No second renders: `mlp` does not have them.
const NO_CONSISTENCY: ConsistencyConfig = ConsistencyConfig { view_weight: 0.0, mode_weight: 0.0, view_every: 4 };

/// Twice the published weights, as half the squared error is not what pixels cost here.
const CONSISTENCY: ConsistencyConfig = ConsistencyConfig { view_weight: 2e-3, mode_weight: 2e-6, ..NO_CONSISTENCY };

/// A network that encodes each photo.
pub(super) fn appearance<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn AppearanceModel>, SystemError> {
    let codes: CodeConfig = planning.settings.of(&planning.by_field(HASH_GRID_ENCODED, CODES))?;
    codes.check()?;
    let encoder: PhotoEncoderConfig = planning.settings.of(&planning.by_field(hash_grid(), published()))?;
    encoder.check()?;
    let consistency: ConsistencyConfig = planning.settings.of(&planning.by_field(CONSISTENCY, NO_CONSISTENCY))?;
    consistency.check()?;
    if planning.choice.field == FieldKind::Mlp {
        consistency.check_without_second_render()?;
    }
    let (data, seed) = (planning.data, planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(Encoder::new(&codes, &encoder, &consistency, data, seed)?))))
}

/// Appearance alone: errors are squared, or robust on the hash grid.
pub(super) fn no_occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let settings: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    settings.check()?;
    let kernel = settings.kernel();
    Ok(Box::new(move || Ok(Box::new(NoOccluders { kernel, coarse: kernel }))))
}

/// The visibility map.
pub(super) fn occluders<'a>(planning: &mut Planning<'a>) -> Result<Build<'a, dyn OccluderModel>, SystemError> {
    let planned = planning.by_field(VisibilityConfig::HASH_GRID, VisibilityConfig::PUBLISHED);
    let settings: VisibilityConfig = planning.settings.of(&planned)?;
    settings.check()?;
    let error: KernelConfig = planning.settings.of(&planning.by_field(CHARBONNIER, SQUARED))?;
    error.check()?;
    let (views, seed) = (planning.data.len(), planning.run.seed);
    Ok(Box::new(move || Ok(Box::new(Visibility::new(&settings, error.kernel(), views, seed)?))))
}

/// The map, and the loss with it.
struct Visibility {
    map: VisibilityMap,
    /// The price of leaving pixels out, and that of this step.
    schedule: SizeSchedule,
    lambda: f32,
    /// Of the scene's errors.
    kernel: Kernel,
    /// `[pixels of the batch]`
    m: Vec<f32>,
}

impl Visibility {
    fn new(settings: &VisibilityConfig, kernel: Kernel, views: usize, seed: u64) -> Result<Self, SystemError> {
        Ok(Self {
            map: VisibilityMap::new(settings, views, seed)?,
            schedule: settings.schedule(),
            lambda: settings.mask_size_start,
            kernel,
            m: Vec::new(),
        })
    }

    /// `1 - m` and `2 lambda m^2` of pixel `i` of the batch.
    fn weight_and_size(&self, i: usize) -> (f32, f32) {
        let m = self.m[i];
        (1.0 - m, 2.0 * self.lambda * m * m)
    }
}

/// The derivative of `(1 - m) e2 + 2 lambda m^2` with respect to `m`.
fn map_bar(m: f32, e2: f32, lambda: f32) -> f32 {
    4.0 * lambda * m - e2
}

impl OccluderModel for Visibility {
    fn begin(&mut self, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        self.lambda = self.schedule.at(step) as f32;
        self.map.forward(batch, &mut self.m);
        Ok(())
    }

    /// `(1 - m) |C - Y|^2 + 2 lambda m^2`, the square for the scene as `kernel` has it.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let (weight, size) = self.weight_and_size(i);
        let (loss, bar) = kernel_loss(self.kernel, pixel.rgb, truth, weight);
        (loss + size, bar)
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (weight, _) = self.weight_and_size(i);
        let (loss, bar) = kernel_loss(self.kernel, rgb, truth, weight);
        (loss, bar.rgb)
    }

    /// The network learns from the square.
    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let m = std::mem::take(&mut self.m);
        let lambda = self.lambda;
        let bad = self.map.learn(outcome, &m, |i| {
            let e2 = (0..3).map(|c| (outcome.pixels[i].rgb[c] - outcome.truth[i][c]).powi(2)).sum::<f32>() / 3.0;
            outcome.share * outcome.batch.weight[i] * map_bar(m[i], e2, lambda)
        });
        self.m = m;
        bad
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let mut out = self.map.of_view(seen);
        out.iter_mut().for_each(|m| *m = if *m < 0.5 { 1.0 } else { 0.0 });
        Some(out)
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.map.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.map.load_state(state)
    }

    fn parameter_count(&self) -> usize {
        self.map.parameter_count()
    }

    fn memory_bytes(&self) -> usize {
        self.map.memory_bytes() + 4 * self.m.capacity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use float_core::Simd;
    use glam::DVec3;
    use losses::visibility::{best_map, masked, masked_backward, size, size_backward};
    use render_core::ray::Ray;

    fn visibility(settings: &VisibilityConfig) -> Visibility {
        Visibility::new(settings, CHARBONNIER.kernel(), 2, 5).unwrap()
    }

    /// Pixels of views 0, 1, 0, 1 …, all over their photos.
    fn batch(n: usize, rgb: f32) -> Batch {
        let rays = vec![Ray { o: DVec3::ONE * f64::from(rgb), d: DVec3::Z }; n];
        let mut batch = Batch::of_rays(&rays, &vec![[rgb; 3]; n]);
        for i in 0..n {
            batch.view[i] = i as u32 % 2;
            batch.place[i] = [(i / 2 % 8) as f32 / 8.0 + 0.0625, (i / 16 % 8) as f32 / 8.0 + 0.0625];
        }
        batch
    }

    fn outcome<'a>(batch: &'a Batch, pixels: &'a [Pixel], truth: &'a [[f32; 3]]) -> Outcome<'a> {
        Outcome {
            step: 0,
            lr: 1e-2,
            simd: Simd::best(),
            batch,
            share: 1.0 / batch.len() as f32,
            pixels,
            truth,
            appearance_bar: &[],
            transient_bar: &[],
        }
    }

    #[test]
    fn the_map_depends_on_photo_and_place_alone() {
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        visibility.begin(&mut batch(128, 0.2), 0).unwrap();
        let first = visibility.m.clone();
        // Other rays, other colours, another step, another order.
        let mut other = batch(128, 0.9);
        other.view.reverse();
        other.place.reverse();
        visibility.begin(&mut other, 700).unwrap();
        assert!(visibility.m.iter().rev().eq(&first));
        assert!(first[0] != first[1] && first[0] != first[2], "neither photo nor place matter");
        // The same as a picture.
        let seen = PhotoAndRender { view: 1, size: [8, 8], stride: 1, pixels: &[], truth: &[], alpha: &[], place: &[] };
        for (i, m) in visibility.map.of_view(&seen).into_iter().enumerate() {
            assert!((m - first[2 * i + 1]).abs() < 1e-6, "pixel {i}: {m} {}", first[2 * i + 1]);
        }
    }

    #[test]
    fn descent_meets_the_closed_form() {
        let mask_size = VisibilityConfig::HASH_GRID.mask_size;
        let lambda = f64::from(mask_size);
        let mut visibility =
            visibility(&VisibilityConfig { mask_size_start: mask_size, ..VisibilityConfig::HASH_GRID });
        let mut batch = batch(128, 0.0);
        // Photo 0 fits on the left half and half-way on the right; photo 1 does not fit on the right.
        let squares: Vec<f32> = (0..128)
            .map(|i| match (batch.view[i], batch.place[i][0] < 0.5) {
                (_, true) => 0.0,
                (0, false) => 2.0 * mask_size,
                _ => 40.0 * mask_size,
            })
            .collect();
        let pixels: Vec<Pixel> = squares.iter().map(|e2| Pixel { rgb: [e2.sqrt(); 3], ..Pixel::default() }).collect();
        for step in 0..1500 {
            visibility.begin(&mut batch, step).unwrap();
            assert_eq!(visibility.learn(&outcome(&batch, &pixels, &batch.rgb)), 0);
        }
        visibility.begin(&mut batch, 1500).unwrap();
        for (i, (&m, &e2)) in visibility.m.iter().zip(&squares).enumerate() {
            let best = best_map(f64::from(e2), lambda) as f32;
            assert!((m - best).abs() < 0.1, "pixel {i}: {m}, best {best}");
        }
    }

    #[test]
    fn the_loss_of_a_pixel_is_twice_the_released_one() {
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        visibility.begin(&mut batch(64, 0.0), 100).unwrap();
        let (lambda, m) = (f64::from(visibility.lambda), visibility.m.clone());
        assert!((lambda - 0.05 * (0.12_f64).powf(0.2)).abs() < 1e-6, "{lambda}");
        let e2: Vec<f32> = (0..64).map(|i| 0.001 * i as f32).collect();
        let loss = |i: usize, e2: f32| {
            let (weight, size) = visibility.weight_and_size(i);
            weight * e2 + size
        };
        let sum: f32 = e2.iter().enumerate().map(|(i, &e2)| loss(i, e2)).sum();
        let released = masked(&m, &e2).unwrap() + lambda * size(&m);
        assert!((f64::from(sum) / 64.0 - 2.0 * released).abs() < 1e-6);
        // And its derivative, which the photos' codes and the network learn from.
        let (mut m_bar, mut e2_bar) = (vec![0.0; 64], vec![0.0; 64]);
        masked_backward(&m, &e2, 2.0, Some(&mut m_bar), &mut e2_bar).unwrap();
        size_backward(&m, 2.0 * lambda, &mut m_bar).unwrap();
        for i in 0..64 {
            let own = map_bar(m[i], e2[i], visibility.lambda) / 64.0;
            assert!((own - m_bar[i]).abs() < 1e-7);
            assert!((e2_bar[i] - visibility.weight_and_size(i).0 / 64.0).abs() < 1e-7);
        }
    }

    #[test]
    fn pixels_that_do_not_count_teach_nothing() {
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        let mut batch = batch(64, 0.0);
        batch.weight.fill(0.0);
        visibility.begin(&mut batch, 0).unwrap();
        let before = visibility.map.network.params.clone();
        let pixels = vec![Pixel { rgb: [1.0; 3], ..Pixel::default() }; 64];
        visibility.learn(&outcome(&batch, &pixels, &batch.rgb));
        assert_eq!(visibility.map.network.params, before);
    }
}
