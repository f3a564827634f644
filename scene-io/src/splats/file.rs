//! A cloud as it was read, and how one is written.

use splat_core::{Gaussians, Widening};

/// A cloud of Gaussians as read.
#[derive(Clone, Debug, PartialEq)]
pub struct SplatFile {
    /// Raw parameters, world units of the file.
    pub cloud: Gaussians,
    /// How the cloud wants to be drawn: what it was trained with. `None` where the file does not say.
    pub widening: Option<Widening>,
    /// What was dropped, clamped or ignored, a line each.
    pub notes: Vec<String>,
}

/// How to write a cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SplatOptions {
    /// What the cloud was trained with: bit 0 of the flags of SPZ, a comment of PLY; `.splat` cannot say it.
    pub widening: Widening,
    /// SPZ: positions are multiples of `2^-bits` and lie within `2^(23 - bits)`. `None`: as many bits, up to 24, as
    /// hold all positions.
    pub fractional_bits: Option<u32>,
}

impl SplatOptions {
    /// The same for a cloud trained with another widening; [`SplatOptions::widening`].
    #[must_use]
    pub fn with_widening(self, widening: Widening) -> Self {
        Self { widening, ..self }
    }

    /// The same with another precision of positions; [`SplatOptions::fractional_bits`].
    #[must_use]
    pub fn with_fractional_bits(self, fractional_bits: impl Into<Option<u32>>) -> Self {
        Self { fractional_bits: fractional_bits.into(), ..self }
    }
}

/// "1 thing", "2 things".
pub(super) fn count(n: usize, one: &str, many: &str) -> String {
    if n == 1 { format!("1 {one}") } else { format!("{n} {many}") }
}
