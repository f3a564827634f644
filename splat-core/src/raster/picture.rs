//! All tiles of a picture, forward and backward.

use alloc::vec::Vec;

use float_core::Simd;

use super::backward::Backward;
use super::blocks::{cut, paste};
use super::forward::Forward;
use super::median::{HALF, MedianDepth};
use super::{PIXELS, ProjectedGradient, Tile};
use crate::chunks::{both, for_each};
use crate::order::Sorter;
use crate::project::ProjectedGaussian;
use crate::tiles::{Grid, Lists, TILE};
use crate::{RasterSettings, SplatError};

/// Gaussians per task when gradients are gathered.
const GATHER: usize = 1024;

/// Composites projected Gaussians with `K` features each (colour, depth, masks, ...) front to back, for any `K`.
///
/// Holds what the backward pass needs of the last picture: `4 (K + 1)` bytes per pixel and `10 + 4 (6 + K)` per pair of a Gaussian and
/// a tile (8 more for absolute gradients).
///
/// # Source
/// Kerbl et al., "3D Gaussian splatting", 2023, section 6 and appendix C.
#[derive(Clone, Debug, Default)]
pub struct Raster<const K: usize> {
    size: [usize; 2],
    sorter: Sorter,
    lists: Lists,
    /// `[tiles][K + 1][PIXELS]`
    tiles: Vec<f32>,
    visited: Vec<u32>,
    /// `[pairs]` one bit for each block of the tile to which the Gaussian contributed.
    blocks: Vec<u16>,
    /// `[pairs]` gradients summed over one tile, in the order of the tiles' lists.
    pair_gradients: Vec<ProjectedGradient<K>>,
    /// `[pairs]` absolute view-space gradients, likewise; only written where they are asked for.
    pair_absolute: Vec<[f32; 2]>,
}

/// How much work a picture was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawStats {
    /// Pairs of a Gaussian and a tile.
    pub pairs: u64,
    /// Pairs that were skipped because all pixels of the tile had ended in front of them.
    pub hidden: u64,
    /// Tiles that no Gaussian touches.
    pub empty_tiles: u64,
    /// Number of tiles.
    pub tiles: u64,
}

/// Gaussians with their features and the settings: the inputs of every pass.
#[derive(Clone, Copy)]
struct Inputs<'a, const K: usize> {
    gaussians: &'a [ProjectedGaussian],
    features: &'a [[f32; K]],
    settings: &'a RasterSettings,
}

struct Job<'a, const K: usize> {
    out: &'a mut [f32],
    visited: &'a mut u32,
    blocks: &'a mut [u16],
    gradients: &'a mut [ProjectedGradient<K>],
    uv_absolute: &'a mut [[f32; 2]],
}

impl<const K: usize> Raster<K> {
    /// Draw `gaussians` on a picture of `size` (columns, rows). `features` has one row per Gaussian.
    ///
    /// # Errors
    /// [`SplatError`] if there are not as many features as Gaussians, a setting is out of range, or there are more pairs of a Gaussian
    /// and a tile than `u32` can count.
    ///
    /// # Panics
    /// If there is no memory for the picture's tiles. May panic if the number of tiles does not fit `u32`.
    pub fn draw(
        &mut self,
        simd: Simd,
        gaussians: &[ProjectedGaussian],
        features: &[[f32; K]],
        size: [usize; 2],
        settings: &RasterSettings,
    ) -> Result<DrawStats, SplatError> {
        settings.check()?;
        if gaussians.len() != features.len() {
            return Err(SplatError::Shape { what: "features", want: gaussians.len(), got: features.len() });
        }
        let grid = Grid::new(size);
        self.size = size;
        let (sorter, lists) = (&mut self.sorter, &mut self.lists);
        let (order, ()) = both(|| sorter.sort(gaussians.iter().map(|f| f.z)), || lists.find(gaussians, grid));
        let too_many = |got| SplatError::TooMany { what: "pairs of Gaussians and tiles", got };
        self.lists.fill(order).map_err(too_many)?;
        self.tiles.resize(grid.len() * (K + 1) * PIXELS, 0.0);
        self.visited.resize(grid.len(), 0);
        let (lists, inputs) = (&self.lists, Inputs { gaussians, features, settings });
        self.blocks.resize(lists.pairs(), 0);
        let mut jobs = jobs::<K>(&mut self.tiles, &mut self.visited, &mut self.blocks, lists);
        for_each(&mut jobs, |k, job| {
            let tile = inputs.tile(lists, size, k);
            *job.visited = simd.run(Forward { tile, out: job.out, blocks: job.blocks });
        });
        let pairs = self.lists.pairs() as u64;
        let visited: u64 = self.visited.iter().map(|&n| u64::from(n)).sum();
        let empty = self.lists.lengths().filter(|pairs| *pairs == 0).count() as u64;
        Ok(DrawStats { pairs, hidden: pairs - visited, empty_tiles: empty, tiles: grid.len() as u64 })
    }

