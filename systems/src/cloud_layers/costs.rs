//! What a picture of two clouds costs, in two parts: the first says where Gaussians are needed, the second only how they are.
//!
//! ```text
//! main    = |C - I| + w_e sum_(e in f, b) 1[P_e > 0.51] (|C_e - I| + 0.1 (1 - SSIM(C_e, I)))
//!           + w_v mean 1[P_f > 0.51] r(C_f, C_b) + w_d mean 1[P_f > 0.6] max(D_f - D_b, 0) + w_s V(D_b, I)
//! utility = w_u (1 - SSIM(C, I)) + w_p P_f + w_h H(P_f) + w_B |B - 1|
//! ```
//!
//! Apart (`front_apart`), `|C - I|` and `1 - SSIM(C, I)` are not there: each cloud costs `1[P_e > 0.51] |C_e - I|`, the one behind its
//! structure there, and the share has the gradient of `(1 - P_f) |C_b - I|`.
//!
//! `r` is the likeness of structure ([`losses::structure`]), `D` are depths, `V` their variation ([`losses::edge_variation`]), `H` the entropy of the mask. Before the cloud in front begins, the one
//! behind learns alone. Indicators and the depth behind in the separation have no gradient. The share of the front
//! (`w_p`) costs nothing in the paper.
//!
//! # Source
//! Wang et al., "DeGauss", 2025, equations 3 to 10, supplement and released code; what differs: `docs/decisions/0066-degauss.md`.

use super::composite::{Composed, ComposedBar};
use super::settings::LayerSettings;
use crate::views::{RenderedPicture, TargetPicture};
use float_core::Simd;
use losses::LossError;
use losses::dssim::{Dssim, Pair, Target};
use losses::edge_variation::{DepthAndPhoto, edge_variation_backward};
use losses::entropy;
use losses::structure::{Pictures, structure_backward};

/// A pixel is most likely of a cloud above this share of it; its depth is compared above the second one.
const LIKELY: f32 = 0.51;
const CERTAIN: f32 = 0.6;
/// Share of structure in what each cloud alone costs, beside the absolute difference.
const STRUCTURE_OF_EACH: f32 = 0.1;
/// Below this opacity a cloud has no depth.
const OPAQUE: f32 = 0.5;
/// Masks become clear from this share of the schedule on.
const CLEAR_FROM: f64 = 0.5;
/// Brightness is free at first: its weight is this at the start, and grows from a tenth of the schedule on.
const FREE_BRIGHTNESS: f64 = 2.5e-4;
const BRIGHTNESS_FROM: f64 = 0.1;

/// Both clouds as a photo's camera sees them.
pub(super) struct Seen<'a> {
    pub(super) composed: &'a [Composed],
    pub(super) behind: RenderedPicture<'a>,
    /// `None`: it has not begun.
    pub(super) front: Option<RenderedPicture<'a>>,
}

/// Gradients of a part of the cost.
#[derive(Clone, Debug, Default)]
pub(super) struct CostBars {
    /// `[pixels]`
    pub(super) composed: Vec<ComposedBar>,
    /// `[pixels]`, with respect to the composited depths, and to the transmittance of the front.
    pub(super) behind_depth: Vec<f32>,
    pub(super) front_depth: Vec<f32>,
    pub(super) front_transmittance: Vec<f32>,
}

impl CostBars {
    fn begin(&mut self, pixels: usize) {
        self.composed.clear();
        self.composed.resize(pixels, ComposedBar::default());
        for plane in [&mut self.behind_depth, &mut self.front_depth, &mut self.front_transmittance] {
            plane.clear();
            plane.resize(pixels, 0.0);
        }
    }

    /// Add those of another part.
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, more) in self.composed.iter_mut().zip(&other.composed) {
            for c in 0..3 {
                sum.colour[c] += more.colour[c];
                sum.front[c] += more.front[c];
                sum.behind[c] += more.behind[c];
            }
            sum.share += more.share;
            sum.brightness += more.brightness;
        }
        let planes = [
            (&mut self.behind_depth, &other.behind_depth),
            (&mut self.front_depth, &other.front_depth),
            (&mut self.front_transmittance, &other.front_transmittance),
        ];
        for (sum, more) in planes {
            sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
}

/// One of the three pictures.
#[derive(Clone, Copy)]
enum Which {
    Both,
    Front,
    Behind,
}

