//! A multiresolution hash grid of space and time: learned features at the vertices of grids of `(x, y, z, t)`, blended linearly inside
//! their cells.
//!
//! Wang, Chen, Wang, Shao, Dong, Zhao, Liu, "Masked Space-Time Hash Encoding for Efficient Dynamic Scene Reconstruction", 2023 (MSTH),
//! section 3.1: the hash of Müller et al. (2022), equation 4, with a fourth prime. Unlike products of planes, what is learned at one
//! place and time changes nothing far from there.
//!
//! Here a cell is cut into the 24 simplices of Kuhn (1960), one for each order of the fractions `f`, and a sample reads the five vertices
//! of its simplex instead of all sixteen of its cell:
//!
//! ```text
//! f_(1) >= f_(2) >= f_(3) >= f_(4)          fractions in the cell, in order
//! v_0 = lowest corner,  v_k = v_(k-1) + e_(k)          one axis after the other
//! out = (1 - f_(1)) T[v_0] + (f_(1) - f_(2)) T[v_1] + ... + f_(4) T[v_4]
//! ```
//!
//! It is continuous, and exact where what is learnt is linear.

mod kernel;
#[cfg(test)]
mod tests;

use alloc::vec::Vec;
use core::ops::Range;

use float_core::{Simd, m64};

use self::kernel::{Gather, Place, PositionGradient, Scatter};
use super::lattice::PRIMES;
use super::{rows, rows_mut};
use crate::FieldError;
use crate::error::check_len;

pub use super::lattice::kernel::BLOCK_FLOATS;

/// Prime of the hash for the time.
const TIME_PRIME: u32 = 3_674_653_429;
/// Most cells along an axis: a place in a cell keeps 10 bits of single precision.
const MOST_CELLS: u32 = 1 << 14;
/// Most numbers of a table: 2 GiB.
const MOST_NUMBERS: u64 = 1 << 29;
/// Most levels a grid can have.
pub const MAX_LEVELS: usize = 32;
/// Sizes of a [`TimeHash`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeHashConfig {
    /// Levels, `1..=32`.
    pub levels: usize,
    /// Features of an entry: 1, 2, 4 or 8.
    pub features: usize,
    /// Each level has at most `2^log2_table` entries, 3 to 28.
    pub log2_table: u32,
    /// Cells along an axis of space, of the coarsest and the finest level; geometric in between.
    pub space: [u32; 2],
    /// The same along the time.
    pub time: [u32; 2],
}

/// One level of a [`TimeHash`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeLevel {
    /// Cells along an axis of space, and along the time.
    pub cells: [u32; 2],
    /// Where the level starts in the parameter buffer, in entries.
    pub offset: usize,
    /// Entries of this level.
    pub entries: u32,
    /// Whether every vertex has an entry of its own, `x + R (y + R (z + R t))`; a hash otherwise.
    pub dense: bool,
}

impl TimeLevel {
    /// Entry, counted from the start of the level, of the vertex at integer coordinates `(x, y, z, t)`.
    ///
    /// # Panics
    /// May do so outside of a dense level, or where `entries` was set to 0, which no level of a grid has.
    #[must_use]
    pub fn entry(&self, v: [u32; 4]) -> u32 {
        if self.dense {
            let r = self.cells[0] + 1;
            return v[0] + r * (v[1] + r * (v[2] + r * v[3]));
        }
        let hash = v[0] ^ v[1].wrapping_mul(PRIMES[0]) ^ v[2].wrapping_mul(PRIMES[1]) ^ v[3].wrapping_mul(TIME_PRIME);
        hash & (self.entries - 1)
    }
}

/// A hash grid of space and time. It holds no parameters: buffers are passed in, level after level, each starting at
/// `level.offset` entries.
///
/// # Shapes
/// * `x` `[3][n]` positions in `[0, 1]`, `t` `[n]` times in `[0, 1]`; clamped, with zero gradient outside; NaN counts as 0
/// * `params`, `grad` `[entries][features]`
/// * `out`, `out_bar` `[features][n]` of a level
///
/// # Numerics
/// All SIMD levels and all numbers of threads give the same bits: gradients are added in the order of the samples, and a level is one thread's work.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeHash {
    config: TimeHashConfig,
    levels: Vec<TimeLevel>,
    entries: usize,
}

/// Cells of a level, this share of the way from the coarsest to the finest.
fn between(range: [u32; 2], share: f64) -> u32 {
    let [first, last] = range.map(f64::from);
    m64::round_ties_even(first * m64::exp(m64::ln(last / first) * share)) as u32
}

impl TimeHash {
    /// Lay out a grid.
    ///
    /// # Errors
    /// [`FieldError::Config`] naming the setting that is out of range.
    pub fn new(config: TimeHashConfig) -> Result<Self, FieldError> {
        let refuse = |what, got: f64, accepts| Err(FieldError::Config { what, got, accepts });
        if !(1..=MAX_LEVELS).contains(&config.levels) {
            return refuse("levels", config.levels as f64, "1 to 32");
        }
        if !matches!(config.features, 1 | 2 | 4 | 8) {
            return refuse("features", config.features as f64, "1, 2, 4 or 8");
        }
        if !(3..=28).contains(&config.log2_table) {
            return refuse("log2_table", f64::from(config.log2_table), "3 to 28");
        }
        for (what, [first, last], most) in [("space", config.space, MOST_CELLS), ("time", config.time, MOST_CELLS)] {
            if first == 0 || first > last || last > most {
                return refuse(what, f64::from(last), "1 to 2^14 cells, the coarsest level first");
            }
        }
        let table = 1_u64 << config.log2_table;
        if (config.levels * config.features) as u64 * table > MOST_NUMBERS {
            return refuse(
                "log2_table",
                f64::from(config.log2_table),
                "levels * features * 2^log2_table of at most 2^29",
            );
        }
        let mut offset = 0;
        let levels = (0..config.levels).map(|l| {
            let share = l as f64 / (config.levels - 1).max(1) as f64;
            let cells = [between(config.space, share), between(config.time, share)];
            // At most 2^57: compared with a table of at most 2^28.
            let [side, along] = cells.map(|cells| f64::from(cells + 1));
            let vertices = side * side * side * along;
            let dense = vertices <= table as f64;
            let entries = if dense { vertices as u32 } else { table as u32 };
            let level = TimeLevel { cells, offset, entries, dense };
            offset += entries as usize;
            level
        });
        let levels = levels.collect();
        Ok(Self { config, levels, entries: offset })
    }

