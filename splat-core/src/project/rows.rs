//! Loads SIMD vectors from rows `[component][n]`.

use float_core::Vector;

/// Most lanes of a vector.
pub(crate) const LANES_MAX: usize = 16;

/// `LANES` values of row `row` from index `at` on; 0 past the end of the row.
#[inline(always)]
pub(crate) fn lanes<V: Vector>(rows: &[f32], n: usize, row: usize, at: usize) -> V {
    let row = &rows[row * n..][..n];
    if at + V::LANES <= n {
        V::load(&row[at..])
    } else {
        let mut padded = [0.0; LANES_MAX];
        padded[..n - at].copy_from_slice(&row[at..]);
        V::load(&padded)
    }
}

/// The lanes of a vector; the rest of the array is 0.
#[inline(always)]
pub(crate) fn to_array<V: Vector>(x: V) -> [f32; LANES_MAX] {
    let mut out = [0.0; LANES_MAX];
    x.store(&mut out);
    out
}
