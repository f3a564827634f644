//! Blocks of 4 x 4 pixels: a tile has 4 x 4 of them, and each is one vector of 16 lanes.
//!
//! Most Gaussians of a trained cloud are a few pixels wide. A square of 16 pixels wastes fewer lanes on them than a row of 16 does.

use float_core::Vector;

use super::{PIXELS, Tile};
use crate::tiles::TILE;

/// Side of a block, pixels; blocks of a tile along each axis.
pub(super) const SIDE: usize = 4;
/// Pixels of a block, and blocks of a tile.
pub(super) const BLOCK: usize = SIDE * SIDE;
/// Slack of the test of blocks, pixels; and of `q`, relative to its terms: above rounding error.
const SLACK: f32 = 1e-3;
const SLACK_Q: f32 = 2e-6;

const _: () = assert!(SIDE * SIDE == TILE && BLOCK * BLOCK == PIXELS);

/// Numbers of a tile's pixels, block by block, row by row.
pub(super) type Pixels = [[f32; BLOCK]; BLOCK];

/// Column and row of pixel `pixel` of block `block`.
const fn place(block: usize, pixel: usize) -> [usize; 2] {
    [block % SIDE * SIDE + pixel % SIDE, block / SIDE * SIDE + pixel / SIDE]
}

/// Centres of all pixels along one axis, relative to the tile's corner.
const fn centres(axis: usize) -> Pixels {
    let mut x = [[0.0; BLOCK]; BLOCK];
    let mut i = 0;
    while i < PIXELS {
        x[i / BLOCK][i % BLOCK] = place(i / BLOCK, i % BLOCK)[axis] as f32 + 0.5;
        i += 1;
    }
    x
}
pub(super) static CENTRES: [Pixels; 2] = [centres(0), centres(1)];

/// The first pixel centre of each block along one axis, less the slack.
const fn lows(axis: usize) -> [f32; BLOCK] {
    let mut low = [0.0; BLOCK];
    let mut block = 0;
    while block < BLOCK {
        low[block] = place(block, 0)[axis] as f32 + 0.5 - SLACK;
        block += 1;
    }
    low
}
static LOWS: [[f32; BLOCK]; 2] = [lows(0), lows(1)];
/// Width of the box of a block's pixel centres with its slack.
const WIDTH: f32 = SIDE as f32 - 1.0 + 2.0 * SLACK;

/// Blocks that have a pixel in the picture, one bit each.
pub(super) fn in_picture<const K: usize>(tile: &Tile<'_, K>) -> u32 {
    let [columns, rows] = tile.size.map(|n| n.div_ceil(SIDE));
    (0..BLOCK).filter(|block| block % SIDE < columns && block / SIDE < rows).map(|block| 1 << block).sum()
}

/// Bits of the blocks of `tile` with a pixel where `q < q_max`, give or take the slack.
///
/// `q` is convex: over a box it is smallest at the centre, or on one of the two sides that face the centre.
#[inline(always)]
pub(super) fn touched<V: Vector, const K: usize>(tile: &Tile<'_, K>, entry: u32) -> u32 {
    let f = &tile.gaussians[entry as usize];
    let [u, v] = [f.uv[0] - tile.corner[0], f.uv[1] - tile.corner[1]];
    let (conic @ [a, b, c], q_max) = (f.conic, f.q_max);
    let (zero, width) = (V::splat(0.0), V::splat(WIDTH));
    let mut blocks = 0;
    for at in (0..BLOCK).step_by(V::LANES) {
        let (left, top) = (V::load(&LOWS[0][at..]) - V::splat(u), V::load(&LOWS[1][at..]) - V::splat(v));
        let (right, bottom) = (left + width, top + width);
        let (x, y) = (left.max(zero.min(right)), top.max(zero.min(bottom)));
        let beside = bound(conic, x, top.max((V::splat(-b / c) * x).min(bottom)));
        let above = bound(conic, left.max((V::splat(-b / a) * y).min(right)), y);
        blocks |= (V::splat(q_max) - beside.min(above)).positive() << at;
    }
    blocks
}

/// A lower bound on `q`, whatever its terms are rounded to.
#[inline(always)]
fn bound<V: Vector>([a, b, c]: [f32; 3], dx: V, dy: V) -> V {
    let squares = V::splat(a) * dx * dx + V::splat(c) * dy * dy;
    squares.mul_add(V::splat(1.0 - SLACK_Q), V::splat(2.0 * b) * dx * dy)
}

/// The blocks of some bits, ascending.
pub(super) struct EachOf(pub(super) u32);

impl Iterator for EachOf {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let block = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (block < BLOCK).then_some(block)
    }
}

