//! Tiles of photos, and what is summed of the pixels that were seen in each.
//!
//! A short training sees a pixel or two of each tile. Then tiles are judged together: in blocks of 2 x 2, or of 4 x 4, that have enough.

use engine::data::Dataset;
use render_core::camera::Camera;

/// Tiles along the longest side of a photo.
const TILES: u32 = 32;
/// Side of a tile at least, pixels.
const SMALLEST: u32 = 4;
/// Tiles along a side of a block at most.
const MOST: u32 = 4;

/// Side of a tile of a photo, pixels.
pub(super) fn side_of_tile(camera: &Camera) -> u32 {
    camera.width.max(camera.height).div_ceil(TILES).max(SMALLEST)
}

/// The tiles of a view.
#[derive(Clone, Copy, Debug)]
pub(super) struct ViewTiles {
    /// Number of its first tile among those of all views.
    first: usize,
    /// Tiles in a row, and rows.
    columns: u32,
    rows: u32,
    /// Side of a tile, pixels.
    pub(super) side: u32,
}

impl ViewTiles {
    fn count(&self) -> usize {
        self.columns as usize * self.rows as usize
    }

    /// Number of a tile among those of its photo.
    fn at(&self, column: u32, row: u32) -> usize {
        (row * self.columns + column) as usize
    }

    /// Column and row of each tile, in their order.
    pub(super) fn places(self) -> impl Iterator<Item = [u32; 2]> {
        (0..self.rows).flat_map(move |y| (0..self.columns).map(move |x| [x, y]))
    }
}

/// `N` sums for each tile of all views; the first counts pixels.
#[derive(Clone, Debug)]
pub(super) struct Tiles<const N: usize> {
    views: Vec<ViewTiles>,
    /// `[tiles][N]`
    pub(super) sums: Vec<f32>,
}

impl<const N: usize> Tiles<N> {
    /// No pixel was seen yet.
    pub(super) fn new(data: &Dataset) -> Self {
        let of_view = |camera: &Camera| {
            let side = side_of_tile(camera);
            [camera.width.div_ceil(side), camera.height.div_ceil(side), side]
        };
        Self::of(data.views().iter().map(|view| of_view(&view.camera)))
    }

    /// Columns, rows and side of the tiles of each view.
    fn of(shapes: impl Iterator<Item = [u32; 3]>) -> Self {
        let mut first = 0;
        let views: Vec<ViewTiles> = shapes
            .map(|[columns, rows, side]| {
                let view = ViewTiles { first, columns, rows, side };
                first += view.count();
                view
            })
            .collect();
        Self { views, sums: vec![0.0; first * N] }
    }

    pub(super) fn views(&self) -> usize {
        self.views.len()
    }

    pub(super) fn view(&self, view: usize) -> ViewTiles {
        self.views[view]
    }

    /// The sums of each tile of a view.
    pub(super) fn of_view(&self, view: usize) -> std::slice::ChunksExact<'_, f32> {
        let tiles = self.views[view];
        self.sums[tiles.first * N..][..tiles.count() * N].chunks_exact(N)
    }

    /// The sums of the tile of a pixel.
    pub(super) fn of_pixel(&mut self, view: usize, pixel: [u32; 2]) -> &mut [f32] {
        let tiles = self.views[view];
        let at = tiles.first + tiles.at(pixel[0] / tiles.side, pixel[1] / tiles.side);
        &mut self.sums[at * N..][..N]
    }

    /// Tiles along a side of the blocks that have `enough` pixels each, on average over all photos.
    pub(super) fn side_of_block(&self, enough: f32) -> u32 {
        let seen: f32 = self.sums.chunks_exact(N).map(|sums| sums[0]).sum();
        let each = seen / (self.sums.len() / N).max(1) as f32;
        let is_enough = |side: &u32| each * (side * side) as f32 >= enough;
        [1, 2].into_iter().find(is_enough).unwrap_or(MOST)
    }

    /// Blocks of `side` x `side` tiles, as tiles of their own.
    pub(super) fn in_blocks(&self, side: u32) -> Self {
        let blocks = |tiles: &ViewTiles| [tiles.columns.div_ceil(side), tiles.rows.div_ceil(side), tiles.side * side];
        let mut all = Self::of(self.views.iter().map(blocks));
        for (view, tiles) in self.views.iter().enumerate() {
            let block = all.views[view];
            for ([x, y], sums) in tiles.places().zip(self.of_view(view)) {
                let at = block.first + block.at(x / side, y / side);
                all.sums[at * N..][..N].iter_mut().zip(sums).for_each(|(sum, more)| *sum += more);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::super::moving_tests::filmed;
    use super::*;

    #[test]
    fn a_block_has_the_pixels_of_its_tiles_also_where_the_last_ones_are_missing() {
        // 24 pixels a side: six tiles of four, or two blocks of sixteen, the second of two columns.
        let mut tiles = Tiles::<2>::new(&filmed(24));
        assert_eq!((tiles.view(0).columns, tiles.view(0).rows, tiles.view(0).side), (6, 6, 4));
        for (k, pixel) in [[0, 0], [15, 3], [16, 3], [23, 23]].into_iter().enumerate() {
            let sums = tiles.of_pixel(1, pixel);
            sums[0] += 1.0;
            sums[1] += 10.0_f32.powi(k as i32);
        }
        let blocks = tiles.in_blocks(4);
        let sums: Vec<&[f32]> = blocks.of_view(1).collect();
        assert_eq!(sums, [[2.0, 11.0], [1.0, 100.0], [0.0, 0.0], [1.0, 1000.0]]);
        assert!(blocks.of_view(0).chain(blocks.of_view(2)).flatten().all(|x| *x == 0.0));
        assert_eq!(blocks.view(1).side, 16);
        assert_eq!(tiles.in_blocks(1).sums, tiles.sums);
    }

    #[test]
    fn blocks_are_as_small_as_have_enough_pixels() {
        let mut tiles = Tiles::<2>::new(&filmed(32));
        assert_eq!(tiles.side_of_block(4.0), 4, "nothing was seen");
        for (each, side) in [(0.9, 4), (1.0, 2), (3.9, 2), (4.0, 1), (50.0, 1)] {
            tiles.sums.chunks_exact_mut(2).for_each(|sums| sums[0] = each);
            assert_eq!(tiles.side_of_block(4.0), side, "{each}");
        }
        assert_eq!(Tiles::<2>::of([].into_iter()).side_of_block(4.0), 4);
    }
}
