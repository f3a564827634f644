//! Density control by splits along the longest axis, which hardly change the picture.

use alloc::vec::Vec;

use float_core::m64;

use super::rows::{countable, hottest, split_and_cloned};
use super::{Change, Rows, logit, opacity, rotation, scales};
use crate::chunks::for_each;
use crate::{Gaussians, SplatError};

/// Rows per task.
const CHUNK: usize = 1024;

/// Settings of splits along the longest axis. Steps count from 1.
///
/// A Gaussian that grows is replaced by two, one on each side of its centre on its longest axis. They have together its mass (opacity
/// times volume), its centre and its covariance: with the longest standard deviation `s` of the parent, `a` [`shorter`](Self::shorter)
///
/// ```text
/// s' = a s,   centre +- sqrt(1 - a^2) s,   opacity' = opacity / (2 a)
/// ```
///
/// A clone has all of its parent's opacity, and a random split has no mass in common with it: both make the next pictures worse by
/// 0.5 to 1 dB, until some fifty steps have mended it.
///
/// # Source
/// The split along the longest axis: Deng et al., "Improving densification in 3D Gaussian splatting for high-fidelity rendering", 2025.
/// That the moments are kept, and so the constants, is ours.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct AxisSplit {
    /// Grow and prune only after this step.
    pub after: u64,
    /// Grow and prune only before this step.
    pub until: u64,
    /// Grow and prune at steps divisible by this.
    pub every: u64,
    /// Split where the mean view-space positional gradient ([`ViewSpaceGradients::mean`](super::ViewSpaceGradients::mean)) is at
    /// least this.
    pub gradient_threshold: f32,
    /// Longest standard deviation of the children in that of their parent, at least 1/2.
    pub shorter: f64,
    /// Fade at steps divisible by this. The more often, and the less each time, the less a picture differs from the one before.
    pub fade_every: u64,
    /// Factor on opacities each time, down to [`decay_to`](Self::decay_to): those that no photo needs fade.
    pub decay: f64,
    /// Opacities fall no lower than this by decay.
    pub decay_to: f64,
    /// Prune Gaussians with a smaller opacity.
    pub opacity_min: f64,
}

impl AxisSplit {
    /// The children's offset and standard deviation on the axis are the same; step and threshold are those of 3DGS.
    pub const DEFAULT: Self = Self {
        after: 500,
        until: 15_000,
        every: 100,
        gradient_threshold: 2e-4,
        shorter: core::f64::consts::FRAC_1_SQRT_2,
        fade_every: 100,
        decay: 1.0,
        decay_to: 1.0 / 128.0,
        opacity_min: 0.005,
    };

