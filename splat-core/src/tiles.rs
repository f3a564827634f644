//! Which tiles of the picture a projected Gaussian touches, and the list of each tile, front to back.
//!
//! Gaussians are sorted by depth once. Appending each in that order to the lists of its tiles leaves every list sorted: pairs of a
//! Gaussian and a tile are never sorted themselves.

use alloc::vec::Vec;

use float_core::m32;

use crate::chunks::for_each;
use crate::project::ProjectedGaussian;

/// Side of a tile, pixels. A row of a tile is one vector of 16 lanes.
pub const TILE: usize = 16;
/// Slack of the tile test, pixels: above rounding error, far below a pixel.
const SLACK: f32 = 1e-3;

/// Number of tiles of a picture along each axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Grid {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
}

impl Grid {
    pub(crate) fn new([width, height]: [usize; 2]) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }

    pub(crate) fn len(self) -> usize {
        self.columns * self.rows
    }
}

/// Visits the index of every tile with a pixel centre inside the ellipse `q < q_max` (give or take [`SLACK`]), row by row, each once.
pub(crate) fn touched(f: &ProjectedGaussian, grid: Grid, mut visit: impl FnMut(u32)) {
    let [a, b, c] = f.conic;
    let [hx, hy] = f.half;
    let tile = TILE as f32;
    let span = |low: f32, high: f32, n: usize| {
        // Saturating casts round down and stop at the border.
        let (first, last) = ((low / tile) as usize, (high / tile) as usize);
        first..if high < 0.0 { 0 } else { last.saturating_add(1).min(n) }
    };
    let rows = span(f.uv[1] - hy - SLACK, f.uv[1] + hy + SLACK, grid.rows);
    let columns = span(f.uv[0] - hx - SLACK, f.uv[0] + hx + SLACK, grid.columns);
    if rows.len() < 2 || columns.len() < 2 {
        // It reaches all sides of its box.
        for row in rows {
            columns.clone().for_each(|column| visit((row * grid.columns + column) as u32));
        }
        return;
    }
    // The ellipse is widest at dy = -b hx / c (dx = hx) and at the mirror image.
    let widest = -b * hx / c;
    // 1 / det of the covariance.
    let det = a * c - b * b;
    // Both ends of the chord at height dy.
    let chord = |dy: f32| {
        let half = m32::sqrt((a * f.q_max - det * dy * dy).max(0.0));
        [(-b * dy - half) / a, (-b * dy + half) / a]
    };
    for row in rows {
        let low = (row as f32 * tile + 0.5 - f.uv[1]).max(-hy);
        let high = ((row as f32 + 1.0) * tile - 0.5 - f.uv[1]).min(hy);
        let ([l0, r0], [l1, r1]) = (chord(low), chord(high));
        let within = |dy: f32| low <= dy && dy <= high;
        let right = if within(widest) { hx } else { r0.max(r1) };
        let left = if within(-widest) { -hx } else { l0.min(l1) };
        for column in span(f.uv[0] + left - SLACK, f.uv[0] + right + SLACK, grid.columns) {
            visit((row * grid.columns + column) as u32);
        }
    }
}

/// The depth-sorted lists of all tiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lists {
    /// `[tiles + 1]` start of each tile's list in `entries`.
    pub(crate) starts: Vec<u32>,
    /// Indices of Gaussians, tile by tile, front to back.
    pub(crate) entries: Vec<u32>,
    /// `[gaussians + 1]` start of each Gaussian's pairs in `places`.
    pub(crate) firsts: Vec<u32>,
    /// Position in `entries` of each pair, Gaussian by Gaussian.
    pub(crate) places: Vec<u32>,
    cursors: Vec<u32>,
    chunks: Vec<Chunk>,
}

/// Gaussians per task.
const CHUNK: usize = 1024;

/// Tiles of the Gaussians of one chunk.
#[derive(Clone, Debug, Default)]
struct Chunk {
    tiles: Vec<u32>,
    /// Start of each Gaussian's tiles in `tiles`.
    firsts: Vec<u32>,
}

impl Lists {
    /// First half: find the tiles of each Gaussian.
    pub(crate) fn find(&mut self, gaussians: &[ProjectedGaussian], grid: Grid) {
        self.chunks.resize_with(gaussians.len().div_ceil(CHUNK), Chunk::default);
        for_each(&mut self.chunks, |k, chunk| {
            chunk.tiles.clear();
            chunk.firsts.clear();
            for f in &gaussians[k * CHUNK..((k + 1) * CHUNK).min(gaussians.len())] {
                chunk.firsts.push(chunk.tiles.len() as u32);
                touched(f, grid, |tile| chunk.tiles.push(tile));
            }
        });
    }

    /// Second half, for the same Gaussians: fill the lists in the given order of depths. Returns `false` if there are more pairs than
    /// `u32` can count.
    pub(crate) fn fill(&mut self, grid: Grid, order: impl Iterator<Item = u32>) -> bool {
        if u32::try_from(self.chunks.iter().map(|chunk| chunk.tiles.len()).sum::<usize>()).is_err() {
            return false;
        }
        self.firsts.clear();
        // Holds tile indices first; the loop below replaces them by positions.
        self.places.clear();
        for chunk in &self.chunks {
            let before = self.places.len() as u32;
            self.firsts.extend(chunk.firsts.iter().map(|first| before + first));
            self.places.extend_from_slice(&chunk.tiles);
        }
        self.firsts.push(self.places.len() as u32);
        self.starts.clear();
        self.starts.resize(grid.len() + 1, 0);
        for &tile in &self.places {
            self.starts[tile as usize + 1] += 1;
        }
        for tile in 0..grid.len() {
            self.starts[tile + 1] += self.starts[tile];
        }
        self.cursors.clear();
        self.cursors.extend_from_slice(&self.starts[..grid.len()]);
        self.entries.clear();
        self.entries.resize(self.places.len(), 0);
        for g in order {
            let [from, to] = [self.firsts[g as usize], self.firsts[g as usize + 1]];
            for place in &mut self.places[from as usize..to as usize] {
                let cursor = &mut self.cursors[*place as usize];
                self.entries[*cursor as usize] = g;
                *place = *cursor;
                *cursor += 1;
            }
        }
        true
    }
}
