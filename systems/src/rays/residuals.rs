//! What a field at rest leaves of its photos: signed errors over tiles of all views, as its training batches show them.
//!
//! A texture that is not learnt yet errs to both sides, and its mean over a tile is next to nothing. What moves is elsewhere in the
//! photo than in the field: its tile is brighter or darker as a whole.

use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_counts, take_numbers, u64_tensor};
use render_core::camera::Camera;

/// Tiles along the longest side of a photo.
const TILES: u32 = 32;
/// Side of a tile at least, pixels.
const SMALLEST: u32 = 4;
/// Pixels of a tile at least, so that its mean says something.
const FEW: f32 = 4.0;
/// Mean error of a tile that moves: of a colour in `[0, 1]`, in units of what half of all tiles exceed, and in units of its
/// standard error. Dark photos differ by little where something moves, and a field that is not sharp yet errs a little everywhere.
const MOVES: f32 = 0.01;
const TIMES_USUAL: f32 = 2.5;
const SIGMAS: f32 = 2.5;
/// Largest error of a colour that is told apart.
const LARGEST: f32 = 2.0;
/// Numbers kept of a tile: pixels, the sum of their weights, that of the squares of weights, three weighted sums of errors, that of
/// squared errors. Weights grow with the square of the step: what was not sharp yet is forgotten.
const NUMBERS: usize = 7;
/// Where they lie in a checkpoint.
const TENSOR: &str = "residuals.tiles";
const LOOKS: &str = "residuals.looks";

/// Signed errors over tiles of all views.
#[derive(Clone, Debug)]
pub(super) struct Residuals {
    /// Of each view: its first tile, tiles in a row, side of a tile in pixels.
    views: Vec<[u32; 3]>,
    /// `[tiles][NUMBERS]`
    tiles: Vec<f32>,
    /// How often it was looked what moves.
    looks: u32,
}

/// What tiles are told by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ToldBy {
    /// What a field at rest cannot explain.
    Residuals,
    /// Masks of all photos.
    Masks,
}

/// A tile of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PhotoTile {
    /// Its middle, pixels.
    pub(super) middle: [u32; 2],
    /// Whether it moves.
    pub(super) moves: bool,
}

/// How far a tile is off.
struct TileError {
    /// Its middle, pixels.
    middle: [u32; 2],
    /// Mean error of the colour that errs most, and its standard error.
    mean: f32,
    noise: f32,
}

/// Side of a tile of a photo, pixels.
pub(super) fn side_of_tile(camera: &Camera) -> u32 {
    camera.width.max(camera.height).div_ceil(TILES).max(SMALLEST)
}

impl Residuals {
    /// Nothing is known yet.
    pub(super) fn new(data: &Dataset) -> Self {
        let (mut views, mut first) = (Vec::with_capacity(data.len()), 0);
        for view in data.views() {
            let [width, height] = [view.camera.width, view.camera.height];
            let side = side_of_tile(&view.camera);
            views.push([first, width.div_ceil(side), side]);
            first += width.div_ceil(side) * height.div_ceil(side);
        }
        Self { views, tiles: vec![0.0; first as usize * NUMBERS], looks: 0 }
    }

    /// How often it was looked what moves.
    pub(super) fn looks(&self) -> u32 {
        self.looks
    }

    /// After one more look.
    pub(super) fn looked(self) -> Self {
        Self { looks: self.looks + 1, ..self }
    }

    /// Learn from the pixels of the batch of a step, each with its signed error.
    pub(super) fn learn(&mut self, step: u64, batch: &Batch, errors: impl Iterator<Item = [f32; 3]>) {
        let w = ((step + 1) as f32).powi(2);
        for (i, error) in errors.enumerate() {
            if batch.weight[i] <= 0.0 || !error.iter().all(|e| e.is_finite()) {
                continue;
            }
            // A field that is lost shows any number; sums stay finite.
            let error = error.map(|e| e.clamp(-LARGEST, LARGEST));
            let [first, columns, side] = self.views[batch.view[i] as usize];
            let [x, y] = batch.pixel[i].map(|at| u32::from(at) / side);
            let numbers = &mut self.tiles[(first + y * columns + x) as usize * NUMBERS..][..NUMBERS];
            numbers[0] += 1.0;
            numbers[1] += w;
            numbers[2] += w * w;
            numbers[3..6].iter_mut().zip(error).for_each(|(sum, e)| *sum += w * e);
            numbers[6] += w * error.iter().map(|e| e * e).sum::<f32>() / 3.0;
        }
    }

    /// The tiles of each view that enough pixels were seen of.
    pub(super) fn tiles(&self) -> Vec<Vec<PhotoTile>> {
        let views: Vec<Vec<TileError>> = (0..self.views.len()).map(|view| self.errors(view)).collect();
        let mut all: Vec<f32> = views.iter().flatten().map(|tile| tile.mean).collect();
        let middle = all.len() / 2;
        let usual = if all.is_empty() { 0.0 } else { *all.select_nth_unstable_by(middle, f32::total_cmp).1 };
        let least = MOVES.max(TIMES_USUAL * usual);
        let moves = |tile: &TileError| tile.mean > least && tile.mean > SIGMAS * tile.noise;
        let tile = |tile: &TileError| PhotoTile { middle: tile.middle, moves: moves(tile) };
        views.iter().map(|tiles| tiles.iter().map(tile).collect()).collect()
    }

