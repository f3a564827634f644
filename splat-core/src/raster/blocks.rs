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

/// Copy the part of a picture's plane that a tile covers, from column `x` and row `y` on, to `tile`, block by block. Pixels outside of the picture are left as they are.
pub(super) fn cut(plane: &[f32], [x, y]: [usize; 2], width: usize, tile: &mut [f32]) {
    for (y, row) in plane.chunks_exact(width).skip(y).take(TILE).enumerate() {
        for (column, from) in row[x..].chunks(SIDE).take(SIDE).enumerate() {
            let at = (y / SIDE * SIDE + column) * BLOCK + y % SIDE * SIDE;
            tile[at..][..from.len()].copy_from_slice(from);
        }
    }
}
