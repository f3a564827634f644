//! Which rays of a batch of patches to learn from: small errors, their neighbours, and patches that are mostly small errors.
//!
//! Letters: `e` error of a ray (the norm over channels, or the mean of squares: only its order counts), `tau` threshold,
//! `p` side of a patch. Four steps, each keeps what the one before kept:
//!
//! 1. **trim**: `inlier = [e <= tau]`, `tau` an order statistic of the batch;
//! 2. **diffuse**: `W = inlier or [mean of inlier over 3x3 >= 1/2]`: a pixel among inliers is one;
//! 3. **vote**: `[mean of W over the patch >= 0.6]` makes the whole inner block inliers: fine texture, which errs most, learns
//!    where most of its surroundings do;
//! 4. `weight = W or vote` inside the inner block, `W` outside it.
//!
//! Weights are constants of the loss: no gradient flows through them. Divide the weighted loss by the number of rays, as
//! [`crate::photometric::mean`] does, not by the sum of weights; with all weights 0 it is 0. On data without outliers the
//! first step throws away half of what there is to learn: leave it out there.
//!
//! Source: Sabour, Vora, Duckworth, Krasin, Fleet, Tagliasacchi, "RobustNeRF: ignoring distractors with robust losses", 2023,
//! section 4.

use crate::{LossError, error::same, order::lower_quantile};
use alloc::vec::Vec;

/// What the 3x3 mean sees beyond the edge of a patch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Border {
    /// Nothing: the mean is over the 4, 6 or 9 pixels that there are.
    #[default]
    Valid,
    /// Outliers, as the released code pads: always over 9, so that a corner (three neighbours) can never be recovered.
    Zero,
}

/// What the vote of a patch is the mean of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum VoteOn {
    /// `W`, as published.
    #[default]
    Diffused,
    /// The inliers of the first step, as NeRF-HuGS ports it.
    Inliers,
}

/// What happens at equality.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Compare {
    /// An error at the threshold is an inlier, a mean at its threshold is enough: equal errors are all inliers.
    #[default]
    AtMost,
    /// An error at the threshold is an outlier, a mean has to exceed its threshold, as released: equal errors are all
    /// outliers.
    Below,
}

/// The trimmed, diffused and patch-voted weights of RobustNeRF. `default()` is as published.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct TrimmedMask {
    /// Share of the batch that counts as inliers, `[0, 1]`: 0.5. The released configuration has 0.8, of the batch before.
    pub quantile: f32,
    /// What the 3x3 mean has to reach: 0.5.
    pub diffuse: f32,
    /// What the mean over a patch has to reach: 0.6. Released: more than 0.5.
    pub vote: f32,
    /// Side of a patch, pixels: 16.
    pub patch: usize,
    /// Side of the centred block that the vote speaks for, at most `patch`: 8.
    pub inner: usize,
    /// Beyond the edge of a patch.
    pub border: Border,
    /// What votes.
    pub vote_on: VoteOn,
    /// At equality.
    pub compare: Compare,
}

impl Default for TrimmedMask {
    fn default() -> Self {
        Self {
            quantile: 0.5,
            diffuse: 0.5,
            vote: 0.6,
            patch: 16,
            inner: 8,
            border: Border::default(),
            vote_on: VoteOn::default(),
            compare: Compare::default(),
        }
    }
}

/// How many errors are NaN or infinite: [`TrimmedMask::weights`] makes them outliers, whoever trains should say so.
#[must_use]
pub fn count_non_finite(residuals: &[f32]) -> usize {
    residuals.iter().filter(|e| !e.is_finite()).count()
}

impl TrimmedMask {
    float_core::setters! {
        with_quantile quantile: f32;
        with_diffuse diffuse: f32;
        with_vote vote: f32;
        with_patch patch: usize;
        with_inner inner: usize;
        with_border border: Border;
        with_vote_on vote_on: VoteOn;
        with_compare compare: Compare;
    }

