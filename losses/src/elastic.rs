//! Elastic energy: how far a deformation is from rigid, by the logarithms of its Jacobian's singular values.
//!
//! Letters: `n` samples; `j` their Jacobians, row `3 i + k` the derivative of output `i` along input `k`; `sigma` the three
//! singular values of one; `energy = sum(ln(sigma)^2)`, written `E^2` in the source: 0 for a rotation, the same for
//! stretching and squeezing by one factor.
//!
//! ```text
//! d energy / d J = 2 U diag(ln(sigma) / sigma) V^T = J V diag(ln(lambda) / lambda) V^T,   lambda = sigma^2
//! ```
//!
//! The singular values enter as a set (a *spectral* function), so this is smooth where they coincide, as they nearly do in
//! every good warp; the derivatives of singular vectors, which blow up there, never appear. `V` and `J V` come from
//! one-sided Jacobi rotations in `f64`: the eigenvectors of `J^T J` without forming it, so that small singular values keep
//! their digits.
//!
//! Singular values below [`SMALLEST`] count as that and get no gradient. Reflections cost nothing here: a mirror has
//! singular values 1. Count them with [`orientation_flips`].
//!
//! # Numerics
//! Finite for every finite Jacobian, singular, zero, mirrored and huge ones included; what is not
//! finite in a Jacobian gives a sample that is not finite, unless its weight is 0.
//!
//! # Source
//! Park et al., "Nerfies: deformable neural radiance fields", 2021, sec. 3.3. Singular values by rotations of
//! columns: Hestenes, "Inversion of matrices by biorthogonalization", 1958.

use crate::{LossError, error::same};
use float_core::m64;

/// Scale of the robust remapping in Nerfies.
pub const SCALE: f32 = 0.03;

/// Singular values below it count as it.
pub const SMALLEST: f64 = 1e-6;

/// Rounds of rotations; 4 do for all but contrived matrices, and what is left after 8 is rounding.
const SWEEPS: usize = 8;

type Matrix = [[f64; 3]; 3];

/// Energy of each sample.
///
/// # Shapes and units
/// * `j` `[9][n]`
/// * `energy` `[n]` out, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn energy(j: &[f32], energy: &mut [f32]) -> Result<(), LossError> {
    same("j", 9 * energy.len(), j.len())?;
    let n = energy.len();
    for (s, energy) in energy.iter_mut().enumerate() {
        *energy = energy_of(&jacobian(j, n, s)) as f32;
    }
    Ok(())
}

/// Backward twin of [`energy`]: adds into `j_bar`, shaped as `j`. Samples of `energy_bar` 0 cost nothing.
///
/// # Errors
/// As [`energy`].
pub fn energy_backward(j: &[f32], energy_bar: &[f32], j_bar: &mut [f32]) -> Result<(), LossError> {
    same("j", 9 * energy_bar.len(), j.len())?;
    same("j_bar", j.len(), j_bar.len())?;
    let n = energy_bar.len();
    for (s, &bar) in energy_bar.iter().enumerate().filter(|(_, bar)| **bar != 0.0) {
        let (_, gradient) = energy_gradient_of(&jacobian(j, n, s));
        add(&gradient, f64::from(bar), j_bar, n, s);
    }
    Ok(())
}

/// `sum_k w[k] rho(energy[k])` with the robust `rho = 2 z / (z + 4)`, `z = energy / c^2`: about `z / 2` where rigid, never
/// above 2. 0 for no samples. Samples of weight 0 are skipped.
///
/// Weights are constants: those of the rendering, without gradient, divided by the rays (Nerfies' mean over rays).
///
/// # Shapes and units
/// * `j` `[9][n]`, `w` `[n]`
/// * `c` `> 0`, [`SCALE`] in Nerfies
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable `c`.
pub fn elastic(j: &[f32], w: &[f32], c: f32) -> Result<f64, LossError> {
    check(j, w, c)?;
    let (n, mut sum) = (w.len(), 0.0);
    for (s, &w) in w.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        sum += f64::from(w) * robust(energy_of(&jacobian(j, n, s)), c).0;
    }
    Ok(sum)
}

/// Backward twin of [`elastic`]: adds `loss_bar` times its gradient into `j_bar`, shaped as `j`. Answers with the sum,
/// which falls out on the way.
///
/// # Errors
/// As [`elastic`].
pub fn elastic_backward(j: &[f32], w: &[f32], c: f32, loss_bar: f64, j_bar: &mut [f32]) -> Result<f64, LossError> {
    check(j, w, c)?;
    same("j_bar", j.len(), j_bar.len())?;
    let (n, mut sum) = (w.len(), 0.0);
    for (s, &w) in w.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        let (energy, gradient) = energy_gradient_of(&jacobian(j, n, s));
        let (value, derivative) = robust(energy, c);
        sum += f64::from(w) * value;
        add(&gradient, loss_bar * f64::from(w) * derivative, j_bar, n, s);
    }
    Ok(sum)
}

