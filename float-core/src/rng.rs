//! Counter-based random numbers: a draw is a function of (seed, stream, index), never of history.
//!
//! The generator is Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011): the 64-bit seed
//! is the key, the 128-bit counter holds the index and the stream. Threads, tiles and resumed runs get the same
//! number for the same index, in any order.
//!
//! ```
//! use float_core::rng::Rng;
//!
//! let step = Rng::new(7, 0).substream(1000);
//! let mut u = [0.0; 3];
//! step.fill_uniform(40, &mut u);
//! assert_eq!(u, [step.uniform_at(40), step.uniform_at(41), step.uniform_at(42)]);
//! ```

use crate::m32;

const MULTIPLIER: [u32; 2] = [0xD251_1F53, 0xCD9E_8D57];
const WEYL: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
const ROUNDS: usize = 10;
/// `2^-24`: uniforms keep as many bits as an `f32` has digits.
const ULP24: f32 = 1.0 / 16_777_216.0;
/// Separates the counters that name substreams from those that draw numbers.
const SUBSTREAM_KEY: u64 = 0x5DEE_CE66_D1CE_4E5B;

/// A random stream. Holds 16 bytes and no state: copy it into jobs and threads.
///
/// One index is one draw, 128 bits long, however it is read: `uniform_at(5)` and `below_at(5, n)` come from the same
/// bits, so give each use its own indices or its own [`substream`](Self::substream).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Rng {
    seed: u64,
    stream: u64,
}

impl Rng {
    /// Stream `stream` of seed `seed`. Streams of one seed never share a counter.
    #[must_use]
    pub const fn new(seed: u64, stream: u64) -> Self {
        Self { seed, stream }
    }

    /// The `k`-th child stream, named by a hash of this stream and `k`. Two different paths of substreams meet with
    /// probability `2^-64` for each pair.
    #[must_use]
    pub fn substream(self, k: u64) -> Self {
        let hash = philox([k, self.stream], self.seed ^ SUBSTREAM_KEY);
        Self { seed: self.seed, stream: word_pair(hash[0], hash[1]) }
    }

    /// All 128 bits of draw `index`.
    #[inline]
    #[must_use]
    pub fn block_at(self, index: u64) -> [u32; 4] {
        philox([index, self.stream], self.seed)
    }

    /// The first 64 bits of draw `index`.
    #[inline]
    #[must_use]
    pub fn u64_at(self, index: u64) -> u64 {
        let block = self.block_at(index);
        word_pair(block[0], block[1])
    }

    /// Uniform in `[0, 1)`, a multiple of `2^-24`.
    #[inline]
    #[must_use]
    pub fn uniform_at(self, index: u64) -> f32 {
        unit(self.block_at(index)[0])
    }

    /// Four independent uniforms in `[0, 1)` for the price of one; the first is [`uniform_at`](Self::uniform_at).
    #[inline]
    #[must_use]
    pub fn uniform4_at(self, index: u64) -> [f32; 4] {
        self.block_at(index).map(unit)
    }

    /// Uniform integer in `0..n`; 0 for `n = 0`. Multiply and shift of 64 bits: no value is favoured by more than
    /// `n / 2^64`.
    #[inline]
    #[must_use]
    pub fn below_at(self, index: u64, n: u32) -> u32 {
        // The high word of a 64 x 32 bit product is below n.
        ((u128::from(self.u64_at(index)) * u128::from(n)) >> 64) as u32
    }

    /// Standard normal, by Box and Muller; `|x| < 6.7`.
    #[inline]
    #[must_use]
    pub fn normal_at(self, index: u64) -> f32 {
        let block = self.block_at(index);
        // In (0, 1]: the logarithm is finite.
        let radius2 = (block[0] as f32 + 1.0) * (1.0 / 4_294_967_296.0);
        m32::sqrt(-2.0 * m32::ln(radius2)) * m32::cos(unit(block[1]) * core::f32::consts::TAU)
    }

    /// `out[i] = uniform_at(start_index + i)`.
    pub fn fill_uniform(self, start_index: u64, out: &mut [f32]) {
        for (index, x) in (0..).zip(out) {
            *x = self.uniform_at(start_index.wrapping_add(index));
        }
    }

    /// `out[i] = normal_at(start_index + i)`.
    pub fn fill_normal(self, start_index: u64, out: &mut [f32]) {
        for (index, x) in (0..).zip(out) {
            *x = self.normal_at(start_index.wrapping_add(index));
        }
    }
}

#[inline(always)]
fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * ULP24
}

