//! Activations of the layers, each with its derivative written in terms of the *output*, so that nothing but outputs is kept.

use float_core::{Vector, m32, vecmath};

/// Activation after a linear layer.
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

    /// Apply to the numbers of `y`, a multiple of the lanes.
    #[inline(always)]
    pub(super) fn apply<V: Vector>(self, y: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => map::<V>(y, Relu),
            Self::LeakyRelu { slope } => map::<V>(y, LeakyRelu(slope)),
            Self::Softplus { shift } => map::<V>(y, Softplus(shift)),
            Self::Logistic { pad } => map::<V>(y, Logistic(pad)),
            Self::Tanh => map::<V>(y, Tanh),
            Self::TruncExp => map::<V>(y, Exp),
        }
    }

    /// `y_bar *= dy/dx`, given the outputs `y`; equal lengths, a multiple of the lanes.
    #[inline(always)]
    pub(super) fn apply_backward<V: Vector>(self, y: &[f32], y_bar: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => pull_back::<V>(y, y_bar, Relu),
            Self::LeakyRelu { slope } => pull_back::<V>(y, y_bar, LeakyRelu(slope)),
            Self::Softplus { shift } => pull_back::<V>(y, y_bar, Softplus(shift)),
            Self::Logistic { pad } => pull_back::<V>(y, y_bar, Logistic(pad)),
            Self::Tanh => pull_back::<V>(y, y_bar, Tanh),
            Self::TruncExp => pull_back::<V>(y, y_bar, Exp),
        }
    }
}

/// An activation of whole vectors. Types, not closures: a closure cannot be marked `inline(always)`, and one that is not
/// inlined calls every vector instruction as a function.
trait Curve: Copy {
    fn value<V: Vector>(self, x: V) -> V;
    /// `y_bar * dy/dx` given the output `y`.
    fn pull_back<V: Vector>(self, y: V, y_bar: V) -> V;
}

macro_rules! curves {
    ($($name:ident $(($field:ident))? { |$x:ident| $value:expr, |$y:ident, $bar:ident| $back:expr })+) => {$(
        #[derive(Clone, Copy)]
        struct $name $((curves!(@number $field)))?;

        impl Curve for $name {
            #[inline(always)]
            fn value<V: Vector>(self, $x: V) -> V {
                $(let Self($field) = self; let _ = $field;)?
                $value
            }
            #[inline(always)]
            fn pull_back<V: Vector>(self, $y: V, $bar: V) -> V {
                $(let Self($field) = self; let _ = $field;)?
                $back
            }
        }
    )+};
    (@number $field:ident) => { f32 };
}

curves! {
    Relu { |x| x.max(V::splat(0.0)), |y, bar| y.select_positive(bar, V::splat(0.0)) }
    LeakyRelu(slope) {
        |x| x.select_positive(x, V::splat(slope) * x),
        |y, bar| y.select_positive(bar, V::splat(slope) * bar)
    }
    Softplus(shift) { |x| vecmath::softplus(x + V::splat(shift)), |y, bar| bar * vecmath::one_minus_exp_neg(y) }
    Logistic(pad) {
        |x| vecmath::logistic(x).mul_add(V::splat(1.0 + 2.0 * pad), V::splat(-pad)),
        |y, bar| {
            let p = (y + V::splat(pad)) * V::splat(1.0 / (1.0 + 2.0 * pad));
            bar * (V::splat(1.0 + 2.0 * pad) * p * (V::splat(1.0) - p))
        }
    }
    Tanh { |x| vecmath::tanh(x), |y, bar| bar * (V::splat(1.0) - y * y) }
    Exp {
        |x| vecmath::exp(x),
        // In this order NaN stays NaN.
        |y, bar| bar * V::splat(TRUNC_EXP_RANGE.0).max(V::splat(TRUNC_EXP_RANGE.1).min(y))
    }
}

#[inline(always)]
fn map<V: Vector>(y: &mut [f32], f: impl Curve) {
    for c in y.chunks_exact_mut(V::LANES) {
        f.value(V::load(c)).store(c);
    }
}

#[inline(always)]
fn pull_back<V: Vector>(y: &[f32], y_bar: &mut [f32], f: impl Curve) {
    for (y, b) in y.chunks_exact(V::LANES).zip(y_bar.chunks_exact_mut(V::LANES)) {
        f.pull_back(V::load(y), V::load(b)).store(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec::Vec;
    use float_core::{Simd, Task};

    const ALL: [Activation; 9] = [
        Activation::None,
        Activation::Relu,
        Activation::LeakyRelu { slope: 0.1 },
        Activation::SOFTPLUS,
        Activation::Softplus { shift: -1.0 },
        Activation::LOGISTIC,
        Activation::Logistic { pad: 0.001 },
        Activation::Tanh,
        Activation::TruncExp,
    ];

    struct Apply<'a>(Activation, &'a mut [f32], &'a mut [f32]);
    impl Task for Apply<'_> {
        type Output = ();
        #[inline(always)]
        fn run<V: Vector>(self) {
            self.0.apply::<V>(self.1);
            self.0.apply_backward::<V>(self.1, self.2);
        }
    }

    #[test]
    fn vectors_match_the_value_and_derivative_at_one_point() {
        // Miri is slow, and looks at the memory: few will do.
        let stride = if cfg!(miri) { 16 } else { 1 };
        let x: Vec<f32> = (0..512).step_by(stride).map(|i| (i as f32 - 256.0) * 0.41).collect();
        for activation in ALL {
            for simd in Simd::available() {
                let (mut y, mut bar) = (x.clone(), alloc::vec![-3.0_f32; x.len()]);
                simd.run(Apply(activation, &mut y, &mut bar));
                for ((&x, &y), &bar) in x.iter().zip(&y).zip(&bar) {
                    let want = activation.value(x);
                    // Few units in the last place of the value, or of the padding it is a difference from.
                    assert!((y - want).abs() <= 5e-7 * want.abs() + 1e-9, "{activation:?} at {x}: {y} {want}");
                    let want = -3.0 * activation.derivative_from_output(y);
                    // `1 - p` of a padded output has the absolute error of `p`: it is divided or multiplied by the width.
                    let rounding = if matches!(activation, Activation::Logistic { .. }) { 3e-7 } else { 1e-38 };
                    assert!((bar - want).abs() <= 1e-6 * want.abs() + rounding, "{activation:?} at {x}: {bar} {want}");
                }
            }
        }
    }

    #[test]
    fn nan_comes_out_of_smooth_activations_as_nan() {
        for activation in &ALL[2..] {
            for simd in Simd::available() {
                let (mut y, mut bar) = ([f32::NAN; 16], [1.0; 16]);
                simd.run(Apply(*activation, &mut y, &mut bar));
                assert!(y.iter().all(|y| y.is_nan()), "{activation:?} {y:?}");
                // The slopes of a leaky ReLU are constants.
                let constant = matches!(activation, Activation::LeakyRelu { .. });
                assert!(constant || bar.iter().all(|b| b.is_nan()), "{activation:?} {bar:?}");
            }
        }
    }
}
