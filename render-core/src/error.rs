//! What can be wrong with the input of this crate.

use core::fmt;

/// An array of the wrong length, or a value that is not a number, handed to a numeric function.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum RenderError {
    /// `what` should hold `want` values and holds `got`.
    Shape {
        /// The array.
        what: &'static str,
        /// Length it should have.
        want: usize,
        /// Length it has.
        got: usize,
    },
    /// `what[index]` is NaN or infinite.
    NonFinite {
        /// The array.
        what: &'static str,
        /// Where.
        index: usize,
    },
}

impl fmt::Display for RenderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::NonFinite { what, index } => write!(f, "`{what}[{index}]` is NaN or infinite"),
        }
    }
}

impl core::error::Error for RenderError {}

/// `Ok` when `what` holds `want` values.
pub(crate) fn check_len(what: &'static str, want: usize, got: usize) -> Result<(), RenderError> {
    if want == got { Ok(()) } else { Err(RenderError::Shape { what, want, got }) }
}

/// A matrix or quaternion that is not a camera pose.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// An entry of the matrix is NaN or infinite.
    NonFinite {
        /// Row, from 0.
        row: usize,
        /// Column, from 0.
        column: usize,
    },
    /// The 3x3 part has no inverse.
    Singular {
        /// Its determinant.
        det: f64,
    },
    /// The 3x3 part mirrors: the file was written with left-handed axes.
    LeftHanded {
        /// Its determinant.
        det: f64,
    },
    /// The 3x3 part is neither a rotation nor a uniformly scaled one.
    NotRotation {
        /// `|R^T R - I|` (Frobenius) after a uniform scale was taken out; at most 1e-3 is repaired.
        error: f64,
    },
    /// The quaternion is zero, NaN or infinite.
    Quaternion {
        /// Its length.
        norm: f64,
    },
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NonFinite { row, column } => {
                write!(f, "pose matrix: row {row}, column {column} is NaN or infinite")
            }
            Self::Singular { det } => write!(f, "pose matrix: the 3x3 part is singular (determinant {det:.3e})"),
            Self::LeftHanded { det } => write!(
                f,
                "pose matrix: the 3x3 part mirrors (determinant {det:.6}): export the cameras with right-handed axes"
            ),
            Self::NotRotation { error } => {
                write!(
                    f,
                    "pose matrix: the 3x3 part is not a rotation: |R^T R - I| = {error:.3e}, at most 1e-3 is repaired"
                )
            }
            Self::Quaternion { norm } => write!(f, "pose quaternion has length {norm}, expected 1"),
        }
    }
}

impl core::error::Error for PoseError {}

/// Intrinsics or lens parameters that do not describe a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum CameraError {
    /// A model takes another number of parameters.
    ParameterCount {
        /// COLMAP name of the model.
        model: &'static str,
        /// Parameters it has.
        want: usize,
        /// Parameters given.
        got: usize,
    },
    /// A parameter is NaN or infinite.
    NonFinite {
        /// Which.
        parameter: &'static str,
    },
    /// A focal length is not positive.
    Focal {
        /// `fx` or `fy`.
        parameter: &'static str,
        /// Its value.
        value: f64,
    },
    /// The image has no pixels.
    EmptyImage {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The angle of the FOV model is not in `(-pi, pi)`.
    Omega {
        /// Its value.
        value: f64,
    },
    /// A parameter is finite, and no camera has such a one.
    OutOfRange {
        /// Which.
        parameter: &'static str,
        /// Its value.
        value: f64,
        /// Smallest that is taken for a camera of this image size.
        least: f64,
        /// Largest.
        most: f64,
    },
}

impl CameraError {
    /// The parameter that is wrong and its value, where there is one.
    #[must_use]
    pub fn parameter(&self) -> Option<(&'static str, f64)> {
        match *self {
            Self::Focal { parameter, value } | Self::OutOfRange { parameter, value, .. } => Some((parameter, value)),
            Self::Omega { value } => Some(("omega", value)),
            Self::NonFinite { .. } | Self::ParameterCount { .. } | Self::EmptyImage { .. } => None,
        }
    }
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::ParameterCount { model, want, got } => {
                write!(f, "camera model {model} takes {want} parameters, {got} given")
            }
            Self::NonFinite { parameter } => write!(f, "camera parameter {parameter} is NaN or infinite"),
            Self::Focal { parameter, value } => write!(f, "focal length {parameter} = {value}, expected more than 0"),
            Self::EmptyImage { width, height } => write!(f, "image size {width} x {height} holds no pixel"),
            Self::Omega { value } => write!(f, "omega = {value} of the FOV model, expected an angle in (-pi, pi)"),
            Self::OutOfRange { parameter, value, least, most } => {
                write!(f, "camera parameter {parameter} = {value:e}, expected {least:e} to {most:e}")
            }
        }
    }
}

impl core::error::Error for CameraError {}
