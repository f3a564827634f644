//! Errors of the tape.

use super::args::MAX_INPUTS;
use super::shape::Shape;
use crate::FieldError;
use core::fmt;

/// Why the tape refused a node. The node was not recorded; the tape stays usable.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum TapeError {
    /// Argument `what` of `op` should have shape `want`.
    Shape {
        /// Operation.
        op: &'static str,
        /// Name of its argument.
        what: &'static str,
        /// Shape expected.
        want: Shape,
        /// Shape found.
        got: Shape,
    },
    /// Argument `what` of `op` should hold `want` values (or nodes, or rows).
    Length {
        /// Operation.
        op: &'static str,
        /// Name of its argument.
        what: &'static str,
        /// Count expected.
        want: usize,
        /// Count found.
        got: usize,
    },
    /// A slice reaches past the rows of its matrix.
    Rows {
        /// First row requested.
        start: usize,
        /// One past the last row requested.
        end: usize,
        /// Rows there are.
        rows: usize,
    },
    /// A parameter leaf reaches past the flat parameter vector.
    Parameters {
        /// First parameter requested.
        start: usize,
        /// How many.
        len: usize,
        /// How many there are in all.
        available: usize,
    },
    /// The node was recorded on another tape.
    ForeignNode {
        /// Operation it was given to.
        op: &'static str,
    },
    /// A custom operation has more inputs than [`MAX_INPUTS`], or none.
    Inputs {
        /// Operation.
        op: &'static str,
        /// Inputs given.
        got: usize,
    },
    /// A tangent was requested through an operation that has no tangent rule.
    NoTangent {
        /// Operation.
        op: &'static str,
    },
    /// The last [`backward`](super::Tape::backward) did not reach the node, or it is a constant or a parameter.
    NoGradient,
    /// A custom operation refused its inputs.
    Custom {
        /// Operation.
        op: &'static str,
        /// Its reason.
        reason: &'static str,
    },
    /// A function pair of this crate refused its inputs.
    Field(FieldError),
}

impl fmt::Display for TapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Shape { op, what, want, got } => write!(f, "{op}: `{what}` is {got}, expected {want}"),
            Self::Length { op, what, want, got } => write!(f, "{op}: `{what}` holds {got}, expected {want}"),
            Self::Rows { start, end, rows } => write!(f, "slice: rows {start}..{end} of a matrix of {rows} rows"),
            Self::Parameters { start, len, available } => {
                write!(f, "parameter: {len} values from {start}, but there are only {available}")
            }
            Self::ForeignNode { op } => write!(f, "{op}: the node belongs to another tape"),
            Self::Inputs { op, got } => write!(f, "{op}: {got} inputs, expected 1 to {MAX_INPUTS}"),
            Self::NoTangent { op } => write!(f, "{op} has no tangent rule"),
            Self::NoGradient => write!(f, "the node has no gradient: constant, parameter, or not part of the loss"),
            Self::Custom { op, reason } => write!(f, "{op}: {reason}"),
            Self::Field(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for TapeError {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Field(error) => Some(error),
            _ => None,
        }
    }
}

impl From<FieldError> for TapeError {
    fn from(error: FieldError) -> Self {
        Self::Field(error)
    }
}
