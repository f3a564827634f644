//! The functions of [`vecmath`](super) as a list: each with its exact value, the plain `f32` version and its stated error, so
//! that tables, tests and benches measure the same thing.

use super::{cos, exp, exp_m1, exp_neg, exp2, ln, logistic, sin, sin_cos_pi, softplus, tanh};
use crate::{Simd, SimdLevel, Task, Vector, m32, m64};

/// A function of [`vecmath`](super).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Function {
    /// [`exp`].
    Exp,
    /// [`exp2`].
    Exp2,
    /// [`exp_m1`].
    ExpM1,
    /// [`exp_neg`].
    ExpNeg,
    /// [`ln`].
    Ln,
    /// [`logistic`].
    Logistic,
    /// [`softplus`].
    Softplus,
    /// [`tanh`].
    Tanh,
    /// [`sin`].
    Sin,
    /// [`cos`].
    Cos,
    /// The sine of [`sin_cos_pi`].
    SinPi,
    /// The cosine of [`sin_cos_pi`].
    CosPi,
}

/// The largest error that [`Function::worst`] has met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// In units in the last place of the exact value (subnormal results: of the smallest number). Infinite where exactly
    /// one of both is NaN or infinite.
    pub ulp: f64,
    /// An argument that has it.
    pub at: f32,
}

impl Worst {
    /// No error yet.
    pub const NONE: Self = Self { ulp: 0.0, at: 0.0 };

    /// The larger of two.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        if other.ulp > self.ulp { other } else { self }
    }
}

impl Function {
    /// All of them.
    pub const ALL: [Self; 12] = [
        Self::Exp,
        Self::Exp2,
        Self::ExpM1,
        Self::ExpNeg,
        Self::Ln,
        Self::Logistic,
        Self::Softplus,
        Self::Tanh,
        Self::Sin,
        Self::Cos,
        Self::SinPi,
        Self::CosPi,
    ];

    /// The name in the code.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Exp => "exp",
            Self::Exp2 => "exp2",
            Self::ExpM1 => "exp_m1",
            Self::ExpNeg => "exp_neg",
            Self::Ln => "ln",
            Self::Logistic => "logistic",
            Self::Softplus => "softplus",
            Self::Tanh => "tanh",
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::SinPi => "sin_pi",
            Self::CosPi => "cos_pi",
        }
    }

    /// The exact value in `f64`, with arguments clamped as its documentation states.
    #[must_use]
    pub fn exact(self, x: f64) -> f64 {
        // `f64::clamp` keeps NaN.
        match self {
            Self::Exp => m64::exp(x.clamp(-87.0, 88.0)),
            Self::Exp2 => m64::exp(core::f64::consts::LN_2 * x.clamp(-126.0, 127.0)),
            Self::ExpM1 => m64::exp_m1(if x.is_nan() { 88.0 } else { x.clamp(-87.0, 88.0) }),
            Self::ExpNeg => {
                if x < 87.0 {
                    m64::exp((-x).clamp(-87.0, 88.0))
                } else {
                    0.0
                }
            }
            Self::Ln => m64::ln(x),
            Self::Logistic => m64::logistic(x),
            Self::Softplus => {
                if x.is_nan() {
                    x
                } else {
                    m64::softplus(x)
                }
            }
            Self::Tanh => m64::tanh(x),
            Self::Sin => m64::sin(x),
            Self::Cos => m64::cos(x),
            Self::SinPi => turns(x).0,
            Self::CosPi => turns(x).1,
        }
    }

    /// The version of [`m32`], one number at a time: the baseline of the vector function.
    #[must_use]
    pub fn plain(self, x: f32) -> f32 {
        match self {
            Self::Exp => m32::exp(x.clamp(-87.0, 88.0)),
            Self::Exp2 => m32::exp(core::f32::consts::LN_2 * x.clamp(-126.0, 127.0)),
            Self::ExpM1 => m32::exp_m1(x.clamp(-87.0, 88.0)),
            Self::ExpNeg => {
                if x < 87.0 {
                    m32::exp(-x)
                } else {
                    0.0
                }
            }
            Self::Ln => m32::ln(x),
            Self::Logistic => m32::logistic(x),
            Self::Softplus => m32::softplus(x),
            Self::Tanh => m32::tanh(x),
            Self::Sin => m32::sin(x),
            Self::Cos => m32::cos(x),
            Self::SinPi => m32::sin(core::f32::consts::PI * x),
            Self::CosPi => m32::cos(core::f32::consts::PI * x),
        }
    }

    /// The error it states at a level, in units in the last place, over all arguments.
    #[must_use]
    pub fn bound(self, level: SimdLevel) -> f64 {
        let (fused, twice) = match self {
            Self::Exp | Self::ExpNeg => (1.1, 1.1),
            Self::Exp2 => (2.2, 2.4),
            Self::ExpM1 => (1.6, 1.7),
            Self::Ln => (0.9, 0.9),
            Self::Logistic => (2.5, 2.5),
            Self::Softplus => (1.9, 2.3),
            Self::Tanh => (2.6, 2.6),
            Self::Sin | Self::Cos | Self::SinPi | Self::CosPi => (1.7, 1.7),
        };
        if level == SimdLevel::Scalar { twice } else { fused }
    }

    /// `y = f(x)` for whole slices, any length.
    ///
    /// # Panics
    /// Where the lengths differ.
    pub fn map(self, simd: Simd, x: &[f32], y: &mut [f32]) {
        assert_eq!(x.len(), y.len(), "vecmath: x and y differ in length");
        match self {
            Self::Exp => simd.run(Map(x, y, Exp)),
            Self::Exp2 => simd.run(Map(x, y, Exp2)),
            Self::ExpM1 => simd.run(Map(x, y, ExpM1)),
            Self::ExpNeg => simd.run(Map(x, y, ExpNeg)),
            Self::Ln => simd.run(Map(x, y, Ln)),
            Self::Logistic => simd.run(Map(x, y, Logistic)),
            Self::Softplus => simd.run(Map(x, y, Softplus)),
            Self::Tanh => simd.run(Map(x, y, Tanh)),
            Self::Sin => simd.run(Map(x, y, Sin)),
            Self::Cos => simd.run(Map(x, y, Cos)),
            Self::SinPi => simd.run(Map(x, y, SinPi)),
            Self::CosPi => simd.run(Map(x, y, CosPi)),
        }
    }

    /// Largest error among the arguments `x`, against their [exact](Function::exact) values (taken once for all levels).
    ///
    /// # Panics
    /// Where the lengths differ.
    #[must_use]
    pub fn worst(self, simd: Simd, x: &[f32], exact: &[f64]) -> Worst {
        assert_eq!(x.len(), exact.len(), "vecmath: x and exact differ in length");
        let mut y = [0.0; 256];
        let mut worst = Worst::NONE;
        for (x, exact) in x.chunks(y.len()).zip(exact.chunks(y.len())) {
            let y = &mut y[..x.len()];
            self.map(simd, x, y);
            for ((&x, &y), &exact) in x.iter().zip(y.iter()).zip(exact) {
                worst = worst.max(Worst { ulp: ulps(y, exact), at: x });
            }
        }
        worst
    }
}