impl Which {
    fn of(self, pixel: &Composed) -> [f32; 3] {
        match self {
            Self::Both => pixel.colour,
            Self::Front => pixel.front,
            Self::Behind => pixel.behind,
        }
    }

    fn bar(self, pixel: &mut ComposedBar) -> &mut [f32; 3] {
        match self {
            Self::Both => &mut pixel.colour,
            Self::Front => &mut pixel.front,
            Self::Behind => &mut pixel.behind,
        }
    }
}

/// Which pixels count.
#[derive(Clone, Copy)]
enum Counted {
    All,
    /// Those that are most likely the cloud's.
    Likely,
}

/// Costs, with their buffers.
pub(super) struct Costs {
    settings: LayerSettings,
    dssim: Dssim,
    planes: Vec<f32>,
    planes_bar: Vec<f32>,
    weights: Vec<f32>,
    pub(super) main: CostBars,
    pub(super) utility: CostBars,
}

impl Costs {
    pub(super) fn new(simd: Simd, settings: LayerSettings) -> Self {
        Self {
            settings,
            dssim: Dssim::new(simd),
            planes: Vec::new(),
            planes_bar: Vec::new(),
            weights: Vec::new(),
            main: CostBars::default(),
            utility: CostBars::default(),
        }
    }

    /// The cost at a share of the schedule; its gradients are in [`main`](Self::main) and [`utility`](Self::utility).
    pub(super) fn add(&mut self, seen: &Seen<'_>, target: &TargetPicture<'_>, at: f64) -> Result<f64, LossError> {
        let size = seen.behind.size;
        let pixels = size[0] * size[1];
        let [mut main, mut utility] = [std::mem::take(&mut self.main), std::mem::take(&mut self.utility)];
        main.begin(pixels);
        utility.begin(pixels);
        let LayerSettings { front_structure, front_each, .. } = self.settings;
        let mut sum = 0.0;
        let structure = front_structure as f32;
        if let Some(front) = &seen.front {
            if self.settings.front_apart {
                sum += self.apart(seen, target, &mut main)?;
                sum += self.compare(Which::Behind, seen, target, Counted::Likely, [0.0, structure], &mut utility)?;
            } else {
                sum += self.compare(Which::Both, seen, target, Counted::All, [1.0, 0.0], &mut main)?;
                sum += self.compare(Which::Both, seen, target, Counted::All, [0.0, structure], &mut utility)?;
            }
            let own = [front_each as f32, STRUCTURE_OF_EACH * front_each as f32];
            sum += self.compare(Which::Front, seen, target, Counted::Likely, own, &mut main)?;
            sum += self.compare(Which::Behind, seen, target, Counted::Likely, own, &mut main)?;
            sum += self.divergence(seen, target, &mut main)?;
            sum += self.separation(seen, front, target, &mut main);
            sum += self.masks(seen, target, at, &mut utility);
        } else {
            sum += self.compare(Which::Behind, seen, target, Counted::All, [1.0, 0.0], &mut main)?;
            sum += self.compare(Which::Behind, seen, target, Counted::All, [0.0, structure], &mut utility)?;
        }
        if let Some(depth) = seen.behind.depth.filter(|_| self.settings.front_smoothness > 0.0) {
            let of = DepthAndPhoto { size, depth, photo: target.colour };
            let weight = self.settings.front_smoothness;
            sum += weight * edge_variation_backward(&of, weight, &mut main.behind_depth)?;
        }
        (self.main, self.utility) = (main, utility);
        Ok(sum)
    }

    /// `weights[0] mean g |x - y| + weights[1] mean g (1 - SSIM)` of one of the pictures; of those pixels only that
    /// are `counted`.
    fn compare(
        &mut self,
        which: Which,
        seen: &Seen<'_>,
        target: &TargetPicture<'_>,
        counted: Counted,
        weights: [f32; 2],
        bars: &mut CostBars,
    ) -> Result<f64, LossError> {
        let (size, n) = (seen.behind.size, seen.composed.len());
        let total = weights[0] + weights[1];
        if total <= 0.0 || n == 0 {
            return Ok(0.0);
        }
        self.planes.resize(3 * n, 0.0);
        for (c, plane) in self.planes.chunks_exact_mut(n).enumerate() {
            plane.iter_mut().zip(seen.composed).for_each(|(x, pixel)| *x = which.of(pixel)[c]);
        }
        self.planes_bar.clear();
        self.planes_bar.resize(3 * n, 0.0);
        let weights_of_pixels = match counted {
            Counted::All => target.weights,
            Counted::Likely => Some(likely_weights(which, seen, target, &mut self.weights)),
        };
        let pair = Pair {
            channels: 3,
            height: size[1],
            width: size[0],
            x: &self.planes,
            target: Target::Planes(target.colour),
            weights: weights_of_pixels,
        };
        let (lambda, bar) = (weights[1] / total, f64::from(total));
        let loss = self.dssim.l1_dssim_backward(&pair, lambda, bar, &mut self.planes_bar)?.loss;
        for (c, plane) in self.planes_bar.chunks_exact(n).enumerate() {
            bars.composed.iter_mut().zip(plane).for_each(|(pixel, bar)| which.bar(pixel)[c] += bar);
        }
        Ok(bar * loss)
    }

