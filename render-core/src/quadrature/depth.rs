//! Depth layers, opacity, normals: what else the weights of a ray say.

use super::{LastInterval, Samples, check_offsets};
use float_core::m32;

/// Accumulated opacity of each ray, `A = sum(w)`, written. Keeps the digits of thin rays; `1 - trans_end` does not.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `out` `[rays]`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn opacity(offsets: &[u32], w: &[f32], out: &mut [f32]) {
    each_ray(offsets, w.len(), out, |range| w[range].iter().map(|&w| f64::from(w)).sum::<f64>() as f32);
}

/// Depth of each ray, not normalised: `sum(w * t)`, written. Its way back is `w_bar[i] += out_bar[r] * t[i]`.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `t` `[n]` distance of each sample, `out` `[rays]` in the unit of `t`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn depth_raw(offsets: &[u32], w: &[f32], t: &[f32], out: &mut [f32]) {
    assert_eq!(w.len(), t.len(), "w and t differ in length");
    each_ray(offsets, w.len(), out, |range| weighted_sums(&w[range.clone()], &t[range]).1 as f32);
}

/// Smallest opacity that the expected depth divides by, and thereby the opacity below which it fades to 0.
pub const MIN_OPACITY: f64 = 1e-10;

/// Expected depth of each ray, `sum(w * t) / max(A, 1e-10)`, written. Where `A = 0` the depth is undefined and `far` is
/// written (use `f32::INFINITY` where a missing hit must show).
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `t` `[n]` distance of each sample, `out` `[rays]` in the unit of `t`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn depth_expected(offsets: &[u32], w: &[f32], t: &[f32], far: f32, out: &mut [f32]) {
    assert_eq!(w.len(), t.len(), "w and t differ in length");
    each_ray(offsets, w.len(), out, |range| {
        let (a, wt) = weighted_sums(&w[range.clone()], &t[range]);
        if a > 0.0 { (wt / a.max(MIN_OPACITY)) as f32 } else { far }
    });
}

/// Gradients of a depth loss.
#[derive(Debug)]
pub struct DepthBar<'a> {
    /// `[n]`, added to.
    pub w: &'a mut [f32],
    /// `[n]`, added to; nothing when the distances do not learn.
    pub t: Option<&'a mut [f32]>,
}

/// Gradient of [`depth_expected`]: adds `out_bar * (t - depth) / A` to the gradient of the weights and
/// `out_bar * w / A` to that of the distances. A ray that hit nothing gets none.
///
/// # Shapes and units
/// As [`depth_expected`]; `out_bar` `[rays]`.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn depth_expected_backward(offsets: &[u32], w: &[f32], t: &[f32], out_bar: &[f32], bar: DepthBar<'_>) {
    assert_eq!(w.len(), t.len(), "w and t differ in length");
    assert_eq!(w.len(), bar.w.len(), "w and its gradient differ in length");
    check_offsets(offsets, w.len());
    assert_eq!(out_bar.len(), offsets.len().saturating_sub(1), "out_bar holds one number a ray");
    let mut t_bar = bar.t;
    assert!(t_bar.as_ref().is_none_or(|x| x.len() == t.len()), "t and its gradient differ in length");
    for (ends, &out_bar) in offsets.windows(2).zip(out_bar) {
        let range = ends[0] as usize..ends[1] as usize;
        let (a, wt) = weighted_sums(&w[range.clone()], &t[range.clone()]);
        if a <= 0.0 {
            continue;
        }
        let scale = f64::from(out_bar) / a.max(MIN_OPACITY);
        // Below the smallest opacity the divisor is a constant.
        let depth = if a > MIN_OPACITY { wt / a } else { 0.0 };
        for i in range {
            bar.w[i] += (scale * (f64::from(t[i]) - depth)) as f32;
            if let Some(t_bar) = t_bar.as_deref_mut() {
                t_bar[i] += (scale * f64::from(w[i])) as f32;
            }
        }
    }
}