#[inline(always)]
fn word_pair(low: u32, high: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

/// Philox4x32-10 of the counter, four words little end first, under the key.
#[inline(always)]
fn philox(counter: [u64; 2], key: u64) -> [u32; 4] {
    let mut c = [counter[0] as u32, (counter[0] >> 32) as u32, counter[1] as u32, (counter[1] >> 32) as u32];
    let mut k = [key as u32, (key >> 32) as u32];
    for _ in 0..ROUNDS {
        let p0 = u64::from(MULTIPLIER[0]) * u64::from(c[0]);
        let p1 = u64::from(MULTIPLIER[1]) * u64::from(c[2]);
        c = [(p1 >> 32) as u32 ^ c[1] ^ k[0], p1 as u32, (p0 >> 32) as u32 ^ c[3] ^ k[1], p0 as u32];
        k = [k[0].wrapping_add(WEYL[0]), k[1].wrapping_add(WEYL[1])];
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers of the Random123 distribution, `kat_vectors`, philox4x32 with 10 rounds.
    #[test]
    fn philox_gives_the_published_vectors() {
        assert_eq!(philox([0; 2], 0), [0x6627_E8D5, 0xE169_C58D, 0xBC57_AC4C, 0x9B00_DBD8]);
        assert_eq!(philox([u64::MAX; 2], u64::MAX), [0x408F_276D, 0x41C8_3B0E, 0xA20B_C7C6, 0x6D54_51FD]);
        assert_eq!(
            philox([0x85A3_08D3_243F_6A88, 0x0370_7344_1319_8A2E], 0x299F_31D0_A409_3822),
            [0xD16C_FE09, 0x94FD_CCEB, 0x5001_E420, 0x2412_6EA1]
        );
    }

    #[test]
    fn uniforms_have_the_right_moments_and_fill_every_bin() {
        const N: usize = 1 << 16;
        let rng = Rng::new(1, 2);
        let (mut sum, mut sum2, mut lagged, mut bins) = (0.0, 0.0, 0.0, [0_u32; 64]);
        let mut before = 0.5_f64;
        for i in 0..N as u64 {
            let u = rng.uniform_at(i);
            assert!((0.0..1.0).contains(&u));
            bins[(u * 64.0) as usize] += 1;
            let u = f64::from(u);
            sum += u;
            sum2 += u * u;
            lagged += (u - 0.5) * (before - 0.5);
            before = u;
        }
        let n = N as f64;
        // Five standard errors: 1/sqrt(12 n), sqrt(4/45 / n), 1/(12 sqrt n).
        assert!((sum / n - 0.5).abs() < 5.0 * (1.0 / 12.0 / n).sqrt());
        assert!((sum2 / n - 1.0 / 3.0).abs() < 5.0 * (4.0 / 45.0 / n).sqrt());
        assert!((lagged / n).abs() < 5.0 / 12.0 / n.sqrt());
        let expected = n / 64.0;
        let chi2: f64 = bins.iter().map(|&b| (f64::from(b) - expected).powi(2) / expected).sum();
        // 63 degrees of freedom: mean 63, deviation 11.2.
        assert!((20.0..120.0).contains(&chi2), "chi squared {chi2}");
    }

    #[test]
    fn normals_have_the_right_moments() {
        const N: usize = 1 << 16;
        let rng = Rng::new(3, 4);
        let m = (0..N as u64).fold([0.0; 4], |m, i| {
            let x = f64::from(rng.normal_at(i));
            [m[0] + x, m[1] + x * x, m[2] + x.powi(3), m[3] + x.powi(4)]
        });
        let n = N as f64;
        for (k, (got, (want, variance))) in m.iter().zip([(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0)]).enumerate()
        {
            let got = got / n;
            assert!((got - want).abs() < 5.0 * f64::sqrt(variance / n), "moment {}: {got}", k + 1);
        }
    }

    #[test]
    fn below_reaches_every_value_equally_and_nothing_else() {
        let rng = Rng::new(5, 6);
        let mut counts = [0_u32; 7];
        for i in 0..70_000 {
            counts[rng.below_at(i, 7) as usize] += 1;
        }
        assert!(counts.iter().all(|&c| c.abs_diff(10_000) < 500), "{counts:?}");
        assert_eq!(rng.below_at(0, 0), 0);
        assert_eq!(rng.below_at(0, 1), 0);
        assert!((0..1000).map(|i| rng.below_at(i, u32::MAX)).any(|x| x > u32::MAX / 2));
    }

    #[test]
    fn seeds_streams_and_substreams_differ() {
        let base = Rng::new(1, 0);
        let others =
            [Rng::new(2, 0), Rng::new(1, 1), base.substream(0), base.substream(1), base.substream(0).substream(0)];
        for (a, other) in others.iter().enumerate() {
            assert!((0..64).all(|i| base.u64_at(i) != other.u64_at(i)), "stream {a}");
        }
        assert_eq!(base.substream(9), base.substream(9));
    }

    #[test]
    fn fills_equal_single_draws_and_empty_is_legal() {
        let rng = Rng::new(8, 9);
        let (mut u, mut g) = ([0.0; 37], [0.0; 37]);
        rng.fill_uniform(100, &mut u);
        rng.fill_normal(100, &mut g);
        for i in 0..37 {
            assert_eq!(u[i], rng.uniform_at(100 + i as u64));
            assert_eq!(g[i], rng.normal_at(100 + i as u64));
        }
        assert_eq!(rng.uniform4_at(4)[0], rng.uniform_at(4));
        rng.fill_uniform(0, &mut []);
        rng.fill_uniform(u64::MAX, &mut [0.0; 2]);
    }
}
