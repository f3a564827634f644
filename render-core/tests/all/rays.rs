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

/// A batch whose rays are the beginnings of one ray of `n` samples, of 0 to `n` of them: the transmittances to its backgrounds
/// are those along the ray. Returns the offsets and, for each sample, its place on the ray.
pub(crate) fn beginnings(n: usize) -> (Vec<u32>, Vec<usize>) {
    let lengths: Vec<usize> = (0..=n).collect();
    (offsets(&lengths), lengths.iter().flat_map(|&k| 0..k).collect())
}

/// Transmittances along a ray, before its first sample to behind its last: all of the light at first, never more again, and less
/// wherever an interval takes enough for `f32` to tell (`taken[k]` is the interval's optical depth).
#[track_caller]
pub(crate) fn check_transmittance(trans: &[f32], taken: &[f64], what: impl std::fmt::Display) {
    assert_eq!(trans.len(), taken.len() + 1, "{what}");
    assert_eq!(trans[0], 1.0, "{what}");
    for (k, (pair, &tau)) in trans.windows(2).zip(taken).enumerate() {
        let [before, after] = [pair[0], pair[1]];
        assert!((0.0..=1.0).contains(&after), "{what}: {after} behind sample {k}");
        assert!(after <= before, "{what}: {before} rises to {after} behind sample {k} of optical depth {tau}");
        // Depths below 87 are rounded to an ulp, 8e-6.
        assert!(after < before || tau < 1e-4 || before < 1e-30, "{what}: {before} stays behind {tau}");
    }
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
