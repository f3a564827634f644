//! Adaptive density control: clone, split, prune, reset opacities.

use alloc::vec::Vec;

use float_core::m64;
use float_core::rng::Rng;

use super::rows::{countable, hottest, split_and_cloned};
use super::{Change, Rows, largest_scale, logit, opacity, rotation, scales};
use crate::{Gaussians, SplatError};

/// Settings of adaptive density control. Steps count from 1.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting", 2023, section 5.2 and algorithm 1; the constants are those of the released code.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Adc {
    /// Grow and prune only after this step.
    pub after: u64,
    /// Grow, prune and reset opacities only before this step.
    pub until: u64,
    /// Grow and prune at steps divisible by this.
    pub every: u64,
    /// Reset opacities at steps divisible by this.
    pub reset_every: u64,
    /// Prune by size only after this step.
    pub size_after: u64,
    /// Densify where the mean view-space positional gradient ([`ViewSpaceGradients::mean`](super::ViewSpaceGradients::mean)) is at
    /// least this (3DGS `densify_grad_threshold`). It depends on the gradients that are collected: 2e-4 for plain ones, larger for
    /// absolute ones (8e-4 in gsplat, 4e-4 in AbsGS).
    pub gradient_threshold: f32,
    /// Of these, Gaussians with a larger standard deviation than this, in units of the scene's extent, are split; others are cloned.
    pub split_above: f64,
    /// The children of a split have their parent's scale divided by this.
    pub shrink: f64,
    /// Prune Gaussians with a smaller opacity.
    pub opacity_min: f64,
    /// Prune Gaussians with a larger standard deviation, in units of the scene's extent. Infinite: never.
    pub size_max: f64,
    /// An opacity reset lowers opacities to at most this.
    pub reset_to: f64,
}

impl Adc {
    /// The constants of 3DGS.
    pub const DEFAULT: Self = Self {
        after: 500,
        until: 15_000,
        every: 100,
        reset_every: 3000,
        size_after: 3000,
        gradient_threshold: 2e-4,
        split_above: 0.01,
        shrink: 1.6,
        opacity_min: 0.005,
        size_max: 0.1,
        reset_to: 0.01,
    };

    float_core::setters! {
        with_after after: u64;
        with_until until: u64;
        with_every every: u64;
        with_reset_every reset_every: u64;
        with_size_after size_after: u64;
        with_gradient_threshold gradient_threshold: f32;
        with_split_above split_above: f64;
        with_shrink shrink: f64;
        with_opacity_min opacity_min: f64;
        with_size_max size_max: f64;
        with_reset_to reset_to: f64;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let share = |x: f64| x > 0.0 && x < 1.0;
        let checks = [
            ("every", self.every as f64, self.every > 0, "at least 1"),
            ("reset_every", self.reset_every as f64, self.reset_every > 0, "at least 1"),
            (
                "gradient_threshold",
                f64::from(self.gradient_threshold),
                positive(f64::from(self.gradient_threshold)),
                "a positive number",
            ),
            ("split_above", self.split_above, positive(self.split_above), "a positive number"),
            ("shrink", self.shrink, positive(self.shrink), "a positive number"),
            ("opacity_min", self.opacity_min, share(self.opacity_min), "a number between 0 and 1"),
            ("size_max", self.size_max, self.size_max > 0.0, "a positive number or infinity"),
            ("reset_to", self.reset_to, share(self.reset_to), "a number between 0 and 1"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got, accepts }),
            None => Ok(()),
        }
    }

    /// Whether to [`grow`](Self::grow) and [`prune`](Self::prune) at the end of this step.
    #[must_use]
    pub fn grows_at(&self, step: u64) -> bool {
        step > self.after && step < self.until && step.is_multiple_of(self.every)
    }

    /// Whether to [reset opacities](Self::reset_opacity) at the end of this step.
    #[must_use]
    pub fn resets_at(&self, step: u64) -> bool {
        step > 0 && step < self.until && step.is_multiple_of(self.reset_every)
    }

    /// Densify: Gaussians with a large view-space gradient are cloned if they are small and split if they are large. A clone is an exact
    /// copy; the two children of a split are drawn from their parent, which is removed.
    ///
    /// `view_space_gradient` `[n]` is the mean for each Gaussian; `extent` of the scene in world units. The new rows are those that
    /// stay, then the clones, then pairs of children, each in the order of their sources. If there would be more than `max` rows, those
    /// with the largest gradients grow, ties by index.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range, wrong lengths or more Gaussians than `u32` can count.
    pub fn grow(
        &self,
        cloud: &Gaussians,
        view_space_gradient: &[f32],
        extent: f64,
        max: usize,
        rng: Rng,
    ) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        if view_space_gradient.len() != n {
            return Err(SplatError::Shape { what: "view_space_gradient", want: n, got: view_space_gradient.len() });
        }
        countable(n)?;
        let growing = hottest(view_space_gradient, self.gradient_threshold, max.saturating_sub(n));
        let (split, cloned): (Vec<u32>, Vec<u32>) =
            growing.into_iter().partition(|&i| largest_scale(cloud, i as usize) > self.split_above * extent);
        let rows = split_and_cloned(n, &split, &cloned)?;
        let mut out = rows.follow(cloud)?;
        let (len, first) = (out.len(), rows.len() - 2 * split.len());
        let smaller = m64::ln(self.shrink);
        for (k, &parent) in split.iter().enumerate() {
            let parent = parent as usize;
            let (s, r) = (scales(cloud, parent), rotation(cloud, parent));
            for child in 0..2 {
                let at = first + 2 * k + child;
                let eta = [0, 1, 2].map(|a| f64::from(rng.normal_at((6 * parent + 3 * child + a) as u64)));
                for (a, row) in r.iter().enumerate() {
                    let offset: f64 = (0..3).map(|b| row[b] * s[b] * eta[b]).sum();
                    out.mean[a * len + at] = (f64::from(cloud.mean[a * n + parent]) + offset) as f32;
                    out.log_scale[a * len + at] = (f64::from(cloud.log_scale[a * n + parent]) - smaller) as f32;
                }
            }
        }
        Ok(Change { cloud: out, rows })
    }

    /// Remove Gaussians that are too transparent and, after step `size_after`, those that are too large. `exempt` ones stay.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn prune(
        &self,
        cloud: &Gaussians,
        extent: f64,
        step: u64,
        exempt: impl Fn(usize) -> bool,
    ) -> Result<Rows, SplatError> {
        self.check()?;
        cloud.check()?;
        let faint = |i| opacity(cloud, i) < self.opacity_min;
        let large = |i| step > self.size_after && largest_scale(cloud, i) > self.size_max * extent;
        Rows::keep(cloud.len(), |i| exempt(i) || !(faint(i) || large(i)))
    }

    /// Opacity reset: lower the opacity of every Gaussian for which `resets` is true to at most `reset_to`. Set the optimiser's moments
    /// of these logits to 0 afterwards.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn reset_opacity(&self, cloud: &mut Gaussians, resets: impl Fn(usize) -> bool) -> Result<(), SplatError> {
        self.check()?;
        cloud.check()?;
        let most = logit(self.reset_to);
        for (_, x) in cloud.logit.iter_mut().enumerate().filter(|&(i, _)| resets(i)) {
            // Not `min`, which would replace NaN.
            if *x > most {
                *x = most;
            }
        }
        Ok(())
    }
}

impl Default for Adc {
    fn default() -> Self {
        Self::DEFAULT
    }
}
