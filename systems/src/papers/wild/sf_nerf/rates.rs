//! Learning rates of the filter: the branch of the features and the joined layers are held back until the branch of the place
//! has found where occluders are.

/// Learning rate of the layers that are held back, relative to that of the branch of the place.
const HELD: f64 = 0.1;

/// Learning rates, relative to that of the field's networks.
pub(super) struct Rates {
    pub(super) filter: f64,
    pub(super) codes: f64,
    /// Steps in which all but the branch of the place is held back, and steps until it is not.
    pub(super) hold: u64,
    pub(super) ease: u64,
}

impl Rates {
    /// Learning rate of the layers that are held back, relative to that of the branch of the place: [`HELD`], then along a
    /// cosine up to 1.
    pub(super) fn eased(&self, step: u64) -> f64 {
        let x = if self.ease == 0 { 1.0 } else { (step.saturating_sub(self.hold) as f64 / self.ease as f64).min(1.0) };
        if step < self.hold { HELD } else { HELD + (1.0 - HELD) * 0.5 * (1.0 - (std::f64::consts::PI * x).cos()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_held_back_then_let_go() {
        let rates = Rates { filter: 1.0, codes: 1.0, hold: 100, ease: 50 };
        assert_eq!([0, 99, 100, 150, 1_000_000].map(|step| rates.eased(step)), [HELD, HELD, HELD, 1.0, 1.0]);
        assert!((rates.eased(125) - 0.55).abs() < 1e-12);
        assert_eq!(Rates { hold: 0, ease: 0, ..rates }.eased(0), 1.0);
    }
}