    /// The configuration it was made from.
    #[must_use]
    pub fn config(&self) -> &TimeHashConfig {
        &self.config
    }

    /// The levels, coarse to fine.
    #[must_use]
    pub fn levels(&self) -> &[TimeLevel] {
        &self.levels
    }

    /// Length of the parameter buffer.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.entries * self.config.features
    }

    /// Rows of all levels: `levels * features`.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.config.levels * self.config.features
    }

    /// Which parameters belong to a level.
    ///
    /// # Panics
    /// If there is no such level.
    #[must_use]
    pub fn level_range(&self, level: usize) -> Range<usize> {
        let l = &self.levels[level];
        l.offset * self.config.features..(l.offset + l.entries as usize) * self.config.features
    }

    /// Features of one level: `out` `[features][n]`; `params` is the whole buffer.
    ///
    /// # Errors
    /// [`FieldError::Shape`], [`FieldError::Index`] for a level that does not exist.
    pub fn encode_level(
        &self,
        simd: Simd,
        params: &[f32],
        level: usize,
        x: &[f32],
        t: &[f32],
        out: &mut [f32],
    ) -> Result<(), FieldError> {
        let place = self.place(level, x, t, "out", out.len())?;
        check_len("params", params.len(), self.params_len())?;
        let table = &params[self.level_range(level)];
        match self.config.features {
            1 => simd.run(Gather::<1> { place, table, out: rows_mut(out) }),
            2 => simd.run(Gather::<2> { place, table, out: rows_mut(out) }),
            4 => simd.run(Gather::<4> { place, table, out: rows_mut(out) }),
            _ => simd.run(Gather::<8> { place, table, out: rows_mut(out) }),
        }
        Ok(())
    }

    /// Add one level's table gradient. `grad` is the level's part of the gradient, `touched` a bit for each [`BLOCK_FLOATS`] of its numbers,
    /// set where something was added.
    ///
    /// # Errors
    /// As [`encode_level`](Self::encode_level).
    #[expect(clippy::too_many_arguments, reason = "the arguments of the pair, and the touched words")]
    pub fn encode_level_backward(
        &self,
        simd: Simd,
        level: usize,
        x: &[f32],
        t: &[f32],
        out_bar: &[f32],
        grad: &mut [f32],
        touched: &mut [u64],
    ) -> Result<(), FieldError> {
        let place = self.place(level, x, t, "out_bar", out_bar.len())?;
        let floats = self.level_range(level).len();
        check_len("grad", grad.len(), floats)?;
        check_len("touched", touched.len(), floats.div_ceil(BLOCK_FLOATS).div_ceil(64))?;
        match self.config.features {
            1 => simd.run(Scatter::<1> { place, out_bar: rows(out_bar), grad, touched }),
            2 => simd.run(Scatter::<2> { place, out_bar: rows(out_bar), grad, touched }),
            4 => simd.run(Scatter::<4> { place, out_bar: rows(out_bar), grad, touched }),
            _ => simd.run(Scatter::<8> { place, out_bar: rows(out_bar), grad, touched }),
        }
        Ok(())
    }

    /// Add one level's gradient of the positions to `x_bar` `[3][n]`.
    ///
    /// # Errors
    /// As [`encode_level`](Self::encode_level).
    #[expect(clippy::too_many_arguments, reason = "the arguments of the pair")]
    pub fn encode_level_backward_x(
        &self,
        simd: Simd,
        params: &[f32],
        level: usize,
        x: &[f32],
        t: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        let place = self.place(level, x, t, "out_bar", out_bar.len())?;
        check_len("params", params.len(), self.params_len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        let (table, x_bar) = (&params[self.level_range(level)], rows_mut(x_bar));
        match self.config.features {
            1 => simd.run(PositionGradient::<1> { place, table, out_bar: rows(out_bar), x_bar }),
            2 => simd.run(PositionGradient::<2> { place, table, out_bar: rows(out_bar), x_bar }),
            4 => simd.run(PositionGradient::<4> { place, table, out_bar: rows(out_bar), x_bar }),
            _ => simd.run(PositionGradient::<8> { place, table, out_bar: rows(out_bar), x_bar }),
        }
        Ok(())
    }

    /// A level, and points of matching sizes.
    fn place<'a>(
        &self,
        level: usize,
        x: &'a [f32],
        t: &'a [f32],
        name: &'static str,
        len: usize,
    ) -> Result<Place<'a>, FieldError> {
        let Some(&of) = self.levels.get(level) else {
            return Err(FieldError::Index { what: "level", index: 0, got: level, limit: self.levels.len() });
        };
        check_len("x", x.len(), 3 * t.len())?;
        check_len(name, len, t.len() * self.config.features)?;
        let [a, b, c] = rows(x);
        Ok(Place { level: of, rows: [a, b, c, t] })
    }
}