    /// The errors of the tiles of a view that enough pixels were seen of. A photo that is brighter as a whole does not move.
    fn errors(&self, view: usize) -> Vec<TileError> {
        let [first, columns, side] = self.views[view];
        let last = self.views.get(view + 1).map_or(self.tiles.len() / NUMBERS, |next| next[0] as usize);
        let all = self.tiles[first as usize * NUMBERS..last * NUMBERS].chunks_exact(NUMBERS);
        let known = || all.clone().enumerate().filter(|(_, numbers)| numbers[0] >= FEW);
        let mut of_photo = [0.0; 3];
        for (c, middle) in of_photo.iter_mut().enumerate() {
            let mut means: Vec<f32> = known().map(|(_, numbers)| numbers[3 + c] / numbers[1]).collect();
            means.sort_by(f32::total_cmp);
            *middle = means.get(means.len() / 2).copied().unwrap_or(0.0);
        }
        known()
            .map(|(k, numbers)| {
                let sum = numbers[1];
                let mean = [0, 1, 2].map(|c| numbers[3 + c] / sum - of_photo[c]);
                let largest = mean.into_iter().map(f32::abs).fold(0.0, f32::max);
                // As many pixels of equal weight: the square of the sum over the sum of squares.
                let noise = (numbers[6] / sum * (numbers[2] / (sum * sum))).sqrt();
                let [x, y] = [k as u32 % columns, k as u32 / columns].map(|at| at * side + side / 2);
                TileError { middle: [x, y], mean: largest, noise }
            })
            .collect()
    }

    /// Everything the next step depends on.
    pub(super) fn state(&self) -> [Tensor<'_>; 2] {
        [f32_tensor(TENSOR, &self.tiles), u64_tensor(LOOKS, vec![u64::from(self.looks)])]
    }

    /// Whether a checkpoint holds some.
    pub(super) fn is_in(state: &TensorMap) -> bool {
        state.contains_key(TENSOR)
    }

    /// What [`Residuals::state`] gave, for the same views.
    ///
    /// # Errors
    /// [`SystemError::State`] for an array that is missing or of another length.
    pub(super) fn restored(self, state: &TensorMap) -> Result<Self, SystemError> {
        // More looks than there are is no more than all.
        let looks = take_counts(state, LOOKS, 1)?[0].min(u64::from(u16::MAX)) as u32;
        Ok(Self { tiles: take_numbers(state, TENSOR, self.tiles.len())?, looks, ..self })
    }
}

#[cfg(test)]
mod tests {
    use super::super::moving_tests::filmed;
    use super::*;
    use field_core::rng::Rng;

    /// Errors of all pixels of all views, some of which lie in the left quarter of the photo.
    fn of(error: impl Fn(usize, [u32; 2], f32) -> f32) -> Residuals {
        let data = filmed(32);
        let mut residuals = Residuals::new(&data);
        for step in 0..40 {
            let mut batch = Batch::default();
            data.draw_among(5, step, 1 << 12, None, &mut batch).unwrap();
            let noise = Rng::new(4, 2).substream(step);
            let errors: Vec<[f32; 3]> = (0..batch.len())
                .map(|i| {
                    let at = batch.pixel[i].map(u32::from);
                    [error(batch.view[i] as usize, at, noise.uniform_at(i as u64) - 0.5); 3]
                })
                .collect();
            residuals.learn(step, &batch, errors.into_iter());
        }
        residuals
    }

    #[test]
    fn a_tile_that_errs_to_one_side_moves_and_neither_noise_nor_a_brighter_photo_does() {
        let residuals = of(|view, [x, _], noise| {
            let brighter = if view == 2 { 0.3 } else { 0.0 };
            let moved = if view == 5 && x < 8 { 0.2 } else { 0.0 };
            0.1 * noise + brighter + moved
        });
        let mut mistaken = 0;
        for (view, tiles) in residuals.tiles().into_iter().enumerate() {
            assert_eq!(tiles.len(), 64, "32 pixels a side, tiles of 4");
            for tile in tiles {
                let moved = view == 5 && tile.middle[0] < 8;
                assert!(tile.moves || !moved, "view {view}: {tile:?}");
                mistaken += usize::from(tile.moves && !moved);
            }
        }
        assert!(mistaken < 26, "{mistaken} of 1264 tiles at rest");
    }

    #[test]
    fn what_was_not_seen_says_nothing_and_a_checkpoint_brings_all_back() {
        let data = filmed(32);
        let fresh = Residuals::new(&data);
        assert!(fresh.tiles()[0].is_empty());
        let residuals = of(|_, _, noise| noise);
        let residuals = residuals.looked();
        let tensors = residuals.state().map(Tensor::into_owned);
        let state: TensorMap = tensors.into_iter().map(|tensor| (tensor.name.clone(), tensor)).collect();
        let again = fresh.clone().restored(&state).unwrap();
        assert_eq!((again.tiles(), again.looks()), (residuals.tiles(), 1));
        assert!(fresh.restored(&TensorMap::new()).is_err());
    }
}
