//! Density control as Markov chain Monte Carlo: a fixed budget of Gaussians, dead ones relocated, noise on the positions.

use alloc::{vec, vec::Vec};

use float_core::rng::Rng;
use float_core::{m32, m64};

use super::rows::countable;
use super::{Change, Rows, noise, opacity};
use crate::chunks::for_each;
use crate::{Gaussians, SplatError};

/// Most Gaussians that one is replaced by when [`relocation`] is computed.
const COPIES_MAX: u32 = 50;
/// Rows per task.
const CHUNK: usize = 1024;

/// Settings of 3DGS-MCMC. Steps count from 1.
///
/// # Source
/// Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024, sections 3.2 to 3.5; the constants are those of the
/// released code.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Mcmc {
    /// Relocate and add only after this step.
    pub after: u64,
    /// Relocate and add only before this step.
    pub until: u64,
    /// Relocate and add at steps divisible by this.
    pub every: u64,
    /// A Gaussian with this opacity or less is dead.
    pub opacity_dead: f64,
    /// Fraction by which the cloud grows each time.
    pub growth: f64,
    /// Strength of the noise, relative to the learning rate of the means.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean scale (world units) in the loss.
    pub scale_weight: f64,
}

impl Mcmc {
    /// The constants of the released code.
    pub const DEFAULT: Self = Self {
        after: 500,
        until: 25_000,
        every: 100,
        opacity_dead: 0.005,
        growth: 0.05,
        noise: 5e5,
        opacity_weight: 0.01,
        scale_weight: 0.01,
    };