    /// `sum_e mean 1[P_e > 0.51] |C_e - I|`: each cloud learns what it has. The share has the gradient of `(1 - P_f) |C_b - I|`: the
    /// front has what the cloud behind is far from.
    fn apart(&mut self, seen: &Seen<'_>, target: &TargetPicture<'_>, bars: &mut CostBars) -> Result<f64, LossError> {
        let mut sum = self.compare(Which::Front, seen, target, Counted::Likely, [1.0, 0.0], bars)?;
        sum += self.compare(Which::Behind, seen, target, Counted::Likely, [1.0, 0.0], bars)?;
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
        let weights = likely_weights(Which::Front, seen, target, &mut self.weights);
        let of = Pictures { size: seen.behind.size, x: &x, y: &y, weights: Some(weights) };
        let mut both = [vec![0.0; 3 * n], vec![0.0; 3 * n]];
        let [x_bar, y_bar] = &mut both;
        let likeness = structure_backward(&of, weight, x_bar, y_bar)?;
        for (which, planes) in [Which::Front, Which::Behind].into_iter().zip(&both) {
            for (c, plane) in planes.chunks_exact(n).enumerate() {
                bars.composed.iter_mut().zip(plane).for_each(|(pixel, bar)| which.bar(pixel)[c] += bar);
            }
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

    /// Masks of the front, masks that are neither, and brightness other than 1.
    fn masks(&self, seen: &Seen<'_>, target: &TargetPicture<'_>, at: f64, bars: &mut CostBars) -> f64 {
        let n = seen.composed.len().max(1) as f64;
        let entropy = if at < CLEAR_FROM { 0.0 } else { self.settings.front_entropy / n };
        let grown = ((at - BRIGHTNESS_FROM) / (1.0 - BRIGHTNESS_FROM)).max(0.0) * self.settings.front_brightness;
        let brightness = FREE_BRIGHTNESS.max(grown) / n;
        let sparsity = self.settings.sparsity(at) / n;
        let mut sum = 0.0;
        for (i, (pixel, bar)) in seen.composed.iter().zip(&mut bars.composed).enumerate() {
            let counts = target.weights.map_or(1.0, |w| f64::from(w[i]));
            let off = pixel.brightness - 1.0;
            sum += counts * (entropy * entropy::value(pixel.share) + brightness * f64::from(off.abs()));
            sum += counts * sparsity * f64::from(pixel.share);
            bar.share += (counts * (sparsity + entropy * entropy::derivative(pixel.share))) as f32;
            let sign = if off == 0.0 { 0.0 } else { off.signum() };
            bar.brightness += (counts * brightness) as f32 * sign;
        }
        sum
    }
}

/// `[pixels]`, how much each counts of what one cloud alone costs, written over `out`.
fn likely_weights<'a>(which: Which, seen: &Seen<'_>, target: &TargetPicture<'_>, out: &'a mut Vec<f32>) -> &'a [f32] {
    let weight = |(i, pixel): (usize, &Composed)| likely(which, pixel) * target.weights.map_or(1.0, |w| w[i]);
    out.clear();
    out.extend(seen.composed.iter().enumerate().map(weight));
    out
}

/// How much a pixel counts of what one cloud alone costs: 1 where it is most likely the cloud's. Not its share: steps of Adam are as long
/// for a hundredth of a gradient.
fn likely(which: Which, pixel: &Composed) -> f32 {
    let own = match which {
        Which::Both => 1.0,
        Which::Front => pixel.share,
        Which::Behind => 1.0 - pixel.share,
    };
    f32::from(u8::from(own > LIKELY))
}
