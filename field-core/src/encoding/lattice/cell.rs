//! The eight corners around sixteen points: entries and weights.
//!
//! Plain loops over arrays of [`BLOCK`]: the compiler vectorises them for the level they are inlined into. No fused
//! multiply-add, so all levels give the same bits.

use super::{Addressing, Interpolation, Lattice, PRIMES};

/// Points worked on together.
pub(crate) const BLOCK: usize = 16;
/// One number for each point.
pub(crate) type Lanes = [f32; BLOCK];
/// One number for each corner of each point's cell; corner `c` has bit 0 = +x, bit 1 = +y, bit 2 = +z.
pub(crate) type Corners<T> = [[T; BLOCK]; 8];

/// Adding and subtracting `2^52` rounds numbers in `[0, 2^52)` to integers.
const ROUND: f64 = 4_503_599_627_370_496.0;

/// Where sixteen points lie in their cells.
#[derive(Clone, Copy)]
pub(crate) struct Cells {
    /// Integer coordinates of the lower corner.
    base: [[u32; BLOCK]; 3],
    /// Weight of the upper side, for each axis.
    upper: [Lanes; 3],
    /// Its derivative with respect to `x`; 0 where `x` was clamped.
    derivative: [Lanes; 3],
    /// Its second derivative.
    second: [Lanes; 3],
}

/// What the corners are weighted with.
#[derive(Clone, Copy)]
pub(crate) enum Weights<'a> {
    /// The interpolation itself.
    Value,
    /// Its derivative along this direction.
    Tangent(&'a [Lanes; 3]),
}

impl Cells {
    /// Before anything was located.
    pub(crate) const NOTHING: Self = Self {
        base: [[0; BLOCK]; 3],
        upper: [[0.0; BLOCK]; 3],
        derivative: [[0.0; BLOCK]; 3],
        second: [[0.0; BLOCK]; 3],
    };

    /// Locate points; coordinates outside `[0, 1]` are clamped, NaN counts as 0.
    #[inline(always)]
    pub(crate) fn locate(lattice: &Lattice, interpolation: Interpolation, x: &[Lanes; 3]) -> Self {
        let mut cells = Self::NOTHING;
        for a in 0..3 {
            for i in 0..BLOCK {
                let x = x[a][i];
                let inside = if (0.0..=1.0).contains(&x) { lattice.scale[a] } else { 0.0 };
                let x = if x > 0.0 { x } else { 0.0 };
                let x = if x < 1.0 { x } else { 1.0 };
                // In f64, where this is exact: in f32 the fraction loses a bit for each doubling of the resolution.
                let p = f64::from(x) * f64::from(lattice.scale[a]) + f64::from(lattice.shift);
                let (cell, f) = split(p, f64::from(lattice.last_cell[a]));
                cells.base[a][i] = cell;
                match interpolation {
                    Interpolation::Linear => {
                        cells.upper[a][i] = f;
                        cells.derivative[a][i] = inside;
                    }
                    Interpolation::Smoothstep => {
                        cells.upper[a][i] = f * f * (3.0 - 2.0 * f);
                        cells.derivative[a][i] = inside * (6.0 * f * (1.0 - f));
                        cells.second[a][i] = inside * inside * (6.0 - 12.0 * f);
                    }
                }
            }
        }
        cells
    }

