//! What can be wrong with the arguments of a loss.

use core::fmt;

/// A loss was called with arguments that do not fit together.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LossError {
    /// `what` should hold `want` values and holds `got`.
    Shape {
        /// The argument.
        what: &'static str,
        /// Values it should hold.
        want: usize,
        /// Values it holds.
        got: usize,
    },
    /// `what` decreases.
    Order {
        /// The argument.
        what: &'static str,
    },
    /// A parameter of a kernel is outside its range.
    Parameter {
        /// The parameter, with its kernel.
        what: &'static str,
        /// What it holds.
        value: f32,
        /// What it may hold.
        range: &'static str,
    },
}

impl fmt::Display for LossError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Order { what } => write!(f, "`{what}` decrease"),
            Self::Parameter { what, value, range } => write!(f, "{what} is {value}, expected {range}"),
        }
    }
}

impl core::error::Error for LossError {}
