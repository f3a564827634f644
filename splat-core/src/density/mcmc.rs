//! Density control as sampling: a budget of Gaussians, the dead moved to where there is matter.

use alloc::{vec, vec::Vec};

use field_core::rng::Rng;
use float_core::{m32, m64};

use super::rows::countable;
use super::{Change, Rows, noise, opacity};
use crate::chunks::for_each;
use crate::{Gaussians, SplatError};

/// Gaussians that share one place at most.
const SHARE_MAX: u32 = 50;
/// Rows that one task regularises.
const CHUNK: usize = 1024;

/// Constants of 3DGS-MCMC. Steps count from 1.
///
/// # Source
/// Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024, sections 3.2 to 3.5; the numbers are those of the
/// released code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mcmc {
    /// Move and add at steps above this,
    pub after: u64,
    /// below this,
    pub until: u64,
    /// and divisible by this.
    pub every: u64,
    /// Up to this opacity a Gaussian is dead.
    pub opacity_dead: f64,
    /// Share by which the cloud grows each time.
    pub growth: f64,
    /// Strength of the noise, in units of the means' learning rate.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean scale (world units) in the loss.
    pub scale_weight: f64,
}

impl Mcmc {
    /// Those of the paper's code.
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

    /// # Errors
    /// [`SplatError::Value`] naming the first constant outside its range.
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

    /// Whether a step ends with moving and adding.
    #[must_use]
    pub fn moves_at(&self, step: u64) -> bool {
        step > self.after && step < self.until && step.is_multiple_of(self.every)
    }