    /// The last picture, written to `out` `[K + 1][rows][columns]`: features, then transmittance.
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
                paste(&tile[*plane * PIXELS..][..PIXELS], column * TILE, width, out);
            }
        });
        Ok(())
    }

    /// Median depth of the last picture, written to `out` `[rows][columns]`: the depth `z` of the Gaussian at which a pixel's transmittance
    /// falls to 1/2, infinite where it never does. `gaussians`, `features` and `settings` must be those of the last
    /// [`draw`](Self::draw); only their number is compared.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn median_depth(
        &self,
        simd: Simd,
        gaussians: &[ProjectedGaussian],
        features: &[[f32; K]],
        settings: &RasterSettings,
        out: &mut [f32],
    ) -> Result<(), SplatError> {
        let [width, height] = self.size;
        if out.len() != width * height {
            return Err(SplatError::Shape { what: "out", want: width * height, got: out.len() });
        }
        self.check_gaussians(gaussians, features)?;
        let (lists, grid) = (&self.lists, Grid::new(self.size));
        let settings = RasterSettings { transmittance_stop: HALF, ..*settings };
        let inputs = Inputs { gaussians, features, settings: &settings };
        let mut jobs: Vec<(usize, &mut [f32])> = out.chunks_mut((width * TILE).max(1)).enumerate().collect();
        for_each(&mut jobs, |_, (tile_row, out)| {
            let mut median_depth = [0.0; PIXELS];
            for column in 0..grid.columns {
                let k = *tile_row * grid.columns + column;
                simd.run(MedianDepth { tile: inputs.tile(lists, self.size, k), out: &mut median_depth });
                paste(&median_depth, column * TILE, width, out);
            }
        });
        Ok(())
    }

    /// Gradients of the last picture, written to `gradients`: one for each Gaussian.
    ///
    /// `planes_bar` `[K + 1][rows][columns]` is the gradient with respect to [`planes`](Self::planes). `gaussians`, `features` and
    /// `settings` must be those of the last [`draw`](Self::draw); only their number is compared.
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    pub fn backward(
        &mut self,
        simd: Simd,
        gaussians: &[ProjectedGaussian],
        features: &[[f32; K]],
        settings: &RasterSettings,
        planes_bar: &[f32],
        gradients: &mut Vec<ProjectedGradient<K>>,
    ) -> Result<(), SplatError> {
        let inputs = Inputs { gaussians, features, settings };
        self.run_backward::<false>(simd, inputs, planes_bar, gradients, &mut Vec::new())
    }

    /// [`backward`](Self::backward), and absolute view-space gradients, written to `uv_absolute`: for each Gaussian the sum over pixels of
    /// the absolute value of a pixel's gradient with respect to the centre, for each axis. `gradients` receives the same bits.
    ///
    /// Unlike in [`ProjectedGradient::uv`], opposite gradients of different pixels do not cancel: a better criterion for splitting large
    /// Gaussians ([`ViewSpaceGradients`](crate::density::ViewSpaceGradients)).
    ///
    /// # Errors
    /// [`SplatError::Shape`].
    ///
    /// # Source
    /// Ye et al., "AbsGS: recovering fine details for 3D Gaussian splatting", 2024.
    #[expect(clippy::too_many_arguments, reason = "the forward pass's inputs and their gradients")]
    pub fn backward_absolute(
        &mut self,
        simd: Simd,
        gaussians: &[ProjectedGaussian],
        features: &[[f32; K]],
        settings: &RasterSettings,
        planes_bar: &[f32],
        gradients: &mut Vec<ProjectedGradient<K>>,
        uv_absolute: &mut Vec<[f32; 2]>,
    ) -> Result<(), SplatError> {
        let inputs = Inputs { gaussians, features, settings };
        self.run_backward::<true>(simd, inputs, planes_bar, gradients, uv_absolute)
    }

    fn run_backward<const ABSOLUTE: bool>(
        &mut self,
        simd: Simd,
        inputs: Inputs<'_, K>,
        planes_bar: &[f32],
        gradients: &mut Vec<ProjectedGradient<K>>,
        uv_absolute: &mut Vec<[f32; 2]>,
    ) -> Result<(), SplatError> {
        let Inputs { gaussians, features, .. } = inputs;
        self.check_planes("planes_bar", planes_bar.len())?;
        self.check_gaussians(gaussians, features)?;
        let (size, grid) = (self.size, Grid::new(self.size));
        let lists = &self.lists;
        self.pair_gradients.resize(lists.pairs(), ProjectedGradient::default());
        let mut left = &mut self.pair_gradients[..];
        if ABSOLUTE {
            self.pair_absolute.resize(lists.pairs(), [0.0; 2]);
        }
        let mut absolute_left = &mut self.pair_absolute[..];
        let mut jobs = jobs::<K>(&mut self.tiles, &mut self.visited, &mut self.blocks, lists);
        for job in &mut jobs {
            let pairs = job.blocks.len();
            (job.gradients, left) = left.split_at_mut(pairs);
            (job.uv_absolute, absolute_left) = absolute_left.split_at_mut(if ABSOLUTE { pairs } else { 0 });
        }
        for_each(&mut jobs, |k, job| {
            if job.gradients.is_empty() {
                return;
            }
            let (mut few, mut many) = ([const { [0.0; PIXELS] }; FEW_PLANES], Vec::new());
            let bar = if K < FEW_PLANES {
                &mut few.as_flattened_mut()[..(K + 1) * PIXELS]
            } else {
                many.resize((K + 1) * PIXELS, 0.0);
                &mut many[..]
            };
            let corner = [k % grid.columns * TILE, k / grid.columns * TILE];
            for (plane, bar) in planes_bar.chunks_exact(size[0] * size[1]).zip(bar.chunks_exact_mut(PIXELS)) {
                cut(plane, corner, size[0], bar);
            }
            let tile = inputs.tile(lists, size, k);
            simd.run(Backward::<K, ABSOLUTE> {
                tile,
                out: job.out,
                value_bar: bar,
                blocks: &job.blocks[..*job.visited as usize],
                gradients: job.gradients,
                uv_absolute: job.uv_absolute,
            });
        });
        gradients.resize(gaussians.len(), ProjectedGradient::default());
        let pair_gradients = &self.pair_gradients;
        let mut parts: Vec<&mut [ProjectedGradient<K>]> = gradients.chunks_mut(GATHER).collect();
        for_each(&mut parts, |k, part| {
            for (i, sum) in part.iter_mut().enumerate() {
                *sum = ProjectedGradient::default();
                lists.of_gaussian(k * GATHER + i).for_each(|pair| sum.add(&pair_gradients[pair]));
            }
        });
        if ABSOLUTE {
            uv_absolute.resize(gaussians.len(), [0.0; 2]);
            let pair_absolute = &self.pair_absolute;
            let mut parts: Vec<&mut [[f32; 2]]> = uv_absolute.chunks_mut(GATHER).collect();
            for_each(&mut parts, |k, part| {
                for (i, sum) in part.iter_mut().enumerate() {
                    *sum = [0.0; 2];
                    for [u, v] in lists.of_gaussian(k * GATHER + i).map(|pair| pair_absolute[pair]) {
                        *sum = [sum[0] + u, sum[1] + v];
                    }
                }
            });
        }
        Ok(())
    }

    /// Whether there are as many Gaussians as the last picture had, each with its features.
    fn check_gaussians(&self, gaussians: &[ProjectedGaussian], features: &[[f32; K]]) -> Result<(), SplatError> {
        let want = self.lists.gaussians();
        if gaussians.len() == want && gaussians.len() == features.len() {
            return Ok(());
        }
        Err(SplatError::Shape { what: "gaussians", want, got: gaussians.len() })
    }

    fn check_planes(&self, what: &'static str, got: usize) -> Result<(), SplatError> {
        let want = (K + 1) * self.size[0] * self.size[1];
        if got == want { Ok(()) } else { Err(SplatError::Shape { what, want, got }) }
    }
}

