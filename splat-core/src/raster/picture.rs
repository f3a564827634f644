//! All tiles of a picture, forwards and backwards.

use alloc::vec::Vec;

use float_core::Simd;

use super::backward::Backward;
use super::forward::Forward;
use super::middle::{HALF, Middle};
use super::{PIXELS, Record, Tile};
use crate::chunks::{both, for_each};
use crate::order::Sorter;
use crate::project::Footprint;
use crate::tiles::{Grid, Lists, TILE};
use crate::{Rules, SplatError};

/// Ellipses that one task gathers the records of.
const GATHER: usize = 1024;

/// Draws ellipses with `K` features each (colour, depth, masks, whatever composites), and takes gradients back.
///
/// Holds what the backward pass needs of the last picture drawn: `4 (K + 1)` bytes a pixel, `8 + 4 (6 + K)` a pair of ellipse
/// and tile.
#[derive(Clone, Debug, Default)]
pub struct Raster<const K: usize> {
    size: [usize; 2],
    sorter: Sorter,
    lists: Lists,
    /// `[tiles][K + 1][PIXELS]`
    tiles: Vec<f32>,
    looked: Vec<u32>,
    records: Vec<Record<K>>,
}

/// Work of the last picture drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// Pairs of ellipse and tile.
    pub pairs: u64,
    /// Of them, those that lay behind tiles that were finished.
    pub hidden: u64,
    /// Tiles with nothing over them.
    pub empty_tiles: u64,
    /// All tiles.
    pub tiles: u64,
}

struct Job<'a, const K: usize> {
    out: &'a mut [f32],
    looked: &'a mut u32,
    records: &'a mut [Record<K>],
}

impl<const K: usize> Raster<K> {
    /// Draw ellipses of a picture of `size` (columns, rows); `features` has a row for each.
    ///
    /// # Errors
    /// [`SplatError`] where the numbers of ellipses and features differ, rules are out of range, or there is too much to count.
    ///
    /// # Panics
    /// If there is no memory for the picture's tiles. May do so where their number does not fit `u32`.
    pub fn draw(
        &mut self,
        simd: Simd,
        (footprints, features): (&[Footprint], &[[f32; K]]),
        size: [usize; 2],
        rules: &Rules,
    ) -> Result<Drawn, SplatError> {
        rules.check()?;
        if footprints.len() != features.len() {
            return Err(SplatError::Shape { what: "features", want: footprints.len(), got: features.len() });
        }
        let grid = Grid::new(size);
        self.size = size;
        let (sorter, lists) = (&mut self.sorter, &mut self.lists);
        let (order, ()) = both(|| sorter.sort(footprints.iter().map(|f| f.z)), || lists.find(footprints, grid));
        if !self.lists.fill(grid, order) {
            return Err(SplatError::TooMany { what: "pairs of Gaussians and tiles", got: self.lists.places.len() });
        }
        self.tiles.resize(grid.len() * (K + 1) * PIXELS, 0.0);
        self.looked.resize(grid.len(), 0);
        let lists = &self.lists;
        let mut jobs: Vec<Job<'_, K>> = self
            .tiles
            .chunks_exact_mut((K + 1) * PIXELS)
            .zip(&mut self.looked)
            .map(|(out, looked)| Job { out, looked, records: &mut [] })
            .collect();
        for_each(&mut jobs, |k, job| {
            let tile = tile(lists, (footprints, features), grid, size, rules, k);
            *job.looked = simd.run(Forward { tile, out: job.out });
        });
        let pairs = self.lists.entries.len() as u64;
        let looked: u64 = self.looked.iter().map(|&n| u64::from(n)).sum();
        let empty = self.lists.starts.windows(2).filter(|w| w[0] == w[1]).count() as u64;
        Ok(Drawn { pairs, hidden: pairs - looked, empty_tiles: empty, tiles: grid.len() as u64 })
    }

