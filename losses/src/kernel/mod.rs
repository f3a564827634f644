//! Kernels: the cost of one error, and its derivative.
//!
//! Letters: `x` is an error `prediction - target` in colour units, `c` and `delta` are scales in the same unit. Every
//! kernel is three plain functions, `f(x, ..)`, `f_derivative(x, ..)` and `f_weight(x, ..)`, finite for every finite `x` whose
//! cost fits an `f32`; NaN stays NaN. [`Kernel`] names them as data, for configurations and for [`crate::photometric`].
//!
//! The weight is `f'(x) / x`, with its limit at 0: to first order, minimising `f` is minimising `weight x^2 / 2` with the
//! weight held ([`crate::irls`]).
//!
//! Scale: the kernels that forget outliers ([`general`] and those it contains, [`tukey`], [`trimmed`]) take the error in
//! units of `c` and are `(x / c)^2 / 2` near 0, so that all weigh `1 / c^2` there. The others keep the scale they were
//! published with.

mod cauchy;
mod charbonnier;
mod geman_mcclure;
mod general;
mod huber;
mod l1;
mod log_squared;
mod squared;
mod tukey;
mod welsch;

pub use cauchy::{cauchy, cauchy_derivative, cauchy_weight};
pub use charbonnier::{charbonnier, charbonnier_derivative, charbonnier_weight};
pub use geman_mcclure::{geman_mcclure, geman_mcclure_derivative, geman_mcclure_weight};
pub use general::{general, general_derivative, general_weight};
pub use huber::{
    NGP_DELTA, NGP_DIVISOR, huber, huber_derivative, huber_ngp, huber_ngp_derivative, huber_ngp_weight, huber_weight,
};
pub use l1::{L1_WEIGHT_FLOOR, l1, l1_derivative, l1_weight};
pub use log_squared::{LOG_EPS, log_squared, log_squared_derivative, log_squared_weight};
pub use squared::{squared, squared_derivative, squared_weight};
pub use tukey::{trimmed, trimmed_derivative, trimmed_weight, tukey, tukey_derivative, tukey_weight};
pub use welsch::{welsch, welsch_derivative, welsch_weight};

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
    /// [`general`], all shapes and their limits.
    General {
        /// 2 least squares, 1 Charbonnier, 0 Cauchy, -2 Geman-McClure, `-inf` Welsch; any number but NaN.
        shape: f32,
        /// Errors well below count as in least squares, colour units, `> 0`.
        c: f32,
    },
    /// [`cauchy`].
    Cauchy {
        /// As in [`Kernel::General`].
        c: f32,
    },
    /// [`geman_mcclure`].
    GemanMcClure {
        /// As in [`Kernel::General`].
        c: f32,
    },
    /// [`welsch`].
    Welsch {
        /// As in [`Kernel::General`].
        c: f32,
    },
    /// [`tukey`].
    Tukey {
        /// From here on errors weigh nothing, colour units, `> 0`.
        c: f32,
    },
    /// [`trimmed`] least squares.
    Trimmed {
        /// Beyond it errors weigh nothing, colour units, `> 0`.
        c: f32,
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
            Self::General { shape, c } => general(prediction - target, shape, c),
            Self::Cauchy { c } => cauchy(prediction - target, c),
            Self::GemanMcClure { c } => geman_mcclure(prediction - target, c),
            Self::Welsch { c } => welsch(prediction - target, c),
            Self::Tukey { c } => tukey(prediction - target, c),
            Self::Trimmed { c } => trimmed(prediction - target, c),
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
            Self::General { shape, c } => general_derivative(prediction - target, shape, c),
            Self::Cauchy { c } => cauchy_derivative(prediction - target, c),
            Self::GemanMcClure { c } => geman_mcclure_derivative(prediction - target, c),
            Self::Welsch { c } => welsch_derivative(prediction - target, c),
            Self::Tukey { c } => tukey_derivative(prediction - target, c),
            Self::Trimmed { c } => trimmed_derivative(prediction - target, c),
        }
    }

    /// Weight of iteratively reweighted least squares: [`Kernel::derivative`] over `prediction - target`, its limit where
    /// they are equal. Finite and `>= 0` for finite colours.
    ///
    /// | kernel | at 0 |
    /// | --- | --- |
    /// | squared, Huber of Instant-NGP | 2 |
    /// | Huber | 1 |
    /// | L1, Charbonnier with `c = 0` | `1e6`: no limit, the error counts as at least [`L1_WEIGHT_FLOOR`] |
    /// | Charbonnier | `1 / c` |
    /// | log-squared | `2 / (target + eps)^2` |
    /// | general, Cauchy, Geman-McClure, Welsch, Tukey, trimmed | `1 / c^2` |
    #[inline]
    #[must_use]
    pub fn weight(self, prediction: f32, target: f32) -> f32 {
        match self {
            Self::Squared => squared_weight(prediction - target),
            Self::L1 => l1_weight(prediction - target),
            Self::Charbonnier { c } => charbonnier_weight(prediction - target, c),
            Self::Huber { delta } => huber_weight(prediction - target, delta),
            Self::HuberNgp => huber_ngp_weight(prediction - target),
            Self::LogSquared { eps } => log_squared_weight(prediction, target, eps),
            Self::General { shape, c } => general_weight(prediction - target, shape, c),
            Self::Cauchy { c } => cauchy_weight(prediction - target, c),
            Self::GemanMcClure { c } => geman_mcclure_weight(prediction - target, c),
            Self::Welsch { c } => welsch_weight(prediction - target, c),
            Self::Tukey { c } => tukey_weight(prediction - target, c),
            Self::Trimmed { c } => trimmed_weight(prediction - target, c),
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
            Self::General { shape, .. } if shape.is_nan() => {
                Err(LossError::Parameter { what: "`shape` of the general kernel", value: shape, range: "a number" })
            }
            Self::General { c, .. } => positive("`c` of the general kernel", c),
            Self::Cauchy { c } => positive("`c` of the Cauchy kernel", c),
            Self::GemanMcClure { c } => positive("`c` of the Geman-McClure kernel", c),
            Self::Welsch { c } => positive("`c` of the Welsch kernel", c),
            Self::Tukey { c } => positive("`c` of the Tukey kernel", c),
            Self::Trimmed { c } => positive("`c` of the trimmed kernel", c),
        }
    }
}
