//! Errors of state that comes from a checkpoint.

use core::fmt;

/// Why a state was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum OptimError {
    /// `what` should hold `want` values and holds `got`.
    Shape {
        /// The array.
        what: &'static str,
        /// Expected length.
        want: usize,
        /// Length found.
        got: usize,
    },
    /// `what[index]` is `value`, which no run can have written.
    Value {
        /// The array.
        what: &'static str,
        /// Where.
        index: usize,
        /// What is there.
        value: f32,
    },
}

impl fmt::Display for OptimError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Value { what, index, value } => write!(f, "`{what}[{index}]` is {value}"),
        }
    }
}

impl core::error::Error for OptimError {}
