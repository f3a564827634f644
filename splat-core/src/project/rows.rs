//! Vectors out of rows `[component][n]`, and back.

use float_core::Vector;

/// Lanes of one vector at most.
pub(crate) const LANES_MAX: usize = 16;

/// `LANES` numbers of row `row` from `at` on; past the end of the row: 0.
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

/// The numbers of a vector.
#[inline(always)]
pub(crate) fn numbers<V: Vector>(x: V) -> [f32; LANES_MAX] {
    let mut out = [0.0; LANES_MAX];
    x.store(&mut out);
    out
}
