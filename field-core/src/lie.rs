//! Exponential maps of rotations and rigid motions with their derivatives, and the way back.
//!
//! `[w]` is the matrix of the cross product, `[w] x = w x x`; a twist is `xi = (w, u)`, rotation first. The
//! coefficients `c_k` are [Stumpff functions](crate::stumpff) of `|w|^2`: nothing divides by the angle, so values and
//! derivatives are exact at 0, tiny angles, pi and beyond.
//!
//! ```text
//! R = exp(w)   = 1 + c_1 [w] + c_2 [w]^2          dR/dw_k from dc/d(w.w) = c', d(w.w)/dw_k = 2 w_k, d[w]/dw_k = [e_k]
//! V = J_l(w)   = 1 + c_2 [w] + c_3 [w]^2          exp(w, u) = [R | V u]
//! ```
//!
//! Matrices are rows of columns, `m[row][column]`; everything is `f64`: this is for poses. Many points at once in `f32`:
//! [`crate::deform`].
//!
//! # Numerics
//! Rotations are orthonormal to 1e-14 up to `|w| = 1e3`. Angles are radians, and 2 pi is not wrapped: where a rotation
//! vector is optimised, call `wrap` now and then. Input that is not finite gives output that is not finite.
//!
//! # Source
//! Gallego and Yezzi, "A compact formula for the derivative of a 3-D rotation in exponential coordinates", 2015; Barfoot,
//! "State Estimation for Robotics", 2017, ch. 7.

use crate::stumpff::{stumpff, stumpff_derivative};
use core::f64::consts::PI;
use float_core::m64;

/// A 3x3 matrix, rows first.
pub type Matrix3 = [[f64; 3]; 3];
/// A rigid motion `[R | t]`: `x -> R x + t`.
pub type Rigid = [[f64; 4]; 3];

/// Rotation by the angle `|w|` around `w`.
///
/// ```
/// let quarter = field_core::lie::so3_exp([0.0, 0.0, core::f64::consts::FRAC_PI_2]);
/// assert!((quarter[1][0] - 1.0).abs() < 1e-15 && quarter[0][0].abs() < 1e-15);
/// ```
#[must_use]
pub fn so3_exp(w: [f64; 3]) -> Matrix3 {
    family(w, 1)
}

/// `d[i][j][k]` = derivative of [`so3_exp`]`(w)[i][j]` along `w[k]`.
#[must_use]
pub fn so3_exp_derivative(w: [f64; 3]) -> [Matrix3; 3] {
    family_derivative(w, 1)
}

/// Adds the gradient with respect to `w` of a loss whose gradient with respect to [`so3_exp`]`(w)` is `r_bar`.
pub fn so3_exp_backward(w: [f64; 3], r_bar: &Matrix3, w_bar: &mut [f64; 3]) {
    contract(&so3_exp_derivative(w), r_bar, w_bar);
}

/// Left Jacobian `V` of the rotation group: `exp(w + dw) = exp(V dw) exp(w)` to first order.
#[must_use]
pub fn so3_left_jacobian(w: [f64; 3]) -> Matrix3 {
    family(w, 2)
}

/// The shortest rotation vector of a rotation, `|w| <= pi`: `log(exp(w)) = w` below pi. At pi one of the two.
///
/// `r` is not checked to be a rotation; for a matrix that is nearly one, the result is nearly right.
#[must_use]
pub fn so3_log(r: &Matrix3) -> [f64; 3] {
    let a = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]].map(|x| 0.5 * x);
    let (sin, cos) = (length(a), 0.5 * (r[0][0] + r[1][1] + r[2][2] - 1.0));
    // atan2: the arc cosine loses half the digits at 0 and at pi.
    let angle = m64::atan2(sin, cos);
    if cos > 0.0 {
        // angle / sin of a small angle without a quotient of nothing by nothing.
        let scale = if angle < 1e-4 { 1.0 + angle * angle / 6.0 } else { angle / sin };
        return a.map(|x| scale * x);
    }
    // Past a right angle `a` fades and the symmetric part `cos 1 + (1 - cos) n n^T` takes over: its column of the largest
    // diagonal entry is the axis, with all digits in all its entries.
    let k = (0..3).fold(0, |best, i| if r[i][i] > r[best][best] { i } else { best });
    let axis: [f64; 3] = core::array::from_fn(|i| 0.5 * (r[i][k] + r[k][i]) - if i == k { cos } else { 0.0 });
    let sign = if axis.iter().zip(a).map(|(n, a)| n * a).sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
    let scale = sign * angle / length(axis);
    axis.map(|n| scale * n)
}

/// The same rotation with `|w| <= pi`: for a parameter after an optimiser's step.
#[must_use]
pub fn wrap(w: [f64; 3]) -> [f64; 3] {
    let angle = length(w);
    if angle <= PI || !angle.is_finite() {
        return w;
    }
    let turns = m64::round_ties_even(angle / (2.0 * PI));
    w.map(|x| x * (1.0 - 2.0 * PI * turns / angle))
}

