//! Contraction: all of space into a ball or cube of radius 2.
//!
//! With `m` the norm of `x`, `contract(x) = x` where `m <= 1`, else `(2 - 1/m) x/m`. Everything from distance 1 to
//! infinity lands between 1 and 2.
//!
//! Source: Barron et al., "Mip-NeRF 360", 2022, eq. 10; the max norm instead of the Euclidean one as in nerfacto.
//!
//! ```
//! use render_core::contract::{Norm, contract, inv_contract};
//!
//! let far = [30.0_f64, -40.0, 0.0];
//! let y = contract(Norm::L2, far); // 2 - 1/50 along (0.6, -0.8, 0)
//! assert!((y[0] - 1.98 * 0.6).abs() < 1e-12 && (y[1] + 1.98 * 0.8).abs() < 1e-12);
//! assert!((inv_contract(Norm::L2, y)[1] + 40.0).abs() < 1e-9);
//! ```

mod batch;

pub use self::batch::{contract_batch, contract_batch_backward};
use crate::real::{Real, dot, mat_t_vec, mat_vec};

/// How far out a point counts as being.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Norm {
    /// Euclidean length: space becomes the ball of radius 2. Once continuously differentiable.
    L2,
    /// Largest coordinate: space becomes the cube `[-2, 2]^3`, which a grid fills. The gradient jumps where two
    /// coordinates tie.
    Max,
}

/// A point outside of the unit ball: its direction `x / m`, its norm (infinite past the largest number) and `1 / m`.
struct Outside<T> {
    u: [T; 3],
    m: T,
    inv_m: T,
}

/// `None` inside the unit ball (and where a coordinate is NaN).
#[inline(always)]
fn outside<T: Real>(norm: Norm, x: [T; 3]) -> Option<Outside<T>> {
    // The largest coordinate is divided out first: squares of 1e20 are beyond f32.
    let s = x[0].abs().max(x[1].abs()).max(x[2].abs());
    if s + s <= T::ONE {
        return None; // |x| <= sqrt(3) / 2
    }
    let inv_s = T::ONE / s;
    let u = x.map(|x| x / s);
    let n = match norm {
        Norm::L2 => dot(u, u).sqrt(),
        Norm::Max => T::ONE,
    };
    (s * n > T::ONE).then(|| Outside { u: u.map(|u| u / n), m: s * n, inv_m: inv_s / n })
}

/// The contracted point: `x` in the unit ball, else `(2 - 1/m) x/m`.
///
/// Finite points stay below 2 in their norm (2 itself by rounding). Infinite or NaN coordinates pass on NaN or come
/// back unchanged: check positions before.
#[inline]
#[must_use]
pub fn contract<T: Real>(norm: Norm, x: [T; 3]) -> [T; 3] {
    match outside(norm, x) {
        None => x,
        Some(Outside { u, inv_m, .. }) => u.map(|u| (T::TWO - inv_m) * u),
    }
}

/// The point that [`contract`] sends to `y`.
///
/// Norms of `y` above `2 - Real::CONTRACT_GAP` count as that: the answer stays finite.
#[inline]
#[must_use]
pub fn inv_contract<T: Real>(norm: Norm, y: [T; 3]) -> [T; 3] {
    inv_contract_within(norm, y, T::CONTRACT_GAP)
}

/// [`inv_contract`] with a nearer end of the world: norms of `y` above `2 - gap` count as that, so nothing is further out than
/// `1 / gap`. 1e-3 suits losses on `f32` positions.
#[inline]
#[must_use]
pub fn inv_contract_within<T: Real>(norm: Norm, y: [T; 3], gap: T) -> [T; 3] {
    match outside(norm, y) {
        None => y,
        Some(Outside { u, m, .. }) => {
            let left = (T::TWO - m).max(gap);
            u.map(|u| u / left)
        }
    }
}

