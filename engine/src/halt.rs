//! A wish to stop that long work checks between its smallest parts: a few rays of a picture, a chunk of densities.
//!
//! What was being drawn when the wish came is not whole: check [`Halt::raised`] before it is used.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A flag that is raised from outside, once and for good; or none.
#[derive(Clone, Debug, Default)]
pub struct Halt(Option<Arc<AtomicBool>>);

impl Halt {
    /// Never raised.
    pub const NEVER: Self = Self(None);

    /// Raised when `flag` is.
    #[must_use]
    pub fn on(flag: Arc<AtomicBool>) -> Self {
        Self(Some(flag))
    }

    /// Whether work should end.
    #[must_use]
    pub fn raised(&self) -> bool {
        self.0.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed))
    }
}

/// What is asked for does not depend on who may stop it.
impl PartialEq for Halt {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_halt_is_raised_with_its_flag() {
        let flag = Arc::new(AtomicBool::new(false));
        let halt = Halt::on(flag.clone());
        assert!(!halt.raised() && !Halt::NEVER.raised());
        flag.store(true, Ordering::Relaxed);
        assert!(halt.raised() && halt.clone().raised() && !Halt::NEVER.raised());
    }
}