/// Rigid motion of a twist `xi = (w, u)`: `[exp(w) | V u]`.
#[must_use]
pub fn se3_exp(xi: [f64; 6]) -> Rigid {
    let [w, u] = halves(xi);
    let (r, v) = (family(w, 1), family(w, 2));
    core::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], dot(v[i], u)])
}

/// `d[i][j][k]` = derivative of [`se3_exp`]`(xi)[i][j]` along `xi[k]`.
#[must_use]
pub fn se3_exp_derivative(xi: [f64; 6]) -> [[[f64; 6]; 4]; 3] {
    let [w, u] = halves(xi);
    let (dr, v, dv) = (family_derivative(w, 1), family(w, 2), family_derivative(w, 2));
    let mut d = [[[0.0; 6]; 4]; 3];
    for i in 0..3 {
        for k in 0..3 {
            for j in 0..3 {
                d[i][j][k] = dr[i][j][k];
                d[i][3][k] += dv[i][j][k] * u[j];
            }
            d[i][3][3 + k] = v[i][k];
        }
    }
    d
}

/// Adds the gradient with respect to `xi` of a loss whose gradient with respect to [`se3_exp`]`(xi)` is `t_bar`.
pub fn se3_exp_backward(xi: [f64; 6], t_bar: &Rigid, xi_bar: &mut [f64; 6]) {
    contract(&se3_exp_derivative(xi), t_bar, xi_bar);
}

/// The twist of a rigid motion, `|w| <= pi`: the inverse of [`se3_exp`] below pi.
#[must_use]
pub fn se3_log(t: &Rigid) -> [f64; 6] {
    let w = so3_log(&core::array::from_fn(|i| [t[i][0], t[i][1], t[i][2]]));
    let shift = [t[0][3], t[1][3], t[2][3]];
    let s = dot(w, w);
    // V^-1 = 1 - [w] / 2 + kappa [w]^2, kappa = (1 - c_1 / (2 c_2)) / s written without its 0/0; c_2 > 0 up to pi.
    let kappa = (stumpff(3, s) - 2.0 * stumpff(4, s)) / (2.0 * stumpff(2, s));
    let once = cross(w, shift);
    let twice = cross(w, once);
    let u: [f64; 3] = core::array::from_fn(|i| shift[i] - 0.5 * once[i] + kappa * twice[i]);
    [w[0], w[1], w[2], u[0], u[1], u[2]]
}

/// `1 + c_k [w] + c_{k+1} [w]^2`.
fn family(w: [f64; 3], k: u32) -> Matrix3 {
    let s = dot(w, w);
    let (a, b) = (stumpff(k, s), stumpff(k + 1, s));
    let (once, twice) = (cross_matrix(w), squared(w));
    from_fn(|i, j| f64::from(u8::from(i == j)) + (a * once[i][j] + b * twice[i][j]))
}

fn family_derivative(w: [f64; 3], k: u32) -> [Matrix3; 3] {
    let s = dot(w, w);
    let (a, b) = (stumpff(k, s), stumpff(k + 1, s));
    let (da, db) = (stumpff_derivative(k, 1, s), stumpff_derivative(k + 1, 1, s));
    let (once, twice) = (cross_matrix(w), squared(w));
    let mut d = [[[0.0; 3]; 3]; 3];
    for n in 0..3 {
        let mut e = [0.0; 3];
        e[n] = 1.0;
        let turn = cross_matrix(e);
        for i in 0..3 {
            for j in 0..3 {
                // d [w]^2 / dw_n = e_n w^T + w e_n^T - 2 w_n 1
                let diagonal = if i == j { 2.0 * w[n] } else { 0.0 };
                let outer = e[i] * w[j] + w[i] * e[j] - diagonal;
                d[i][j][n] = 2.0 * w[n] * (da * once[i][j] + db * twice[i][j]) + a * turn[i][j] + b * outer;
            }
        }
    }
    d
}

/// `bar[k] += sum(d[i][j][k] out_bar[i][j])`.
fn contract<const J: usize, const K: usize>(d: &[[[f64; K]; J]; 3], out_bar: &[[f64; J]; 3], bar: &mut [f64; K]) {
    for (d, out_bar) in d.iter().flatten().zip(out_bar.iter().flatten()) {
        for (bar, d) in bar.iter_mut().zip(d) {
            *bar += d * out_bar;
        }
    }
}

fn halves([a, b, c, d, e, f]: [f64; 6]) -> [[f64; 3]; 2] {
    [[a, b, c], [d, e, f]]
}

fn from_fn(f: impl Fn(usize, usize) -> f64) -> Matrix3 {
    core::array::from_fn(|i| core::array::from_fn(|j| f(i, j)))
}

fn cross_matrix([x, y, z]: [f64; 3]) -> Matrix3 {
    [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
}

/// `[w]^2 = w w^T - (w.w) 1`, its diagonal without the difference.
fn squared([x, y, z]: [f64; 3]) -> Matrix3 {
    [[-(y * y + z * z), x * y, x * z], [x * y, -(x * x + z * z), y * z], [x * z, y * z, -(x * x + y * y)]]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    core::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Without overflow or underflow in between.
fn length([x, y, z]: [f64; 3]) -> f64 {
    m64::hypot(m64::hypot(x, y), z)
}
