//! Deformations of space: from a point at one time to its place in the canonical scene. Tape operations, and the rigid one
//! as a plain pair ([`rigid_points`]) for rendering.
//!
//! A network outputs a displacement, or a twist: rotation vector `omega` and `v`. Both deformations are the identity, bit for
//! bit, where that is 0, and differentiable there to any order, so that losses can contain their Jacobians (three
//! tangents).
//!
//! # Source
//! Pumarola et al., "D-NeRF", 2021, eq. 2 (translation); Park et al., "Nerfies", 2021, sec. 3.2 (rigid
//! motions). Nerfies divides `omega` and `v` by the angle, which is 0/0 at rest; here the same motion is written with
//! coefficients that are smooth functions of the squared angle.

mod points;

pub use points::{RigidBars, rigid_points, rigid_points_backward};

use crate::tape::{Node, Tape, TapeError};

/// `x + delta`.
///
/// # Shapes and units
/// All `[3 x n]` (any rows), world units.
///
/// # Errors
/// [`TapeError::Shape`], [`TapeError::ForeignNode`].
pub fn translate(tape: &mut Tape, x: Node, delta: Node) -> Result<Node, TapeError> {
    tape.add(x, delta)
}

/// The rigid motion `exp(omega, v)` of each sample applied to it: `R x + V v`, `R = 1 + c_1 [omega] + c_2 [omega]^2`,
/// `V = 1 + c_2 [omega] + c_3 [omega]^2` with [Stumpff functions](crate::stumpff) of `|omega|^2`.
///
/// # Shapes and units
/// `x` `[3 x n]` world units, `omega` `[3 x n]` radians, `v` and the result as `x`.
///
/// # Errors
/// [`TapeError::Shape`], [`TapeError::ForeignNode`].
pub fn rigid(tape: &mut Tape, x: Node, omega: Node, v: Node) -> Result<Node, TapeError> {
    let squared = tape.dot(omega, omega)?;
    let [c1, c2, c3] = [tape.stumpff(squared, 1)?, tape.stumpff(squared, 2)?, tape.stumpff(squared, 3)?];
    // x + v + omega x ((c1 x + c2 v) + omega x (c2 x + c3 v)): two cross products instead of matrices.
    let once = combine(tape, x, c1, v, c2)?;
    let twice = combine(tape, x, c2, v, c3)?;
    let twice = tape.cross(omega, twice)?;
    let turned = tape.add(once, twice)?;
    let turned = tape.cross(omega, turned)?;
    let moved = tape.add(x, v)?;
    tape.add(moved, turned)
}

/// [`rigid`] around a pivot of each sample: `exp(omega, v)(x - pivot) + pivot`.
///
/// # Shapes and units
/// As [`rigid`]; `pivot` as `x`.
///
/// # Errors
/// [`TapeError::Shape`], [`TapeError::ForeignNode`].
pub fn rigid_about(tape: &mut Tape, x: Node, omega: Node, v: Node, pivot: Node) -> Result<Node, TapeError> {
    let local = tape.sub(x, pivot)?;
    let moved = rigid(tape, local, omega, v)?;
    tape.add(moved, pivot)
}

/// `by_a a + by_b b`, the factors one row each.
fn combine(tape: &mut Tape, a: Node, by_a: Node, b: Node, by_b: Node) -> Result<Node, TapeError> {
    let a = tape.mul_row(a, by_a)?;
    let b = tape.mul_row(b, by_b)?;
    tape.add(a, b)
}
