//! Errors of the function pairs of this crate.

use core::fmt;

/// Why an input was refused. Nothing was written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FieldError {
    /// `what` should hold `want` values and holds `got`.
    Shape {
        /// Name of the argument.
        what: &'static str,
        /// Values expected.
        want: usize,
        /// Values found.
        got: usize,
    },
    /// A setting lies outside its range.
    Config {
        /// Name of the setting.
        what: &'static str,
        /// The refused value.
        got: f64,
        /// What would be accepted.
        accepts: &'static str,
    },
    /// `what[index]` is `got`, but only values below `limit` exist.
    Index {
        /// Name of the argument.
        what: &'static str,
        /// Where in the argument.
        index: usize,
        /// The value there.
        got: usize,
        /// One past the largest legal value.
        limit: usize,
    },
    /// Direction `index` is zero or not finite.
    Direction {
        /// Which sample.
        index: usize,
    },
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Config { what, got, accepts } => write!(f, "`{what}` is {got}, expected {accepts}"),
            Self::Direction { index } => write!(f, "direction {index} is zero or not finite"),
            Self::Index { what, index, got, limit } => {
                write!(f, "`{what}[{index}]` is {got}, but there are only {limit} entries")
            }
        }
    }
}

impl core::error::Error for FieldError {}

/// [`FieldError::Shape`] unless `got == want`.
pub(crate) fn check_len(what: &'static str, got: usize, want: usize) -> Result<(), FieldError> {
    if got == want { Ok(()) } else { Err(FieldError::Shape { what, want, got }) }
}
