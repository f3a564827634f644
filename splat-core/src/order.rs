//! Sorts Gaussians front to back: by depth, ties by index.

use alloc::{vec, vec::Vec};

/// Bits of a radix digit: three passes sort the 31 bits of a positive `f32`.
const DIGIT: u32 = 11;
const BUCKETS: usize = 1 << DIGIT;

/// Buffers of a sort.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sorter {
    keys: Vec<(u32, u32)>,
    spare: Vec<(u32, u32)>,
}

impl Sorter {
    /// Indices that sort positive depths in ascending order, ties by index. The IEEE bits of positive numbers compare as integers.
    ///
    /// A stable radix sort: all three histograms are counted in one pass, and digits that are equal everywhere are skipped.
    pub(crate) fn sort(
        &mut self,
        depths: impl ExactSizeIterator<Item = f32>,
    ) -> impl Iterator<Item = u32> + Clone + Send + Sync + '_ {
        self.keys.clear();
        self.keys.extend(depths.enumerate().map(|(i, z)| (z.to_bits(), i as u32)));
        let mut counts = vec![[0_u32; BUCKETS]; 3];
        for &(key, _) in &self.keys {
            for (pass, counts) in counts.iter_mut().enumerate() {
                counts[(key >> (DIGIT * pass as u32)) as usize % BUCKETS] += 1;
            }
        }
        self.spare.resize(self.keys.len(), (0, 0));
        for (pass, counts) in counts.iter_mut().enumerate() {
            if counts.iter().any(|&n| n as usize == self.keys.len()) {
                continue;
            }
            let mut start = 0;
            for count in counts.iter_mut() {
                start += core::mem::replace(count, start);
            }
            for &pair in &self.keys {
                let at = &mut counts[(pair.0 >> (DIGIT * pass as u32)) as usize % BUCKETS];
                self.spare[*at as usize] = pair;
                *at += 1;
            }
            core::mem::swap(&mut self.keys, &mut self.spare);
        }
        self.keys.iter().map(|&(_, i)| i)
    }
}
