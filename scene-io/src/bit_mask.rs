//! A mask of one bit a pixel.

/// A set of pixels. One bit each: a photo may come with hundreds of segments.
#[derive(Clone, PartialEq, Eq)]
pub struct BitMask {
    width: u32,
    height: u32,
    /// Row by row, without padding at the end of rows.
    words: Vec<u64>,
}

impl BitMask {
    /// No pixel set.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self { width, height, words: vec![0; pixels.div_ceil(64)] }
    }

    /// The pixels `(column, row)` of which a function says so.
    pub fn from_fn(width: u32, height: u32, mut is_set: impl FnMut(u32, u32) -> bool) -> Self {
        let mut mask = Self::new(width, height);
        for row in 0..height {
            for column in 0..width {
                if is_set(column, row) {
                    mask.set(column, row);
                }
            }
        }
        mask
    }

    /// Pixels of at least half brightness, from `height * width` values.
    pub(crate) fn from_grey(width: u32, height: u32, grey: &[u8]) -> Self {
        let at = |column: u32, row: u32| row as usize * width as usize + column as usize;
        Self::from_fn(width, height, |column, row| grey[at(column, row)] >= 128)
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    fn place(&self, column: u32, row: u32) -> (usize, u64) {
        let (w, h) = (self.width, self.height);
        assert!(column < w && row < h, "pixel ({column}, {row}) outside {w}x{h}");
        let at = row as usize * w as usize + column as usize;
        (at / 64, 1 << (at % 64))
    }

    /// Is a pixel in the set?
    ///
    /// # Panics
    /// Outside the mask.
    #[must_use]
    pub fn get(&self, column: u32, row: u32) -> bool {
        let (word, bit) = self.place(column, row);
        self.words[word] & bit != 0
    }

    /// Adds a pixel.
    ///
    /// # Panics
    /// Outside the mask.
    pub fn set(&mut self, column: u32, row: u32) {
        let (word, bit) = self.place(column, row);
        self.words[word] |= bit;
    }

    /// Number of pixels in the set.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.words.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Share of the pixels that are in the set; 0 of none.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.count() as f64 / (u64::from(self.width) * u64::from(self.height)).max(1) as f64
    }

    /// All pixels, row by row.
    pub fn iter(&self) -> impl Iterator<Item = bool> + '_ {
        let pixels = self.width as usize * self.height as usize;
        (0..pixels).map(|at| self.words[at / 64] >> (at % 64) & 1 == 1)
    }

    /// The mask at another size, each pixel as the one of the old mask that its centre falls into.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) || self.width == 0 || self.height == 0 {
            return if (width, height) == (self.width, self.height) { self.clone() } else { Self::new(width, height) };
        }
        let at = |column, row| self.get(nearest(column, width, self.width), nearest(row, height, self.height));
        Self::from_fn(width, height, at)
    }
}

/// The one of `from` cells that the centre of cell `i` of `to` falls into, both over the same length.
pub(crate) fn nearest(i: u32, to: u32, from: u32) -> u32 {
    let cell = (2 * u64::from(i) + 1) * u64::from(from) / (2 * u64::from(to));
    // Below `from` because `i` is below `to`.
    cell as u32
}

impl std::fmt::Debug for BitMask {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "BitMask({}x{}, {} set)", self.width, self.height, self.count())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn bits_are_what_was_set(w in 1_u32..40, h in 1_u32..20, seed: u64) {
            let is = |x: u32, y: u32| (seed ^ u64::from(x * 31 + y * 17)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 63 == 1;
            let mask = BitMask::from_fn(w, h, is);
            let want: Vec<bool> = (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).map(|(x, y)| is(x, y)).collect();
            prop_assert_eq!(mask.iter().collect::<Vec<_>>(), want.clone());
            prop_assert_eq!(mask.count(), want.iter().filter(|b| **b).count() as u64);
            prop_assert!((0..h).all(|y| (0..w).all(|x| mask.get(x, y) == is(x, y))));
            // Doubling and halving again changes nothing.
            prop_assert_eq!(mask.resized(2 * w, 2 * h).resized(w, h), mask);
        }

        #[test]
        fn nearest_stays_inside_and_is_monotone(to in 1_u32..5000, from in 1_u32..5000) {
            let cells: Vec<u32> = (0..to).map(|i| nearest(i, to, from)).collect();
            prop_assert!(cells.iter().all(|c| *c < from) && cells.is_sorted());
        }
    }

    #[test]
    fn empty_masks_are_legal() {
        assert_eq!(BitMask::new(0, 5).count(), 0);
        assert_eq!(BitMask::new(0, 5).resized(2, 2).count(), 0);
        assert_eq!(BitMask::new(3, 3).resized(0, 0).iter().count(), 0);
    }
}