/// Disparity of each ray, `A / max(sum(w * t), 1e-10)`, written: the inverse of the expected depth, 0 where nothing was hit.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `t` `[n]` distance of each sample, `out` `[rays]`, 1 / unit of `t`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn disparity(offsets: &[u32], w: &[f32], t: &[f32], out: &mut [f32]) {
    assert_eq!(w.len(), t.len(), "w and t differ in length");
    each_ray(offsets, w.len(), out, |range| {
        let (a, wt) = weighted_sums(&w[range.clone()], &t[range]);
        (a / wt.max(MIN_OPACITY)) as f32
    });
}

/// Median depth of each ray: the distance of the first sample whose running sum of weights reaches one half, or `far`
/// where none does; written. It jumps from sample to sample and has no gradient.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, `w` `[n]`, `t` `[n]` distance of each sample, `out` `[rays]` in the unit of `t`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn depth_median(offsets: &[u32], w: &[f32], t: &[f32], far: f32, out: &mut [f32]) {
    assert_eq!(w.len(), t.len(), "w and t differ in length");
    each_ray(offsets, w.len(), out, |range| {
        let mut sum = 0.0_f64;
        for i in range {
            sum += f64::from(w[i]);
            if sum >= 0.5 {
                return t[i];
            }
        }
        far
    });
}

/// Median depth of each ray inside the interval where it lies: the distance where the transmittance is one half under
/// constant density in each interval, or `far` where it stays above; written. Continuous in the optical depths.
///
/// # Shapes and units
/// * `start` `[n]` where each interval begins, `dt` `[n]` its length, unit of `out`
/// * `out`   `[rays]`
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn depth_median_exact(samples: Samples<'_>, start: &[f32], dt: &[f32], far: f32, out: &mut [f32]) {
    let n = samples.tau.len();
    assert_eq!(start.len(), n, "start and tau differ in length");
    assert_eq!(dt.len(), n, "dt and tau differ in length");
    let last = samples.last;
    each_ray(samples.offsets, n, out, |range| {
        let (mut depth, end) = (0.0_f64, range.end);
        for i in range {
            let opaque = last == LastInterval::Opaque && i + 1 == end;
            let tau = if opaque { f64::INFINITY } else { f64::from(samples.tau[i]) };
            if depth + tau >= core::f64::consts::LN_2 {
                // An infinite optical depth puts the point at the interval's start.
                let part = if tau > 0.0 { (core::f64::consts::LN_2 - depth) / tau } else { 0.0 };
                return (f64::from(start[i]) + part * f64::from(dt[i])) as f32;
            }
            depth += tau;
        }
        far
    });
}

/// Unit vectors out of sums such as accumulated normals, `[rays][3]`, in place. A sum shorter than `1e-12` becomes 0:
/// nothing was hit, or what was hit cancels.
///
/// # Panics
/// When the length is not a multiple of 3.
pub fn normalise(vectors: &mut [f32]) {
    assert_eq!(vectors.len() % 3, 0, "three numbers a ray");
    for v in vectors.chunks_exact_mut(3) {
        let length = m32::hypot(m32::hypot(v[0], v[1]), v[2]);
        // The shortest normal kept: far below any weight that can be seen.
        let scale = if length > 1e-12 { 1.0 / length } else { 0.0 };
        for x in v {
            *x *= scale;
        }
    }
}

/// `(sum(w), sum(w * t))`.
fn weighted_sums(w: &[f32], t: &[f32]) -> (f64, f64) {
    w.iter().zip(t).fold((0.0, 0.0), |(a, wt), (&w, &t)| (a + f64::from(w), wt + f64::from(w) * f64::from(t)))
}

fn each_ray(offsets: &[u32], n: usize, out: &mut [f32], f: impl Fn(core::ops::Range<usize>) -> f32) {
    check_offsets(offsets, n);
    assert_eq!(out.len(), offsets.len().saturating_sub(1), "out holds one number a ray");
    for (out, ends) in out.iter_mut().zip(offsets.windows(2)) {
        *out = f(ends[0] as usize..ends[1] as usize);
    }
}
