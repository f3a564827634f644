//! SPZ: gzip of a header of 16 bytes and one block for each attribute.
//!
//! | block | bytes each | encoding |
//! | --- | --- | --- |
//! | positions | 9 | 3 signed 24-bit numbers, `round(x 2^bits)` |
//! | opacities | 1 | `round(255 o)` |
//! | colours | 3 | `round(255 (0.15 h + 0.5))` |
//! | sizes | 3 | `round(16 (l + 10))` |
//! | rotations | 4, in version 2: 3 | see `rotation` |
//! | harmonics | 3 K | coefficient by coefficient, channels inside: `128 h + 128` |
//!
//! # Source
//! Niantic's description of the format, versions 2 and 3.

mod read;
mod rotation;
mod write;

pub(super) use read::read;
pub(super) use write::Packing;

/// First bytes of what is inside the gzip, and of versions from 4 on, which have none.
pub(super) const MAGIC: &[u8; 4] = b"NGSP";
const HEADER: usize = 16;
/// Files of more Gaussians are refused, as other readers do.
const MAX_COUNT: usize = 10_000_000;
/// Positions are then within half a unit.
const MAX_FRACTIONAL_BITS: u32 = 24;
const ANTIALIASED: u8 = 1;
const EXTENSIONS: u8 = 2;
/// Colours: steeper than the function of degree 0, so that they may leave `[0, 1]`.
const COLOUR: f64 = 0.15;
/// What the axes x, y, z are multiplied by: right, down, front to right, up, back. A half turn about x.
const FLIP: [f32; 3] = [1.0, -1.0, -1.0];
/// What that half turn multiplies coefficients 1 to 15 by.
const FLIP_SH: [f32; 15] = [
    -1.0, -1.0, 1.0, // y z x
    -1.0, 1.0, 1.0, -1.0, 1.0, // xy yz zz xz xx-yy
    -1.0, 1.0, -1.0, -1.0, 1.0, -1.0, 1.0,
];

/// Bytes of one Gaussian inside the gzip.
fn stride(rotation: usize, per_channel: usize) -> usize {
    9 + 1 + 3 + 3 + rotation + 3 * per_channel
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Degree-3 functions at a direction, signs left out: they do not change under flips.
    fn harmonics([x, y, z]: [f32; 3]) -> [f32; 15] {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        [
            y,
            z,
            x,
            x * y,
            y * z,
            2.0 * zz - xx - yy,
            x * z,
            xx - yy,
            y * (3.0 * xx - yy),
            x * y * z,
            y * (4.0 * zz - xx - yy),
            z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            x * (4.0 * zz - xx - yy),
            z * (xx - yy),
            x * (xx - 3.0 * yy),
        ]
    }

    #[test]
    fn signs_of_harmonics_are_those_of_the_half_turn() {
        let d = [0.36, -0.48, 0.8];
        let turned = std::array::from_fn(|i| FLIP[i] * d[i]);
        for (k, (a, b)) in harmonics(d).into_iter().zip(harmonics(turned)).enumerate() {
            assert!((b - FLIP_SH[k] * a).abs() < 1e-6 && a.abs() > 1e-3, "coefficient {}", k + 1);
        }
    }
}
