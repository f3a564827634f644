//! Background: points that are known to stand still must not be moved by a deformation.
//!
//! Letters: `n` points; `d` their displacements, deformed less original; `|d|` the length of one.
//!
//! | form | costs a point | source |
//! | --- | --- | --- |
//! | [`Form::Robust`] | `2 z / (z + 4)`, `z = (|d| / c)^2` | the released code, `c` = [`SCALE`], times 1 |
//! | [`Form::Length`] | `|d|` | the paper, times 1e-3 |
//!
//! Sums are `f64` in index order; the caller divides by the points it drew. Values are not scanned: NaN in gives NaN out.
//!
//! Source: Park et al., "Nerfies: deformable neural radiance fields", 2021, sec. 3.4 and the released code.

use crate::{LossError, error::same};
use float_core::m64;

/// Scale of the robust form in the released code, in units of a scene of size 1.
pub const SCALE: f32 = 0.001;

/// What a displaced point costs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Geman-McClure in the length: smooth at rest, saturates at 2.
    Robust {
        /// Displacements well below count as in least squares, world unit, `> 0`.
        c: f32,
    },
    /// The length; its derivative at 0 counts as 0.
    Length,
}

impl Form {
    /// As released.
    pub const NERFIES: Self = Self::Robust { c: SCALE };
}

/// Sum over the points; 0 for none.
///
/// # Shapes and units
/// * `d` `[3][n]` world unit
///
/// # Errors
/// [`LossError::Shape`] unless `d` is three rows, [`LossError::Parameter`] for an unusable form.
pub fn background(d: &[f32], form: Form) -> Result<f64, LossError> {
    let n = check(d, form)?;
    Ok((0..n).map(|s| cost(form, squared_length(d, n, s)).0).sum())
}

/// Backward twin of [`background`]: adds `loss_bar` times its gradient into `d_bar` `[3][n]`.
///
/// # Errors
/// As [`background`].
pub fn background_backward(d: &[f32], form: Form, loss_bar: f64, d_bar: &mut [f32]) -> Result<(), LossError> {
    let n = check(d, form)?;
    same("d_bar", d.len(), d_bar.len())?;
    for s in 0..n {
        let weight = loss_bar * cost(form, squared_length(d, n, s)).1;
        for row in 0..3 {
            d_bar[row * n + s] += (weight * f64::from(d[row * n + s])) as f32;
        }
    }
    Ok(())
}

/// Cost of a squared length, and its derivative with respect to the displacement over the displacement.
fn cost(form: Form, squared: f64) -> (f64, f64) {
    match form {
        Form::Robust { c } => {
            let c2 = f64::from(c) * f64::from(c);
            // f32 lengths leave f64 room: z stays finite.
            let q = 1.0 / (squared / c2 + 4.0);
            (2.0 * (squared / c2) * q, 16.0 * q * q / c2)
        }
        Form::Length => {
            let length = m64::sqrt(squared);
            (length, if length == 0.0 { 0.0 } else { 1.0 / length })
        }
    }
}

fn squared_length(d: &[f32], n: usize, s: usize) -> f64 {
    (0..3).map(|row| f64::from(d[row * n + s])).map(|x| x * x).sum()
}

fn check(d: &[f32], form: Form) -> Result<usize, LossError> {
    same("d", d.len().div_ceil(3) * 3, d.len())?;
    match form {
        Form::Robust { c } if !(c > 0.0 && c.is_finite()) => {
            Err(LossError::Parameter { what: "`c` of the background loss", value: c, range: "a finite number above 0" })
        }
        _ => Ok(d.len() / 3),
    }
}
