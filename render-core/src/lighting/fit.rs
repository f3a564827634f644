//! Lighting from what surfaces receive.

use super::{COEFFICIENTS, Kind, Lighting, basis};
use crate::error::{RenderError, check_len};
use core::fmt;
use float_core::m64;

/// Why no lighting was fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FitError {
    /// An array of the wrong length, or a value that is not a number.
    Input(RenderError),
    /// The normals do not determine this coefficient, given those before it: too few, or all alike. A ridge helps.
    Undetermined {
        /// The first such coefficient, `0..9`.
        coefficient: usize,
    },
}

impl fmt::Display for FitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(e) => e.fmt(f),
            Self::Undetermined { coefficient } => {
                write!(
                    f,
                    "the normals do not determine coefficient {coefficient} of the lighting: too few, or too much alike"
                )
            }
        }
    }
}

impl core::error::Error for FitError {}

impl From<RenderError> for FitError {
    fn from(e: RenderError) -> Self {
        Self::Input(e)
    }
}

/// The lighting (of [`Kind::Irradiance`]) whose irradiances at the given unit normals come closest to the given ones in the
/// sum of squares.
///
/// # Shapes and units
/// * `normals` `[n][3]`, `irradiance` `[n][3]` linear colour
/// * `ridge`  `>= 0`, added to the mean of squares for each squared coefficient: what the data leave open tends to 0
///
/// # Numerics
/// Normal equations of nine unknowns in `f64`. Normals from all around have a condition of about 1; half a sphere of
/// them, about `1e3`.
///
/// # Errors
/// [`FitError::Input`] for arrays of different lengths or values that are not finite; [`FitError::Undetermined`] for normals that
/// leave a coefficient open, as fewer than nine always do, unless a ridge decides.
///
/// # Panics
/// When the ridge is negative or NaN.
pub fn fit_irradiance(normals: &[[f64; 3]], irradiance: &[[f64; 3]], ridge: f64) -> Result<Lighting<f64>, FitError> {
    assert!(ridge >= 0.0, "the ridge is {ridge}, expected at least 0");
    check_len("irradiance", normals.len(), irradiance.len())?;
    for (what, rows) in [("normals", normals), ("irradiance", irradiance)] {
        if let Some(index) = rows.as_flattened().iter().position(|x| !x.is_finite()) {
            return Err(RenderError::NonFinite { what, index }.into());
        }
    }
    let each = 1.0 / (normals.len().max(1) as f64);
    let mut gram = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut lighting = Lighting::dark(Kind::Irradiance);
    for (&n, e) in normals.iter().zip(irradiance) {
        let y = basis(n);
        for i in 0..COEFFICIENTS {
            for j in 0..=i {
                gram[i][j] += each * y[i] * y[j];
            }
            for (out, e) in lighting.coefficients[i].iter_mut().zip(e) {
                *out += each * y[i] * e;
            }
        }
    }
    for (i, row) in gram.iter_mut().enumerate() {
        row[i] += ridge;
    }
    solve(gram, &mut lighting.coefficients)?;
    Ok(lighting)
}

/// Solve `A x = b` in place by Cholesky's factors; `a` holds the lower triangle.
#[expect(clippy::needless_range_loop, reason = "triangles: indices of rows and columns depend on each other")]
fn solve(mut a: [[f64; COEFFICIENTS]; COEFFICIENTS], b: &mut [[f64; 3]; COEFFICIENTS]) -> Result<(), FitError> {
    for i in 0..COEFFICIENTS {
        let diagonal = a[i][i];
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| a[i][k] * a[j][k]).sum();
            let rest = a[i][j] - known;
            if j < i {
                a[i][j] = rest / a[j][j];
            } else if rest > 1e-12 * diagonal {
                a[i][i] = m64::sqrt(rest);
            } else {
                // What is left is the rounding of what was there. NaN cannot be: the input is finite.
                return Err(FitError::Undetermined { coefficient: i });
            }
        }
    }
    for c in 0..3 {
        for i in 0..COEFFICIENTS {
            let known: f64 = (0..i).map(|k| a[i][k] * b[k][c]).sum();
            b[i][c] = (b[i][c] - known) / a[i][i];
        }
        for i in (0..COEFFICIENTS).rev() {
            let known: f64 = (i + 1..COEFFICIENTS).map(|k| a[k][i] * b[k][c]).sum();
            b[i][c] = (b[i][c] - known) / a[i][i];
        }
    }
    Ok(())
}
