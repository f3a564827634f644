//! Operations that work number by number.

use super::error::TapeError;
use super::op::{Binary, Op};
use super::shape::Node;
use super::state::Tape;
use super::unary::Unary;

macro_rules! unary_ops {
    ($($(#[$doc:meta])* $name:ident = $f:expr;)+) => {$(
        $(#[$doc])*
        ///
        /// # Errors
        /// [`TapeError::ForeignNode`].
        pub fn $name(&mut self, x: Node) -> Result<Node, TapeError> {
            self.unary(stringify!($name), $f, x)
        }
    )+};
}

macro_rules! binary_ops {
    ($($(#[$doc:meta])* $name:ident = $f:expr;)+) => {$(
        $(#[$doc])*
        ///
        /// Both have one shape.
        ///
        /// # Errors
        /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
        pub fn $name(&mut self, a: Node, b: Node) -> Result<Node, TapeError> {
            self.binary(stringify!($name), $f, a, b)
        }
    )+};
}

impl Tape<'_> {
    binary_ops! {
        /// `a + b`.
        add = Binary::Add;
        /// `a - b`.
        sub = Binary::Sub;
        /// `a * b`.
        mul = Binary::Mul;
        /// `a / b`.
        div = Binary::Div;
    }

    unary_ops! {
        /// `-x`.
        neg = Unary::Affine(-1.0, 0.0);
        /// `x^2`.
        square = Unary::Square;
        /// Square root. The derivative at 0 counts as 0, so that lengths of zero vectors stay differentiable.
        sqrt = Unary::Sqrt;
        /// `1 / sqrt(x)`; 0, with derivative 0, for `x <= 0`.
        rsqrt = Unary::Rsqrt;
        /// `1 / x`.
        recip = Unary::Recip;
        /// `e^x`; the argument is clamped to `[-87, 88]`.
        exp = Unary::Exp;
        /// `e^x` whose derivative is `e^clamp(x, -15, 15)` (instant-ngp's density activation).
        trunc_exp = Unary::TruncExp;
        /// Natural logarithm.
        log = Unary::Log;
        /// Sine of radians.
        sin = Unary::Sin;
        /// Cosine of radians.
        cos = Unary::Cos;
        /// `max(x, 0)`, derivative 0 at 0.
        relu = Unary::Relu;
        /// `max(x, 0)`: another name of [`relu`](Self::relu).
        max0 = Unary::Relu;
        /// `1 / (1 + e^-x)`.
        logistic = Unary::Logistic;
        /// Derivative of the logistic function, with full digits where that saturates.
        logistic_derivative = Unary::LogisticDerivative;
        /// Hyperbolic tangent.
        tanh = Unary::Tanh;
        /// `|x|`, derivative 0 at 0.
        abs = Unary::Abs;
        /// -1, 0 or 1, without gradient.
        sign = Unary::Sign;
        /// A copy through which no gradient and no tangent flows.
        detach = Unary::Detach;
    }

    /// `factor * x`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn scale(&mut self, x: Node, factor: f32) -> Result<Node, TapeError> {
        self.unary("scale", Unary::Affine(factor, 0.0), x)
    }

    /// `scale * x + shift`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn affine(&mut self, x: Node, scale: f32, shift: f32) -> Result<Node, TapeError> {
        self.unary("affine", Unary::Affine(scale, shift), x)
    }

    /// `x` above 0, else `slope * x`; the derivative at 0 is `slope`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn leaky_relu(&mut self, x: Node, slope: f32) -> Result<Node, TapeError> {
        self.unary("leaky_relu", Unary::LeakyRelu(slope), x)
    }

    /// `ln(1 + e^(x + shift))`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn softplus(&mut self, x: Node, shift: f32) -> Result<Node, TapeError> {
        self.unary("softplus", Unary::Softplus(shift), x)
    }

    /// `x^p` for one fixed exponent; NaN where `x < 0` and `p` is not an integer.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn pow(&mut self, x: Node, p: f32) -> Result<Node, TapeError> {
        self.unary("pow", Unary::Pow(p), x)
    }

    /// `min(max(x, low), high)`; derivative 1 inside and on the bounds, else 0.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn clamp(&mut self, x: Node, low: f32, high: f32) -> Result<Node, TapeError> {
        self.unary("clamp", Unary::Clamp(low, high), x)
    }

    /// Stumpff function `c_k(u) = sum((-u)^j / (k + 2 j)!)` of a squared angle: `c_1(t^2) = sin t / t`,
    /// `c_2(t^2) = (1 - cos t) / t^2`, `c_3(t^2) = (t - sin t) / t^3`, smooth at 0 and everywhere.
    ///
    /// Error at most 4e-7 of `max(|c_k(u)|, c_k(0))` for `k <= 9` and first to third derivatives; any finite `u` gives a
    /// finite number (`u < -6400` counts as -6400), NaN stays NaN.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn stumpff(&mut self, u: Node, k: u32) -> Result<Node, TapeError> {
        self.stumpff_derivative(u, k, 0)
    }

    pub(super) fn stumpff_derivative(&mut self, u: Node, k: u32, order: u32) -> Result<Node, TapeError> {
        self.unary("stumpff", Unary::Stumpff(k, order), u)
    }

    /// 1 where `low <= x <= high`, else 0, without gradient.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn inside(&mut self, x: Node, low: f32, high: f32) -> Result<Node, TapeError> {
        self.unary("inside", Unary::Inside(low, high), x)
    }

    /// `v` where `x > 0`, else `slope * v`; no gradient flows to `x`. The tangent rule of (leaky) ReLU.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn gate(&mut self, x: Node, v: Node, slope: f32) -> Result<Node, TapeError> {
        self.binary("gate", Binary::Gate(slope), x, v)
    }

    fn unary(&mut self, name: &'static str, f: Unary, x: Node) -> Result<Node, TapeError> {
        let shape = self.entry(name, x)?.shape;
        self.emit(Op::Unary { f, x: x.id }, shape)
    }

    fn binary(&mut self, name: &'static str, f: Binary, a: Node, b: Node) -> Result<Node, TapeError> {
        let want = self.entry(name, a)?.shape;
        let got = self.entry(name, b)?.shape;
        if got != want {
            return Err(TapeError::Shape { op: name, what: "b", want, got });
        }
        self.emit(Op::Binary { f, a: a.id, b: b.id }, want)
    }
}