    /// Whether the parameters are usable.
    ///
    /// # Errors
    /// [`LossError::Parameter`] naming the one that is not.
    pub fn check(&self) -> Result<(), LossError> {
        let shares = [
            ("`quantile` of the trimmed mask", self.quantile),
            ("`diffuse` of the trimmed mask", self.diffuse),
            ("`vote` of the trimmed mask", self.vote),
        ];
        for (what, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                return Err(LossError::Parameter { what, value, range: "0 to 1" });
            }
        }
        if self.patch == 0 {
            return Err(LossError::Parameter { what: "`patch` of the trimmed mask", value: 0.0, range: "1 or more" });
        }
        if self.patch.checked_mul(self.patch).is_none_or(|area| area > isize::MAX as usize) {
            let (what, value) = ("`patch` of the trimmed mask", self.patch as f32);
            return Err(LossError::Parameter { what, value, range: "a side whose square can be counted" });
        }
        if self.inner > self.patch {
            let (what, value) = ("`inner` of the trimmed mask", self.inner as f32);
            return Err(LossError::Parameter { what, value, range: "at most `patch`" });
        }
        Ok(())
    }

    /// The threshold `tau` of a batch: the smallest error that the share `quantile` of the errors does not exceed (one half of
    /// an even number: the lower median).
    ///
    /// * `residuals` any number of errors, in any order; NaN counts as the largest
    /// * `scratch` grows to as many values and is kept by the caller
    ///
    /// `+inf` for no errors, and where the share reaches into those that are NaN: then all others are inliers.
    #[must_use]
    pub fn threshold(&self, residuals: &[f32], scratch: &mut Vec<f32>) -> f32 {
        lower_quantile(residuals, self.quantile, scratch)
    }

    /// Weight of every ray, 0 or 1.
    ///
    /// # Shapes and units
    /// * `residuals` `[patches][p * p]` errors, each patch row by row; NaN and infinite ones are outliers (they may still be
    ///   recovered by their neighbours or their patch, as any outlier)
    /// * `threshold` in the same unit, usually [`TrimmedMask::threshold`] of this or the previous batch
    /// * `scratch` grows to `p * p` values and is kept by the caller
    /// * `out` `[patches][p * p]` written
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree or are not whole patches, [`LossError::Parameter`] as [`TrimmedMask::check`].
    pub fn weights(
        &self,
        residuals: &[f32],
        threshold: f32,
        scratch: &mut Vec<f32>,
        out: &mut [f32],
    ) -> Result<(), LossError> {
        self.check()?;
        let area = self.patch * self.patch;
        same("residuals", residuals.len().div_ceil(area) * area, residuals.len())?;
        same("out", residuals.len(), out.len())?;
        scratch.clear();
        // Nothing for no patches, whatever their size.
        scratch.resize(area.min(residuals.len()), 0.0);
        for (e, out) in residuals.chunks_exact(area).zip(out.chunks_exact_mut(area)) {
            self.patch(e, threshold, scratch, out);
        }
        Ok(())
    }

    /// One patch.
    fn patch(&self, e: &[f32], threshold: f32, inlier: &mut [f32], out: &mut [f32]) {
        for (inlier, &e) in inlier.iter_mut().zip(e) {
            let small = match self.compare {
                Compare::AtMost => e <= threshold,
                Compare::Below => e < threshold,
            };
            *inlier = f32::from(u8::from(small && e.is_finite()));
        }
        self.diffuse(inlier, out);
        let kept: f32 = match self.vote_on {
            VoteOn::Diffused => out.iter().sum(),
            VoteOn::Inliers => inlier.iter().sum(),
        };
        if self.reaches(kept / e.len() as f32, self.vote) {
            let start = (self.patch - self.inner) / 2;
            for row in out.chunks_exact_mut(self.patch).skip(start).take(self.inner) {
                row[start..start + self.inner].fill(1.0);
            }
        }
    }

    /// `out = inlier or [3x3 mean reaches its threshold]`.
    fn diffuse(&self, inlier: &[f32], out: &mut [f32]) {
        let p = self.patch;
        let around = |i: usize| i.saturating_sub(1)..(i + 2).min(p);
        for (i, out) in out.iter_mut().enumerate() {
            let (rows, columns) = (around(i / p), around(i % p));
            let count = match self.border {
                Border::Valid => rows.len() * columns.len(),
                Border::Zero => 9,
            };
            let kept: f32 = rows.map(|y| inlier[y * p..][columns.clone()].iter().sum::<f32>()).sum();
            // Counts up to 2^24 are exact, and one division rounds as the threshold itself was rounded: no tie is lost.
            let diffused = self.reaches(kept / count as f32, self.diffuse);
            *out = if diffused { 1.0 } else { inlier[i] };
        }
    }

    fn reaches(&self, mean: f32, threshold: f32) -> bool {
        match self.compare {
            Compare::AtMost => mean >= threshold,
            Compare::Below => mean > threshold,
        }
    }
}
