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
    /// A parameter is outside its range.
    Parameter {
        /// The parameter, with what it belongs to.
        what: &'static str,
        /// What it holds.
        value: f32,
        /// What it may hold.
        range: &'static str,
    },
    /// `what[index]` is NaN or infinite where nothing can be made of it.
    NonFinite {
        /// The argument.
        what: &'static str,
        /// Which of its values.
        index: usize,
    },
}

/// `Ok` if `what` holds `want` values.
pub(crate) fn same(what: &'static str, want: usize, got: usize) -> Result<(), LossError> {
    if want == got { Ok(()) } else { Err(LossError::Shape { what, want, got }) }
}

impl fmt::Display for LossError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape { what, want, got } => write!(f, "`{what}` holds {got} values, expected {want}"),
            Self::Order { what } => write!(f, "`{what}` decrease"),
            Self::Parameter { what, value, range } => write!(f, "{what} is {value}, expected {range}"),
            Self::NonFinite { what, index } => write!(f, "value {index} of `{what}` is NaN or infinite"),
        }
    }
}

impl core::error::Error for LossError {}
