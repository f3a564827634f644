//! Activations of the layers, each with its derivative written in terms of the *output*, so that nothing but outputs is kept.

use float_core::{Vector, m32, vecmath};

/// What follows a linear layer.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Activation {
    /// `y = x`.
    #[default]
    None,
    /// `max(x, 0)`; derivative 0 at 0.
    Relu,
    /// `x` where positive, else `slope * x`, `slope > 0`.
    LeakyRelu {
        /// Slope on the negative side.
        slope: f32,
    },
    /// `ln(1 + exp(x + shift))`. mip-NeRF uses `shift = -1`.
    Softplus {
        /// Added to the argument.
        shift: f32,
    },
    /// `(1 + 2 pad) / (1 + exp(-x)) - pad`. Colours of mip-NeRF use `pad = 0.001`; plain logistic has 0.
    Logistic {
        /// How far the output may leave `[0, 1]`.
        pad: f32,
    },
    /// Hyperbolic tangent.
    Tanh,
    /// `exp(x)`, clamped to finite values; the backward pass uses `exp(clamp(x, -15, 15))` (instant-ngp, `trunc_exp`).
    TruncExp,
}

/// Bounds of the argument in the derivative of [`Activation::TruncExp`], as exponentials: `exp(-15)`, `exp(15)`.
const TRUNC_EXP_RANGE: (f32, f32) = (3.059_023_3e-7, 3_269_017.4);

impl Activation {
    /// Plain logistic.
    pub const LOGISTIC: Self = Self::Logistic { pad: 0.0 };
    /// Plain softplus.
    pub const SOFTPLUS: Self = Self::Softplus { shift: 0.0 };

    /// The value at one point.
    #[must_use]
    pub fn value(self, x: f32) -> f32 {
        match self {
            Self::None => x,
            Self::Relu => x.max(0.0),
            Self::LeakyRelu { slope } => {
                if x > 0.0 {
                    x
                } else {
                    slope * x
                }
            }
            Self::Softplus { shift } => m32::softplus(x + shift),
            Self::Logistic { pad } => (1.0 + 2.0 * pad) * m32::logistic(x) - pad,
            Self::Tanh => m32::tanh(x),
            Self::TruncExp => m32::exp(x.clamp(-87.0, 88.0)),
        }
    }

    /// `dy/dx` given the output `y`.
    #[must_use]
    pub fn derivative_from_output(self, y: f32) -> f32 {
        match self {
            Self::None => 1.0,
            Self::Relu => {
                if y > 0.0 {
                    1.0
                } else {
                    0.0
                }
            }
            Self::LeakyRelu { slope } => {
                if y > 0.0 {
                    1.0
                } else {
                    slope
                }
            }
            // y = ln(1 + e^x)  =>  logistic(x) = 1 - e^-y.
            Self::Softplus { .. } => -m32::exp_m1(-y),
            Self::Logistic { pad } => {
                let p = (y + pad) / (1.0 + 2.0 * pad);
                (1.0 + 2.0 * pad) * p * (1.0 - p)
            }
            Self::Tanh => 1.0 - y * y,
            Self::TruncExp => y.clamp(TRUNC_EXP_RANGE.0, TRUNC_EXP_RANGE.1),
        }
    }

    /// Apply to the first `n` numbers of `y`, a multiple of the lanes.
    #[inline(always)]
    pub(super) fn apply<V: Vector>(self, y: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => {
                for c in y.chunks_exact_mut(V::LANES) {
                    V::load(c).max(V::splat(0.0)).store(c);
                }
            }
            Self::Logistic { pad } => {
                for c in y.chunks_exact_mut(V::LANES) {
                    vecmath::logistic(V::load(c)).mul_add(V::splat(1.0 + 2.0 * pad), V::splat(-pad)).store(c);
                }
            }
            Self::TruncExp => {
                for c in y.chunks_exact_mut(V::LANES) {
                    vecmath::exp(V::load(c)).store(c);
                }
            }
            _ => y.iter_mut().for_each(|v| *v = self.value(*v)),
        }
    }

    /// `y_bar *= dy/dx`, given the outputs `y`; equal lengths, a multiple of the lanes.
    #[inline(always)]
    pub(super) fn apply_backward<V: Vector>(self, y: &[f32], y_bar: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => {
                for (y, b) in y.chunks_exact(V::LANES).zip(y_bar.chunks_exact_mut(V::LANES)) {
                    V::load(y).select_positive(V::load(b), V::splat(0.0)).store(b);
                }
            }
            _ => y.iter().zip(y_bar).for_each(|(y, b)| *b *= self.derivative_from_output(*y)),
        }
    }
}
