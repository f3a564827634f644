//! Eigenvectors of symmetric 3x3 matrices.

use float_core::m64;
use glam::{DMat3, DVec3};

/// Sweeps of rotations; convergence is quadratic, six are enough for every matrix of `f64`.
const SWEEPS: usize = 12;

/// Eigenvalues, ascending, and unit eigenvectors of a symmetric matrix, by Jacobi rotations. The upper triangle is read.
pub(crate) fn eigen(m: DMat3) -> ([f64; 3], [DVec3; 3]) {
    let mut a = [0, 1, 2].map(|i| [0, 1, 2].map(|j: usize| m.col(j.max(i))[i.min(j)]));
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let sign = if theta < 0.0 { -1.0 } else { 1.0 };
            let t = sign / (theta.abs() + m64::hypot(theta, 1.0));
            let c = 1.0 / m64::hypot(t, 1.0);
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            let (above, below) = a.split_at_mut(q);
            for (x, y) in above[p].iter_mut().zip(&mut below[0]) {
                (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
            }
            for row in &mut v {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| DVec3::new(v[0][i], v[1][i], v[2][i]).normalize_or_zero()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_those_the_matrix_was_made_of() {
        let r = DMat3::from_quat(glam::DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 0.7)));
        for values in [[1.0, 2.0, 5.0], [0.0, 0.0, 3.0], [-2.0, 0.5, 0.5]] {
            let m = r * DMat3::from_diagonal(values.into()) * r.transpose();
            let (found, axes) = eigen(m);
            for k in 0..3 {
                assert!((found[k] - values[k]).abs() < 1e-12, "{found:?}");
                assert!((m * axes[k] - axes[k] * values[k]).length() < 1e-12 && axes[k].is_normalized());
            }
        }
        assert_eq!(eigen(DMat3::ZERO).0, [0.0; 3]);
    }
}
