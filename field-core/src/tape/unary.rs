//! Functions of one number: value and derivative, over whole rows.

use crate::stumpff::Lanes as Stumpff;
use float_core::{MAX_LANES, Task, Vector, m32, vecmath};

/// Where the backward pass of `trunc_exp` clamps its argument.
pub(super) const TRUNC_EXP_LIMIT: f32 = 15.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unary {
    /// `scale * x + shift`.
    Affine(f32, f32),
    Square,
    /// Derivative 0 for `x <= 0`.
    Sqrt,
    /// `1 / sqrt(x)`, 0 for `x <= 0`.
    Rsqrt,
    Recip,
    Exp,
    /// `exp(x)` with derivative `exp(clamp(x, -15, 15))`.
    TruncExp,
    Log,
    Sin,
    Cos,
    Relu,
    /// `x` above 0, else this factor times `x`.
    LeakyRelu(f32),
    /// `ln(1 + exp(x + shift))`.
    Softplus(f32),
    Logistic,
    /// Derivative of the logistic function, with full digits where it saturates.
    LogisticDerivative,
    Tanh,
    Abs,
    Pow(f32),
    Clamp(f32, f32),
    /// `Stumpff(k, order)`: derivative of order `order` of the Stumpff function `c_k`.
    Stumpff(u32, u32),
    /// -1, 0 or 1. Flat.
    Sign,
    /// 1 inside the bounds, else 0. Flat.
    Inside(f32, f32),
    /// A copy that stops the gradient. Flat.
    Detach,
}

impl Unary {
    /// Whether the derivative counts as 0 everywhere.
    pub(super) fn is_flat(self) -> bool {
        matches!(self, Self::Sign | Self::Inside(..) | Self::Detach)
    }
}

/// `y = f(x)`.
pub(super) struct Forward<'a> {
    pub(super) f: Unary,
    pub(super) x: &'a [f32],
    pub(super) y: &'a mut [f32],
}

impl Task for Forward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { f, x, y } = self;
        match f {
            Unary::Affine(scale, shift) => map(x, y, |x| scale * x + shift),
            Unary::Square => map(x, y, |x| x * x),
            Unary::Sqrt => map(x, y, m32::sqrt),
            Unary::Rsqrt => map(x, y, rsqrt),
            Unary::Recip => map(x, y, |x| 1.0 / x),
            Unary::Exp | Unary::TruncExp => map_lanes::<V>(x, y, Exp),
            Unary::Log => map(x, y, m32::ln),
            Unary::Sin => map(x, y, m32::sin),
            Unary::Cos => map(x, y, m32::cos),
            // Comparisons are turned so that NaN stays NaN.
            Unary::Relu => map(x, y, |x| if x <= 0.0 { 0.0 } else { x }),
            Unary::LeakyRelu(slope) => map(x, y, |x| if x <= 0.0 { slope * x } else { x }),
            Unary::Softplus(shift) => map_lanes::<V>(x, y, Softplus(shift)),
            Unary::Logistic => map_lanes::<V>(x, y, Logistic(0.0)),
            Unary::LogisticDerivative => map_lanes::<V>(x, y, LogisticDerivative),
            Unary::Tanh => map(x, y, m32::tanh),
            Unary::Abs => map(x, y, f32::abs),
            Unary::Pow(p) => map(x, y, |x| m32::powf(x, p)),
            Unary::Clamp(low, high) => map(x, y, |x| clamp(x, low, high)),
            Unary::Stumpff(k, order) => Stumpff::new(k, order).map::<V>(x, y),
            Unary::Sign => map(x, y, sign),
            Unary::Inside(low, high) => map(x, y, |x| if x >= low && x <= high { 1.0 } else { 0.0 }),
            Unary::Detach => y.copy_from_slice(x),
        }
    }
}

/// `x_bar += f'(x) * y_bar`.
pub(super) struct Backward<'a> {
    pub(super) f: Unary,
    pub(super) x: &'a [f32],
    pub(super) y: &'a [f32],
    pub(super) y_bar: &'a [f32],
    pub(super) x_bar: &'a mut [f32],
}

impl Task for Backward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { f, x, y, y_bar: g, x_bar: out } = self;
        match f {
            Unary::Affine(scale, _) => fold(x, g, out, |_| scale),
            Unary::Square => fold(x, g, out, |x| 2.0 * x),
            Unary::Sqrt => fold(y, g, out, |y| if y > 0.0 { 0.5 / y } else { 0.0 }),
            Unary::Rsqrt => fold(y, g, out, |y| -0.5 * y * y * y),
            Unary::Recip => fold(y, g, out, |y| -y * y),
            Unary::Exp => fold(y, g, out, |y| y),
            Unary::TruncExp => fold_lanes::<V>(x, g, out, ClampedExp),
            Unary::Log => fold(x, g, out, |x| 1.0 / x),
            Unary::Sin => fold(x, g, out, m32::cos),
            Unary::Cos => fold(x, g, out, |x| -m32::sin(x)),
            Unary::Relu => fold(x, g, out, |x| if x <= 0.0 { 0.0 } else { 1.0 }),
            Unary::LeakyRelu(slope) => fold(x, g, out, |x| if x <= 0.0 { slope } else { 1.0 }),
            Unary::Softplus(shift) => fold_lanes::<V>(x, g, out, Logistic(shift)),
            Unary::Logistic => fold_lanes::<V>(x, g, out, LogisticDerivative),
            Unary::LogisticDerivative => fold_lanes::<V>(x, g, out, LogisticSecondDerivative),
            Unary::Tanh => fold_lanes::<V>(x, g, out, TanhDerivative),
            Unary::Abs => fold(x, g, out, sign),
            Unary::Pow(0.0) => {}
            Unary::Pow(p) => fold(x, g, out, |x| p * m32::powf(x, p - 1.0)),
            Unary::Clamp(low, high) => fold(x, g, out, |x| if x >= low && x <= high { 1.0 } else { 0.0 }),
            Unary::Stumpff(k, order) => Stumpff::new(k, order + 1).fold::<V>(x, g, out),
            Unary::Sign | Unary::Inside(..) | Unary::Detach => {}
        }
    }
}