    float_core::setters! {
        with_after after: u64;
        with_until until: u64;
        with_every every: u64;
        with_opacity_dead opacity_dead: f64;
        with_growth growth: f64;
        with_noise noise: f64;
        with_opacity_weight opacity_weight: f64;
        with_scale_weight scale_weight: f64;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let weight = |x: f64| x >= 0.0 && x.is_finite();
        let dead = self.opacity_dead;
        let checks = [
            ("every", self.every as f64, self.every > 0, "at least 1"),
            ("opacity_dead", dead, dead > 0.0 && dead < 1.0, "a number between 0 and 1"),
            ("growth", self.growth, weight(self.growth), "at least 0"),
            ("noise", self.noise, weight(self.noise), "at least 0"),
            ("opacity_weight", self.opacity_weight, weight(self.opacity_weight), "at least 0"),
            ("scale_weight", self.scale_weight, weight(self.scale_weight), "at least 0"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got, accepts }),
            None => Ok(()),
        }
    }

    /// Whether to [`relocate`](Self::relocate) and [`add`](Self::add) at the end of this step.
    #[must_use]
    pub fn relocates_at(&self, step: u64) -> bool {
        step > self.after && step < self.until && step.is_multiple_of(self.every)
    }

    /// Relocate each dead Gaussian to one that is alive, drawn with probability proportional to opacity. The Gaussians that are then at
    /// one place get the opacity and scale of [`relocation`], and are marked fresh. If none is alive, nothing changes.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn relocate(&self, cloud: &Gaussians, rng: Rng) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        countable(n)?;
        let dead = |i: usize| opacity(cloud, i) <= self.opacity_dead;
        let alive = Multinomial::new(n, |i| if dead(i) { 0.0 } else { opacity(cloud, i) });
        let target = |i: usize| if dead(i) { alive.draw(rng.u64_at(i as u64)) } else { None };
        self.relocated(cloud, (0..n as u32).map(|i| target(i as usize).unwrap_or(i)).collect())
    }

    /// Add a fraction `growth` of Gaussians (rounded up), to `max` at most: copies of Gaussians drawn with probability proportional to
    /// opacity. Sources and copies get the opacity and scale of [`relocation`].
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range, fields of the wrong length or more Gaussians than `u32` can count.
    pub fn add(&self, cloud: &Gaussians, max: usize, rng: Rng) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        // Saturates.
        let more = (m64::ceil(self.growth * n as f64) as usize).min(max.saturating_sub(n));
        countable(n.saturating_add(more))?;
        let all = Multinomial::new(n, |i| opacity(cloud, i));
        let added = (0..more as u64).map_while(|k| all.draw(rng.u64_at(k)));
        self.relocated(cloud, (0..n as u32).chain(added).collect())
    }

    /// The cloud with row `i` copied from `from[i]`, and the Gaussians of one source rescaled by [`relocation`].
    fn relocated(&self, cloud: &Gaussians, from: Vec<u32>) -> Result<Change, SplatError> {
        // Number of copies of each Gaussian, besides itself.
        let mut copies = vec![0_u32; cloud.len()];
        for (i, &source) in from.iter().enumerate() {
            if i != source as usize {
                copies[source as usize] += 1;
            }
        }
        let fresh: Vec<bool> = from.iter().map(|&source| copies[source as usize] > 0).collect();
        let rows = Rows::of(cloud.len(), from.iter().copied().zip(fresh.iter().copied()));
        let mut out = rows.follow(cloud)?;
        let len = out.len();
        // For each source: the new logit, and what is added to the logarithms of the scales.
        let mut rescaled: Vec<Option<(f32, f64)>> = vec![None; cloud.len()];
        for (i, &source) in from.iter().enumerate().filter(|&(i, _)| fresh[i]) {
            let s = source as usize;
            let (logit, smaller) = *rescaled[s].get_or_insert_with(|| {
                let (o, factor) = relocation(opacity(cloud, s), (copies[s] + 1).min(COPIES_MAX));
                let most = 1.0 - f64::from(f32::EPSILON);
                let o = o.clamp(self.opacity_dead.min(most), most);
                ((m64::ln(o) - m64::ln_1p(-o)) as f32, m64::ln(factor))
            });
            out.logit[i] = logit;
            for k in 0..3 {
                out.log_scale[k * len + i] = (f64::from(out.log_scale[k * len + i]) + smaller) as f32;
            }
        }
        Ok(Change { cloud: out, rows })
    }

    /// Add noise to the means after an optimiser's step with learning rate `lr` (world units): `p += Sigma eta` with standard normal
    /// `eta`, times `noise lr logistic(-100 (opacity - opacity_dead))`. Opaque Gaussians do not move.
    ///
    /// # Errors
    /// [`SplatError`] for settings or a rate out of range, or fields of the wrong length.
    pub fn add_noise(&self, cloud: &mut Gaussians, lr: f64, rng: Rng) -> Result<(), SplatError> {
        self.check()?;
        cloud.check()?;
        if !(lr >= 0.0 && lr.is_finite()) {
            return Err(SplatError::Value { what: "lr", got: lr, accepts: "at least 0" });
        }
        noise::add(cloud, self.noise * lr, self.opacity_dead, rng);
        Ok(())
    }

    /// Regularisation loss `opacity_weight mean(opacity) + scale_weight mean(scale)`, the second mean over all three scales. Its
    /// gradient is added to `grad`, of the cloud's shape.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn regularise(&self, cloud: &Gaussians, grad: &mut Gaussians) -> Result<f64, SplatError> {
        self.check()?;
        cloud.check()?;
        grad.check()?;
        let n = cloud.len();
        if grad.len() != n {
            return Err(SplatError::Shape { what: "grad", want: n, got: grad.len() });
        }
        if n == 0 {
            return Ok(0.0);
        }
        let (per_o, per_s) = (self.opacity_weight / n as f64, self.scale_weight / (3 * n) as f64);
        let opacities = sum_with_gradient(&cloud.logit, &mut grad.logit, |x| {
            let o = m32::logistic(x);
            (o, per_o as f32 * o * (1.0 - o))
        });
        let scales = sum_with_gradient(&cloud.log_scale, &mut grad.log_scale, |x| {
            let s = m32::exp(x);
            (s, per_s as f32 * s)
        });
        Ok(per_o * opacities + per_s * scales)
    }
}

