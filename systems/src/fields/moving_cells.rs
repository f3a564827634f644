//! Where something moves: cells of the unit cube, one bit each.

const SIDE: usize = 128;
/// Blocks along an axis.
const BLOCKS: usize = SIDE / 2;

/// Cells in which something moves at some time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MovingCells {
    /// `x` first, then `y`, then `z`.
    bits: Vec<u64>,
}

impl MovingCells {
    /// Cells along an axis.
    pub(crate) const SIDE: usize = SIDE;

    /// Words of [`MovingCells::words`].
    pub(crate) const WORDS: usize = SIDE * SIDE * SIDE / 64;

    /// Cells of the cube.
    pub(crate) const ALL: usize = SIDE * SIDE * SIDE;

    /// Blocks of a row, which follow each other.
    pub(crate) const ROW: usize = BLOCKS;

    /// Blocks of the cube.
    pub(crate) const BLOCKS: usize = BLOCKS * BLOCKS * BLOCKS;

    /// Nothing moves.
    pub(crate) fn none() -> Self {
        Self { bits: vec![0; Self::WORDS] }
    }

    /// Something may move everywhere.
    #[cfg(test)]
    pub(crate) fn everywhere() -> Self {
        Self { bits: vec![u64::MAX; Self::WORDS] }
    }

    /// The words of a checkpoint; `None` where there are too few or too many.
    pub(crate) fn of_words(bits: Vec<u64>) -> Option<Self> {
        (bits.len() == Self::WORDS).then_some(Self { bits })
    }

    /// One bit a cell.
    pub(crate) fn words(&self) -> &[u64] {
        &self.bits
    }

    /// The cell of a point of the unit cube; what lies outside belongs to the nearest.
    pub(crate) fn cell(x: [f32; 3]) -> usize {
        let [x, y, z] = x.map(|x| ((x * SIDE as f32) as usize).min(SIDE - 1));
        (z * SIDE + y) * SIDE + x
    }

    /// Whether something moves in the cell of a point of the unit cube.
    pub(crate) fn holds(&self, x: [f32; 3]) -> bool {
        let cell = Self::cell(x);
        self.bits[cell / 64] >> (cell % 64) & 1 == 1
    }

    /// Mark a cell.
    pub(crate) fn mark(&mut self, cell: usize) {
        self.bits[cell / 64] |= 1 << (cell % 64);
    }

    /// Mark the cells of a block: two along each axis.
    pub(crate) fn mark_block(&mut self, block: usize) {
        let [x, y, z] = [block % BLOCKS, block / BLOCKS % BLOCKS, block / (BLOCKS * BLOCKS)];
        for k in 0..8 {
            self.mark(((2 * z + k / 4) * SIDE + 2 * y + k / 2 % 2) * SIDE + 2 * x + k % 2);
        }
    }

    /// The middle of a block, in the unit cube.
    pub(crate) fn middle_of_block(block: usize) -> [f32; 3] {
        let at = [block % BLOCKS, block / BLOCKS % BLOCKS, block / (BLOCKS * BLOCKS)];
        at.map(|at| (at as f32 + 0.5) / BLOCKS as f32)
    }

    /// The middle of a cell, in the unit cube.
    pub(crate) fn middle_of_cell(cell: usize) -> [f32; 3] {
        let at = [cell % SIDE, cell / SIDE % SIDE, cell / (SIDE * SIDE)];
        at.map(|at| (at as f32 + 0.5) / SIDE as f32)
    }

    /// The cells that are marked, in order.
    pub(crate) fn marked(&self) -> impl Iterator<Item = usize> {
        (0..Self::ALL).filter(|cell| self.bits[cell / 64] >> (cell % 64) & 1 == 1)
    }

    /// The cells that both mark.
    pub(crate) fn and(&self, other: &Self) -> Self {
        Self { bits: self.bits.iter().zip(&other.bits).map(|(bits, other)| bits & other).collect() }
    }

    /// Mark what another one marks.
    pub(crate) fn unite(&mut self, other: &Self) {
        self.bits.iter_mut().zip(&other.bits).for_each(|(bits, other)| *bits |= other);
    }

    /// Cells that are marked.
    pub(crate) fn count(&self) -> usize {
        self.bits.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Those of points `[3][n]` of the unit cube in whose cells something moves, in their order, written over `out`.
    pub(crate) fn columns(&self, x: &[f32], out: &mut Vec<u32>) {
        let n = x.len() / 3;
        out.clear();
        out.extend((0..n).filter(|&i| self.holds([x[i], x[n + i], x[2 * n + i]])).map(|i| i as u32));
    }

    /// The same cells and those that share a face with them.
    pub(crate) fn grown(&self) -> Self {
        let mut out = self.clone();
        for cell in self.marked() {
            for (axis, stride) in [1, SIDE, SIDE * SIDE].into_iter().enumerate() {
                let at = cell / SIDE.pow(axis as u32) % SIDE;
                if at > 0 {
                    out.mark(cell - stride);
                }
                if at + 1 < SIDE {
                    out.mark(cell + stride);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_find_the_cells_that_are_marked_and_no_others() {
        let mut cells = MovingCells::none();
        let at = |u: f32| (u + 0.5) / SIDE as f32;
        let marked = [at(3.0), at(127.0), at(64.0)];
        cells.mark(MovingCells::cell(marked));
        assert!(cells.holds(marked) && cells.count() == 1);
        assert!(!cells.holds([at(4.0), marked[1], marked[2]]));
        // Beyond the cube the nearest cell counts, and what is no number is at its corner.
        assert!(cells.holds([marked[0], 7.0, marked[2]]));
        assert!(!cells.holds([f32::NAN, marked[1], marked[2]]));
        let x = [0.1, marked[0], 0.9, marked[1], 0.5, marked[2]];
        let mut columns = vec![9];
        cells.columns(&x, &mut columns);
        assert_eq!(columns, [1]);
        cells.columns(&[], &mut columns);
        assert!(columns.is_empty());
    }

    #[test]
    fn a_block_is_eight_cells_around_its_middle() {
        let mut cells = MovingCells::none();
        let x = MovingCells::middle_of_block(5 + 64 * (17 + 64 * 60));
        cells.mark_block(5 + 64 * (17 + 64 * 60));
        assert_eq!(x, [5.5 / 64.0, 17.5 / 64.0, 60.5 / 64.0]);
        assert!(cells.holds(x) && cells.holds(x.map(|x| x - 0.007)) && cells.count() == 8);
        let mut other = MovingCells::none();
        other.mark(0);
        other.unite(&cells);
        assert!(other.holds(x) && other.holds([0.0; 3]) && other.count() == 9);
    }

    #[test]
    fn cells_grow_by_their_neighbours_and_not_around_the_cube() {
        let mut cells = MovingCells::none();
        cells.mark(0);
        cells.mark(MovingCells::cell([0.5; 3]));
        let grown = cells.grown();
        assert_eq!(grown.count(), 4 + 7);
        assert_eq!(MovingCells::everywhere().grown(), MovingCells::everywhere());
        assert_eq!(MovingCells::of_words(grown.words().to_vec()), Some(grown));
        assert_eq!(MovingCells::of_words(vec![0; 3]), None);
    }
}
