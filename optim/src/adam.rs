//! Adam and AdamW.

mod kernel;
#[cfg(test)]
mod tests;

use crate::{CHUNK, OptimError};
use alloc::{vec, vec::Vec};
use float_core::{Simd, m64};
use kernel::{Coefficients, StepSlice, StepTouched, ZeroGradient};

/// Entries per mark (bit) of [`Adam::step_touched`]: one cache line of parameters.
pub const BLOCK: usize = 16;

/// How many words of marks `len` parameters need: a bit for each started [`BLOCK`].
#[must_use]
pub const fn touched_len(len: usize) -> usize {
    len.div_ceil(BLOCK).div_ceil(64)
}

/// Weight decay.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Decay {
    /// None.
    #[default]
    None,
    /// `g + rate * p` takes the place of the gradient: an L2 penalty, as in plain Adam.
    L2(f64),
    /// `p *= 1 - lr * rate` before the step, as in AdamW.
    Decoupled(f64),
}

/// The constants of Adam: one of the sets below, changed by `with_` and the name of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AdamConfig {
    /// Decay rate of the first moment, in `[0, 1)`.
    pub beta1: f64,
    /// Decay rate of the second moment, in `[0, 1)`.
    pub beta2: f64,
    /// Added to `sqrt(v)` after bias correction, outside the root. `> 0`, also as `f32`.
    pub eps: f64,
    /// Weight decay.
    pub decay: Decay,
}

impl AdamConfig {
    /// `(0.9, 0.999)`, `1e-8`: Kingma and Ba, 2015.
    pub const DEFAULT: Self = Self { beta1: 0.9, beta2: 0.999, eps: 1e-8, decay: Decay::None };
    /// `(0.9, 0.999)`, `1e-7`: Mildenhall et al., "NeRF", 2020.
    pub const NERF: Self = Self { eps: 1e-7, ..Self::DEFAULT };
    /// `(0.9, 0.99)`, `1e-15`: Müller et al., "Instant neural graphics primitives", 2022.
    pub const NGP: Self = Self { beta2: 0.99, eps: 1e-15, ..Self::DEFAULT };

    /// The same with other decay rates of the moments.
    #[must_use]
    pub const fn with_betas(self, beta1: f64, beta2: f64) -> Self {
        Self { beta1, beta2, ..self }
    }

    /// The same with another `eps`.
    #[must_use]
    pub const fn with_eps(self, eps: f64) -> Self {
        Self { eps, ..self }
    }

    /// The same with weight decay.
    #[must_use]
    pub const fn with_decay(self, decay: Decay) -> Self {
        Self { decay, ..self }
    }
}

impl Default for AdamConfig {
    /// [`AdamConfig::DEFAULT`].
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Adam's state: the moments of `len` parameters (8 bytes each) and the number of steps taken.
///
/// One step with learning rate `lr`, at step `t = 1, 2, ..`, for each entry with gradient `g`:
///
/// ```text
/// m = beta1 m + (1 - beta1) g
/// v = beta2 v + (1 - beta2) g^2
/// p = p - lr / (1 - beta1^t) * m / (sqrt(v) / sqrt(1 - beta2^t) + eps)
/// ```
///
/// `t` is one number for all entries, also in the sparse steps.
///
/// # Numerics
/// * An entry whose gradient is NaN or infinite is left as it is, parameter and moments; the steps return how many there
///   were. Hand that to a [`NonFiniteGuard`](crate::NonFiniteGuard).
/// * Gradients beyond `±1.8e19` count as `±1.8e19`: their squares would overflow and stop the entry for good.
/// * Parameters stay finite with every learning rate: a step that overflows ends at the largest number of its sign.
/// * Below `1e-19` the square underflows and the step is `lr m / eps`-like. With `eps >= 1e-8` it is the same to `1e-11`.
/// * No fused multiply-add: all SIMD levels give the same bits.
///
/// # Source
/// Kingma and Ba, "Adam", 2015, algorithm 1; Loshchilov and Hutter, "Decoupled weight decay regularization", 2019,
/// algorithm 2.
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    config: AdamConfig,
    m: Vec<f32>,
    v: Vec<f32>,
    steps: u64,
}

