//! What a picture of two clouds costs, in two parts: the first says where Gaussians are needed, the second only how they are.
//!
//! ```text
//! main    = |C - I| + w_e sum_(e in f, b) 1[P_e > 0.51] (|C_e - I| + 0.1 (1 - SSIM(C_e, I)))
//!           + w_v mean 1[P_f > 0.51] r(C_f, C_b) + w_d mean 1[P_f > 0.6] max(D_f - D_b, 0) + w_s V(D_b, I)
//! utility = w_u (1 - SSIM(C, I)) + masks ([`super::mask_costs`])
//! ```
//!
//! Before that, where a first stage is asked for: [`super::first_stage`].
//!
//! Apart (`front_apart`), `|C - I|` and `1 - SSIM(C, I)` are not there: each cloud costs `1[P_e > 0.51] |C_e - I|`, the one behind its
//! structure there, and the share has the gradient of `(1 - P_f) |C_b - I|`.
//!
//! `r` is the likeness of structure ([`losses::structure`]), `D` are depths, `V` their variation ([`losses::edge_variation`]). Before the cloud in front begins, the one
//! behind learns alone. Indicators and the depth behind in the separation have no gradient.
//!
//! # Source
//! Wang et al., "DeGauss", 2025, equations 3 to 8, supplement and released code; what differs: `docs/decisions/0066-degauss.md`.

use super::compare::{Comparison, Counted, Which};
use super::seen::{CostBars, PartBars, Seen};
use super::settings::LayerSettings;
use super::{first_stage, mask_costs};
use crate::views::{RenderedPicture, TargetPicture};
use float_core::Simd;
use losses::LossError;
use losses::edge_variation::{DepthAndPhoto, edge_variation_backward};
use losses::structure::{Pictures, structure_backward};

/// Above this share of a cloud its depth is compared.
const CERTAIN: f32 = 0.6;
/// Share of structure in what each cloud alone costs, beside the absolute difference.
const STRUCTURE_OF_EACH: f32 = 0.1;
/// Below this opacity a cloud has no depth.
const OPAQUE: f32 = 0.5;

/// Costs, with their buffers.
pub(super) struct Costs {
    settings: LayerSettings,
    comparison: Comparison,
    pub(super) main: CostBars,
    pub(super) utility: CostBars,
}

impl Costs {
    pub(super) fn new(simd: Simd, settings: LayerSettings) -> Self {
        Self { settings, comparison: Comparison::new(simd), main: CostBars::default(), utility: CostBars::default() }
    }

    /// The cost at a share of the schedule; its gradients are in [`main`](Self::main) and [`utility`](Self::utility).
    pub(super) fn add(&mut self, seen: &Seen<'_>, target: &TargetPicture<'_>, at: f64) -> Result<f64, LossError> {
        let size = seen.behind.size;
        let pixels = size[0] * size[1];
        let [mut main, mut utility] = [std::mem::take(&mut self.main), std::mem::take(&mut self.utility)];
        main.begin(pixels);
        utility.begin(pixels);
        let mut sum = 0.0;
        match &seen.front {
            Some(_) if at < self.settings.front_first_stage => {
                let bars = PartBars { main: &mut main, utility: &mut utility };
                sum += first_stage::add(&mut self.comparison, seen, target, bars)?;
            }
            Some(front) => {
                let bars = PartBars { main: &mut main, utility: &mut utility };
                sum += self.of_both(seen, front, target, at, bars)?;
            }
            None => {
                let structure = self.settings.front_structure as f32;
                let all = Counted::All;
                sum += self.comparison.add(Which::Behind, seen, target, all, [1.0, 0.0], &mut main)?;
                sum += self.comparison.add(Which::Behind, seen, target, all, [0.0, structure], &mut utility)?;
            }
        }
        if let Some(depth) = seen.behind.depth.filter(|_| self.settings.front_smoothness > 0.0) {
            let of = DepthAndPhoto { size, depth, photo: target.colour };
            let weight = self.settings.front_smoothness;
            sum += weight * edge_variation_backward(&of, weight, &mut main.behind_depth)?;
        }
        (self.main, self.utility) = (main, utility);
        Ok(sum)
    }

