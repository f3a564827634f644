//! Weighted linear least squares in a few unknowns.

use crate::{LossError, error::same};
use alloc::{vec, vec::Vec};
use float_core::m64;

/// A pivot of the normal equations, relative to its own diagonal entry, under which they have no single answer.
const PIVOT: f64 = 1e-12;

/// Whether a weighted fit has an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Solved {
    /// It was written.
    Yes,
    /// Singular or underdetermined: nothing was written.
    Undetermined,
}

/// Minimise `sum_i w[i] (a[i] . parameters - y[i])^2`.
///
/// # Shapes and units
/// * `a` `[n][k]` row by row, `y` `[n]`, `w` `[n]` `>= 0`
/// * `parameters` `[k]` out
///
/// # Numerics
/// Normal equations and Cholesky in `f64`: for few, well-scaled unknowns. Undetermined where what a column adds to those before
/// it is below `1e-12` of its own square (and for NaN).
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
///
/// # Panics
/// If there is no memory for `k * k` numbers.
pub fn solve_linear(a: &[f64], y: &[f64], w: &[f64], parameters: &mut [f64]) -> Result<Solved, LossError> {
    let k = parameters.len();
    same("a", y.len() * k, a.len())?;
    same("w", y.len(), w.len())?;
    if k == 0 {
        return Ok(Solved::Yes);
    }
    // Lower triangle of A^T W A, and A^T W y.
    let (mut normal, mut right) = (vec![0.0; k * k], vec![0.0; k]);
    for ((row, &y), &w) in a.chunks_exact(k).zip(y).zip(w) {
        for r in 0..k {
            right[r] += w * row[r] * y;
            for c in 0..=r {
                normal[r * k + c] += w * row[r] * row[c];
            }
        }
    }
    Ok(match cholesky(&mut normal, k) {
        Solved::Yes => {
            parameters.copy_from_slice(&substitute(&normal, right));
            Solved::Yes
        }
        Solved::Undetermined => Solved::Undetermined,
    })
}

/// `L` with `L L^T = a`, in place of the lower triangle.
fn cholesky(a: &mut [f64], k: usize) -> Solved {
    for r in 0..k {
        for c in 0..=r {
            let inner: f64 = (0..c).map(|i| a[r * k + i] * a[c * k + i]).sum();
            let rest = a[r * k + c] - inner;
            if r > c {
                a[r * k + c] = rest / a[c * k + c];
            } else if rest > PIVOT * a[r * k + r] {
                a[r * k + r] = m64::sqrt(rest);
            } else {
                return Solved::Undetermined;
            }
        }
    }
    Solved::Yes
}

/// Solve `L L^T x = b`.
fn substitute(l: &[f64], mut x: Vec<f64>) -> Vec<f64> {
    let k = x.len();
    for r in 0..k {
        let inner: f64 = (0..r).map(|c| l[r * k + c] * x[c]).sum();
        x[r] = (x[r] - inner) / l[r * k + r];
    }
    for r in (0..k).rev() {
        let inner: f64 = (r + 1..k).map(|c| l[c * k + r] * x[c]).sum();
        x[r] = (x[r] - inner) / l[r * k + r];
    }
    x
}
