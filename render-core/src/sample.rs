//! Where to sample a ray: stratified samples, and samples drawn from the weights of an earlier pass.
//!
//! Everything is driven by the caller's uniform numbers `u` in `[0, 1)`; nothing here is random. Distances are worked out in
//! `f64` and rounded once. No sample carries a gradient.
//!
//! | function | samples |
//! | --- | --- |
//! | [`stratified_bins`] | one in each of `n` equal bins |
//! | [`stratified_nerf`] | one around each of `n` equally spaced points, as NeRF's code does it |
//! | [`invert_cdf`] | where the weights of a histogram are |
//! | [`nerf_sample_pdf`] | the same as NeRF's code does it, with its epsilons |
//! | [`invert_linear`] | where the light of a ray with piecewise-linear density comes from |
//! | [`depth_cued`] | around a depth that was measured, some anywhere |
//! | [`merge_sorted`] | two sorted sets in one |
//! | [`dt_from_edges`], [`dt_from_points`] | interval lengths |

mod depth;
mod linear;

pub use depth::{DepthCue, depth_cued};
pub use linear::invert_linear;

/// What is equally spaced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Spacing {
    /// The distance.
    #[default]
    Linear,
    /// The inverse of the distance: more samples near the camera, and a far end at infinity is legal.
    Disparity,
}

impl Spacing {
    /// The distance at `s` in `[0, 1]` between `near` and `far`; both ends are met exactly.
    #[must_use]
    pub fn at(self, near: f64, far: f64, s: f64) -> f64 {
        if s <= 0.0 {
            near
        } else if s >= 1.0 {
            far
        } else {
            match self {
                Self::Linear => near * (1.0 - s) + far * s,
                Self::Disparity => 1.0 / ((1.0 - s) / near + s / far),
            }
        }
    }
}

/// The edges of `n` bins between `near` and `far`: `edges` `[n + 1]`, written, unit of `near`.
pub fn bin_edges(near: f32, far: f32, spacing: Spacing, edges: &mut [f32]) {
    let bins = edges.len().saturating_sub(1).max(1) as f64;
    for (i, edge) in edges.iter_mut().enumerate() {
        *edge = spacing.at(near.into(), far.into(), i as f64 / bins) as f32;
    }
}

/// One sample in each of `n` equally spaced bins: `t[i]` at the share `u[i]` of bin `i`. Increasing.
///
/// # Shapes and units
/// * `u` `[n]` in `[0, 1)`; `t` `[n]` out, unit of `near`
///
/// # Panics
/// When the lengths differ.
///
/// # Source
/// Mildenhall et al., "NeRF", 2020, eq. 2.
pub fn stratified_bins(near: f32, far: f32, spacing: Spacing, u: &[f32], t: &mut [f32]) {
    assert_eq!(u.len(), t.len(), "one random number a sample");
    let n = u.len() as f64;
    let edge_at = |i: f64| spacing.at(near.into(), far.into(), i / n);
    let mut lower = f64::from(near);
    for (i, (t, &u)) in t.iter_mut().zip(u).enumerate() {
        let upper = edge_at((i + 1) as f64);
        // A bin that ends at infinity has its share in the inverse of the distance.
        let shared = if upper.is_finite() { between(lower, upper, u) } else { edge_at(i as f64 + f64::from(u)) };
        *t = shared as f32;
        lower = upper;
    }
}

/// One sample around each of `n` equally spaced points from `near` to `far`, between the mid-points to its neighbours:
/// the first and the last have half as much room. `n = 1` gives `near`.
///
/// # Shapes and units
/// * `u` `[n]` in `[0, 1)`; `t` `[n]` out, unit of `near`
///
/// # Panics
/// When the lengths differ.
///
/// # Source
/// The released code of Mildenhall et al., "NeRF", 2020.
pub fn stratified_nerf(near: f32, far: f32, spacing: Spacing, u: &[f32], t: &mut [f32]) {
    assert_eq!(u.len(), t.len(), "one random number a sample");
    let n = u.len();
    let point = |i: usize| spacing.at(near.into(), far.into(), i as f64 / (n.max(2) - 1) as f64);
    let mut lower = f64::from(near);
    for (i, (t, &u)) in t.iter_mut().zip(u).enumerate() {
        let upper = if i + 1 < n { 0.5 * (point(i) + point(i + 1)) } else { point(i) };
        *t = between(lower, upper, u) as f32;
        lower = upper;
    }
}

