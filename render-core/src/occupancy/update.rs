//! Learning which cells are occupied.

use super::{INVISIBLE, OccupancyGrid};
use alloc::vec::Vec;
use core::mem;

impl OccupancyGrid {
    /// Take in the optical thickness measured in some cells: `G = max(decay * G, thickness)`, then all bits anew.
    ///
    /// `thickness[i]` belongs to `cells[i]`: density at a point of the cell times the shortest step of its cascade
    /// (`dt_min * 2^k`). Each cell should come once; cells not named keep what they have. NaN counts as no measurement.
    /// Cells that no camera sees stay so.
    ///
    /// # Panics
    /// When the lengths differ or a cell does not exist.
    pub fn update(&mut self, cells: &[u32], thickness: &[f32]) {
        assert_eq!(cells.len(), thickness.len(), "one thickness a cell");
        for (&cell, &new) in cells.iter().zip(thickness) {
            let old = &mut self.thickness[cell as usize];
            if *old >= 0.0 {
                // `max` drops a NaN. An infinite thickness would never decay.
                *old = (*old * self.settings.decay).max(new).min(f32::MAX);
            }
        }
        self.updates += 1;
        self.rebuild();
    }

    /// Cells that no camera sees are never occupied and never picked again: `visible` is asked for each cell with its
    /// lowest corner and side, grid units.
    pub fn mark_invisible(&mut self, mut visible: impl FnMut([f32; 3], f32) -> bool) {
        for id in 0..self.thickness.len() {
            let (corner, side) = self.cell_box(id as u32);
            if self.thickness[id] >= 0.0 && !visible(corner, side) {
                self.thickness[id] = INVISIBLE;
            }
        }
        self.rebuild();
    }

    /// All cells that some camera sees, in order: what the first updates measure. Written over `out`.
    pub fn pick_all(&self, out: &mut Vec<u32>) {
        out.clear();
        out.extend((0..self.thickness.len() as u32).filter(|&i| self.thickness[i as usize] >= 0.0));
    }

    /// Cells to measure in a later update: one of each four neighbours (a uniform quarter), and as many again among the
    /// occupied ones, spread evenly (all of them where there are fewer). In order, each once, none that no camera
    /// sees. Written over `out`.
    ///
    /// `u(i)` is a random number in `[0, 1)`; it is asked for `i` in `0 .. cells / 2`, each at most once.
    pub fn pick(&self, mut u: impl FnMut(u32) -> f32, out: &mut Vec<u32>) {
        out.clear();
        let quarter = self.thickness.len() as u64 / 4;
        let occupied = self.occupied_cells();
        let mut wanted = OccupiedPicks { next: 0, at: None, picks: quarter.min(occupied), quarter, occupied };
        let mut rank = 0_u64;
        for (word, &bits) in self.bits().iter().enumerate() {
            let mut mask = 0_u64;
            for group in 0..16 {
                let i = word as u32 * 16 + group;
                mask |= 1 << (group * 4 + ((u(i) * 4.0) as u32).min(3));
            }
            // The wanted ranks among the occupied cells that fall into this word.
            let end = rank + u64::from(bits.count_ones());
            let (mut left, mut at) = (bits, rank);
            while let Some(target) = wanted.peek(&mut u).filter(|&t| t < end) {
                while at < target {
                    left &= left - 1;
                    at += 1;
                }
                mask |= left & left.wrapping_neg();
                wanted.advance();
            }
            rank = end;
            while mask != 0 {
                let id = word * 64 + mask.trailing_zeros() as usize;
                mask &= mask - 1;
                if self.thickness[id] >= 0.0 {
                    out.push(id as u32);
                }
            }
        }
    }

    /// From the next update on, cells with at most this thickness are empty.
    pub fn set_threshold(&mut self, threshold: f32) {
        self.settings.threshold = threshold;
    }

    /// Bits from thickness.
    pub(super) fn rebuild(&mut self) {
        let level = self.level();
        let mut bits = mem::take(&mut self.occupied.bits);
        for (word, cells) in bits.iter_mut().zip(self.thickness.as_chunks::<64>().0) {
            *word = cells.iter().enumerate().fold(0, |word, (i, &x)| word | u64::from(x > level) << i);
        }
        // A coarse cell is also reached by long steps through what finer cells cover.
        self.lift(&mut bits);
        self.occupied.bits = bits;
        self.occupied.renew_blocks();
    }

    /// Cells with more than this thickness are occupied, by what is known now: `min(threshold, mean)`, and before the first update
    /// less than any that a camera sees.
    #[must_use]
    pub fn level(&self) -> f32 {
        if self.updates == 0 {
            // Everything that is not negative.
            return 0.5 * INVISIBLE;
        }
        // Eight partial sums in a fixed order.
        let (mut sums, mut counts) = ([0.0_f64; 8], [0_u64; 8]);
        for cells in self.thickness.as_chunks::<8>().0 {
            for lane in 0..8 {
                sums[lane] += f64::from(cells[lane].max(0.0));
                counts[lane] += u64::from(cells[lane] >= 0.0);
            }
        }
        let mean = sums.iter().sum::<f64>() / counts.iter().sum::<u64>().max(1) as f64;
        // A hair under the mean: a field that is the same everywhere must not vanish.
        self.settings.threshold.min((0.999 * mean) as f32)
    }
}

/// Ranks of the occupied cells to pick, increasing.
struct OccupiedPicks {
    next: u64,
    at: Option<u64>,
    picks: u64,
    quarter: u64,
    occupied: u64,
}

impl OccupiedPicks {
    /// The next rank: one from each of `picks` equal parts of the occupied cells.
    fn peek(&mut self, u: &mut impl FnMut(u32) -> f32) -> Option<u64> {
        if self.next == self.picks {
            return None;
        }
        if self.at.is_none() {
            let j = self.next;
            let u = if self.picks == self.occupied { 0.0 } else { f64::from(u((self.quarter + j) as u32)) };
            let rank = (j as f64 + u) * self.occupied as f64 / self.picks as f64;
            self.at = Some((rank as u64).min(self.occupied - 1));
        }
        self.at
    }

    fn advance(&mut self) {
        self.next += 1;
        self.at = None;
    }
}
