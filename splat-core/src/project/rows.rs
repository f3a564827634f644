//! Loads SIMD vectors from rows `[component][n]`.

use float_core::Vector;

/// Most lanes of a vector.
pub(crate) const LANES_MAX: usize = float_core::MAX_LANES;

/// `LANES` values of row `row` from index `at` on; 0 past the end of the row.
#[inline(always)]
pub(crate) fn lanes<V: Vector>(rows: &[f32], n: usize, row: usize, at: usize) -> V {
    V::load_part(&rows[row * n..][at..n])
}

/// The lanes of a vector; the rest of the array is 0.
#[inline(always)]
pub(crate) fn to_array<V: Vector>(x: V) -> [f32; LANES_MAX] {
    let mut out = [0.0; LANES_MAX];
    x.store(&mut out);
    out
}
