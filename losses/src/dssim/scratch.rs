//! What one band of rows needs: buffers, and the sizes that they are laid out by.

use alloc::vec::Vec;

/// Taps of the window along one axis, and how many of them lie before its centre.
pub(super) const TAPS: usize = 11;
pub(super) const REACH: usize = TAPS / 2;
/// Columns worked on together, whatever the level: a multiple of all lanes.
pub(super) const BLOCK: usize = 16;
/// Filtered planes on the way to the map, and back from it.
pub(super) const MOMENTS: usize = 4;
pub(super) const DERIVATIVES: usize = 3;

/// Buffers of a band.
///
/// Rows that are filtered along x have [`REACH`] zeros before their first pixel and zeros after their last. Rings hold the last
/// [`TAPS`] rows, row `i` in slot `i % TAPS`, and lie block by block, so that a filter along y reads one run of memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// `[slot][p, q][row]`.
    pub(super) halves: Vec<f32>,
    /// `[block][slot][moment][BLOCK]`.
    pub(super) moments: Vec<f32>,
    /// Derivatives of the map, `[derivative][row]`.
    pub(super) derivatives: Vec<f32>,
    /// The same filtered along x, `[block][slot][derivative][BLOCK]`.
    pub(super) filtered: Vec<f32>,
    /// Weights of a row, 0 past its end.
    pub(super) weights: Vec<f32>,
    /// Gradient of a row.
    pub(super) out: Vec<f32>,
}

impl Scratch {
    /// All zero, for rows of `blocks`.
    pub(super) fn clear(&mut self, blocks: usize) {
        let (row, columns) = (padded(blocks), blocks * BLOCK);
        for (buffer, len) in [
            (&mut self.halves, TAPS * 2 * row),
            (&mut self.moments, TAPS * MOMENTS * columns),
            (&mut self.derivatives, DERIVATIVES * row),
            (&mut self.filtered, TAPS * DERIVATIVES * columns),
            (&mut self.weights, columns),
            (&mut self.out, columns),
        ] {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
    }
}

/// Values of a row that is filtered along x: a block may read two blocks from its own start.
pub(super) const fn padded(blocks: usize) -> usize {
    const { assert!(BLOCK + 2 * REACH <= 2 * BLOCK) };
    (blocks + 1) * BLOCK
}
