//! What was skipped, added up.

/// Kinds of work that may be skipped. See the [table](super).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Skip {
    /// Samples behind what is opaque.
    Behind,
    /// Colours of samples that carry next to no weight.
    Faint,
    /// Samples in blocks of space that are empty.
    Empty,
    /// The side of a blend that has next to no weight.
    Branch,
    /// Levels or bands that are windowed away.
    Window,
    /// Degrees of spherical harmonics without energy.
    Harmonics,
}

impl Skip {
    /// All of them, in the order of the ledger.
    pub const ALL: [Self; 6] = [Self::Behind, Self::Faint, Self::Empty, Self::Branch, Self::Window, Self::Harmonics];

    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Behind => "samples behind what is opaque",
            Self::Faint => "colours of samples without weight",
            Self::Empty => "samples in empty space",
            Self::Branch => "sides of blends without weight",
            Self::Window => "levels that are windowed away",
            Self::Harmonics => "harmonics without energy",
        }
    }
}

/// Some kinds of skips.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SkipSet(u8);

impl SkipSet {
    /// All kinds.
    pub const ALL: Self = Self(u8::MAX);
    /// None.
    pub const NONE: Self = Self(0);

    /// One kind alone.
    #[must_use]
    pub const fn only(skip: Skip) -> Self {
        Self(1 << skip as u8)
    }

    /// Whether it is among them.
    #[inline(always)]
    #[must_use]
    pub const fn has(self, skip: Skip) -> bool {
        self.0 >> skip as u8 & 1 == 1
    }
}

/// Bounds are added up as whole multiples of this, so that the order does not matter: 2^-40. A sum holds 16 million pixels
/// of bound 1.
const UNIT: f64 = 1.0 / (1_u64 << 40) as f64;

/// One kind of skip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// Units of work skipped.
    pub skipped: u64,
    /// Units of work there would have been.
    pub total: u64,
    /// Pixels that a bound was spent on.
    pub pixels: u64,
    spent: u64,
    most: u64,
}

impl Entry {
    /// Sum of the bounds of all pixels, colour units, rounded up.
    #[must_use]
    pub fn spent(&self) -> f64 {
        self.spent as f64 * UNIT
    }

    /// Largest bound of a pixel, rounded up.
    #[must_use]
    pub fn most(&self) -> f64 {
        self.most as f64 * UNIT
    }
}

/// What was skipped, by kind. 240 bytes; whole numbers, so that parts may be merged in any order and give the same bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ledger {
    entries: [Entry; Skip::ALL.len()],
}

impl Ledger {
    /// An entry.
    #[must_use]
    pub fn entry(&self, skip: Skip) -> Entry {
        self.entries[skip as usize]
    }

    /// `skipped` of `total` units of work were skipped.
    pub fn count(&mut self, skip: Skip, skipped: u64, total: u64) {
        let entry = &mut self.entries[skip as usize];
        entry.skipped += skipped;
        entry.total += total;
    }

    /// A pixel may be off by `bound` because of a skip.
    pub fn spend(&mut self, skip: Skip, bound: f64) {
        let entry = &mut self.entries[skip as usize];
        // The cast rounds down, and takes NaN to 0 and what is too large to the largest number.
        let bound = if bound > 0.0 { ((bound / UNIT) as u64).saturating_add(1) } else { 0 };
        entry.pixels += 1;
        entry.spent = entry.spent.saturating_add(bound);
        entry.most = entry.most.max(bound);
    }

    /// Add another ledger.
    pub fn merge(&mut self, other: &Self) {
        for (a, b) in self.entries.iter_mut().zip(&other.entries) {
            a.skipped += b.skipped;
            a.total += b.total;
            a.pixels += b.pixels;
            a.spent = a.spent.saturating_add(b.spent);
            a.most = a.most.max(b.most);
        }
    }
}
