//! Ready-made robust fits.

use super::{Irls, Outcome, Report, Solved, solve_linear};
use crate::{LossError, error::same};
use alloc::{vec, vec::Vec};

/// A robust mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Location {
    /// The mean, in the unit of the values.
    pub value: f64,
    /// How it went.
    pub report: Report,
}

/// A robust line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Value at `x = 0`.
    pub intercept: f64,
    /// Growth per unit of `x`.
    pub slope: f64,
    /// How it went.
    pub report: Report,
}

impl Irls {
    /// Robust mean of `y`, from its median.
    ///
    /// # Errors
    /// [`LossError::Shape`] for no values, else as [`Irls::minimise`].
    pub fn location(&self, y: &[f64]) -> Result<Location, LossError> {
        if y.is_empty() {
            return Err(LossError::Shape { what: "y", want: 1, got: 0 });
        }
        finite("y", y)?;
        let mut parameters = [median(&mut y.to_vec())];
        let ones = vec![1.0; y.len()];
        let report = self.linear(&ones, y, &mut parameters)?;
        Ok(Location { value: parameters[0], report })
    }

    /// Robust line through the points `(x, y)`, from the repeated median: nearly half of the points may be anywhere.
    ///
    /// The start compares every pair of points: quadratic time.
    ///
    /// # Errors
    /// [`LossError::Shape`] unless there are as many `x` as `y`, and two at least; [`LossError::NonFinite`]; else as
    /// [`Irls::minimise`]. Where no two `x` differ: [`Outcome::Undetermined`] and slope 0.
    ///
    /// # Source
    /// Siegel, "Robust regression using repeated medians", 1982 (the start).
    pub fn line(&self, x: &[f64], y: &[f64]) -> Result<Line, LossError> {
        same("y", x.len(), y.len())?;
        if x.len() < 2 {
            return Err(LossError::Shape { what: "x", want: 2, got: x.len() });
        }
        finite("x", x)?;
        finite("y", y)?;
        let slope = repeated_median(x, y);
        let mut rest: Vec<f64> = x.iter().zip(y).map(|(x, y)| y - slope * x).collect();
        let mut parameters = [median(&mut rest), slope];
        let design: Vec<f64> = x.iter().flat_map(|&x| [1.0, x]).collect();
        let report = self.linear(&design, y, &mut parameters)?;
        let [intercept, slope] = parameters;
        Ok(Line { intercept, slope, report })
    }

    /// Robust linear regression `y ~ a parameters`, from the parameters given.
    ///
    /// # Shapes and units
    /// * `a` `[n][k]` row by row, `y` `[n]`
    /// * `parameters` `[k]` in: the start; out: the fit
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, else as [`Irls::minimise`].
    ///
    /// # Panics
    /// If there is no memory for `k * k` numbers.
    pub fn linear(&self, a: &[f64], y: &[f64], parameters: &mut [f64]) -> Result<Report, LossError> {
        let k = parameters.len();
        same("a", y.len() * k, a.len())?;
        if k == 0 {
            let report = Report { outcome: Outcome::Converged, iterations: 0, objective: self.objective(y) };
            return self.kernel.check().map(|()| report);
        }
        let (mut e, mut w) = (vec![0.0; y.len()], vec![0.0; y.len()]);
        let errors = |p: &[f64], e: &mut [f64]| {
            for ((e, row), y) in e.iter_mut().zip(a.chunks_exact(k)).zip(y) {
                *e = row.iter().zip(p).map(|(a, p)| a * p).sum::<f64>() - y;
            }
        };
        // Lengths were checked above.
        let solve = |w: &[f64], p: &mut [f64]| solve_linear(a, y, w, p).unwrap_or(Solved::Undetermined);
        self.minimise(parameters, &mut e, &mut w, errors, solve)
    }
}

/// Lower median; at least one value, all finite. Reorders them.
fn median(values: &mut [f64]) -> f64 {
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Median over points of the median slope to all others.
fn repeated_median(x: &[f64], y: &[f64]) -> f64 {
    let mut slopes = Vec::with_capacity(x.len());
    let mut outer = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        slopes.clear();
        slopes.extend((0..x.len()).filter(|&j| x[j] != x[i]).map(|j| (y[j] - y[i]) / (x[j] - x[i])));
        if !slopes.is_empty() {
            outer.push(median(&mut slopes));
        }
    }
    if outer.is_empty() { 0.0 } else { median(&mut outer) }
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), LossError> {
    match values.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(LossError::NonFinite { what, index }),
        None => Ok(()),
    }
}
