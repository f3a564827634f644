//! How visible the scene is in each pixel, as a network says of the photo.
//!
//! ```text
//! V = up(sigmoid(U(I)))                                        a map of the photo made small, between its pixels
//! L = mean over pixels of (1 - d) r V + l (1 - V)^2            r: mean of the absolute errors of a pixel's channels; 1 - d = 0.8
//! ```
//!
//! Where a residual is always the same the best `V` is what [`super::visibility`] gives in closed form, `1 - r / 0.375` for `l = 0.15`. The
//! network must say it of the photo alone: what looks like the scene counts although it is not learnt yet, what looks like things that stay
//! far from their renders does not, and neighbours count alike.
//!
//! In the papers the map is that of a head of the network that encodes the reference photo. Here it has such a network of its own: half of
//! the steps encode less than the photo, and the head is there for any appearance, and for none.
//!
//! # Source
//! Zhang et al., "Gaussian in the Wild", 2024, section 3.4; Xu et al., "Wild-GS", 2024.

use super::error_histogram::Errors;
use super::visibility::{OF_RESIDUAL, SHOWS, VisibilitySettings};
use crate::buffers::shapes_hold;
use crate::cloud_appearance::rate_left;
use crate::cloud_reference::{MapMemory, MapNetwork, MapShape, Reference, SIDE, is_side};
use crate::fields::NetworkParameters;
use crate::views::{Beside, RenderJudge, SeenPhoto, first_of, unless};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::conv::{Extent, Size, resize, resize_backward};
use field_core::rng::Rng;
use float_core::Simd;
use float_core::m32::logistic;
use optim::AdamConfig;
use serde::{Deserialize, Serialize};

/// Stream of random numbers.
const STREAM: u64 = 0x7669_7369;
/// What the map says at the start: nearly all counts, and the sigmoid has a slope.
const AT_START: f32 = 0.9;
/// Largest derivative of a pixel's cost: any weight leaves numbers, and the optimiser's steps do not grow with them.
const STEEPEST: f32 = 1e3;
/// Name in checkpoints.
const NAME: &str = "masks.head";

/// Settings of [`VisibilityHead`], besides those of what is left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HeadSettings {
    /// Side of the square that a photo is made before the network says what it shows, pixels; its map is half as wide.
    pub(crate) head_side: usize,
    /// Learning rate of that network; a tenth is left at the end of the schedule.
    pub(crate) head_lr: f64,
}

impl HeadSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let rate = self.head_lr;
        first_of([
            unless(is_side(self.head_side), "head_side", self.head_side, SIDE),
            unless(rate > 0.0 && rate <= 0.1, "head_lr", rate, "must be above 0, and at most 0.1"),
        ])
    }
}

/// Has pixels count as a network says.
pub(crate) struct VisibilityHead {
    settings: VisibilitySettings,
    head: HeadSettings,
    /// Steps of the schedule.
    horizon: u64,
    network: MapNetwork,
    params: NetworkParameters,
    memory: MapMemory,
    /// Learning rate and gradient of the next step.
    held: Option<(f64, Vec<f32>)>,
}

/// A map of a photo, and as it is at the photo's pixels.
struct Seen {
    size: Size,
    map: Vec<f32>,
    visible: Vec<f32>,
}

impl VisibilityHead {
    /// For a schedule of `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot work.
    pub(crate) fn new(
        settings: VisibilitySettings,
        head: HeadSettings,
        horizon: u64,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let shape = MapShape { side: head.head_side, channels: 3, planes: 1, tones: false };
        let network = MapNetwork::new(shape, "head_side")?;
        let mut params = network.init(Rng::new(seed, STREAM));
        network.begin_at_zero(&mut params);
        if let Some(bias) = params.last_mut() {
            *bias = (AT_START / (1.0 - AT_START)).ln();
        }
        let params = NetworkParameters::new(NAME, params, AdamConfig::DEFAULT);
        Ok(Self { settings, head, horizon, network, params, memory: MapMemory::default(), held: None })
    }

    /// What the network says of a photo; `None` where there is no pixel.
    fn see(&self, beside: &Beside<'_>, memory: &mut MapMemory) -> Option<Seen> {
        let photo =
            SeenPhoto { size: beside.size, colour: beside.photo, weights: beside.before, view: None, depth: None };
        let small = Reference::of(&photo, self.head.head_side)?;
        let map = self.network.forward(&self.params.values, &small.pixels, memory);
        let map: Vec<f32> = map.iter().map(|x| logistic(*x)).collect();
        let side = self.head.head_side / 2;
        let size = Size::one(side, side);
        let visible = resized(&map, size, beside.size);
        Some(Seen { size, map, visible })
    }

    /// The gradient of the loss of what the network said, with respect to what it gave.
    fn map_bar(weight: f32, seen: &Seen, beside: &Beside<'_>) -> Vec<f32> {
        let residual = Errors::of(beside).values;
        let counts = |i: usize| beside.before.is_none_or(|before| before[i] > 0.0);
        let count = (0..residual.len()).filter(|i| counts(*i)).count().max(1) as f32;
        let bar = |(i, (r, v)): (usize, (&f32, &f32))| match counts(i) {
            true => (OF_RESIDUAL * r + 2.0 * weight * (v - 1.0)).clamp(-STEEPEST, STEEPEST) / count,
            false => 0.0,
        };
        let visible_bar: Vec<f32> = residual.iter().zip(&seen.visible).enumerate().map(bar).collect();
        let mut map_bar = vec![0.0; seen.map.len()];
        let to = Extent::new(beside.size[1], beside.size[0]);
        shapes_hold(resize_backward(&visible_bar, 1, seen.size, to, &mut map_bar));
        map_bar.iter_mut().zip(&seen.map).for_each(|(bar, v)| *bar *= v * (1.0 - v));
        map_bar
    }
}

/// A map at the pixels of a picture of `to` columns and rows.
fn resized(map: &[f32], size: Size, to: [usize; 2]) -> Vec<f32> {
    let mut out = vec![0.0; to[0] * to[1]];
    shapes_hold(resize(map, 1, size, Extent::new(to[1], to[0]), &mut out));
    out
}

impl RenderJudge for VisibilityHead {
    fn weights(&mut self, step: u64, beside: &Beside<'_>) -> Option<Vec<f32>> {
        self.held = None;
        let share = step as f64 / self.horizon.max(1) as f64;
        if share < self.settings.judge_from {
            return None;
        }
        let mut memory = std::mem::take(&mut self.memory);
        let seen = self.see(beside, &mut memory)?;
        let map_bar = Self::map_bar(self.settings.weight(share), &seen, beside);
        let gradient = self.network.backward(&self.params.values, &map_bar, &mut memory);
        self.held = Some((rate_left(share) * self.head.head_lr, gradient));
        self.memory = memory;
        Some(seen.visible)
    }

    fn static_pixels(&self, beside: &Beside<'_>) -> Vec<f32> {
        let seen = self.see(beside, &mut MapMemory::default());
        let visible = seen.map(|seen| seen.visible).unwrap_or_default();
        visible.into_iter().map(|v| if v > SHOWS { 1.0 } else { 0.0 }).collect()
    }

    fn learn(&mut self, simd: Simd) -> usize {
        let Some((rate, gradient)) = self.held.take() else { return 0 };
        self.params.step(simd, rate, &gradient)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        self.params.state()
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.params.load(state)?;
        self.held = None;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.params.values.len()
    }

    fn bytes(&self) -> usize {
        // What the network holds of a photo, and gradients of that; those of its parameters.
        4 * (2 * self.network.memory_len() + self.params.values.len())
    }
}

#[cfg(test)]
mod tests;