    /// Entries of the corners times `stride`, the features of an entry: where these start, written over `starts`. Always at most
    /// `(entries - 1) * stride`.
    #[inline(always)]
    pub(crate) fn starts(&self, lattice: &Lattice, stride: u32, starts: &mut Corners<u32>) {
        let [bx, by, bz] = &self.base;
        let last = lattice.entries - 1;
        match lattice.addressing {
            Addressing::Dense => {
                let [r, r2] = lattice.strides;
                for (c, starts) in starts.iter_mut().enumerate() {
                    let step = (c as u32 & 1) + r * (c as u32 >> 1 & 1) + r2 * (c as u32 >> 2);
                    for i in 0..BLOCK {
                        let e = bx[i] + r * by[i] + r2 * bz[i] + step;
                        // One past the edge wraps, once: e < 2 entries. The difference of a smaller e is huge.
                        let e = e.min(e.wrapping_sub(lattice.entries));
                        starts[i] = e.min(last) * stride;
                    }
                }
            }
            Addressing::Hashed => {
                for (c, starts) in starts.iter_mut().enumerate() {
                    let step = [c as u32 & 1, c as u32 >> 1 & 1, c as u32 >> 2];
                    for i in 0..BLOCK {
                        let y = by[i].wrapping_mul(PRIMES[0]).wrapping_add(step[1].wrapping_mul(PRIMES[0]));
                        let z = bz[i].wrapping_mul(PRIMES[1]).wrapping_add(step[2].wrapping_mul(PRIMES[1]));
                        starts[i] = (((bx[i] + step[0]) ^ y ^ z) & last) * stride;
                    }
                }
            }
        }
    }

    /// Weights of the corners, written over `w`.
    #[inline(always)]
    pub(crate) fn weights(&self, kind: Weights<'_>, w: &mut Corners<f32>) {
        for (c, w) in w.iter_mut().enumerate() {
            for i in 0..BLOCK {
                let [x, y, z] = [0, 1, 2].map(|a| side(c >> a, self.upper[a][i]));
                w[i] = match kind {
                    Weights::Value => x * y * z,
                    Weights::Tangent(dot) => {
                        let [dx, dy, dz] = [0, 1, 2].map(|a| sign(c >> a) * (self.derivative[a][i] * dot[a][i]));
                        dx * y * z + x * dy * z + x * y * dz
                    }
                };
            }
        }
    }

    /// Derivatives of the weights with respect to each coordinate: `[corner][axis]`.
    #[inline(always)]
    pub(crate) fn weights_by_x(&self, kind: Weights<'_>) -> [[Lanes; 3]; 8] {
        let mut by_x = [[[0.0; BLOCK]; 3]; 8];
        for (c, by_x) in by_x.iter_mut().enumerate() {
            let s = [0, 1, 2].map(|a| sign(c >> a));
            for i in 0..BLOCK {
                let w = [0, 1, 2].map(|a| side(c >> a, self.upper[a][i]));
                let d = [0, 1, 2].map(|a| s[a] * self.derivative[a][i]);
                for a in 0..3 {
                    let (b, e) = ((a + 1) % 3, (a + 2) % 3);
                    by_x[a][i] = match kind {
                        Weights::Value => d[a] * w[b] * w[e],
                        Weights::Tangent(dot) => {
                            s[a] * self.second[a][i] * dot[a][i] * w[b] * w[e]
                                + d[a] * (d[b] * dot[b][i] * w[e] + w[b] * d[e] * dot[e][i])
                        }
                    };
                }
            }
        }
        by_x
    }
}

/// The cell of `p >= 0`, at most the whole number `last`, and how far into it `p` lies, in cells.
#[inline(always)]
pub(crate) fn split(p: f64, last: f64) -> (u32, f32) {
    let nearest = (p + ROUND) - ROUND;
    let floor = if nearest > p { nearest - 1.0 } else { nearest };
    let floor = if floor < last { floor } else { last };
    // The integer lies in the low bits of the mantissa.
    ((floor + ROUND).to_bits() as u32, (p - floor) as f32)
}

/// Weight of the upper (odd `bit`) or the lower side.
#[inline(always)]
pub(crate) fn side(bit: usize, upper: f32) -> f32 {
    if bit & 1 == 1 { upper } else { 1.0 - upper }
}

#[inline(always)]
pub(crate) fn sign(bit: usize) -> f32 {
    if bit & 1 == 1 { 1.0 } else { -1.0 }
}
