//! Eigenvectors of small symmetric matrices.

use core::array;
use float_core::m64;

/// Sweeps of rotations; convergence is quadratic, ten are enough for matrices of a few rows of `f64`.
const SWEEPS: usize = 12;

/// Eigenvalues, ascending, and eigenvectors, one a row and of length 1 but for rounding, of a symmetric matrix of a few rows, by Jacobi
/// rotations. The upper triangle is read.
#[must_use]
pub fn eigen<const N: usize>(m: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut a: [[f64; N]; N] = array::from_fn(|i| array::from_fn(|j| m[i.min(j)][i.max(j)]));
    let mut v: [[f64; N]; N] = array::from_fn(|i| array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    for _ in 0..SWEEPS {
        for (p, q) in (0..N).flat_map(|p| (p + 1..N).map(move |q| (p, q))) {
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
    let mut order: [usize; N] = array::from_fn(|i| i);
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| array::from_fn(|k| v[k][i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat, DVec3};

    #[test]
    fn eigenvectors_are_those_the_matrix_was_made_of() {
        let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 0.7)));
        for values in [[1.0, 2.0, 5.0], [0.0, 0.0, 3.0], [-2.0, 0.5, 0.5]] {
            let m = r * DMat3::from_diagonal(values.into()) * r.transpose();
            let (found, axes) = eigen(m.to_cols_array_2d());
            for k in 0..3 {
                let axis = DVec3::from_array(axes[k]);
                assert!((found[k] - values[k]).abs() < 1e-12, "{found:?}");
                assert!((m * axis - axis * values[k]).length() < 1e-12 && axis.is_normalized());
            }
        }
        assert_eq!(eigen([[0.0; 3]; 3]).0, [0.0; 3]);
        assert_eq!(eigen([[0.0; 0]; 0]).0, [0.0; 0]);
        assert_eq!(eigen([[-3.0]]), ([-3.0], [[1.0]]));
    }

    #[test]
    fn nine_rows_have_nine_eigenvectors_at_right_angles() {
        // Of sizes from 1e-10 to 7, as the squares of a linear system that barely determines its solution have.
        let rows: [[f64; 9]; 12] =
            array::from_fn(|i| array::from_fn(|j| m64::sin((1.0 + i as f64) * (0.7 + j as f64))));
        let scale: [f64; 9] = array::from_fn(|j| m64::exp(-1.5 * j as f64));
        let dot = |a: &[f64; 9], b: &[f64; 9]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let m: [[f64; 9]; 9] = array::from_fn(|i| {
            array::from_fn(|j| rows.iter().map(|row| row[i] * scale[i] * row[j] * scale[j]).sum::<f64>())
        });
        let (values, vectors) = eigen(m);
        assert!(values.is_sorted() && values[0] > -1e-14 && values[8] > 0.1, "{values:?}");
        for (k, vector) in vectors.iter().enumerate() {
            let image: [f64; 9] = array::from_fn(|i| dot(&m[i], vector));
            let is_own = image.iter().zip(vector).all(|(x, v)| (x - values[k] * v).abs() < 1e-14 * values[8] * 100.0);
            assert!(is_own, "{k}: {image:?} of {vector:?}");
            for (l, other) in vectors.iter().enumerate() {
                let want = if k == l { 1.0 } else { 0.0 };
                assert!((dot(vector, other) - want).abs() < 1e-12, "{k}, {l}");
            }
        }
    }
}
