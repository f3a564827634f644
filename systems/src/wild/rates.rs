//! Learning rates of SF-NeRF's filter: what sees features and what joins both branches waits until the place has said where
//! strangers are.

/// Learning rate of the layers behind the branch of the place at first, as a part of that branch's.
const HELD: f64 = 0.1;

/// Learning rates, as parts of that of the field's networks.
pub(super) struct Rates {
    pub(super) filter: f64,
    pub(super) codes: f64,
    /// Steps the layers behind the branch of the place are held back, and steps until they are not.
    pub(super) hold: u64,
    pub(super) ease: u64,
}

impl Rates {
    /// What the layers behind the branch of the place learn at, as a part of what it learns at: [`HELD`], then along a cosine
    /// up to 1.
    pub(super) fn eased(&self, step: u64) -> f64 {
        let x = if self.ease == 0 { 1.0 } else { (step.saturating_sub(self.hold) as f64 / self.ease as f64).min(1.0) };
        if step < self.hold { HELD } else { HELD + (1.0 - HELD) * 0.5 * (1.0 - (std::f64::consts::PI * x).cos()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_behind_the_place_are_held_then_let_go() {
        let rates = Rates { filter: 1.0, codes: 1.0, hold: 100, ease: 50 };
        assert_eq!([0, 99, 100, 150, 1_000_000].map(|step| rates.eased(step)), [HELD, HELD, HELD, 1.0, 1.0]);
        assert!((rates.eased(125) - 0.55).abs() < 1e-12);
        assert_eq!(Rates { hold: 0, ease: 0, ..rates }.eased(0), 1.0);
    }
}