impl Default for Mcmc {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Sum of `f(x).0`, the value; `f(x).1`, the derivative, is added to `bar`. Chunk by chunk.
fn sum_with_gradient(x: &[f32], bar: &mut [f32], f: impl Fn(f32) -> (f32, f32) + Sync) -> f64 {
    let mut jobs: Vec<(&[f32], &mut [f32], f64)> =
        x.chunks(CHUNK).zip(bar.chunks_mut(CHUNK)).map(|(x, bar)| (x, bar, 0.0)).collect();
    for_each(&mut jobs, |_, (x, bar, sum)| {
        for (&x, bar) in x.iter().zip(bar.iter_mut()) {
            let (value, derivative) = f(x);
            *sum += f64::from(value);
            *bar += derivative;
        }
    });
    jobs.iter().map(|(_, _, sum)| sum).sum()
}

/// Opacity of each of `n` equal Gaussians at one place that together transmit as much as one of `opacity`, and the factor on their
/// scales that keeps the accumulated alpha along a line through the centre.
///
/// With `o' = 1 - (1 - o)^(1/n)` the factor is `o / D`,
///
/// ```text
/// D = sum_{i=1..n} sum_{k<i} C(i - 1, k) (-1)^k o'^(k+1) / sqrt(k + 1)
///   = 2 / sqrt(pi) * integral over x > 0 of 1 - (1 - o' exp(-x^2))^n
/// ```
///
/// # Numerics
/// The sum alternates and cancels: at `n = 50` and `o'` near 1 one digit is left. The integrand has one sign and no singularity: the
/// trapezoidal rule gives the integral to 1e-14 with a hundred points. `o = 0` and `n <= 1` give `(o, 1)`.
///
/// # Source
/// Kheradmand et al., 2024, eq. 9; the integral form is ours, from `1 / sqrt(j) = 2 / sqrt(pi) * integral of exp(-j x^2)`.
#[must_use]
pub fn relocation(opacity: f64, n: u32) -> (f64, f64) {
    if n <= 1 || opacity <= 0.0 {
        return (opacity, 1.0);
    }
    // Points 1/16 apart, up to where exp(-x^2) < 1e-21.
    const H: f64 = 1.0 / 16.0;
    const POINTS: u32 = 112;
    let n = f64::from(n);
    let each = -m64::exp_m1(m64::ln_1p(-opacity) / n);
    let alpha = |x: f64| -m64::exp_m1(n * m64::ln_1p(-each * m64::exp(-x * x)));
    let sum = 0.5 * alpha(0.0) + (1..POINTS).map(|i| alpha(f64::from(i) * H)).sum::<f64>();
    (each, opacity / (sum * H * core::f64::consts::FRAC_2_SQRT_PI))
}

/// A multinomial distribution: draws indices with probability proportional to their weights.
struct Multinomial {
    /// `[n]` inclusive prefix sums of the weights.
    sums: Vec<f64>,
}

impl Multinomial {
    /// Weights that are not positive (or NaN) count as 0.
    fn new(n: usize, weight: impl Fn(usize) -> f64) -> Self {
        let positive = |w: f64| if w > 0.0 { w } else { 0.0 };
        let sums = (0..n).scan(0.0, |sum, i| {
            *sum += positive(weight(i));
            Some(*sum)
        });
        Self { sums: sums.collect() }
    }

    /// The index drawn by 64 random bits. `None` if all weights are 0.
    fn draw(&self, bits: u64) -> Option<u32> {
        let total = self.sums.last().copied().filter(|&total| total > 0.0)?;
        // 53 bits: in [0, 1).
        let u = (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64) * total;
        let i = self.sums.partition_point(|&sum| sum <= u);
        // Rounding may reach the total: then take the last index with a weight.
        Some(i.min(self.sums.partition_point(|&sum| sum < total)) as u32)
    }
}
