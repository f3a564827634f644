//! Adaptive density control: clone, split, prune, fade.

use alloc::vec::Vec;

use field_core::rng::Rng;
use float_core::m64;

use super::rows::countable;
use super::{Change, Rows, largest_scale, opacity, rotation, scales};
use crate::{Gaussians, SplatError};

/// Constants of adaptive density control. Steps count from 1.
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting", 2023, section 5.2 and algorithm 1; the numbers are those of the released code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adc {
    /// Grow and prune at steps above this,
    pub after: u64,
    /// below this,
    pub until: u64,
    /// and divisible by this.
    pub every: u64,
    /// Fade at steps below `until` divisible by this.
    pub fade_every: u64,
    /// Prune by size at steps above this.
    pub size_after: u64,
    /// Average pull ([`Pull::mean`](super::Pull::mean)) from which a Gaussian is hot. 8e-4 for absolute gradients.
    pub hot: f32,
    /// Hot ones larger than this share of the scene's extent are split, others cloned.
    pub split_above: f64,
    /// Children of a split are smaller by this.
    pub shrink: f64,
    /// Fainter ones are pruned.
    pub opacity_min: f64,
    /// Those larger than this share of the extent are pruned; infinite: none.
    pub size_max: f64,
    /// Fading leaves no more than this opacity.
    pub fade_to: f64,
}

impl Adc {
    /// Those of 3DGS.
    pub const DEFAULT: Self = Self {
        after: 500,
        until: 15_000,
        every: 100,
        fade_every: 3000,
        size_after: 3000,
        hot: 2e-4,
        split_above: 0.01,
        shrink: 1.6,
        opacity_min: 0.005,
        size_max: 0.1,
        fade_to: 0.01,
    };

    /// # Errors
    /// [`SplatError::Value`] naming the first constant outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        let positive = |x: f64| x > 0.0 && x.is_finite();
        let share = |x: f64| x > 0.0 && x < 1.0;
        let checks = [
            ("every", self.every as f64, self.every > 0, "at least 1"),
            ("fade_every", self.fade_every as f64, self.fade_every > 0, "at least 1"),
            ("hot", f64::from(self.hot), positive(f64::from(self.hot)), "a positive number"),
            ("split_above", self.split_above, positive(self.split_above), "a positive number"),
            ("shrink", self.shrink, positive(self.shrink), "a positive number"),
            ("opacity_min", self.opacity_min, share(self.opacity_min), "a number between 0 and 1"),
            ("size_max", self.size_max, self.size_max > 0.0, "a positive number or infinity"),
            ("fade_to", self.fade_to, share(self.fade_to), "a number between 0 and 1"),
        ];
        match checks.into_iter().find(|(_, _, fine, _)| !fine) {
            Some((what, got, _, accepts)) => Err(SplatError::Value { what, got, accepts }),
            None => Ok(()),
        }
    }

    /// Whether a step ends with growing and pruning.
    #[must_use]
    pub fn grows_at(&self, step: u64) -> bool {
        step > self.after && step < self.until && step.is_multiple_of(self.every)
    }

    /// Whether a step ends with fading.
    #[must_use]
    pub fn fades_at(&self, step: u64) -> bool {
        step > 0 && step < self.until && step.is_multiple_of(self.fade_every)
    }

    /// Two where one was and is pulled at: small ones are doubled in place, large ones give way to two smaller ones drawn from
    /// them. `pull` `[n]`; `extent` of the scene, world units.
    ///
    /// Afterwards: those that stay, then copies of the cloned, then pairs of children, each in the order of their sources. Where
    /// there would be more than `max`, the hottest come first, and among equals the first.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range, wrong lengths or more Gaussians than an index can count.
    pub fn grow(
        &self,
        cloud: &Gaussians,
        pull: &[f32],
        extent: f64,
        max: usize,
        rng: Rng,
    ) -> Result<Change, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        if pull.len() != n {
            return Err(SplatError::Shape { what: "pull", want: n, got: pull.len() });
        }
        countable(n)?;
        let mut hot: Vec<u32> = (0..n as u32).filter(|&i| pull[i as usize] >= self.hot).collect();
        let room = max.saturating_sub(n);
        if hot.len() > room {
            hot.sort_by(|&a, &b| pull[b as usize].total_cmp(&pull[a as usize]).then(a.cmp(&b)));
            hot.truncate(room);
            hot.sort_unstable();
        }
        countable(n + hot.len())?;
        let (split, cloned): (Vec<u32>, Vec<u32>) =
            hot.into_iter().partition(|&i| largest_scale(cloud, i as usize) > self.split_above * extent);
        let mut parents = split.iter().copied().peekable();
        let stay = (0..n as u32).filter(|&i| parents.next_if_eq(&i).is_none());
        let children = split.iter().flat_map(|&i| [i, i]);
        let fresh = cloned.iter().copied().chain(children).map(|i| (i, true));
        let rows = Rows::of(n, stay.map(|i| (i, false)).chain(fresh));
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

    /// Without those that are too faint and, late enough, those that are too large; `exempt` ones stay whatever they are.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range or fields of the wrong length.
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

    /// Take opacity from all that `fades` says, so that only what pictures ask for comes back. Moments of these logits have lost
    /// their meaning and start anew.
    ///
    /// # Errors
    /// [`SplatError`] for constants out of range or fields of the wrong length.
    pub fn fade(&self, cloud: &mut Gaussians, fades: impl Fn(usize) -> bool) -> Result<(), SplatError> {
        self.check()?;
        cloud.check()?;
        let most = (m64::ln(self.fade_to) - m64::ln_1p(-self.fade_to)) as f32;
        for (_, x) in cloud.logit.iter_mut().enumerate().filter(|&(i, _)| fades(i)) {
            // Not `min`, which would make a number of NaN.
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