/// A job for each tile, without gradients.
fn jobs<'a, const K: usize>(
    tiles: &'a mut [f32],
    visited: &'a mut [u32],
    blocks: &'a mut [u16],
    lists: &Lists,
) -> Vec<Job<'a, K>> {
    let mut left = blocks;
    let tiles = tiles.chunks_exact_mut((K + 1) * PIXELS).zip(visited).zip(lists.lengths());
    let job = |((out, visited), pairs): ((&'a mut [f32], &'a mut u32), usize)| {
        let blocks = left.split_off_mut(..pairs).unwrap_or_default();
        Job { out, visited, blocks, gradients: &mut [], uv_absolute: &mut [] }
    };
    tiles.map(job).collect()
}

/// Up to this many planes (features and transmittance), the gradient of a tile's pixels lies on the stack; for more it is allocated.
const FEW_PLANES: usize = 17;

impl<'a, const K: usize> Inputs<'a, K> {
    /// Tile `k` of a picture of `size`.
    fn tile(&self, lists: &'a Lists, size: [usize; 2], k: usize) -> Tile<'a, K> {
        let columns = Grid::new(size).columns;
        let (x, y) = (k % columns * TILE, k / columns * TILE);
        Tile {
            entries: lists.of_tile(k),
            gaussians: self.gaussians,
            features: self.features,
            settings: self.settings,
            corner: [x as f32, y as f32],
            size: [TILE.min(size[0] - x), TILE.min(size[1] - y)],
        }
    }
}