/// Samples distributed as a histogram: `samples[i]` is where the cumulative mass of the bins reaches `u[i]`.
///
/// The mass of a bin is `weights[i] + pad`, over the sum of all; without any mass every **bin** counts the same. Inside a bin
/// mass is spread evenly. Where the cumulative mass is flat the bin to the right is taken; `u = 1` gives the right edge
/// of the last bin with mass. `u` need not be sorted; if it is, so are the samples.
///
/// # Shapes and units
/// * `edges`   `[n + 1]` bin edges, non-decreasing
/// * `weights` `[n]` finite, `>= 0`; need not sum to one
/// * `cdf`     `[n + 1]` out: cumulative mass at the edges, from exactly 0 to exactly 1
/// * `u`, `samples` `[m]`; no bins give no samples: then `m` must be 0
///
/// # Panics
/// When the lengths disagree.
pub fn invert_cdf(edges: &[f32], weights: &[f32], pad: f32, u: &[f32], cdf: &mut [f64], samples: &mut [f32]) {
    let n = weights.len();
    check_lengths(edges, weights, u, cdf, samples);
    if n == 0 {
        return;
    }
    let total: f64 = weights.iter().map(|&w| f64::from(w) + f64::from(pad)).sum();
    cdf[0] = 0.0;
    let mut sum = 0.0;
    for (i, &w) in weights.iter().enumerate() {
        // The mass as a share: no overflow, and no more of it than there is.
        sum += if total > 0.0 { (f64::from(w) + f64::from(pad)) / total } else { 1.0 / n as f64 };
        cdf[i + 1] = sum.min(1.0);
    }
    // The last bin with mass ends at exactly 1, and so do the empty ones behind it.
    let last = if total > 0.0 { (0..n).rev().find(|&i| weights[i] + pad > 0.0).unwrap_or(n - 1) } else { n - 1 };
    cdf[last + 1..].fill(1.0);
    for (sample, &u) in samples.iter_mut().zip(u) {
        let u = f64::from(u);
        let bin = cdf.partition_point(|&c| c <= u).clamp(1, last + 1) - 1;
        let mass = cdf[bin + 1] - cdf[bin];
        let share = if mass > 0.0 { ((u - cdf[bin]) / mass).clamp(0.0, 1.0) } else { 0.0 };
        let (a, b) = (f64::from(edges[bin]), f64::from(edges[bin + 1]));
        *sample = (a + share * (b - a)) as f32;
    }
}

/// What [`nerf_sample_pdf`] adds to each weight, and the mass below which it does not divide.
const NERF_EPS: f64 = 1e-5;

