//! Early termination.
//!
//! Let `T` be the transmittance in front of the samples that are dropped. They and the background share the weight `T`;
//! without them all of `T` goes to the background. The colour changes by
//!
//! ```text
//! | sum(w[i] * (c[i] - background), i dropped) | <= T * max|c[i] - background|
//! ```
//!
//! so that stopping at `T < eps` costs a pixel at most `eps` times the largest difference between a radiance and the
//! background, [`termination_bound`]; at most `eps` for both in `[0, 1]`. Nothing is renormalised.

use float_core::m64;

/// Optical depth at which the transmittance has fallen to `eps`: compare a running sum with it instead of taking an
/// exponential each sample. `eps = 0` gives infinity (never stop), `eps >= 1` gives 0.
#[must_use]
pub fn depth_limit(eps: f32) -> f64 {
    if eps > 0.0 { -m64::ln(f64::from(eps).min(1.0)) } else { f64::INFINITY }
}

/// How many of a ray's samples to keep: up to and with the one behind which the transmittance is below `eps`. All of them
/// where it never is.
///
/// * `tau` `[n]` optical depths, front to back, `>= 0`
#[must_use]
pub fn terminate(tau: &[f32], eps: f32) -> usize {
    let limit = depth_limit(eps);
    let mut depth = 0.0_f64;
    for (i, &tau) in tau.iter().enumerate() {
        depth += f64::from(tau);
        if depth > limit {
            return i + 1;
        }
    }
    tau.len()
}

/// Largest error of a colour channel when the samples behind a transmittance of `trans` are dropped and the background is
/// not more than `spread` away from any of their radiances.
#[must_use]
pub fn termination_bound(trans: f32, spread: f32) -> f32 {
    trans * spread
}