    /// What both clouds cost, after the first stage.
    fn of_both(
        &mut self,
        seen: &Seen<'_>,
        front: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        at: f64,
        bars: PartBars<'_>,
    ) -> Result<f64, LossError> {
        let PartBars { main, utility } = bars;
        let LayerSettings { front_structure, front_each, .. } = self.settings;
        let structure = front_structure as f32;
        let mut sum = 0.0;
        if self.settings.front_apart {
            sum += self.apart(seen, target, main)?;
            sum += self.comparison.add(Which::Behind, seen, target, Counted::Likely, [0.0, structure], utility)?;
        } else {
            sum += self.comparison.add(Which::Both, seen, target, Counted::All, [1.0, 0.0], main)?;
            sum += self.comparison.add(Which::Both, seen, target, Counted::All, [0.0, structure], utility)?;
        }
        let own = [front_each as f32, STRUCTURE_OF_EACH * front_each as f32];
        sum += self.comparison.add(Which::Front, seen, target, Counted::Likely, own, main)?;
        sum += self.comparison.add(Which::Behind, seen, target, Counted::Likely, own, main)?;
        sum += self.divergence(seen, target, main)?;
        sum += self.separation(seen, front, target, main);
        Ok(sum + mask_costs::add(&self.settings, seen, target, at, utility))
    }

    /// `sum_e mean 1[P_e > 0.51] |C_e - I|`: each cloud learns what it has. The share has the gradient of `(1 - P_f) |C_b - I|`: the
    /// front has what the cloud behind is far from.
    fn apart(&mut self, seen: &Seen<'_>, target: &TargetPicture<'_>, bars: &mut CostBars) -> Result<f64, LossError> {
        let mut sum = self.comparison.add(Which::Front, seen, target, Counted::Likely, [1.0, 0.0], bars)?;
        sum += self.comparison.add(Which::Behind, seen, target, Counted::Likely, [1.0, 0.0], bars)?;
        let n = seen.composed.len();
        for (i, (pixel, bar)) in seen.composed.iter().zip(&mut bars.composed).enumerate() {
            let counts = target.weights.map_or(1.0, |w| w[i]);
            let off: f32 = (0..3).map(|c| (pixel.behind[c] - target.colour[c * n + i]).abs()).sum();
            bar.share -= counts * off / (3 * n) as f32;
        }
        Ok(sum)
    }

    /// What is in front should not have the structure of what is behind.
    fn divergence(
        &mut self,
        seen: &Seen<'_>,
        target: &TargetPicture<'_>,
        bars: &mut CostBars,
    ) -> Result<f64, LossError> {
        let (n, weight) = (seen.composed.len(), self.settings.front_divergence);
        if weight <= 0.0 || n == 0 {
            return Ok(0.0);
        }
        let planes = |of: Which| -> Vec<f32> {
            (0..3).flat_map(|c| seen.composed.iter().map(move |pixel| of.of(pixel)[c])).collect()
        };
        let [x, y] = [planes(Which::Front), planes(Which::Behind)];
        let weights = self.comparison.likely(Which::Front, seen, target);
        let of = Pictures { size: seen.behind.size, x: &x, y: &y, weights: Some(weights) };
        let mut both = [vec![0.0; 3 * n], vec![0.0; 3 * n]];
        let [x_bar, y_bar] = &mut both;
        let likeness = structure_backward(&of, weight, x_bar, y_bar)?;
        for (which, planes) in [Which::Front, Which::Behind].into_iter().zip(&both) {
            which.pull_back(planes, seen, bars);
        }
        Ok(weight * likeness)
    }

    /// What is in front should not lie behind.
    fn separation(
        &self,
        seen: &Seen<'_>,
        front: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut CostBars,
    ) -> f64 {
        let (Some(near), Some(far)) = (front.depth, seen.behind.depth) else { return 0.0 };
        let n = seen.composed.len();
        let weight = self.settings.front_separation / n.max(1) as f64;
        let mut sum = 0.0;
        for (i, pixel) in seen.composed.iter().enumerate() {
            let counts = target.weights.map_or(1.0, |w| w[i]);
            let opacity = [front.transmittance[i], seen.behind.transmittance[i]].map(|t| 1.0 - t);
            if pixel.share <= CERTAIN || counts == 0.0 || opacity.iter().any(|a| *a <= OPAQUE) {
                continue;
            }
            let depth = near[i] / opacity[0];
            let excess = depth - far[i] / opacity[1];
            if excess > 0.0 {
                sum += f64::from(excess) * weight;
                bars.front_depth[i] += weight as f32 / opacity[0];
                bars.front_transmittance[i] += weight as f32 * depth / opacity[0];
            }
        }
        sum
    }
}
