//! Iteratively reweighted least squares: a robust fit as a row of weighted ones.
//!
//! For errors `e_i(parameters)` and a kernel `kappa`, minimising `sum kappa(e_i)` is repeated: weigh every error by
//! `kappa'(e_i) / e_i` at the parameters there are, minimise `sum w_i e_i^2`. Where the weight never grows with the error (all
//! kernels here but [`Kernel::LogSquared`] and shapes above 2), each round lowers the sum of `kappa` or leaves it: half the
//! weighted square lies above the kernel and touches it at the current error.
//!
//! A redescending kernel has many minima and the iteration finds the nearest: start from an estimate that outliers do not
//! move (a median), as [`Irls::location`] and [`Irls::line`] do. Those two, and [`Irls::linear`], are the ready-made fits;
//! [`Irls::minimise`] takes any weighted solver.
//!
//! ```
//! use losses::{irls::Irls, kernel::Kernel};
//!
//! // Six values near 1, four gross outliers.
//! let y = [0.9, 1.1, 1.0, 0.95, 1.05, 1.0, 70.0, 75.0, 80.0, 90.0];
//! let fit = Irls::new(Kernel::Tukey { c: 1.0 }).location(&y)?;
//! assert!((fit.value - 1.0).abs() < 1e-6);
//! # Ok::<(), losses::LossError>(())
//! ```
//!
//! Source: Holland and Welsch, "Robust regression using iteratively reweighted least-squares", 1977; Huber, "Robust
//! statistics", 1981, section 7.8 (descent).

mod fits;
mod solve;

pub use fits::{Line, Location};
pub use solve::{Solved, solve_linear};

use crate::{LossError, error::same, kernel::Kernel};

/// A kernel and when to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Irls {
    /// What an error costs.
    pub kernel: Kernel,
    /// Done once no error moves by more, in the unit of errors.
    pub tolerance: f64,
    /// Weighted fits at most.
    pub max_iterations: usize,
}

/// Why the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// No error moved by more than the tolerance.
    Converged,
    /// The iterations are used up.
    MaxIterations,
    /// The weighted fit has no single answer (all weights 0, too few different places): the parameters are the last good ones.
    Undetermined,
}

/// How it went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Why it ended.
    pub outcome: Outcome,
    /// Weighted fits that were made.
    pub iterations: usize,
    /// `sum kappa(e_i)` at the end.
    pub objective: f64,
}

impl Irls {
    /// With a tolerance of `1e-6` and at most 100 fits.
    #[must_use]
    pub const fn new(kernel: Kernel) -> Self {
        Self { kernel, tolerance: 1e-6, max_iterations: 100 }
    }

    float_core::setters! {
        with_kernel kernel: Kernel;
        with_tolerance tolerance: f64;
        with_max_iterations max_iterations: usize;
    }

    /// `sum kappa(e_i)`, in index order.
    #[must_use]
    pub fn objective(&self, e: &[f64]) -> f64 {
        e.iter().map(|&e| f64::from(self.kernel.value(e as f32, 0.0))).sum()
    }

    /// Weight of every error: `w[i] = kappa'(e[i]) / e[i]`, written.
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree.
    pub fn weights(&self, e: &[f64], w: &mut [f64]) -> Result<(), LossError> {
        same("w", e.len(), w.len())?;
        w.iter_mut().zip(e).for_each(|(w, &e)| *w = f64::from(self.kernel.weight(e as f32, 0.0)));
        Ok(())
    }

    /// Iterate from `parameters` until the errors stand still.
    ///
    /// * `parameters` in: the start; out: the fit
    /// * `e`, `w` `[n]` memory; hold the errors of the fit and their weights at the end
    /// * `errors(parameters, e)` writes all errors
    /// * `solve(w, parameters)` replaces the parameters by those that minimise `sum w_i e_i^2` (for errors that are not linear in
    ///   them: brings them closer), or leaves them as they are and says [`Solved::Undetermined`]
    ///
    /// # Errors
    /// [`LossError::Shape`] unless `e` and `w` are of one length, [`LossError::Parameter`] for an unusable kernel,
    /// [`LossError::NonFinite`] naming the first error that is NaN or infinite.
    pub fn minimise(
        &self,
        parameters: &mut [f64],
        e: &mut [f64],
        w: &mut [f64],
        mut errors: impl FnMut(&[f64], &mut [f64]),
        mut solve: impl FnMut(&[f64], &mut [f64]) -> Solved,
    ) -> Result<Report, LossError> {
        self.kernel.check()?;
        same("w", e.len(), w.len())?;
        errors(parameters, e);
        finite(e)?;
        let (mut outcome, mut iterations) = (Outcome::MaxIterations, 0);
        while iterations < self.max_iterations {
            self.weights(e, w)?;
            if solve(w, parameters) == Solved::Undetermined {
                outcome = Outcome::Undetermined;
                break;
            }
            iterations += 1;
            // The weights are spent: their place holds the errors before.
            w.copy_from_slice(e);
            errors(parameters, e);
            finite(e)?;
            let moved = e.iter().zip(&*w).map(|(e, before)| (e - before).abs()).fold(0.0, f64::max);
            if moved <= self.tolerance {
                outcome = Outcome::Converged;
                break;
            }
        }
        self.weights(e, w)?;
        Ok(Report { outcome, iterations, objective: self.objective(e) })
    }
}

fn finite(e: &[f64]) -> Result<(), LossError> {
    match e.iter().position(|e| !e.is_finite()) {
        Some(index) => Err(LossError::NonFinite { what: "errors", index }),
        None => Ok(()),
    }
}