/// Gradient of [`inv_contract_within`]: adds `J^T x_bar` to `y_bar`. Where the norm of `y` was held, it has no derivative.
///
/// With `u = y / m` and `l = 2 - m`, the Jacobian is `(I - u u^T) / (m l) + u u^T / l^2` (`L2`), or with `k` the (first) largest
/// coordinate `I / (m l) + u e_k^T sign(y_k) (1/l^2 - 1/(m l))` (`Max`); `1 / l^2` is 0 where the norm was held.
#[inline]
pub fn inv_contract_within_backward<T: Real>(norm: Norm, y: [T; 3], gap: T, x_bar: [T; 3], y_bar: &mut [T; 3]) {
    let Some(Outside { u, m, inv_m }) = outside(norm, y) else {
        for (y_bar, x_bar) in y_bar.iter_mut().zip(x_bar) {
            *y_bar += x_bar;
        }
        return;
    };
    let held = T::TWO - m <= gap;
    let inv_left = T::ONE / (T::TWO - m).max(gap);
    let across = inv_m * inv_left;
    let along = if held { T::ZERO } else { inv_left * inv_left };
    let radial = (along - across) * dot(x_bar, u);
    let k = largest(u);
    for (i, (y_bar, (x_bar, u))) in y_bar.iter_mut().zip(x_bar.into_iter().zip(u)).enumerate() {
        *y_bar += across * x_bar;
        match norm {
            Norm::L2 => *y_bar += radial * u,
            // The largest coordinate of `u` is its sign.
            Norm::Max if i == k => *y_bar += radial * u,
            Norm::Max => {}
        }
    }
}

/// Jacobian of [`contract`], `[i][j] = d y[i] / d x[j]`.
///
/// `L2`: `(2 - 1/m)/m (I - u u^T) + u u^T / m^2`. `Max`, with `k` the (first) largest coordinate:
/// `(2 - 1/m)/m I + u e_k^T sign(x_k) (2/m^2 - 2/m)`. The identity in the unit ball, its surface included.
#[inline]
#[must_use]
pub fn contract_jacobian<T: Real>(norm: Norm, x: [T; 3]) -> [[T; 3]; 3] {
    let (o, l) = (T::ZERO, T::ONE);
    let Some(Outside { u, inv_m, .. }) = outside(norm, x) else {
        return [[l, o, o], [o, l, o], [o, o, l]];
    };
    let across = (T::TWO - inv_m) * inv_m;
    let mut j = [[across, o, o], [o, across, o], [o, o, across]];
    match norm {
        Norm::L2 => {
            let along = inv_m * inv_m - across;
            for (row, &a) in j.iter_mut().zip(&u) {
                for (entry, &b) in row.iter_mut().zip(&u) {
                    *entry += along * a * b;
                }
            }
        }
        Norm::Max => {
            let k = largest(u);
            let derivative = T::TWO * inv_m * (inv_m - l) * u[k];
            for (row, &a) in j.iter_mut().zip(&u) {
                row[k] += derivative * a;
            }
        }
    }
    j
}

/// Index of the first coordinate of `u` of largest magnitude.
#[inline(always)]
fn largest<T: Real>(u: [T; 3]) -> usize {
    let [a, b, c] = u.map(T::abs);
    if a >= b && a >= c {
        0
    } else if b >= c {
        1
    } else {
        2
    }
}

