//! Which parts of a table got gradients: what a sparse optimiser visits.

use alloc::vec;
use alloc::vec::Vec;
use core::ops::Range;

use super::HashGrid;

pub use crate::encoding::lattice::kernel::BLOCK_FLOATS;

/// A bit for each block of [`BLOCK_FLOATS`] parameters of a [`HashGrid`], set by its backward functions.
///
/// Blocks are counted from the start of each level, and each level starts a new word, so that levels can be filled by
/// different threads. One bit for 16 parameters: 96 KiB for 16 levels of `2^19` entries of 2.
#[derive(Clone, Debug)]
pub struct Touched {
    words: Vec<u64>,
    /// Where each level's words start.
    levels: Vec<Range<usize>>,
    /// Which parameters each level has.
    params: Vec<Range<usize>>,
}

impl Touched {
    /// Nothing touched.
    #[must_use]
    pub fn new(grid: &HashGrid) -> Self {
        let params: Vec<_> = (0..grid.levels().len()).map(|l| grid.level_range(l)).collect();
        let mut end = 0;
        let levels = params
            .iter()
            .map(|range| {
                let start = end;
                end += range.len().div_ceil(BLOCK_FLOATS).div_ceil(64);
                start..end
            })
            .collect();
        Self { words: vec![0; end], levels, params }
    }

    /// The words of one level: bit `b % 64` of word `b / 64` stands for block `b`.
    ///
    /// # Panics
    /// If there is no such level.
    #[must_use]
    pub fn level(&self, level: usize) -> &[u64] {
        &self.words[self.levels[level].clone()]
    }

    /// The words of one level, to be filled.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level_mut(&mut self, level: usize) -> &mut [u64] {
        &mut self.words[self.levels[level].clone()]
    }

    /// The words of all levels, one slice after the other.
    pub fn levels_mut(&mut self) -> impl Iterator<Item = &mut [u64]> {
        let mut rest = self.words.as_mut_slice();
        self.levels.iter().map(move |range| {
            let (head, tail) = core::mem::take(&mut rest).split_at_mut(range.len());
            rest = tail;
            head
        })
    }

    /// Call `f` with the parameter range of every touched block, in ascending order. The last block of a level may be
    /// shorter than [`BLOCK_FLOATS`].
    pub fn for_each(&self, mut f: impl FnMut(Range<usize>)) {
        for level in 0..self.levels.len() {
            self.for_each_of_level(level, &mut f);
        }
    }

    /// As [`for_each`](Self::for_each), for one level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn for_each_of_level(&self, level: usize, mut f: impl FnMut(Range<usize>)) {
        let params = &self.params[level];
        for (w, &word) in self.level(level).iter().enumerate() {
            let mut word = word;
            while word != 0 {
                let start = params.start + (w * 64 + word.trailing_zeros() as usize) * BLOCK_FLOATS;
                f(start..(start + BLOCK_FLOATS).min(params.end));
                word &= word - 1;
            }
        }
    }

    /// Touched blocks.
    #[must_use]
    pub fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// Touch what `other` touched.
    ///
    /// # Panics
    /// If the two were made for grids of different sizes.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.levels, other.levels, "touched blocks of different grids");
        for (a, b) in self.words.iter_mut().zip(&other.words) {
            *a |= b;
        }
    }

    /// Nothing touched, again.
    pub fn clear(&mut self) {
        self.words.fill(0);
    }
}
