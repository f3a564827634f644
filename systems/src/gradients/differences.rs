//! Gradients of rays beside differences of the loss: for the tests of all that give them.

use std::fmt::Display;

/// Components of a gradient that are compared one by one.
pub(crate) struct Differences {
    /// The largest component of the gradient; distances are shares of it.
    largest: f64,
    /// Largest distance.
    bound: f64,
    kinks: usize,
    checked: usize,
}

impl Differences {
    pub(crate) fn new(largest: f64, bound: f64) -> Self {
        Self { largest, bound, kinks: 0, checked: 0 }
    }

    /// Compare a component with `want`. Two `estimates` by differences that disagree lie at a kink: rectified units and the faces of
    /// cells have no derivative there.
    pub(crate) fn compare(&mut self, what: impl Display, got: f64, estimates: [f64; 2], want: f64) {
        let Self { largest, bound, .. } = *self;
        self.checked += 1;
        if (estimates[0] - estimates[1]).abs() > 1e-2 * largest {
            self.kinks += 1;
            return;
        }
        let off = (want - got).abs();
        assert!(off < bound * largest, "{what}: differences say {want}, the gradient {got} of {largest}");
    }

    /// Most components are at no kink.
    pub(crate) fn end(self) {
        let Self { kinks, checked, .. } = self;
        assert!(4 * kinks < checked, "{kinks} of {checked} at kinks");
    }
}
