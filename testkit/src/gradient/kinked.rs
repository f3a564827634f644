//! Functions with corners and jumps: tight everywhere, except for a counted share of entries at the edge.

use super::{Mismatch, Tolerance, compare, distance, step, weighted};
use crate::golden::Number;

/// How many entries were excused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flips {
    /// Entries excused.
    pub flipped: usize,
    /// Entries in all.
    pub of: usize,
}

/// Compare two tensors of a quantity that jumps (a cell index, a threshold): at most `share` of the entries, rounded
/// down, may be outside the bound, the others must keep it. The bound counts from the largest wanted value.
///
/// # Errors
/// The worst entry, where too many are outside.
///
/// # Panics
/// If the lengths differ.
#[track_caller]
pub fn check_with_flips<G: Number, W: Number>(
    what: &'static str,
    got: &[G],
    want: &[W],
    tolerance: Tolerance,
    share: f64,
) -> Result<Flips, Mismatch> {
    let allowed = (share * got.len() as f64) as usize;
    match compare(what, got, want, tolerance) {
        Ok(()) => Ok(Flips { flipped: 0, of: got.len() }),
        Err(mismatch) if mismatch.wrong <= allowed => Ok(Flips { flipped: mismatch.wrong, of: got.len() }),
        Err(mismatch) => Err(mismatch),
    }
}

/// As [`check_pair`](super::check_pair), for functions with corners (`relu`, `abs`, `max`, interpolation in cells).
///
/// An entry of the gradient which is not the central difference is excused only if there *is* a corner within one step:
/// the slopes to the left and to the right differ by more than the bound, and the gradient lies between them or is one
/// of them. At most `share` of the entries, rounded down, may be excused. Functions that jump have no gradient at the
/// jump; move the test point.
///
/// # Errors
/// The worst entry that is neither right nor excused; or, where too many are excused, the worst of those.
pub fn check_kinked(
    x: &[f64],
    out_bar: &[f64],
    mut forward: impl FnMut(&[f64], &mut [f64]),
    mut backward: impl FnMut(&[f64], &[f64], &mut [f64]),
    tolerance: Tolerance,
    share: f64,
) -> Result<Flips, Mismatch> {
    let mut got = vec![0.0; x.len()];
    backward(x, out_bar, &mut got);
    let mut f = weighted(out_bar, &mut forward);
    let here = f(x);
    let mut moved = x.to_vec();
    // One-sided slopes: left and right.
    let mut slopes = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        let mut slope = |h: f64| {
            moved[i] = x[i] + h;
            let travelled = moved[i] - x[i];
            (f(&moved) - here) / travelled
        };
        slopes.push((slope(-step(x[i])), slope(step(x[i]))));
        moved[i] = x[i];
    }
    let central: Vec<f64> = slopes.iter().map(|(left, right)| 0.5 * (left + right)).collect();
    let bound = tolerance.bound(&central);
    // What each entry is compared with: the central difference, or itself where it is excused.
    let mut want = central.clone();
    let mut flipped = 0;
    for (i, &(left, right)) in slopes.iter().enumerate() {
        let between = left.min(right) - bound..=left.max(right) + bound;
        if distance(got[i], central[i]) > bound && (left - right).abs() > bound && between.contains(&got[i]) {
            want[i] = got[i];
            flipped += 1;
        }
    }
    compare("backward against central differences", &got, &want, tolerance)?;
    if flipped > (share * x.len() as f64) as usize {
        let mut mismatch = compare("too many entries at a corner", &got, &central, tolerance);
        if let Err(m) = &mut mismatch {
            m.wrong = flipped;
        }
        mismatch?;
    }
    Ok(Flips { flipped, of: x.len() })
}
