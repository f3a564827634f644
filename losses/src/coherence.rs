//! Coherence: a deformation should keep the distances between neighbours, as rigid as possible.
//!
//! Letters: `n` samples, each with one neighbour; `e` the way from a sample to its neighbour, `there` the same way once both are
//! deformed; `r = |there| / |e| - 1` its stretch, -1 where both fall together.
//!
//! ```text
//! rho(r) = sqrt(1 + (r / c)^2) - 1        (r / c)^2 / 2 well below c, |r| / c well above
//! ```
//!
//! Distances are compared, not displacements. Those of two neighbours differ by up to `2 sin(angle / 2) |e|` where a thing turns,
//! so that a term which keeps displacements alike keeps things from turning. A distance knows of no rotation: what moves as a whole
//! costs nothing, however far it turns. `(|there| - |e|)^2` is what is left of the energy of a cell of one edge, whose rotation is
//! free: the best one lays `e` along `there`. `rho` is about that where little is stretched, and does not let the edges of things that
//! part outweigh all else.
//!
//! [`elastic`](crate::elastic) asks more of one sample, all singular values of the Jacobian, and needs that. This needs the deformation
//! at one more point; over many random neighbours all directions have their turn. Reflections cost nothing in either.
//!
//! # Numerics
//! Lengths and sums are `f64`. A sample whose neighbour is itself (`|e| = 0`) costs nothing; where `there` is 0 it has no direction,
//! and its derivative counts as 0. Values are not scanned: NaN in gives NaN out, unless the weight is 0.
//!
//! # Source
//! Sorkine and Alexa, "As-rigid-as-possible surface modeling", 2007, section 2, for one edge a cell. Charbonnier's kernel as in
//! [`kernel::general`](crate::kernel::general) with shape 1.

use crate::{LossError, error::same};
use float_core::m64;

/// Scale of the stretch where nothing is known of the scene: a tenth.
pub const SCALE: f32 = 0.1;

/// `sum_k w[k] rho(r[k])`; 0 for no samples. Samples of weight 0 are skipped.
///
/// Weights are constants: those of the rendering, without gradient, divided by the rays.
///
/// # Shapes and units
/// * `e` `[3][n]`, `there` `[3][n]` in one unit of length
/// * `w` `[n]`
/// * `c` stretch, `> 0`, [`SCALE`] where nothing is known
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable `c`.
pub fn coherence(e: &[f32], there: &[f32], w: &[f32], c: f32) -> Result<f64, LossError> {
    check(e, there, w, c)?;
    let (n, mut sum) = (w.len(), 0.0);
    for (s, &w) in w.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        sum += f64::from(w) * robust(stretch(length(e, n, s), length(there, n, s)), c).0;
    }
    Ok(sum)
}

/// Backward twin of [`coherence`]: adds `loss_bar` times its gradient into `there_bar`, shaped as `there`. Answers with the sum,
/// which falls out on the way.
///
/// # Errors
/// As [`coherence`].
pub fn coherence_backward(
    e: &[f32],
    there: &[f32],
    w: &[f32],
    c: f32,
    loss_bar: f64,
    there_bar: &mut [f32],
) -> Result<f64, LossError> {
    check(e, there, w, c)?;
    same("there_bar", there.len(), there_bar.len())?;
    let (n, mut sum) = (w.len(), 0.0);
    for (s, &w) in w.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        let (was, now) = (length(e, n, s), length(there, n, s));
        let (value, derivative) = robust(stretch(was, now), c);
        sum += f64::from(w) * value;
        // d r / d there = there / (|there| |e|).
        let lengths = was * now;
        let factor = if lengths > 0.0 { loss_bar * f64::from(w) * derivative / lengths } else { 0.0 };
        for at in (0..3).map(|row| row * n + s) {
            there_bar[at] += (factor * f64::from(there[at])) as f32;
        }
    }
    Ok(sum)
}

/// Stretch of a way from its lengths before and after; 0 for a way of no length.
fn stretch(was: f64, now: f64) -> f64 {
    if was == 0.0 { 0.0 } else { now / was - 1.0 }
}

/// `rho` and its derivative.
fn robust(r: f64, c: f32) -> (f64, f64) {
    let c = f64::from(c);
    let z = (r / c) * (r / c);
    let root = m64::sqrt(1.0 + z);
    // Not root - 1, which has no digits left where little is stretched.
    (z / (root + 1.0), r / (c * c * root))
}

fn length(v: &[f32], n: usize, s: usize) -> f64 {
    m64::sqrt((0..3).map(|row| f64::from(v[row * n + s])).map(|x| x * x).sum())
}

fn check(e: &[f32], there: &[f32], w: &[f32], c: f32) -> Result<(), LossError> {
    same("e", 3 * w.len(), e.len())?;
    same("there", 3 * w.len(), there.len())?;
    if c > 0.0 && c.is_finite() {
        return Ok(());
    }
    Err(LossError::Parameter { what: "scale `c` of the coherence loss", value: c, range: "a finite number above 0" })
}