/// Copy one plane of a tile, block by block, to the rows `out` of the picture that it covers, from column `x` on.
pub(super) fn paste(tile: &[f32], x: usize, width: usize, out: &mut [f32]) {
    for (y, row) in out.chunks_exact_mut(width).take(TILE).enumerate() {
        for (column, out) in row[x..].chunks_mut(SIDE).take(SIDE).enumerate() {
            let from = (y / SIDE * SIDE + column) * BLOCK + y % SIDE * SIDE;
            out.copy_from_slice(&tile[from..][..out.len()]);
        }
    }
}

/// Copy the part of a picture's plane that a tile covers, from column `x` and row `y` on, to `tile`, block by block. Pixels outside of
/// the picture are left as they are.
pub(super) fn cut(plane: &[f32], [x, y]: [usize; 2], width: usize, tile: &mut [f32]) {
    for (y, row) in plane.chunks_exact(width).skip(y).take(TILE).enumerate() {
        for (column, from) in row[x..].chunks(SIDE).take(SIDE).enumerate() {
            let at = (y / SIDE * SIDE + column) * BLOCK + y % SIDE * SIDE;
            tile[at..][..from.len()].copy_from_slice(from);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RasterSettings;
    use crate::project::ProjectedGaussian;
    use alloc::vec;
    use alloc::vec::Vec;
    use float_core::rng::Rng;
    use float_core::{Simd, Task, m32};

    struct Touched<'a>(Tile<'a, 1>);

    impl Task for Touched<'_> {
        type Output = u32;

        #[inline(always)]
        fn run<V: Vector>(self) -> u32 {
            touched::<V, 1>(&self.0, 0)
        }
    }

    /// An ellipse, from less than a pixel to thousands of pixels long, near the tile or far from it.
    fn ellipse(seed: u64) -> ProjectedGaussian {
        let rng = Rng::new(seed, 0);
        let [angle, long, thin, q_max] = rng.uniform4_at(0);
        let [x, y, far, _] = rng.uniform4_at(1);
        let (s, c) = (m32::sin(6.3 * angle), m32::cos(6.3 * angle));
        // Variances: blur is in them.
        let variance = [0.3 + m32::exp(16.0 * long * long), 0.3 + m32::exp(7.0 * thin - 4.6)];
        let [p, r] = variance.map(f32::recip);
        let reach = if far < 0.3 { 3.0 * m32::sqrt(variance[0]) } else { 10.0 };
        ProjectedGaussian {
            uv: [8.0 + reach * (2.0 * x - 1.0), 8.0 + reach * (2.0 * y - 1.0)],
            conic: [p * c * c + r * s * s, (p - r) * s * c, p * s * s + r * c * c],
            opacity: 0.5,
            q_max: 11.0 * q_max,
            ..Default::default()
        }
    }

    #[test]
    fn no_block_with_a_pixel_inside_is_left_out_and_few_others_are_kept() {
        let (mut left_out, mut kept, mut held) = (0, 0, 0);
        for seed in 0..4000 {
            let gaussian = [ellipse(seed)];
            let f = gaussian[0];
            let mut inside = 0;
            let centres = CENTRES[0].iter().flatten().zip(CENTRES[1].iter().flatten());
            for (i, (x, y)) in centres.enumerate() {
                let [dx, dy] = [f64::from(*x) - f64::from(f.uv[0]), f64::from(*y) - f64::from(f.uv[1])];
                let [a, b, c] = f.conic.map(f64::from);
                let q = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy;
                inside |= u32::from(q < f64::from(f.q_max)) << (i / BLOCK);
            }
            for simd in Simd::available() {
                let settings = RasterSettings::DEFAULT;
                let tile = Tile {
                    entries: &[0],
                    gaussians: &gaussian,
                    features: &[[0.0]],
                    settings: &settings,
                    corner: [0.0; 2],
                    size: [TILE; 2],
                };
                let got = simd.run(Touched(tile));
                assert_eq!(inside & !got, 0, "{seed} {:?}: {f:?}", simd.level());
                (left_out, kept, held) =
                    (left_out + (!got & 0xffff).count_ones(), kept + got.count_ones(), held + inside.count_ones());
            }
        }
        // Blocks that an ellipse passes between the centres of pixels are kept, too.
        assert!(left_out > kept && f64::from(kept) < 1.35 * f64::from(held), "{left_out} {kept} {held}");
    }

    #[test]
    fn planes_come_back_from_blocks_as_they_went() {
        for size @ [width, height] in [[16, 16], [21, 18], [3, 2], [33, 47]] {
            let plane: Vec<f32> = (0..width * height).map(|i| i as f32).collect();
            let mut back = vec![f32::NAN; plane.len()];
            for (y, x) in (0..height).step_by(TILE).flat_map(|y| (0..width).step_by(TILE).map(move |x| (y, x))) {
                let mut tile = [0.0; PIXELS];
                cut(&plane, [x, y], width, &mut tile);
                paste(&tile, x, width, &mut back[y * width..]);
            }
            assert_eq!(back, plane, "{size:?}");
        }
    }
}