impl Adam {
    /// Moments at 0, no steps taken.
    ///
    /// # Panics
    /// If a constant is outside its range, or there is no memory for the moments.
    #[must_use]
    pub fn new(len: usize, config: AdamConfig) -> Self {
        check(config);
        Self { config, m: vec![0.0; len], v: vec![0.0; len], steps: 0 }
    }

    /// Continue from a checkpoint of [`Adam::first_moment`], [`Adam::second_moment`] and [`Adam::steps`].
    ///
    /// # Errors
    /// [`OptimError::Shape`] where the lengths differ, [`OptimError::Value`] for a non-finite moment or a negative second
    /// moment.
    ///
    /// # Panics
    /// If a constant of `config` is outside its range.
    pub fn restore(config: AdamConfig, m: Vec<f32>, v: Vec<f32>, steps: u64) -> Result<Self, OptimError> {
        check(config);
        if m.len() != v.len() {
            return Err(OptimError::Shape { what: "second moment", want: m.len(), got: v.len() });
        }
        if let Some(index) = m.iter().position(|m| !m.is_finite()) {
            return Err(OptimError::Value { what: "first moment", index, value: m[index] });
        }
        if let Some(index) = v.iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
            return Err(OptimError::Value { what: "second moment", index, value: v[index] });
        }
        Ok(Self { config, m, v, steps })
    }

    /// Number of parameters.
    #[must_use]
    pub fn len(&self) -> usize {
        self.m.len()
    }

    /// Whether there are no parameters.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.m.is_empty()
    }

    /// The constants.
    #[must_use]
    pub fn config(&self) -> AdamConfig {
        self.config
    }

    /// `m`, `[len]`.
    #[must_use]
    pub fn first_moment(&self) -> &[f32] {
        &self.m
    }

    /// `v`, `[len]`, `>= 0`.
    #[must_use]
    pub fn second_moment(&self) -> &[f32] {
        &self.v
    }

    /// Steps taken.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step for every entry. Returns how many were skipped because their gradient is not finite.
    ///
    /// # Shapes
    /// * `params` `[len]`, changed; `grad` `[len]`
    ///
    /// # Panics
    /// If a length is not `len`, or `lr` is negative or not finite.
    #[must_use = "the count of non-finite gradients belongs to a `NonFiniteGuard`"]
    pub fn step(&mut self, simd: Simd, lr: f64, params: &mut [f32], grad: &[f32]) -> usize {
        self.step_all(simd, lr, params, grad, ZeroGradient::Decays)
    }

    /// One step for the entries whose gradient is not exactly 0; the others keep parameter and moments and see no decay.
    /// For sparse tables without marks: it still reads the whole gradient. Returns as [`Adam::step`].
    ///
    /// # Panics
    /// As [`Adam::step`].
    #[must_use = "the count of non-finite gradients belongs to a `NonFiniteGuard`"]
    pub fn step_nonzero(&mut self, simd: Simd, lr: f64, params: &mut [f32], grad: &[f32]) -> usize {
        self.step_all(simd, lr, params, grad, ZeroGradient::Untouched)
    }

    /// [`Adam::step_nonzero`] for the marked blocks only. **Takes** the gradient: marked blocks of `grad` are 0 afterwards
    /// and all marks are cleared, so both arrays are ready for the next step.
    ///
    /// Bit `b % 64` of word `b / 64` says that entries `16 b .. 16 b + 16` may have a gradient: the form in which a hash
    /// grid's backward pass reports what it touched. 64 untouched blocks cost the compare of one word; none of their
    /// parameters, gradients and moments are read. Bits past the last block are ignored. Returns as [`Adam::step`].
    ///
    /// # Shapes
    /// * `params` `[len]`, changed; `grad` `[len]`, taken; `touched` `[touched_len(len)]` words, cleared
    ///
    /// # Panics
    /// As [`Adam::step`]; if `touched` does not hold that many words.
    #[must_use = "the count of non-finite gradients belongs to a `NonFiniteGuard`"]
    pub fn step_touched(
        &mut self,
        simd: Simd,
        lr: f64,
        params: &mut [f32],
        grad: &mut [f32],
        touched: &mut [u64],
    ) -> usize {
        self.check_lengths(params.len(), grad.len());
        assert_eq!(touched.len(), touched_len(self.len()), "touched marks: a bit for each block of {BLOCK}");
        let k = self.advance(lr);
        // CHUNK is a multiple of 64 blocks, so words of marks and entries split at the same places.
        const MARKS: usize = CHUNK / BLOCK / 64;
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            (params.par_chunks_mut(CHUNK), grad.par_chunks_mut(CHUNK), self.m.par_chunks_mut(CHUNK))
                .into_par_iter()
                .zip(self.v.par_chunks_mut(CHUNK))
                .zip(touched.par_chunks_mut(MARKS))
                .map(|(((p, g, m), v), touched)| simd.run(StepTouched { k, p, g, m, v, touched }))
                .sum()
        }
        #[cfg(not(feature = "rayon"))]
        {
            (params.chunks_mut(CHUNK).zip(grad.chunks_mut(CHUNK)))
                .zip(self.m.chunks_mut(CHUNK).zip(self.v.chunks_mut(CHUNK)))
                .zip(touched.chunks_mut(MARKS))
                .map(|(((p, g), (m, v)), touched)| simd.run(StepTouched { k, p, g, m, v, touched }))
                .sum()
        }
    }

    fn step_all(&mut self, simd: Simd, lr: f64, params: &mut [f32], grad: &[f32], zero: ZeroGradient) -> usize {
        self.check_lengths(params.len(), grad.len());
        let k = self.advance(lr);
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            (params.par_chunks_mut(CHUNK), grad.par_chunks(CHUNK), self.m.par_chunks_mut(CHUNK))
                .into_par_iter()
                .zip(self.v.par_chunks_mut(CHUNK))
                .map(|((p, g, m), v)| simd.run(StepSlice { k, zero, p, g, m, v }))
                .sum()
        }
        #[cfg(not(feature = "rayon"))]
        {
            (params.chunks_mut(CHUNK).zip(grad.chunks(CHUNK)))
                .zip(self.m.chunks_mut(CHUNK).zip(self.v.chunks_mut(CHUNK)))
                .map(|((p, g), (m, v))| simd.run(StepSlice { k, zero, p, g, m, v }))
                .sum()
        }
    }

    fn check_lengths(&self, params: usize, grad: usize) {
        assert_eq!(params, self.len(), "Adam: number of parameters");
        assert_eq!(grad, self.len(), "Adam: length of the gradient");
    }

    /// Count a step and work out its coefficients in `f64`.
    fn advance(&mut self, lr: f64) -> Coefficients {
        assert!(lr >= 0.0 && lr.is_finite(), "Adam: learning rate {lr}");
        self.steps += 1;
        let AdamConfig { beta1, beta2, eps, decay } = self.config;
        let t = self.steps as f64;
        let (l2, keep) = match decay {
            Decay::None => (0.0, 1.0),
            Decay::L2(rate) => (rate, 1.0),
            Decay::Decoupled(rate) => (0.0, 1.0 - lr * rate),
        };
        Coefficients {
            beta1: beta1 as f32,
            rest1: (1.0 - beta1) as f32,
            beta2: beta2 as f32,
            rest2: (1.0 - beta2) as f32,
            rate: within(lr / (1.0 - m64::powf(beta1, t))),
            root: (1.0 / m64::sqrt(1.0 - m64::powf(beta2, t))) as f32,
            eps: eps as f32,
            l2: l2 as f32,
            keep: within(keep),
        }
    }
}

/// The nearest `f32` that is finite.
fn within(x: f64) -> f32 {
    (x as f32).clamp(f32::MIN, f32::MAX)
}

fn check(config: AdamConfig) {
    let AdamConfig { beta1, beta2, eps, decay } = config;
    assert!((0.0..1.0).contains(&beta1) && (0.0..1.0).contains(&beta2), "Adam: betas ({beta1}, {beta2})");
    assert!(eps as f32 > 0.0 && eps.is_finite(), "Adam: eps {eps}");
    match decay {
        Decay::None => {}
        Decay::L2(rate) | Decay::Decoupled(rate) => {
            assert!(rate >= 0.0 && rate.is_finite(), "Adam: weight decay {rate}");
        }
    }
}