/// `(sin(pi x), cos(pi x))` in `f64`: the whole turns are taken off exactly, then quarters.
fn turns(x: f64) -> (f64, f64) {
    let t = x - 2.0 * m64::round_ties_even(0.5 * x);
    let quadrant = m64::round_ties_even(2.0 * t);
    let (s, c) = m64::sin_cos((t - 0.5 * quadrant) * core::f64::consts::PI);
    match quadrant as i32 & 3 {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// Distance in units in the last place of `want`.
fn ulps(got: f32, want: f64) -> f64 {
    let near = (want as f32).abs();
    if got.is_nan() || !near.is_finite() {
        let same = got.is_nan() && want.is_nan() || got == want as f32;
        return if same { 0.0 } else { f64::INFINITY };
    }
    // The exponent of `want`, not that of its rounding: a power of two has larger units above than below.
    let exponent = ((near.to_bits() >> 23) as i32).max(1)
        - i32::from(f64::from(near) > want.abs() && near.to_bits() & 0x7f_ffff == 0);
    let ulp = f64::from_bits(((exponent.max(1) - 150 + 1023) as u64) << 52);
    (f64::from(got) - want).abs() / ulp
}

/// What [`Map`] does to each vector. A trait and not a closure: a closure would not be compiled with the level's instructions.
trait Curve {
    fn at<V: Vector>(x: V) -> V;
}

macro_rules! curves {
    ($($name:ident |$x:ident| $body:expr;)+) => {$(
        struct $name;
        impl Curve for $name {
            #[inline(always)]
            fn at<V: Vector>($x: V) -> V {
                $body
            }
        }
    )+};
}

curves! {
    Exp |x| exp(x);
    Exp2 |x| exp2(x);
    ExpM1 |x| exp_m1(x);
    ExpNeg |x| exp_neg(x);
    Ln |x| ln(x);
    Logistic |x| logistic(x);
    Softplus |x| softplus(x);
    Tanh |x| tanh(x);
    Sin |x| sin(x);
    Cos |x| cos(x);
    SinPi |x| sin_cos_pi(x).0;
    CosPi |x| sin_cos_pi(x).1;
}

struct Map<'a, C>(&'a [f32], &'a mut [f32], C);

impl<C: Curve> Task for Map<'_, C> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self(x, y, _) = self;
        let body = x.len() / V::LANES * V::LANES;
        for (x, y) in x[..body].chunks_exact(V::LANES).zip(y.chunks_exact_mut(V::LANES)) {
            C::at(V::load(x)).store(y);
        }
        if body < x.len() {
            C::at(V::load_part(&x[body..])).store_part(&mut y[body..]);
        }
    }
}
