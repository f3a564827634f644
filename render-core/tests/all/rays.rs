//! Batches of rays that tests of quadrature share.

use proptest::prelude::*;
use std::ops::Range;

/// Where the samples of rays of the given lengths begin and end.
pub(crate) fn offsets(lengths: &[usize]) -> Vec<u32> {
    let mut offsets = vec![0];
    for n in lengths {
        offsets.push(offsets[offsets.len() - 1] + *n as u32);
    }
    offsets
}

/// The samples of ray `r`.
pub(crate) fn range(offsets: &[u32], r: usize) -> Range<usize> {
    offsets[r] as usize..offsets[r + 1] as usize
}

/// A fixed pattern in `0..=1`.
pub(crate) fn pattern(n: usize, a: usize, b: usize) -> Vec<f32> {
    (0..n).map(|i| ((i * a + b) % 101) as f32 / 100.0).collect()
}

/// Optical depths: ordinary, tiny, zero, opaque.
pub(crate) fn any_tau() -> impl Strategy<Value = f32> {
    prop_oneof![4 => 0.0_f32..0.5, 2 => 0.0_f32..5.0, 2 => Just(0.0), 1 => 1e-30_f32..1e-6, 1 => 5.0_f32..100.0]
}

#[track_caller]
pub(crate) fn close(got: f32, want: f64, abs: f64, rel: f64, what: impl std::fmt::Display) {
    let bound = abs + rel * want.abs();
    assert!((f64::from(got) - want).abs() <= bound, "{what}: got {got}, want {want}, bound {bound:e}");
}
