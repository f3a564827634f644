//! What this crate refuses.

use core::fmt;

/// Why an input was refused. Nothing was written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SplatError {
    /// `what` should hold `want` values and holds `got`.
    Shape {
        /// Name of the argument.
        what: &'static str,
        /// Values expected.
        want: usize,
        /// Values found.
        got: usize,
    },
    /// Spherical harmonics of a degree above 3.
    Degree {
        /// The degree.
        got: usize,
    },
    /// A setting or a camera's number lies outside its range.
    Value {
        /// Its name.
        what: &'static str,
        /// What it is.
        got: f64,
        /// What would be accepted.
        accepts: &'static str,
    },
    /// More Gaussians or pairs of Gaussians and tiles than an index can count.
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many.
        got: usize,
    },
}

impl fmt::Display for SplatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Degree { got } => write!(f, "spherical harmonics of degree {got}: at most 3"),
            Self::Value { what, got, accepts } => write!(f, "`{what}` is {got}, expected {accepts}"),
            Self::TooMany { what, got } => write!(f, "{got} {what}: at most {}", u32::MAX),
        }
    }
}

impl core::error::Error for SplatError {}