    float_core::setters! {
        with_after after: u64;
        with_until until: u64;
        with_every every: u64;
        with_gradient_threshold gradient_threshold: f32;
        with_shorter shorter: f64;
        with_fade_every fade_every: u64;
        with_decay decay: f64;
        with_decay_to decay_to: f64;
        with_opacity_min opacity_min: f64;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let share = |x: f64| x > 0.0 && x < 1.0;
        let threshold = f64::from(self.gradient_threshold);
        let checks = [
            ("every", self.every as f64, self.every > 0, "at least 1"),
            ("fade_every", self.fade_every as f64, self.fade_every > 0, "at least 1"),
            ("gradient_threshold", threshold, threshold > 0.0 && threshold.is_finite(), "a positive number"),
            ("shorter", self.shorter, (0.5..1.0).contains(&self.shorter), "a number from 0.5 to 1, 1 excluded"),
            ("decay", self.decay, self.decay > 0.0 && self.decay <= 1.0, "a number above 0, at most 1"),
            ("decay_to", self.decay_to, share(self.decay_to), "a number between 0 and 1"),
            ("opacity_min", self.opacity_min, share(self.opacity_min), "a number between 0 and 1"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got, accepts }),
            None => Ok(()),
        }
    }

    /// Whether to [`grow`](Self::grow) and [`prune`](Self::prune) at the end of this step.
    #[must_use]
    pub fn grows_at(&self, step: u64) -> bool {
        self.changes_at(step, self.every)
    }

    /// Whether to [`fade`](Self::fade) at the end of this step.
    #[must_use]
    pub fn fades_at(&self, step: u64) -> bool {
        self.changes_at(step, self.fade_every)
    }

    fn changes_at(&self, step: u64, every: u64) -> bool {
        step > self.after && step < self.until && step.is_multiple_of(every)
    }

    /// How many there may be after the change of a step: what room is left up to `max` is given out evenly over the changes to come,
    /// all of it at the last one.
    #[must_use]
    pub fn room(&self, step: u64, n: usize, max: usize) -> usize {
        let left = self.until.saturating_sub(step).div_ceil(self.every.max(1)).max(1);
        n + max.saturating_sub(n).div_ceil(usize::try_from(left).unwrap_or(usize::MAX))
    }

    /// Split the Gaussians with a large view-space gradient. `view_space_gradient` `[n]` is the mean for each of them. The new rows are
    /// those that stay, then the pairs of children, each in the order of their sources. If there would be more than `max` rows, those
    /// with the largest gradients are split, ties by index.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range, wrong lengths or more Gaussians than `u32` can count.
    pub fn grow(&self, cloud: &Gaussians, view_space_gradient: &[f32], max: usize) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        if view_space_gradient.len() != n {
            return Err(SplatError::Shape { what: "view_space_gradient", want: n, got: view_space_gradient.len() });
        }
        countable(n)?;
        let split = hottest(view_space_gradient, self.gradient_threshold, max.saturating_sub(n));
        let rows = split_and_cloned(n, &split, &[])?;
        let mut out = rows.follow(cloud)?;
        let first = rows.len() - 2 * split.len();
        for (k, &parent) in split.iter().enumerate() {
            self.place_children(cloud, parent as usize, &mut out, first + 2 * k);
        }
        Ok(Change { cloud: out, rows })
    }

    /// Make two copies of a parent, at rows `at` and `at + 1` of `out`, its children.
    fn place_children(&self, cloud: &Gaussians, parent: usize, out: &mut Gaussians, at: usize) {
        let (n, len) = (cloud.len(), out.len());
        let (s, r) = (scales(cloud, parent), rotation(cloud, parent));
        let longest = (1..3).fold(0, |axis, k| if s[k] > s[axis] { k } else { axis });
        let offset = m64::sqrt(1.0 - self.shorter * self.shorter) * s[longest];
        let logit = logit(opacity(cloud, parent) / (2.0 * self.shorter));
        for (child, sign) in [(at, 1.0), (at + 1, -1.0)] {
            for (k, row) in r.iter().enumerate() {
                out.mean[k * len + child] =
                    (f64::from(cloud.mean[k * n + parent]) + sign * offset * row[longest]) as f32;
            }
            out.log_scale[longest * len + child] += m64::ln(self.shorter) as f32;
            out.logit[child] = logit;
        }
    }

    /// Lower all opacities that are above [`decay_to`](Self::decay_to), by the factor [`decay`](Self::decay), to no less than that.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    ///
    /// # Source
    /// LiteGS (Moore Threads, 2025): half of it every ten epochs, instead of the resets of 3DGS.
    pub fn fade(&self, cloud: &mut Gaussians) -> Result<(), SplatError> {
        self.check()?;
        cloud.check()?;
        if self.decay < 1.0 {
            let mut parts: Vec<&mut [f32]> = cloud.logit.chunks_mut(CHUNK).collect();
            for_each(&mut parts, |_, part| {
                for x in part.iter_mut() {
                    let o = m64::logistic(f64::from(*x));
                    let faded = (self.decay * o).max(self.decay_to);
                    // Not `min`, which would replace NaN.
                    if faded < o {
                        *x = logit(faded);
                    }
                }
            });
        }
        Ok(())
    }

    /// Remove Gaussians that are too transparent. `exempt` ones stay.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn prune(&self, cloud: &Gaussians, exempt: impl Fn(usize) -> bool) -> Result<Rows, SplatError> {
        self.check()?;
        cloud.check()?;
        Rows::keep(cloud.len(), |i| exempt(i) || opacity(cloud, i) >= self.opacity_min)
    }
}

impl Default for AxisSplit {
    fn default() -> Self {
        Self::DEFAULT
    }
}
