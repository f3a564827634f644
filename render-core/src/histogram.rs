//! Histograms of weights along a ray, and new intervals drawn from them: blurred, and resampled where the weight is.
//!
//! Intervals follow each other without gaps, so a ray of `n` intervals has `n + 1` *fenceposts* `s`, and the intervals of
//! the next pass are drawn as fenceposts too, not as points. Nothing here is random: the caller brings the quantiles `u` of the
//! mass, see [`quantiles`]. No fencepost carries a gradient.
//!
//! | function | what |
//! | --- | --- |
//! | [`blur_weights`] | weights widened to their neighbours and padded, before they are resampled |
//! | [`quantiles`] | evenly spread quantiles of the mass, jittered or not |
//! | [`resample_fenceposts`] | `m` fenceposts where those quantiles of the mass lie |
//! | [`fenceposts_between`] | `n + 1` fenceposts around `n` centres |

use crate::sample::invert_cdf;

/// How [`quantiles`] of the mass are spread in `[0, 1]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantiles<'a> {
    /// From exactly 0 to exactly 1 in equal steps: fenceposts that keep both ends, for renders.
    Ends,
    /// The middle of each of `n` equal parts: centres, for renders.
    Centres,
    /// One random number in `[0, 1)` for all: quantile `i` is `(i + u) / n`. One jitter a ray.
    Shared(f32),
    /// One random number in `[0, 1)` for each of the `n` quantiles: `(i + u[i]) / n`. Stratified.
    Each(&'a [f32]),
}

/// `n` increasing quantiles of the mass, in `[0, 1]`: `u` `[n]`, written.
///
/// A single quantile of [`Quantiles::Ends`] is 0.
///
/// # Panics
/// When [`Quantiles::Each`] does not hold `n` numbers.
///
/// # Source
/// Barron et al., "Mip-NeRF", 2021, released code (`Each`, `Ends`); "Mip-NeRF 360", 2022, released code (`Shared`,
/// `Centres`).
pub fn quantiles(rule: Quantiles<'_>, u: &mut [f32]) {
    if let Quantiles::Each(random) = rule {
        assert_eq!(random.len(), u.len(), "one random number a quantile");
    }
    let n = u.len() as f64;
    for (i, u) in u.iter_mut().enumerate() {
        let place = i as f64;
        let share = match rule {
            Quantiles::Ends => place / (n - 1.0).max(1.0),
            Quantiles::Centres => (place + 0.5) / n,
            Quantiles::Shared(jitter) => (place + f64::from(jitter)) / n,
            Quantiles::Each(random) => (place + f64::from(random[i])) / n,
        };
        *u = share as f32;
    }
}

/// Fenceposts where the cumulative weight reaches the quantiles `u`: non-decreasing, within `[s[0], s[n]]`.
///
/// Mass is spread evenly inside an interval; a ray without any weight is resampled as if every **interval** weighed the same.
/// Intervals without weight get no fencepost inside. `m` fenceposts make `m - 1` new intervals.
///
/// # Shapes and units
/// * `s`   `[n + 1]` fenceposts, non-decreasing, any unit of distance
/// * `w`   `[n]` weights, finite, `>= 0`; need not sum to one
/// * `u`   `[m]` quantiles of the mass in `[0, 1]`, non-decreasing
/// * `cdf` `[n + 1]` out: cumulative mass at `s`, from exactly 0 to exactly 1
/// * `out` `[m]` out, unit of `s`; no intervals give no fenceposts: then `m` must be 0
///
/// # Panics
/// When the lengths disagree; in debug builds when `u` is not sorted.
///
/// # Source
/// Barron et al., "Mip-NeRF", 2021, section 3.1; "Mip-NeRF 360", 2022, section 3.
pub fn resample_fenceposts(s: &[f32], w: &[f32], u: &[f32], cdf: &mut [f64], out: &mut [f32]) {
    debug_assert!(u.is_sorted(), "quantiles must be sorted");
    invert_cdf(s, w, 0.0, u, cdf, out);
}

/// Fenceposts around centres: halfway between neighbours, and as far beyond the first and the last centre as the post on
/// its other side, but within `[low, high]`. A single centre gives `[low, high]`.
///
/// # Shapes and units
/// * `centres` `[n]`, non-decreasing, within `[low, high]`
/// * `out` `[n + 1]` out, the same unit; no centres give no fenceposts: then it must be empty
///
/// # Panics
/// When the lengths disagree, or with two centres or more when `low` is above `high` or one of them is NaN.
///
/// # Source
/// Barron et al., "Mip-NeRF 360", 2022, released code (`sample_intervals`).
pub fn fenceposts_between(centres: &[f32], [low, high]: [f32; 2], out: &mut [f32]) {
    let n = centres.len();
    assert_eq!(out.len(), if n == 0 { 0 } else { n + 1 }, "centres have one fencepost more");
    match n {
        0 => return,
        1 => out.copy_from_slice(&[low, high]),
        _ => {
            for (post, c) in out[1..n].iter_mut().zip(centres.windows(2)) {
                *post = c[0] + 0.5 * (c[1] - c[0]);
            }
            let first = 2.0 * centres[0] - out[1];
            let last = 2.0 * centres[n - 1] - out[n - 1];
            (out[0], out[n]) = (first.clamp(low, high), last.clamp(low, high));
        }
    }
    // Rounding never puts a post before its predecessor.
    let mut before = out[0];
    for post in out {
        *post = post.max(before);
        before = *post;
    }
}

/// Weights as the next pass should sample them: the mean of the maxima with the left and with the right neighbour, plus
/// `pad`. `out[k] = (max(w[k-1], w[k]) + max(w[k], w[k+1])) / 2 + pad`, the ends replicated.
///
/// # Shapes and units
/// * `w` `[n]`, `>= 0`; `out` `[n]`, written; does not sum to what `w` does
///
/// # Panics
/// When the lengths differ.
///
/// # Source
/// Barron et al., "Mip-NeRF", 2021, section 3.1 (`pad` = 0.01).
pub fn blur_weights(w: &[f32], pad: f32, out: &mut [f32]) {
    assert_eq!(w.len(), out.len(), "one blurred weight a weight");
    let n = w.len();
    for k in 0..n {
        let (left, right) = (w[k.saturating_sub(1)], w[(k + 1).min(n - 1)]);
        out[k] = 0.5 * (left.max(w[k]) + w[k].max(right)) + pad;
    }
}