#[inline(always)]
fn rsqrt(x: f32) -> f32 {
    if x <= 0.0 { 0.0 } else { 1.0 / m32::sqrt(x) }
}

#[inline(always)]
fn sign(x: f32) -> f32 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// NaN stays NaN.
#[inline(always)]
fn clamp(x: f32, low: f32, high: f32) -> f32 {
    let x = if x < low { low } else { x };
    if x > high { high } else { x }
}

/// A function of whole vectors. Types, not closures: a closure cannot be marked `inline(always)`, and one that is not
/// inlined calls every vector instruction as a function.
trait Curve: Copy {
    fn at<V: Vector>(self, x: V) -> V;
}

macro_rules! curves {
    ($($(#[$doc:meta])* $name:ident $(($($field:ident),+))? |$x:ident| $body:block)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy)]
        struct $name $(($(curves!(@number $field)),+))?;

        impl Curve for $name {
            #[inline(always)]
            fn at<V: Vector>(self, $x: V) -> V {
                $(let Self($($field),+) = self;)?
                $body
            }
        }
    )+};
    (@number $field:ident) => { f32 };
}

curves! {
    Exp |x| { vecmath::exp(x) }
    /// Derivative of `trunc_exp`.
    ClampedExp |x| { vecmath::exp(V::splat(-TRUNC_EXP_LIMIT).max(V::splat(TRUNC_EXP_LIMIT).min(x))) }
    /// `1 / (1 + e^-(x + shift))`, at least `e^-87`: its logarithm is finite. NaN stays NaN.
    Logistic(shift) |x| { vecmath::logistic(V::splat(-87.0).max(x + V::splat(shift))) }
    /// `e^-|x| / (1 + e^-|x|)^2`.
    LogisticDerivative |x| {
        let e = exp_minus_abs(x);
        let d = V::splat(1.0) + e;
        e / (d * d)
    }
    /// Second derivative of the logistic function.
    LogisticSecondDerivative |x| { LogisticDerivative.at(x) * (V::splat(1.0) - V::splat(2.0) * Logistic(0.0).at(x)) }
    TanhDerivative |x| { V::splat(4.0) * LogisticDerivative.at(V::splat(2.0) * x) }
    /// `ln(1 + e^x) = max(x, 0) + ln(1 + e^-|x|)` at `x + shift`. Not [`vecmath::softplus`]: see decision 0036 of the repository.
    Softplus(shift) |x| {
        let x = x + V::splat(shift);
        let e = exp_minus_abs(x);
        // ln(1 + e) = 2 atanh(z) with z = e / (2 + e) <= 1/3: the series to z^15 is exact to an ulp.
        let z = e / (V::splat(2.0) + e);
        let z2 = z * z;
        let mut p = V::splat(1.0 / 15.0);
        for k in [13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0] {
            p = p.mul_add(z2, V::splat(1.0 / k));
        }
        V::splat(0.0).max(x) + V::splat(2.0) * z * p
    }
}

#[inline(always)]
fn exp_minus_abs<V: Vector>(x: V) -> V {
    vecmath::exp(-(x.max(-x)))
}

#[inline(always)]
fn map(x: &[f32], y: &mut [f32], f: impl Fn(f32) -> f32) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y = f(x);
    }
}

/// `out[i] += f(x[i]) * g[i]`.
#[inline(always)]
fn fold(x: &[f32], g: &[f32], out: &mut [f32], f: impl Fn(f32) -> f32) {
    for ((out, &x), &g) in out.iter_mut().zip(x).zip(g) {
        *out += f(x) * g;
    }
}

#[inline(always)]
fn map_lanes<V: Vector>(x: &[f32], y: &mut [f32], f: impl Curve) {
    let body = x.len() / V::LANES * V::LANES;
    for (x, y) in x[..body].chunks_exact(V::LANES).zip(y.chunks_exact_mut(V::LANES)) {
        f.at(V::load(x)).store(y);
    }
    if body < x.len() {
        f.at(V::load_part(&x[body..])).store_part(&mut y[body..]);
    }
}

#[inline(always)]
fn fold_lanes<V: Vector>(x: &[f32], g: &[f32], out: &mut [f32], f: impl Curve) {
    let body = x.len() / V::LANES * V::LANES;
    let heads = x[..body].chunks_exact(V::LANES).zip(g.chunks_exact(V::LANES));
    for ((x, g), out) in heads.zip(out.chunks_exact_mut(V::LANES)) {
        f.at(V::load(x)).mul_add(V::load(g), V::load(out)).store(out);
    }
    if body == x.len() {
        return;
    }
    // Not fused here, as the lanes are: the bits of a tail are those of a sum and a product.
    let mut derivative = [0.0; MAX_LANES];
    f.at(V::load_part(&x[body..])).store(&mut derivative);
    for ((out, &g), &derivative) in out[body..].iter_mut().zip(&g[body..]).zip(&derivative) {
        *out += derivative * g;
    }
}