/// Samples distributed as a histogram the way NeRF's released code draws them: `1e-5` is added to every weight, and a bin
/// with less than `1e-5` of the mass counts as if it had all of it, so that its samples stay near its left edge. For
/// published configurations; otherwise prefer [`invert_cdf`].
///
/// # Shapes and units
/// As [`invert_cdf`].
///
/// # Panics
/// When the lengths disagree.
///
/// # Source
/// The released code of Mildenhall et al., "NeRF", 2020, `sample_pdf`.
pub fn nerf_sample_pdf(edges: &[f32], weights: &[f32], u: &[f32], cdf: &mut [f64], samples: &mut [f32]) {
    let n = weights.len();
    check_lengths(edges, weights, u, cdf, samples);
    if n == 0 {
        return;
    }
    let total: f64 = weights.iter().map(|&w| f64::from(w) + NERF_EPS).sum();
    cdf[0] = 0.0;
    for (i, &w) in weights.iter().enumerate() {
        cdf[i + 1] = cdf[i] + (f64::from(w) + NERF_EPS) / total;
    }
    for (sample, &u) in samples.iter_mut().zip(u) {
        let u = f64::from(u);
        let above = cdf.partition_point(|&c| c <= u);
        let (below, above) = (above.max(1) - 1, above.min(n));
        let mass = cdf[above] - cdf[below];
        let share = (u - cdf[below]) / if mass < NERF_EPS { 1.0 } else { mass };
        let (a, b) = (f64::from(edges[below]), f64::from(edges[above]));
        *sample = (a + share * (b - a)) as f32;
    }
}

/// Two sorted sets of distances in one, sorted: `out` `[a + b]`, written. Equal ones keep `a` first.
///
/// # Panics
/// When `out` does not hold as many as both; in debug builds when one is not sorted.
pub fn merge_sorted(a: &[f32], b: &[f32], out: &mut [f32]) {
    assert_eq!(out.len(), a.len() + b.len(), "out holds both sets");
    debug_assert!(a.is_sorted() && b.is_sorted(), "both sets must be sorted");
    let (mut i, mut j) = (0, 0);
    for out in out {
        let from_a = j == b.len() || i < a.len() && a[i] <= b[j];
        // Whatever a NaN compares as (debug builds refuse it), neither end is run past.
        if from_a {
            *out = a[i];
            i += 1;
        } else {
            *out = b[j];
            j += 1;
        }
    }
}

/// Lengths of the intervals between edges: `dt[i] = edges[i + 1] - edges[i]`, written; `edges` `[n + 1]`, `dt` `[n]`.
///
/// # Panics
/// When the lengths disagree.
pub fn dt_from_edges(edges: &[f32], dt: &mut [f32]) {
    assert_eq!(edges.len().saturating_sub(1), dt.len(), "one length between each two edges");
    for (dt, e) in dt.iter_mut().zip(edges.windows(2)) {
        *dt = e[1] - e[0];
    }
}

/// Lengths of the intervals from each sample to the next, and from the last to `far`: `dt` `[n]`, written. NeRF puts `far`
/// at infinity, which [`LastInterval::Opaque`](crate::quadrature::LastInterval::Opaque) says better.
///
/// # Panics
/// When the lengths differ.
pub fn dt_from_points(t: &[f32], far: f32, dt: &mut [f32]) {
    assert_eq!(t.len(), dt.len(), "one length a sample");
    for (i, dt) in dt.iter_mut().enumerate() {
        *dt = t.get(i + 1).copied().unwrap_or(far) - t[i];
    }
}

/// Mid-points between neighbours, `[n - 1]`, written: the bins around NeRF's coarse samples.
///
/// # Panics
/// When the lengths disagree.
pub fn mid_points(t: &[f32], mid: &mut [f32]) {
    assert_eq!(t.len().saturating_sub(1), mid.len(), "one mid-point between each two samples");
    for (mid, t) in mid.iter_mut().zip(t.windows(2)) {
        *mid = 0.5 * (t[0] + t[1]);
    }
}

/// The point at the share `u` between two, never past them.
fn between(a: f64, b: f64, u: f32) -> f64 {
    a + (b - a) * f64::from(u)
}

fn check_lengths(edges: &[f32], weights: &[f32], u: &[f32], cdf: &[f64], samples: &[f32]) {
    assert_eq!(u.len(), samples.len(), "one random number a sample");
    if weights.is_empty() {
        assert!(samples.is_empty(), "no bins give no samples");
    } else {
        assert_eq!(edges.len(), weights.len() + 1, "bins have one edge more than weights");
        assert_eq!(cdf.len(), weights.len() + 1, "cdf holds one number an edge");
    }
}
