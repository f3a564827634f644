//! Turning a lighting: exact, whatever the rotation.
//!
//! Band 1 is a vector and turns as one. Band 2 is the quadratic form `n^T Q n` of a symmetric matrix without trace, and turns
//! as `R Q R^T`. Nine coefficients go in, nine come out: nothing is left over or lost.

use super::{C2, C3, C4, Lighting};
use crate::real::{Real, dot, mat_vec};
use core::array::from_fn;

impl<T: Real> Lighting<T> {
    /// The environment turned by `r` (rows of an orthogonal matrix, a rotation or a mirror): light that came from `d` now comes
    /// from `r d`, so that `rotated.irradiance(r n) = self.irradiance(n)`.
    ///
    /// The map is orthogonal in the coefficients: gradients go back through the transposed matrix.
    #[must_use]
    pub fn rotated(&self, r: &[[T; 3]; 3]) -> Self {
        let mut out = *self;
        for channel in 0..3 {
            let l: [T; 9] = from_fn(|k| self.coefficients[k][channel]);
            // Band 1 as (x, y, z), of which the coefficients are (3, 1, 2).
            let v = mat_vec(r, [l[3], l[1], l[2]]);
            let q = form(&l);
            // Rows of R Q, then times the transpose.
            let rq: [[T; 3]; 3] = from_fn(|i| from_fn(|j| dot(r[i], from_fn(|k| q[k][j]))));
            let q: [[T; 3]; 3] = from_fn(|i| from_fn(|j| dot(rq[i], r[j])));
            let band2 = coefficients(&q);
            let turned = [l[0], v[1], v[2], v[0], band2[0], band2[1], band2[2], band2[3], band2[4]];
            for (row, l) in out.coefficients.iter_mut().zip(turned) {
                row[channel] = l;
            }
        }
        out
    }

    /// The lighting that gives for `-n` what this one gives for `n`: band 1 changes its sign. For lighting that was fitted with
    /// normals pointing into matter.
    #[must_use]
    pub fn inside_out(&self) -> Self {
        let mut out = *self;
        for row in &mut out.coefficients[1..4] {
            *row = row.map(|l| -l);
        }
        out
    }
}

/// The matrix of band 2.
fn form<T: Real>(l: &[T; 9]) -> [[T; 3]; 3] {
    let half = T::of(0.5 * C2);
    let (xy, yz, xz) = (half * l[4], half * l[5], half * l[7]);
    // 3 z^2 - 1 = 2 z^2 - x^2 - y^2 on the sphere.
    let (axial, across) = (T::of(C3) * l[6], T::of(C4) * l[8]);
    [[across - axial, xy, xz], [xy, -across - axial, yz], [xz, yz, axial + axial]]
}

/// Back from the matrix: coefficients 4 to 8. The trace, 0 up to rounding, is left out evenly.
fn coefficients<T: Real>(q: &[[T; 3]; 3]) -> [T; 5] {
    let twice = T::of(2.0 / C2);
    let axial = (q[2][2] + q[2][2] - q[0][0] - q[1][1]) / T::of(6.0 * C3);
    [twice * q[0][1], twice * q[1][2], axial, twice * q[0][2], (q[0][0] - q[1][1]) / T::of(2.0 * C4)]
}
