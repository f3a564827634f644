//! A limit on steps with non-finite gradients.

use core::fmt;

/// Counts the steps in which a gradient was NaN or infinite and fails the run when they are too many.
///
/// The default allows 0.1 % of the steps. Early in a run a share means little, so it is taken of at least `min_steps`
/// steps: with 0.1 % of 1000, one such step is forgiven at any time and the second one fails a run younger than 2000
/// steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonFiniteGuard {
    share: f64,
    min_steps: u64,
    steps: u64,
    bad_steps: u64,
    entries: u64,
}

impl Default for NonFiniteGuard {
    /// 0.1 % of at least 1000 steps.
    fn default() -> Self {
        Self::new(0.001, 1000)
    }
}

/// More steps had non-finite gradients than allowed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TooManyNonFinite {
    /// Steps with a non-finite gradient.
    pub bad_steps: u64,
    /// All steps so far.
    pub steps: u64,
    /// How many of them were allowed to be bad.
    pub allowed: u64,
}

impl fmt::Display for TooManyNonFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bad_steps, steps, allowed } = self;
        write!(
            f,
            "gradients were NaN or infinite in {bad_steps} of {steps} steps, allowed are {allowed}: lower the learning rate or check the input"
        )
    }
}

impl core::error::Error for TooManyNonFinite {}

impl NonFiniteGuard {
    /// Allow this share of the steps, taken of at least `min_steps` of them.
    ///
    /// # Panics
    /// If the share is not in `[0, 1]`.
    #[must_use]
    pub fn new(share: f64, min_steps: u64) -> Self {
        assert!((0.0..=1.0).contains(&share), "share {share} of non-finite steps");
        Self { share, min_steps, steps: 0, bad_steps: 0, entries: 0 }
    }

    /// Continue from a checkpoint of [`NonFiniteGuard::steps`], [`NonFiniteGuard::bad_steps`] and
    /// [`NonFiniteGuard::entries`].
    #[must_use]
    pub fn resumed(self, steps: u64, bad_steps: u64, entries: u64) -> Self {
        Self { steps, bad_steps, entries, ..self }
    }

    /// Count a step in which `non_finite` entries of the gradient were NaN or infinite, over all parameter groups.
    ///
    /// # Errors
    /// If more steps than allowed had any. Counting goes on afterwards.
    pub fn record(&mut self, non_finite: usize) -> Result<(), TooManyNonFinite> {
        self.steps += 1;
        self.bad_steps += u64::from(non_finite > 0);
        self.entries += non_finite as u64;
        let allowed = (self.share * self.steps.max(self.min_steps) as f64) as u64;
        if self.bad_steps > allowed {
            return Err(TooManyNonFinite { bad_steps: self.bad_steps, steps: self.steps, allowed });
        }
        Ok(())
    }

    /// Steps counted.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Steps with any non-finite entry.
    #[must_use]
    pub fn bad_steps(&self) -> u64 {
        self.bad_steps
    }

    /// Non-finite entries over all steps.
    #[must_use]
    pub fn entries(&self) -> u64 {
        self.entries
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::string::ToString;

    #[test]
    fn one_bad_step_is_forgiven_and_the_second_fails_a_young_run() {
        let mut guard = NonFiniteGuard::default();
        guard.record(0).unwrap();
        guard.record(17).unwrap();
        let error = guard.record(1).unwrap_err();
        assert_eq!(error, TooManyNonFinite { bad_steps: 2, steps: 3, allowed: 1 });
        assert!(error.to_string().contains("in 2 of 3 steps, allowed are 1"));
        assert_eq!((guard.bad_steps(), guard.entries(), guard.steps()), (2, 18, 3));
    }

    #[test]
    fn an_old_run_may_have_its_share() {
        let mut guard = NonFiniteGuard::default();
        for step in 1..=10_000_u64 {
            // Exactly one in a thousand, at the end of each thousand.
            guard.record(usize::from(step.is_multiple_of(1000))).unwrap();
        }
        assert!(guard.record(1).is_err());
    }

    #[test]
    fn no_tolerance_fails_at_once_and_full_tolerance_never() {
        assert!(NonFiniteGuard::new(0.0, 1000).record(1).is_err());
        let mut guard = NonFiniteGuard::new(1.0, 0);
        assert!((0..100).all(|_| guard.record(1).is_ok()));
    }

    #[test]
    fn counts_survive_a_checkpoint() {
        let mut guard = NonFiniteGuard::default();
        guard.record(5).unwrap();
        let mut again = NonFiniteGuard::default().resumed(guard.steps(), guard.bad_steps(), guard.entries());
        assert_eq!(again, guard);
        assert!(again.record(1).is_err());
    }
}
