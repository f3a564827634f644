//! An `f32` pair against its `f64` twin, and the twin against central differences.

use super::{Mismatch, Tolerance, check_adds, check_pair, compare};

/// The bounds of [`check_f32_pair`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairTolerances {
    /// Outputs of the `f32` forward against the twin's.
    pub values: Tolerance,
    /// Gradients of the twin against central differences.
    pub twin: Tolerance,
    /// Gradients of the `f32` backward against the twin's.
    pub gradients: Tolerance,
}

impl Default for PairTolerances {
    /// Values and gradients `1e-4` of the largest entry, the twin `1e-7`.
    fn default() -> Self {
        Self { values: Tolerance::SINGLE, twin: Tolerance::TWIN, gradients: Tolerance::SINGLE }
    }
}

/// Check everything about a pair at `x`: the `f32` values against the twin's, the twin's gradient against central
/// differences, the `f32` gradient against the twin's, and that both backward functions add.
///
/// # Errors
/// The worst entry of the first comparison that fails; `what` says which.
pub fn check_f32_pair(
    x: &[f32],
    out_bar: &[f32],
    single: (impl FnMut(&[f32], &mut [f32]), impl FnMut(&[f32], &[f32], &mut [f32])),
    twin: (impl FnMut(&[f64], &mut [f64]), impl FnMut(&[f64], &[f64], &mut [f64])),
    tolerances: PairTolerances,
) -> Result<(), Mismatch> {
    let (mut forward, mut backward) = single;
    let (mut forward_twin, mut backward_twin) = twin;
    let x_twin: Vec<f64> = x.iter().map(|&x| f64::from(x)).collect();
    let out_bar_twin: Vec<f64> = out_bar.iter().map(|&b| f64::from(b)).collect();

    let (mut out, mut want) = (vec![f32::NAN; out_bar.len()], vec![f64::NAN; out_bar.len()]);
    forward(x, &mut out);
    forward_twin(&x_twin, &mut want);
    compare("f32 forward against the twin", &out, &want, tolerances.values)?;

    check_pair(&x_twin, &out_bar_twin, &mut forward_twin, &mut backward_twin, tolerances.twin)?;

    let (mut x_bar, mut want) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    backward(x, out_bar, &mut x_bar);
    backward_twin(&x_twin, &out_bar_twin, &mut want);
    compare("f32 backward against the twin", &x_bar, &want, tolerances.gradients)?;
    check_adds(&x_bar, |x_bar| backward(x, out_bar, x_bar))
}