/// Samples whose Jacobian mirrors (negative determinant): there the deformation folds space over itself.
///
/// # Errors
/// [`LossError::Shape`] unless `j` is nine rows.
pub fn orientation_flips(j: &[f32]) -> Result<usize, LossError> {
    let n = j.len() / 9;
    same("j", 9 * n, j.len())?;
    let mirrors = |s: &usize| {
        let [a, b, c] = jacobian(j, n, *s);
        let cross: [f64; 3] =
            core::array::from_fn(|i| b[(i + 1) % 3] * c[(i + 2) % 3] - b[(i + 2) % 3] * c[(i + 1) % 3]);
        dot(a, cross) < 0.0
    };
    Ok((0..n).filter(mirrors).count())
}

/// Energy of one Jacobian, rows first.
#[must_use]
pub fn energy_of(j: &Matrix) -> f64 {
    let (columns, _) = rotate(j);
    columns.iter().map(|a| half_log(dot(*a, *a)).0).map(|log| log * log).sum()
}

/// Energy of one Jacobian and its gradient, rows first.
#[must_use]
pub fn energy_gradient_of(j: &Matrix) -> (f64, Matrix) {
    let (columns, v) = rotate(j);
    let (mut energy, mut gradient) = (0.0, [[0.0; 3]; 3]);
    for (a, v) in columns.iter().zip(&v) {
        let lambda = dot(*a, *a);
        let (log, is_clamped) = half_log(lambda);
        energy += log * log;
        if !is_clamped {
            let factor = 2.0 * log / lambda;
            for (row, a) in gradient.iter_mut().zip(a) {
                for (g, v) in row.iter_mut().zip(v) {
                    *g += factor * a * v;
                }
            }
        }
    }
    (energy, gradient)
}

/// `ln(sigma)` from its square, and whether it was clamped.
fn half_log(lambda: f64) -> (f64, bool) {
    if lambda < SMALLEST * SMALLEST { (m64::ln(SMALLEST), true) } else { (0.5 * m64::ln(lambda), false) }
}

/// Columns of `J V`, orthogonal, and columns of `V`.
fn rotate(j: &Matrix) -> (Matrix, Matrix) {
    let mut a: Matrix = core::array::from_fn(|k| core::array::from_fn(|i| j[i][k]));
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        let mut is_done = true;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (pp, qq, pq) = (dot(a[p], a[p]), dot(a[q], a[q]), dot(a[p], a[q]));
            // Written so that NaN ends the sweeps.
            if pq.abs() > 1e-16 * m64::sqrt(pp * qq) {
                is_done = false;
                let zeta = (qq - pp) / (2.0 * pq);
                let tan = 1.0_f64.copysign(zeta) / (zeta.abs() + m64::sqrt(1.0 + zeta * zeta));
                let cos = 1.0 / m64::sqrt(1.0 + tan * tan);
                for m in [&mut a, &mut v] {
                    let (x, y) = (m[p], m[q]);
                    m[p] = core::array::from_fn(|i| cos * (x[i] - tan * y[i]));
                    m[q] = core::array::from_fn(|i| cos * (y[i] + tan * x[i]));
                }
            }
        }
        if is_done {
            break;
        }
    }
    (a, v)
}

/// `rho` and its derivative with respect to the energy.
fn robust(energy: f64, c: f32) -> (f64, f64) {
    let c2 = f64::from(c) * f64::from(c);
    let z = energy / c2;
    let q = 1.0 / (z + 4.0);
    (2.0 * z * q, 8.0 * q * q / c2)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn jacobian(j: &[f32], n: usize, s: usize) -> Matrix {
    core::array::from_fn(|i| core::array::from_fn(|k| f64::from(j[(3 * i + k) * n + s])))
}

fn add(gradient: &Matrix, factor: f64, j_bar: &mut [f32], n: usize, s: usize) {
    for (row, &g) in gradient.as_flattened().iter().enumerate() {
        j_bar[row * n + s] += (factor * g) as f32;
    }
}

fn check(j: &[f32], w: &[f32], c: f32) -> Result<(), LossError> {
    same("j", 9 * w.len(), j.len())?;
    if c > 0.0 && c.is_finite() {
        return Ok(());
    }
    Err(LossError::Parameter { what: "scale `c` of the elastic loss", value: c, range: "a finite number above 0" })
}
