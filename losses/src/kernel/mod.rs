//! Kernels: the cost of one error, and its derivative.
//!
//! Letters: `x` is an error `prediction - target` in colour units, `c` and `delta` are scales in the same unit. Every
//! kernel is a pair of plain functions, `f(x, ..)` and `f_derivative(x, ..)`, finite for every finite `x` whose cost fits
//! an `f32`; NaN stays NaN. [`Kernel`] names them as data, for configurations and for [`crate::photometric`].

mod charbonnier;
mod huber;
mod l1;
mod log_squared;
mod squared;

pub use charbonnier::{charbonnier, charbonnier_derivative};
pub use huber::{NGP_DELTA, NGP_DIVISOR, huber, huber_derivative, huber_ngp, huber_ngp_derivative};
pub use l1::{l1, l1_derivative};
pub use log_squared::{LOG_EPS, log_squared, log_squared_derivative};
pub use squared::{squared, squared_derivative};

use crate::LossError;

/// A kernel with its parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Kernel {
    /// [`squared`].
    Squared,
    /// [`l1`].
    L1,
    /// [`charbonnier`].
    Charbonnier {
        /// Width of the rounded tip, colour units, `>= 0`.
        c: f32,
    },
    /// [`huber`].
    Huber {
        /// Where the parabola ends, colour units, `> 0`.
        delta: f32,
    },
    /// [`huber_ngp`].
    HuberNgp,
    /// [`log_squared`].
    LogSquared {
        /// Added before the logarithm, colour units, `> 0`.
        eps: f32,
    },
}

impl Kernel {
    /// Charbonnier as mip-NeRF 360 trains with, `c = 0.001`.
    pub const CHARBONNIER_360: Self = Self::Charbonnier { c: 1e-3 };

    /// Cost of predicting `prediction` where `target` is right.
    #[inline]
    #[must_use]
    pub fn value(self, prediction: f32, target: f32) -> f32 {
        match self {
            Self::Squared => squared(prediction - target),
            Self::L1 => l1(prediction - target),
            Self::Charbonnier { c } => charbonnier(prediction - target, c),
            Self::Huber { delta } => huber(prediction - target, delta),
            Self::HuberNgp => huber_ngp(prediction - target),
            Self::LogSquared { eps } => log_squared(prediction, target, eps),
        }
    }

    /// Derivative of [`Kernel::value`] with respect to `prediction`.
    #[inline]
    #[must_use]
    pub fn derivative(self, prediction: f32, target: f32) -> f32 {
        match self {
            Self::Squared => squared_derivative(prediction - target),
            Self::L1 => l1_derivative(prediction - target),
            Self::Charbonnier { c } => charbonnier_derivative(prediction - target, c),
            Self::Huber { delta } => huber_derivative(prediction - target, delta),
            Self::HuberNgp => huber_ngp_derivative(prediction - target),
            Self::LogSquared { eps } => log_squared_derivative(prediction, target, eps),
        }
    }

    /// Whether the parameters are usable.
    ///
    /// # Errors
    /// [`LossError::Parameter`] naming the one that is not.
    pub fn check(self) -> Result<(), LossError> {
        let positive = |what, value: f32| {
            let good = value > 0.0 && value.is_finite();
            if good { Ok(()) } else { Err(LossError::Parameter { what, value, range: "a finite number above 0" }) }
        };
        match self {
            Self::Squared | Self::L1 | Self::HuberNgp => Ok(()),
            // c = 0 is L1.
            Self::Charbonnier { c: 0.0 } => Ok(()),
            Self::Charbonnier { c } => positive("`c` of the Charbonnier kernel", c),
            Self::Huber { delta } => positive("`delta` of the Huber kernel", delta),
            Self::LogSquared { eps } => positive("`eps` of the log-squared kernel", eps),
        }
    }
}
