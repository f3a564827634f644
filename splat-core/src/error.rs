//! Errors.

use core::fmt;

/// Why an input was refused. Nothing was written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SplatError {
    /// Argument `what` must hold `want` values and holds `got`.
    Shape {
        /// Name of the argument.
        what: &'static str,
        /// Number of values expected.
        want: usize,
        /// Number of values given.
        got: usize,
    },
    /// The degree of the spherical harmonics is above [`MAX_DEGREE`](crate::MAX_DEGREE).
    Degree {
        /// The degree given.
        got: usize,
    },
    /// A setting or a number of a camera lies outside its range.
    Value {
        /// Name of the setting.
        what: &'static str,
        /// The value given.
        got: f64,
        /// The range that is accepted, in words.
        accepts: &'static str,
    },
    /// More Gaussians, or pairs of a Gaussian and a tile, than a `u32` index can count.
    TooMany {
        /// What there is too much of.
        what: &'static str,
        /// How many there are.
        got: usize,
    },
}

impl fmt::Display for SplatError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Degree { got } => write!(f, "spherical harmonics of degree {got}: the largest degree is 3"),
            Self::Value { what, got, accepts } => write!(f, "`{what}` is {got}, expected {accepts}"),
            Self::TooMany { what, got } => write!(f, "{got} {what}: at most {} are possible", u32::MAX),
        }
    }
}

impl core::error::Error for SplatError {}