/// Gradient of [`contract_jacobian`]: adds to `x_bar` what `j_bar`, `[i][j]` that of entry `[i][j]`, says of the point.
///
/// These are the second derivatives of [`contract`]. They are 0 in the unit ball, and jump on its surface, which counts as inside.
/// With `q = 1/m`, `a = 2q - q^2` and `b = 2q^2 - 2q`, the Jacobian is `a I + b u u^T` (`L2`) or `a I + b u e_k^T sign(x_k)`
/// (`Max`), and `dq/dx` is `-q^2` times `u` or `sign(x_k) e_k`.
#[inline]
pub fn contract_jacobian_backward<T: Real>(norm: Norm, x: [T; 3], j_bar: &[[T; 3]; 3], x_bar: &mut [T; 3]) {
    let Some(Outside { u, inv_m: q, .. }) = outside(norm, x) else { return };
    let trace = j_bar[0][0] + j_bar[1][1] + j_bar[2][2];
    let b = T::TWO * q * (q - T::ONE);
    // With `form` what `b` is multiplied by in the Jacobian.
    let q_bar_of = |form: T| T::TWO * (T::ONE - q) * trace + T::TWO * (q + q - T::ONE) * form;
    match norm {
        Norm::L2 => {
            let (rows, columns) = (mat_vec(j_bar, u), mat_t_vec(j_bar, u));
            let form = dot(u, rows);
            let q_bar = q_bar_of(form);
            for i in 0..3 {
                let across = rows[i] + columns[i] - T::TWO * form * u[i];
                x_bar[i] += q * (b * across - q * q_bar * u[i]);
            }
        }
        Norm::Max => {
            let k = largest(u);
            let column = [j_bar[0][k], j_bar[1][k], j_bar[2][k]].map(|bar| bar * u[k]);
            let form = dot(u, column);
            let q_bar = q_bar_of(form);
            for (x_bar, column) in x_bar.iter_mut().zip(column) {
                *x_bar += q * b * column;
            }
            x_bar[k] += -(q * u[k] * (b * form + q * q_bar));
        }
    }
}

/// Gradient of [`contract`]: adds `J^T y_bar` to `x_bar`.
#[inline]
pub fn contract_backward<T: Real>(norm: Norm, x: [T; 3], y_bar: [T; 3], x_bar: &mut [T; 3]) {
    let add = match outside(norm, x) {
        None => y_bar,
        Some(_) => mat_t_vec(&contract_jacobian(norm, x), y_bar),
    };
    for (x_bar, add) in x_bar.iter_mut().zip(add) {
        *x_bar += add;
    }
}

/// Covariance of a contracted Gaussian, `J cov J^T`, linearised at its mean `x`. Rows first.
#[must_use]
pub fn contract_covariance<T: Real>(norm: Norm, x: [T; 3], cov: &[[T; 3]; 3]) -> [[T; 3]; 3] {
    let j = contract_jacobian(norm, x);
    // Row i of J cov is cov^T J_i, of (J cov) J^T is J (row).
    core::array::from_fn(|i| mat_vec(&j, mat_t_vec(cov, j[i])))
}

/// Gradient of [`contract_covariance`]: adds to `x_bar` and `cov_bar` what `out_bar`, `[i][j]` that of entry `[i][j]`, says of the
/// mean and of the covariance.
///
/// All nine entries count by themselves: where only the upper triangle of the result is used, `out_bar` is 0 below the diagonal.
/// `cov_bar = J^T out_bar J`; the mean is that of [`contract_jacobian_backward`] for `out_bar J cov^T + out_bar^T J cov`.
pub fn contract_covariance_backward<T: Real>(
    norm: Norm,
    x: [T; 3],
    cov: &[[T; 3]; 3],
    out_bar: &[[T; 3]; 3],
    x_bar: &mut [T; 3],
    cov_bar: &mut [[T; 3]; 3],
) {
    let j = contract_jacobian(norm, x);
    let mut j_bar = [[T::ZERO; 3]; 3];
    for i in 0..3 {
        // Rows i of `out_bar J` and of `out_bar^T J`.
        let row = mat_t_vec(&j, out_bar[i]);
        let transposed = mat_t_vec(&j, [out_bar[0][i], out_bar[1][i], out_bar[2][i]]);
        let (back, forth) = (mat_vec(cov, row), mat_t_vec(cov, transposed));
        for (k, bar) in j_bar[i].iter_mut().enumerate() {
            *bar = back[k] + forth[k];
        }
        for (cov_bar, j) in cov_bar.iter_mut().zip(&j[i]) {
            for (bar, row) in cov_bar.iter_mut().zip(row) {
                *bar += *j * row;
            }
        }
    }
    contract_jacobian_backward(norm, x, &j_bar, x_bar);
}