    /// Move each dead Gaussian onto one that lives, drawn in proportion to opacity; those that now [`share`] a place take its
    /// opacity and size apart. All of them are fresh. Where none lives, nothing moves.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range or fields of the wrong length.
    pub fn relocate(&self, cloud: &Gaussians, rng: Rng) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        countable(n)?;
        let dead = |i: usize| opacity(cloud, i) <= self.opacity_dead;
        let lot = Lot::new(n, |i| if dead(i) { 0.0 } else { opacity(cloud, i) });
        let place = |i: usize| if dead(i) { lot.draw(rng.u64_at(i as u64)) } else { None };
        self.crowd(cloud, (0..n as u32).map(|i| place(i as usize).unwrap_or(i)).collect())
    }

    /// Grow by a share (rounded up), to `max` at most: copies of Gaussians drawn in proportion to opacity, which [`share`] with
    /// their copies.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range, fields of the wrong length or more Gaussians than an index can count.
    pub fn add(&self, cloud: &Gaussians, max: usize, rng: Rng) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        // Saturates.
        let more = (m64::ceil(self.growth * n as f64) as usize).min(max.saturating_sub(n));
        countable(n.saturating_add(more))?;
        let lot = Lot::new(n, |i| opacity(cloud, i));
        let added = (0..more as u64).map_while(|k| lot.draw(rng.u64_at(k)));
        self.crowd(cloud, (0..n as u32).chain(added).collect())
    }

    /// The cloud with row `i` from `from[i]`, Gaussians at one place sharing it.
    fn crowd(&self, cloud: &Gaussians, from: Vec<u32>) -> Result<Change, SplatError> {
        let mut at = vec![0_u32; cloud.len()];
        for (i, &source) in from.iter().enumerate() {
            // A source that stays counts once it is drawn.
            if i != source as usize {
                at[source as usize] += 1;
            }
        }
        let fresh: Vec<bool> = from.iter().map(|&source| at[source as usize] > 0).collect();
        let rows = Rows::of(cloud.len(), from.iter().copied().zip(fresh.iter().copied()));
        let mut out = rows.follow(cloud)?;
        let len = out.len();
        // What a source gives to each: its logit and what is added to its logarithms of scales.
        let mut given: Vec<Option<(f32, f64)>> = vec![None; cloud.len()];
        for (i, &source) in from.iter().enumerate().filter(|&(i, _)| fresh[i]) {
            let s = source as usize;
            let (logit, smaller) = *given[s].get_or_insert_with(|| {
                let (o, factor) = share(opacity(cloud, s), (at[s] + 1).min(SHARE_MAX));
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

    /// Stir the means after an optimiser's step with learning rate `lr` (world units): `p += Sigma eta` with normal `eta`, times
    /// `noise lr logistic(-100 (opacity - opacity_dead))`. What is opaque stays where it is.
    ///
    /// # Errors
    /// [`SplatError`] for constants or a rate out of range, or fields of the wrong length.
    pub fn stir(&self, cloud: &mut Gaussians, lr: f64, rng: Rng) -> Result<(), SplatError> {
        self.check()?;
        cloud.check()?;
        if !(lr >= 0.0 && lr.is_finite()) {
            return Err(SplatError::Value { what: "lr", got: lr, accepts: "at least 0" });
        }
        noise::stir(cloud, self.noise * lr, self.opacity_dead, rng);
        Ok(())
    }

    /// `opacity_weight mean(opacity) + scale_weight mean(scale)`, the mean of all three scales of all Gaussians. Its gradient is
    /// added to `grad`, of the cloud's shape.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range or fields of the wrong length.
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
        let opacities = add_slopes(&cloud.logit, &mut grad.logit, |x| {
            let o = m32::logistic(x);
            (o, per_o as f32 * o * (1.0 - o))
        });
        let scales = add_slopes(&cloud.log_scale, &mut grad.log_scale, |x| {
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

/// Sum of `f(x).0`, with `f(x).1` added to the gradient: chunk by chunk.
fn add_slopes(x: &[f32], bar: &mut [f32], f: impl Fn(f32) -> (f32, f32) + Sync) -> f64 {
    let mut jobs: Vec<(&[f32], &mut [f32], f64)> =
        x.chunks(CHUNK).zip(bar.chunks_mut(CHUNK)).map(|(x, bar)| (x, bar, 0.0)).collect();
    for_each(&mut jobs, |_, (x, bar, sum)| {
        for (&x, bar) in x.iter().zip(bar.iter_mut()) {
            let (value, slope) = f(x);
            *sum += f64::from(value);
            *bar += slope;
        }
    });
    jobs.iter().map(|(_, _, sum)| sum).sum()
}

/// Opacity of each of `n` equal Gaussians that let through what one of `opacity` does, and the factor of their scales with which
/// the light they take, summed over a line through the centre, is the same.
///
/// With `o' = 1 - (1 - o)^(1/n)` the factor is `o / D`,
///
/// ```text
/// D = sum_{i=1..n} sum_{k<i} C(i - 1, k) (-1)^k o'^(k+1) / sqrt(k + 1)
///   = 2 / sqrt(pi) * integral over x > 0 of 1 - (1 - o' exp(-x^2))^n
/// ```
///
/// # Numerics
/// The sum alternates: of terms up to `(1 + o')^n` a number of order 1 is left, at `n = 50` and `o'` near 1 one digit of it.
/// The integrand has one sign and no singularity anywhere: the trapezoidal rule gives the integral to 1e-14 with a hundred
/// points. `o = 0` and `n <= 1` give `(o, 1)`.
///
/// # Source
/// Kheradmand et al., 2024, eq. 9; the integral is ours, from `1 / sqrt(j) = 2 / sqrt(pi) * integral of exp(-j x^2)`.
#[must_use]
pub fn share(opacity: f64, n: u32) -> (f64, f64) {
    if n <= 1 || opacity <= 0.0 {
        return (opacity, 1.0);
    }
    // Points a sixteenth apart, to where exp(-x^2) < 1e-21.
    const H: f64 = 1.0 / 16.0;
    const POINTS: u32 = 112;
    let n = f64::from(n);
    let each = -m64::exp_m1(m64::ln_1p(-opacity) / n);
    let taken = |x: f64| -m64::exp_m1(n * m64::ln_1p(-each * m64::exp(-x * x)));
    let sum = 0.5 * taken(0.0) + (1..POINTS).map(|i| taken(f64::from(i) * H)).sum::<f64>();
    (each, opacity / (sum * H * core::f64::consts::FRAC_2_SQRT_PI))
}

/// Draws in proportion to weights.
struct Lot {
    /// `[n]` sums up to and with each.
    sums: Vec<f64>,
}

impl Lot {
    /// What is not a positive number is never drawn.
    fn new(n: usize, weight: impl Fn(usize) -> f64) -> Self {
        let positive = |w: f64| if w > 0.0 { w } else { 0.0 };
        let sums = (0..n).scan(0.0, |sum, i| {
            *sum += positive(weight(i));
            Some(*sum)
        });
        Self { sums: sums.collect() }
    }

    /// The one that 64 random bits mean; `None` where nothing has weight.
    fn draw(&self, bits: u64) -> Option<u32> {
        let total = self.sums.last().copied().filter(|&total| total > 0.0)?;
        // 53 bits: in [0, 1).
        let u = (bits >> 11) as f64 * (1.0 / (1_u64 << 53) as f64) * total;
        let i = self.sums.partition_point(|&sum| sum <= u);
        // Rounding may reach the total: then the last one with weight.
        Some(i.min(self.sums.partition_point(|&sum| sum < total)) as u32)
    }
}
