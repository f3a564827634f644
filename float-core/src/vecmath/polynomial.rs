//! Polynomials of vectors.

use crate::Vector;

/// The polynomial with these coefficients, from the highest power down.
#[inline(always)]
pub(super) fn polynomial<V: Vector, const N: usize>(x: V, coefficients: [f32; N]) -> V {
    let mut p = V::splat(coefficients[0]);
    for c in &coefficients[1..] {
        p = p.mul_add(x, V::splat(*c));
    }
    p
}
