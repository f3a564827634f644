//! What a matrix on a tape is known by: its number, and its rows and columns.

use core::fmt;

/// Rows (features) and columns (samples) of a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// Features.
    pub rows: usize,
    /// Samples.
    pub cols: usize,
}

impl Shape {
    /// `rows` features by `cols` samples.
    #[must_use]
    pub const fn new(rows: usize, cols: usize) -> Self {
        Self { rows, cols }
    }

    /// Numbers held; the most that can be counted where there are more.
    #[must_use]
    pub const fn len(self) -> usize {
        self.rows.saturating_mul(self.cols)
    }

    /// Whether no number is held.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{} x {}]", self.rows, self.cols)
    }
}

/// One matrix on a tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    pub(super) id: u32,
    /// Tape of the arena it was recorded on.
    pub(super) generation: u32,
}
