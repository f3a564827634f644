//! A flow made finer: the one near it that fits both pictures best and is smooth.
//!
//! With `N(a, b) = 1 / (a^2 + b^2 + 1)` and `P(x) = sqrt(x + eps^2)` the energy is the sum over pixels of
//! ```text
//! DATA P(N r^2) + DETAIL P(Nx rx^2 + Ny ry^2) + SMOOTHNESS P(|grad u|^2 + |grad v|^2)
//! ```
//! where `r = I(x + u) - T(x)` is linear in what is added to the flow, `rx`, `ry` are its derivatives along x and y (the same place, whatever its
//! brightness), and `N` turns levels of grey into pixels. The second picture is warped anew a few times; in between, the derivatives of `P`
//! are held while linear equations are relaxed, and then renewed.
//!
//! # Source
//! Brox et al., "High accuracy optical flow estimation based on a theory for warping", 2004; normalised and weighted as in
//! Kroeger et al., 2016, section 2.3.

mod equations;
mod relaxation;

use super::field::Field;
use super::plane::Plane;
use equations::Equations;
use relaxation::Checkers;

/// Warps of the second picture.
const WARPS: usize = 3;
/// Renewals of the weights for each warp.
const RENEWALS: usize = 3;
/// Sweeps over all pixels for each renewal.
const SWEEPS: usize = 8;

/// The flow from `first` to `second`, both of one size, near `flow`.
pub(super) fn refined(first: &Plane, second: &Plane, flow: Field) -> Field {
    let mut now = flow;
    for _ in 0..WARPS {
        let equations = Equations::new(first, second, now.clone());
        for _ in 0..RENEWALS {
            let pixels = equations.at(&now);
            let mut checkers = Checkers::of(&now);
            for _ in 0..SWEEPS {
                checkers.sweep(&pixels);
            }
            now = checkers.field();
        }
    }
    now
}
