//! How large each level is, and where its entries lie.

use float_core::m64;

use super::{Growth, HashGridConfig, Rule};
use crate::FieldError;
use crate::encoding::lattice::{Addressing, Lattice, PRIMES};

/// Most levels a grid can have.
pub const MAX_LEVELS: usize = 32;
/// Largest resolution: cell coordinates stay exact in `f32`, staggered by one half.
const MAX_RESOLUTION: f64 = 4_194_304.0; // 2^22
/// A size this close to an integer, relatively, is that integer: `16 exp(ln 128)` must be 2048, not 2048.0000000001.
const SNAP: f64 = 1e-9;

/// One level of a [`HashGrid`](super::HashGrid).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Vertices along each axis.
    pub resolution: u32,
    /// `p = x * scale + shift` are the coordinates in cells.
    pub scale: f32,
    /// One half for [`Rule::Ngp`], 0 for [`Rule::Paper`].
    pub shift: f32,
    /// Largest cell number along an axis.
    last_cell: f32,
    /// Where the level starts in the parameter buffer, in entries.
    pub offset: usize,
    /// Entries of this level.
    pub entries: u32,
    /// How vertices find their entries.
    pub addressing: Addressing,
}

impl Level {
    /// What the kernels need.
    pub(super) fn lattice(&self) -> Lattice {
        Lattice {
            scale: [self.scale; 3],
            shift: self.shift,
            last_cell: [self.last_cell; 3],
            strides: [self.resolution, self.resolution.wrapping_mul(self.resolution)],
            entries: self.entries,
            addressing: self.addressing,
        }
    }

    /// Entry, counted from the start of the level, of the vertex at integer coordinates `v`.
    ///
    /// The definition, for tests and tools: the kernels compute the same numbers sixteen at a time.
    ///
    /// # Panics
    /// May do so where `entries` was set to 0, which no level of a grid has.
    #[must_use]
    pub fn entry(&self, v: [u32; 3]) -> u32 {
        match self.addressing {
            Addressing::Dense => {
                let r = u64::from(self.resolution);
                ((u64::from(v[0]) + r * (u64::from(v[1]) + r * u64::from(v[2]))) % u64::from(self.entries)) as u32
            }
            Addressing::Hashed => {
                (v[0] ^ v[1].wrapping_mul(PRIMES[0]) ^ v[2].wrapping_mul(PRIMES[1])) & (self.entries - 1)
            }
        }
    }
}

/// The levels of a configuration, and their number of entries together.
pub(super) fn lay_out(config: &HashGridConfig) -> Result<([Level; MAX_LEVELS], usize), FieldError> {
    let mut levels = [Level {
        resolution: 0,
        scale: 0.0,
        shift: 0.0,
        last_cell: 0.0,
        offset: 0,
        entries: 0,
        addressing: Addressing::Dense,
    }; MAX_LEVELS];
    let table = 1_u64 << config.log2_table;
    let mut offset = 0;
    for (l, level) in levels.iter_mut().enumerate().take(config.levels) {
        let n = size(config, l);
        if n.is_nan() || n > MAX_RESOLUTION {
            return Err(FieldError::Config { what: "n_min * growth^level", got: n, accepts: "at most 2^22" });
        }
        let (resolution, scale, shift, last_cell) = match config.rule {
            Rule::Ngp => (m64::ceil(n - 1.0) + 1.0, n - 1.0, 0.5, m64::ceil(n - 1.0)),
            Rule::Paper => (m64::floor(n) + 1.0, m64::floor(n), 0.0, m64::floor(n) - 1.0),
        };
        // At most 2^66: fits f64 closely enough to compare with the table, and never overflows.
        let vertices = resolution * resolution * resolution;
        let (entries, addressing) = if vertices <= table as f64 {
            let vertices = vertices as u64;
            let rounded = match config.rule {
                Rule::Ngp => vertices.next_multiple_of(8).min(table),
                Rule::Paper => vertices,
            };
            (rounded as u32, Addressing::Dense)
        } else {
            (table as u32, Addressing::Hashed)
        };
        *level = Level {
            resolution: resolution as u32,
            scale: scale as f32,
            shift,
            last_cell: last_cell as f32,
            offset,
            entries,
            addressing,
        };
        offset += entries as usize;
    }
    Ok((levels, offset))
}

/// `n_min * b^l`, snapped to integers.
fn size(config: &HashGridConfig, l: usize) -> f64 {
    let n_min = f64::from(config.n_min);
    let n = match config.growth {
        Growth::Factor(b) => n_min * m64::powi(b, l as i32),
        Growth::UpTo(_) if l == 0 => n_min,
        Growth::UpTo(n_max) => {
            let last = (config.levels - 1) as f64;
            n_min * m64::exp(m64::ln(f64::from(n_max) / n_min) * (l as f64 / last))
        }
    };
    let nearest = m64::round_ties_even(n);
    if (n - nearest).abs() <= SNAP * n { nearest } else { n }
}
