//! Sets of cells of a grid: what a march goes through, and what lies around it.

use super::OccupancyGrid;
use alloc::vec;
use alloc::vec::Vec;

/// A set of cells of an [`OccupancyGrid`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CellBits {
    /// A bit a cell.
    pub(super) bits: Vec<u64>,
    /// A bit for each word of `bits` that is not 0.
    pub(super) blocks: Vec<u64>,
}

impl CellBits {
    /// The cells of these bits, `[cells / 64]`, lowest bit first.
    ///
    /// # Panics
    /// When the number of words is not a multiple of 64, as that of every grid is.
    #[must_use]
    pub fn new(bits: Vec<u64>) -> Self {
        assert!(bits.len().is_multiple_of(64), "{} words of cells: those of a grid are a multiple of 64", bits.len());
        let mut cells = Self { blocks: vec![0; bits.len() / 64], bits };
        cells.renew_blocks();
        cells
    }

    /// `[cells / 64]` the cells, one bit each, lowest bit first.
    #[must_use]
    pub fn bits(&self) -> &[u64] {
        &self.bits
    }

    /// Whether a cell is in the set.
    ///
    /// # Panics
    /// When there is no such cell.
    #[must_use]
    pub fn contains(&self, id: u32) -> bool {
        self.bits[id as usize / 64] >> (id % 64) & 1 == 1
    }

    /// Number of cells in the set.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.bits.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Bytes held.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        8 * (self.bits.len() + self.blocks.len())
    }

    /// Blocks from bits.
    pub(super) fn renew_blocks(&mut self) {
        for (block, words) in self.blocks.iter_mut().zip(self.bits.as_chunks::<64>().0) {
            *block = words.iter().enumerate().fold(0, |block, (i, &w)| block | u64::from(w != 0) << i);
        }
    }
}

/// The cells of a word whose column, row or layer in their block of 4^3 cells is 0.
const FIRST: [u64; 3] = [0x1111_1111_1111_1111, 0x000F_000F_000F_000F, 0x0000_0000_0000_FFFF];
/// The cells of a word in one coarse cell: two along each axis.
const OCTANT: u64 = 0x0033_0033;

impl OccupancyGrid {
    /// Add to a set of cells, as in [`CellBits::new`], the neighbours of each in its own cascade: up to 26 of them, those that share
    /// a face, an edge or a corner with it.
    ///
    /// # Panics
    /// When the set is of another grid.
    pub fn dilate(&self, bits: &mut [u64]) {
        assert_eq!(bits.len(), self.thickness.len() / 64, "a set of cells of another grid");
        let mut before = vec![0; bits.len()];
        // One axis after the other: in the end all of the 3^3 cells around each.
        for a in 0..3 {
            before.copy_from_slice(bits);
            self.dilate_along(a, &before, bits);
        }
    }

    /// Write over `out` the cells `bits` and those before and behind each along axis `a`.
    fn dilate_along(&self, a: usize, bits: &[u64], out: &mut [u64]) {
        // Words are blocks of 4^3 cells.
        let side = self.settings.resolution as usize / 4;
        let offset = |axis: usize, block: usize| self.axis[4 * block][axis] as usize / 64;
        let (step, first) = (1_u32 << (2 * a), FIRST[a]);
        let last = first << (3 * step);
        for cascade in (0..bits.len()).step_by(side * side * side) {
            for (z, y) in (0..side).flat_map(|z| (0..side).map(move |y| (z, y))) {
                let row = cascade + offset(1, y) + offset(2, z);
                for x in 0..side {
                    let (word, at) = (row + offset(0, x), [x, y, z][a]);
                    let rest = word - offset(a, at);
                    let own = bits[word];
                    let below = if at > 0 { bits[rest + offset(a, at - 1)] } else { 0 };
                    let above = if at + 1 < side { bits[rest + offset(a, at + 1)] } else { 0 };
                    let inside = own | ((own & !last) << step) | ((own & !first) >> step);
                    out[word] = inside | ((below & last) >> (3 * step)) | ((above & first) << (3 * step));
                }
            }
        }
    }

    /// Add to a set of cells, as in [`CellBits::new`], the coarser ones that they lie in, which long steps through them meet.
    ///
    /// # Panics
    /// When the set is of another grid.
    pub fn lift(&self, bits: &mut [u64]) {
        assert_eq!(bits.len(), self.thickness.len() / 64, "a set of cells of another grid");
        let per_cascade = self.cascade_cells() as usize / 64;
        for k in 1..self.settings.cascades {
            for word in (k as usize - 1) * per_cascade..k as usize * per_cascade {
                let fine = bits[word];
                if fine == 0 {
                    continue;
                }
                // A block of 4^3 cells is one of 2^3 coarse ones, all in one block again.
                let (_, x) = self.coordinates(word as u32 * 64);
                let above = self.cell(k, x.map(|x| self.settings.resolution / 4 + x / 2));
                let mut coarse = 0_u64;
                for i in 0..8_u32 {
                    let (x, y, z) = (i & 1, i >> 1 & 1, i >> 2);
                    let part = OCTANT << (2 * x + 8 * y + 32 * z);
                    coarse |= u64::from(fine & part != 0) << (x + 4 * y + 16 * z);
                }
                bits[above as usize / 64] |= coarse << (above % 64);
            }
        }
    }
}
