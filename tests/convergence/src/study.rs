//! How to measure, and random numbers.

use float_core::Simd;

/// How to measure.
#[derive(Clone, Copy, Debug)]
pub struct Study {
    /// Rays in a batch.
    pub rays: usize,
    /// What random numbers come from.
    pub seed: u64,
    /// Times that each measurement is taken.
    pub repeats: usize,
    /// Level that `render-core` runs at.
    pub simd: Simd,
}

impl Default for Study {
    /// 128 rays, seed 0, once, the fastest level.
    fn default() -> Self {
        Self { rays: 128, seed: 0, repeats: 1, simd: Simd::best() }
    }
}

/// A number in `[0, 1)`: a function of seed and index only (SplitMix64, public domain).
pub(crate) fn uniform(seed: u64, index: u64) -> f32 {
    let mut z = seed.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add((index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f32 / (1 << 24) as f32
}