    /// The last picture: `out` `[K + 1][rows][columns]`, features and what is left of the light.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn planes(&self, out: &mut [f32]) -> Result<(), SplatError> {
        let [width, height] = self.size;
        self.check_planes("out", out.len())?;
        let grid = Grid::new(self.size);
        let tile_rows = out.chunks_mut((width * height).max(1)).enumerate().flat_map(|(plane, rows)| {
            rows.chunks_mut(width * TILE).enumerate().map(move |(row, out)| (plane, row, out))
        });
        let mut jobs: Vec<(usize, usize, &mut [f32])> = tile_rows.collect();
        for_each(&mut jobs, |_, (plane, tile_row, out)| {
            let tiles = self.tiles.chunks_exact((K + 1) * PIXELS).skip(*tile_row * grid.columns).take(grid.columns);
            for (column, tile) in tiles.enumerate() {
                paste(&tile[*plane * PIXELS..][..PIXELS], column, width, out);
            }
        });
        Ok(())
    }

    /// Depth `z` of the ellipse at which a pixel's light falls to a half, of the last picture drawn, of the same ellipses: `out`
    /// `[rows][columns]`, infinite where it never does.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn middles(
        &self,
        simd: Simd,
        (footprints, features): (&[Footprint], &[[f32; K]]),
        rules: &Rules,
        out: &mut [f32],
    ) -> Result<(), SplatError> {
        let [width, height] = self.size;
        if out.len() != width * height {
            return Err(SplatError::Shape { what: "out", want: width * height, got: out.len() });
        }
        self.check_ellipses(footprints, features)?;
        let (lists, grid, rules) = (&self.lists, Grid::new(self.size), Rules { enough: HALF, ..*rules });
        let mut jobs: Vec<(usize, &mut [f32])> = out.chunks_mut((width * TILE).max(1)).enumerate().collect();
        for_each(&mut jobs, |_, (tile_row, out)| {
            let mut middles = [0.0; PIXELS];
            for column in 0..grid.columns {
                let k = *tile_row * grid.columns + column;
                simd.run(Middle {
                    tile: tile(lists, (footprints, features), grid, self.size, &rules, k),
                    out: &mut middles,
                });
                paste(&middles, column, width, out);
            }
        });
        Ok(())
    }

    /// Gradients of the last picture drawn, of the same ellipses: `bars` has one record for each, written.
    ///
    /// `value_bar` `[K + 1][rows][columns]` as [`planes`](Self::planes).
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn backward(
        &mut self,
        simd: Simd,
        (footprints, features): (&[Footprint], &[[f32; K]]),
        rules: &Rules,
        value_bar: &[f32],
        bars: &mut Vec<Record<K>>,
    ) -> Result<(), SplatError> {
        self.check_planes("value_bar", value_bar.len())?;
        self.check_ellipses(footprints, features)?;
        let (size, grid) = (self.size, Grid::new(self.size));
        let lists = &self.lists;
        self.records.resize(lists.entries.len(), Record::default());
        let mut left = &mut self.records[..];
        let mut jobs: Vec<Job<'_, K>> = Vec::with_capacity(grid.len());
        for ((out, looked), range) in
            self.tiles.chunks_exact_mut((K + 1) * PIXELS).zip(&mut self.looked).zip(lists.starts.windows(2))
        {
            let (records, more) = left.split_at_mut((range[1] - range[0]) as usize);
            left = more;
            jobs.push(Job { out, looked, records });
        }
        for_each(&mut jobs, |k, job| {
            if job.records.is_empty() {
                return;
            }
            let (mut few, mut many) = ([const { [0.0; PIXELS] }; FEW_PLANES], Vec::new());
            let bar = if K < FEW_PLANES {
                &mut few.as_flattened_mut()[..(K + 1) * PIXELS]
            } else {
                many.resize((K + 1) * PIXELS, 0.0);
                &mut many[..]
            };
            cut(value_bar, size, grid, k, bar);
            let tile = tile(lists, (footprints, features), grid, size, rules, k);
            simd.run(Backward { tile, out: job.out, value_bar: bar, looked: *job.looked, records: job.records });
        });
        bars.clear();
        bars.resize(footprints.len(), Record::default());
        let records = &self.records;
        let mut parts: Vec<&mut [Record<K>]> = bars.chunks_mut(GATHER).collect();
        for_each(&mut parts, |k, part| {
            for (i, bar) in part.iter_mut().enumerate() {
                let g = k * GATHER + i;
                for &place in &lists.places[lists.firsts[g] as usize..lists.firsts[g + 1] as usize] {
                    bar.add(&records[place as usize]);
                }
            }
        });
        Ok(())
    }

    /// As many ellipses as the last picture had, a row of features each.
    fn check_ellipses(&self, footprints: &[Footprint], features: &[[f32; K]]) -> Result<(), SplatError> {
        let want = self.lists.firsts.len().saturating_sub(1);
        if footprints.len() == want && footprints.len() == features.len() {
            return Ok(());
        }
        Err(SplatError::Shape { what: "footprints", want, got: footprints.len() })
    }

    fn check_planes(&self, what: &'static str, got: usize) -> Result<(), SplatError> {
        let want = (K + 1) * self.size[0] * self.size[1];
        if got == want { Ok(()) } else { Err(SplatError::Shape { what, want, got }) }
    }
}

/// Planes of a tile, features and the light that is left, up to which its gradients lie on the stack; more are allocated.
const FEW_PLANES: usize = 17;

fn tile<'a, const K: usize>(
    lists: &'a Lists,
    (footprints, features): (&'a [Footprint], &'a [[f32; K]]),
    grid: Grid,
    size: [usize; 2],
    rules: &'a Rules,
    k: usize,
) -> Tile<'a, K> {
    let (x, y) = (k % grid.columns * TILE, k / grid.columns * TILE);
    let entries = &lists.entries[lists.starts[k] as usize..lists.starts[k + 1] as usize];
    Tile { entries, footprints, features, rules, corner: [x as f32, y as f32], rows: TILE.min(size[1] - y) }
}

/// A plane of the tile in a column of tiles, into the rows of the picture that it covers.
fn paste(tile: &[f32], column: usize, width: usize, out: &mut [f32]) {
    let x = column * TILE;
    let n = TILE.min(width - x);
    for (tile, out) in tile.chunks_exact(TILE).zip(out.chunks_exact_mut(width)) {
        out[x..][..n].copy_from_slice(&tile[..n]);
    }
}

/// A tile's part of planes of a picture; 0 outside the picture.
fn cut(planes: &[f32], [width, height]: [usize; 2], grid: Grid, k: usize, out: &mut [f32]) {
    let (x, y) = (k % grid.columns * TILE, k / grid.columns * TILE);
    let n = TILE.min(width - x);
    for (plane, out) in out.chunks_exact_mut(PIXELS).enumerate() {
        for row in 0..TILE.min(height - y) {
            let from = &planes[(plane * height + y + row) * width + x..][..n];
            out[row * TILE..][..n].copy_from_slice(from);
        }
    }
}
