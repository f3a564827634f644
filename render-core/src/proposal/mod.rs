//! From the weights of one pass along a ray to the intervals of the next.
//!
//! A *proposal* is a histogram `(s, w)` of a ray in normalised distance: `n + 1` fenceposts, `n` weights. Before it is
//! resampled it is [`dilate`]d, so that a thin surface is still covered if the next pass finds it a little beside, and
//! [`anneal`]ed, so that early in training the whole ray gets samples. [`Resampler::next`] does all three steps.
//!
//! Nothing carries a gradient, nothing is random: the caller brings the jitter.
//!
//! Source: Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360", 2022, section 3, appendix C, and released code.

mod anneal;
mod dilate;

pub use anneal::{anneal, annealing_exponent};
pub use dilate::{DilateScratch, dilate, dilated_len};

use crate::histogram::{Quantiles, fenceposts_between, quantiles, resample_fenceposts};
use alloc::vec::Vec;

/// What is done to a histogram before it is resampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refine {
    /// Half the width of the window of [`dilate`], in `s`; 0 leaves the histogram as it is.
    pub dilation: f32,
    /// Exponent of [`anneal`]; 1 leaves the weights as they are.
    pub exponent: f32,
}

/// `bias + multiplier / product(counts)`: half width of the dilation after passes of `counts` intervals.
#[must_use]
pub fn dilation(bias: f32, multiplier: f32, counts: &[usize]) -> f32 {
    counts.iter().fold(multiplier, |d, &n| d / n.max(1) as f32) + bias
}

/// Memory of [`Resampler::next`], kept from ray to ray.
#[derive(Clone, Debug, Default)]
pub struct Resampler {
    s: Vec<f32>,
    w: Vec<f32>,
    u: Vec<f32>,
    centres: Vec<f32>,
    cdf: Vec<f64>,
    dilate: DilateScratch,
}

impl Resampler {
    /// `m` new intervals where the histogram has weight: dilated, annealed, their centres at quantiles of the
    /// mass, their fenceposts halfway between.
    ///
    /// # Shapes and units
    /// * `s` `[n + 1]` fenceposts in `[0, 1]`, non-decreasing; `n >= 1`
    /// * `w` `[n]` weights, finite, `>= 0`; without any weight every interval counts the same
    /// * `rule` of the `m` quantiles: [`Quantiles::Shared`] in training, [`Quantiles::Centres`] in renders
    /// * `out` `[m + 1]` fenceposts in `[0, 1]`, written
    ///
    /// # Panics
    /// When the lengths disagree, or there is nothing to cut.
    pub fn next(&mut self, s: &[f32], w: &[f32], refine: Refine, rule: Quantiles<'_>, out: &mut [f32]) {
        assert!(!w.is_empty() && out.len() > 1, "an interval at least, before and after");
        if refine.dilation > 0.0 {
            let n = dilated_len(w.len());
            self.s.resize(n + 1, 0.0);
            self.w.resize(n, 0.0);
            dilate(s, w, refine.dilation, &mut self.s, &mut self.w, &mut self.dilate);
        } else {
            self.s.clear();
            self.s.extend_from_slice(s);
            self.w.clear();
            self.w.extend_from_slice(w);
        }
        anneal(&self.s, refine.exponent, &mut self.w);
        let m = out.len() - 1;
        self.u.resize(m, 0.0);
        self.centres.resize(m, 0.0);
        self.cdf.resize(self.s.len(), 0.0);
        quantiles(rule, &mut self.u);
        resample_fenceposts(&self.s, &self.w, &self.u, &mut self.cdf, &mut self.centres);
        fenceposts_between(&self.centres, [0.0, 1.0], out);
    }
}
