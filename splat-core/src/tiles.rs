//! Which tiles of the picture a projected Gaussian touches, and the list of each tile, front to back.
//!
//! Gaussians are sorted by depth once. Appending each in that order to the lists of its tiles leaves every list sorted: pairs of a
//! Gaussian and a tile are never sorted themselves. Bands of tile rows are filled side by side, each going through all Gaussians.

use alloc::vec::Vec;
use core::ops::Range;

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

/// Visits every tile with a pixel centre inside the ellipse `q < q_max` (give or take [`SLACK`]): rows of tiles, each once with its columns.
pub(crate) fn touched(f: &ProjectedGaussian, grid: Grid, mut visit: impl FnMut(usize, Range<usize>)) {
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
        rows.for_each(|row| visit(row, columns.clone()));
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
        visit(row, span(f.uv[0] + left - SLACK, f.uv[0] + right + SLACK, grid.columns));
    }
}

/// Bands of tile rows whose lists are filled side by side.
const BANDS: usize = 8;
/// Gaussians per task.
const CHUNK: usize = 1024;

/// The depth-sorted lists of all tiles, band by band.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lists {
    bands: Vec<Band>,
    chunks: Vec<Chunk>,
    /// Number of Gaussians.
    count: usize,
    /// Tiles of a band; the last may have fewer.
    per_band: usize,
}

/// The lists of some rows of tiles.
#[derive(Clone, Debug, Default)]
struct Band {
    /// Pairs of the bands before.
    before: u32,
    /// `[tiles + 1]` start of each tile's list, counted from the first pair of the band.
    starts: Vec<u32>,
    /// Indices of Gaussians, tile by tile, front to back.
    entries: Vec<u32>,
    /// `[gaussians + 1]` start of each Gaussian's pairs in `places`.
    firsts: Vec<u32>,
    /// Position in `entries` of each pair, Gaussian by Gaussian.
    places: Vec<u32>,
    cursors: Vec<u32>,
}

/// Tiles of the Gaussians of one chunk, in one band.
#[derive(Clone, Debug, Default)]
struct Found {
    /// Counted from the band's first tile.
    tiles: Vec<u32>,
    /// Start of each Gaussian's tiles in `tiles`.
    firsts: Vec<u32>,
}

/// Those in all bands.
#[derive(Clone, Debug, Default)]
struct Chunk {
    bands: [Found; BANDS],
}

impl Lists {
    /// First half: find the tiles of each Gaussian.
    pub(crate) fn find(&mut self, gaussians: &[ProjectedGaussian], grid: Grid) {
        let rows = grid.rows.div_ceil(BANDS).max(1);
        self.per_band = rows * grid.columns;
        self.count = gaussians.len();
        self.bands.resize_with(BANDS, Band::default);
        for (k, band) in self.bands.iter_mut().enumerate() {
            let tiles = grid.len().saturating_sub(k * self.per_band).min(self.per_band);
            band.starts.clear();
            band.starts.resize(tiles + 1, 0);
        }
        self.chunks.resize_with(gaussians.len().div_ceil(CHUNK), Chunk::default);
        for_each(&mut self.chunks, |k, Chunk { bands }| {
            for found in bands.iter_mut() {
                found.tiles.clear();
                found.firsts.clear();
            }
            for f in &gaussians[k * CHUNK..((k + 1) * CHUNK).min(gaussians.len())] {
                for found in bands.iter_mut() {
                    found.firsts.push(found.tiles.len() as u32);
                }
                touched(f, grid, |row, columns| {
                    let first = (row % rows * grid.columns) as u32;
                    bands[row / rows].tiles.extend(columns.map(|column| first + column as u32));
                });
            }
        });
    }

    /// Second half, for the same Gaussians: fill the lists in the given order of depths.
    ///
    /// # Errors
    /// The number of pairs, if `u32` cannot count them.
    pub(crate) fn fill(&mut self, order: impl Iterator<Item = u32> + Clone + Sync) -> Result<(), usize> {
        let chunks = &self.chunks;
        let pairs = |k: usize| chunks.iter().map(|chunk| chunk.bands[k].tiles.len()).sum::<usize>();
        let mut before = 0;
        for (k, band) in self.bands.iter_mut().enumerate() {
            band.before = before as u32;
            before += pairs(k);
        }
        if u32::try_from(before).is_err() {
            return Err(before);
        }
        for_each(&mut self.bands, |k, band| band.fill(chunks.iter().map(|chunk| &chunk.bands[k]), order.clone()));
        Ok(())
    }

    /// Number of Gaussians.
    pub(crate) fn gaussians(&self) -> usize {
        self.count
    }

    /// Number of pairs of a Gaussian and a tile.
    pub(crate) fn pairs(&self) -> usize {
        self.bands.iter().map(|band| band.entries.len()).sum()
    }

    /// Number of pairs of each tile.
    pub(crate) fn lengths(&self) -> impl Iterator<Item = usize> {
        self.bands.iter().flat_map(|band| band.starts.windows(2).map(|ends| (ends[1] - ends[0]) as usize))
    }

    /// The Gaussians of tile `k`, front to back.
    pub(crate) fn of_tile(&self, k: usize) -> &[u32] {
        let (band, k) = (&self.bands[k / self.per_band], k % self.per_band);
        &band.entries[band.starts[k] as usize..band.starts[k + 1] as usize]
    }

    /// Number of each pair of Gaussian `g`, tile by tile; pairs are numbered tile by tile, front to back.
    pub(crate) fn of_gaussian(&self, g: usize) -> impl Iterator<Item = usize> {
        self.bands.iter().flat_map(move |band| {
            let places = &band.places[band.firsts[g] as usize..band.firsts[g + 1] as usize];
            places.iter().map(|place| (band.before + place) as usize)
        })
    }
}

impl Band {
    /// Fill the lists with what was found, in the given order of depths.
    fn fill<'a>(&mut self, found: impl Iterator<Item = &'a Found>, order: impl Iterator<Item = u32>) {
        self.firsts.clear();
        // Holds tiles first; the last loop replaces them by positions.
        self.places.clear();
        for found in found {
            let before = self.places.len() as u32;
            self.firsts.extend(found.firsts.iter().map(|first| before + first));
            self.places.extend_from_slice(&found.tiles);
        }
        self.firsts.push(self.places.len() as u32);
        for &tile in &self.places {
            self.starts[tile as usize + 1] += 1;
        }
        for tile in 1..self.starts.len() {
            self.starts[tile] += self.starts[tile - 1];
        }
        self.cursors.clear();
        self.cursors.extend_from_slice(&self.starts);
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
    }
}
