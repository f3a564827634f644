//! What a field at rest leaves of its photos: signed errors over tiles of all views, as its training batches show them.
//!
//! A texture that is not learnt yet errs to both sides, and its mean over a tile is next to nothing. What moves is elsewhere in the
//! photo than in the field: its tile is brighter or darker as a whole. Other exposures, contrasts and tints are errors of a whole photo, so a
//! line through the errors of its tiles is subtracted from them. Noise errs in single tiles, what moves in neighbours or by more.

use super::photo_tiles::{Tiles, ViewTiles};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_counts, take_numbers, u64_tensor};
use losses::irls::Irls;
use losses::kernel::Kernel;
use std::collections::{HashMap, HashSet};

/// Pixels of a tile at least, so that its mean says something. Where tiles have fewer on average blocks of them are judged.
const FEW: f32 = 4.0;
/// Mean error of a tile that moves: of a colour in `[0, 1]`, in units of what half of all tiles exceed, and in units of its
/// standard error. Dark photos differ by little where something moves, and a field that is not sharp yet errs a little everywhere.
const MOVES: f32 = 0.01;
const TIMES_USUAL: f32 = 2.5;
const SIGMAS: f32 = 2.5;
/// Noise alone gives one tile in a hundred an error like that. So a tile moves only where so many of its eight neighbours have one, too, or
/// where its own is so many times as large.
const NEIGHBOURS: usize = 2;
const LARGE: f32 = 2.0;
/// Largest error of a colour that is told apart.
const LARGEST: f32 = 2.0;
/// How the line of a photo is fitted: nearly half of its tiles may move. So many tiles at most, as the time is quadratic.
const LINE: Irls = Irls::new(Kernel::Tukey { c: 0.05 });
const TILES_OF_LINE: usize = 128;
/// Numbers kept of a tile: pixels, the sum of their weights, that of the squares of weights, three weighted sums of errors, that of
/// squared errors, three weighted sums of colours. Weights grow with the square of the step: what was not sharp yet is forgotten.
const NUMBERS: usize = 10;
/// Where they lie in a checkpoint.
const TENSOR: &str = "residuals.tiles";
const LOOKS: &str = "residuals.looks";

/// Signed errors over tiles of all views.
#[derive(Clone, Debug)]
pub(super) struct Residuals {
    tiles: Tiles<NUMBERS>,
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

/// A pixel as the field shows it, and as its photo does.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compared {
    pub(super) shown: [f32; 3],
    pub(super) truth: [f32; 3],
}

/// The error of a tile, or of a block of them.
struct TileError {
    /// Its column and row.
    place: [u32; 2],
    /// Mean error of the colour that errs most, and its standard error.
    mean: f32,
    noise: f32,
}

impl TileError {
    /// Whether it is larger than `times` what noise may be: `least`, of a colour, and [`SIGMAS`].
    fn exceeds(&self, times: f32, least: f32) -> bool {
        self.mean > times * least && self.mean > times * SIGMAS * self.noise
    }
}

impl Residuals {
    /// Nothing is known yet.
    pub(super) fn new(data: &Dataset) -> Self {
        Self { tiles: Tiles::new(data), looks: 0 }
    }

    /// How often it was looked what moves.
    pub(super) fn looks(&self) -> u32 {
        self.looks
    }

    /// After one more look.
    pub(super) fn looked(self) -> Self {
        Self { looks: self.looks + 1, ..self }
    }

    /// Learn from the pixels of the batch of a step.
    pub(super) fn learn(&mut self, step: u64, batch: &Batch, pixels: impl Iterator<Item = Compared>) {
        let w = ((step + 1) as f32).powi(2);
        for (i, Compared { shown, truth }) in pixels.enumerate() {
            let error = [0, 1, 2].map(|c| shown[c] - truth[c]);
            if batch.weight[i] <= 0.0 || !error.iter().all(|e| e.is_finite()) {
                continue;
            }
            // A field that is lost shows any number; sums stay finite.
            let error = error.map(|e| e.clamp(-LARGEST, LARGEST));
            let numbers = self.tiles.of_pixel(batch.view[i] as usize, batch.pixel[i].map(u32::from));
            numbers[0] += 1.0;
            numbers[1] += w;
            numbers[2] += w * w;
            numbers[3..6].iter_mut().zip(error).for_each(|(sum, e)| *sum += w * e);
            numbers[6] += w * error.iter().map(|e| e * e).sum::<f32>() / 3.0;
            numbers[7..10].iter_mut().zip(truth).for_each(|(sum, t)| *sum += w * t);
        }
    }

    /// The tiles of each view that enough pixels were seen of, in them or in their block.
    pub(super) fn tiles(&self) -> Vec<Vec<PhotoTile>> {
        let side = self.tiles.side_of_block(FEW);
        let blocks = self.tiles.in_blocks(side);
        let errors: Vec<Vec<TileError>> = (0..blocks.views()).map(|view| errors(&blocks, view)).collect();
        let usual = middle_of(errors.iter().flatten().map(|tile| tile.mean).collect());
        errors
            .iter()
            .enumerate()
            .map(|(view, errors)| tiles_of(self.tiles.view(view), side, &moving_of(errors, usual)))
            .collect()
    }

    /// Everything the next step depends on.
    pub(super) fn state(&self) -> [Tensor<'_>; 2] {
        [f32_tensor(TENSOR, &self.tiles.sums), u64_tensor(LOOKS, vec![u64::from(self.looks)])]
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
        let mut tiles = self.tiles;
        tiles.sums = take_numbers(state, TENSOR, tiles.sums.len())?;
        Ok(Self { tiles, looks })
    }
}

/// The errors of the tiles of a view that enough pixels were seen of, less those of the whole photo.
fn errors(tiles: &Tiles<NUMBERS>, view: usize) -> Vec<TileError> {
    let known = || tiles.view(view).places().zip(tiles.of_view(view)).filter(|(_, numbers)| numbers[0] >= FEW);
    let at = |numbers: &[f32], c: usize| [numbers[7 + c], numbers[3 + c]].map(|sum| sum / numbers[1]);
    let of_photo = [0, 1, 2].map(|c| line_of(known().map(|(_, numbers)| at(numbers, c)).collect()));
    known()
        .map(|(place, numbers)| {
            let sum = numbers[1];
            let left = |c: usize| {
                let ([intercept, slope], [colour, error]) = (of_photo[c], at(numbers, c));
                (error - (intercept + slope * colour)).abs()
            };
            let largest = (0..3).map(left).fold(0.0, f32::max);
            // As many pixels of equal weight: the square of the sum over the sum of squares.
            let noise = (numbers[6] / sum * (numbers[2] / (sum * sum))).sqrt();
            TileError { place, mean: largest, noise }
        })
        .collect()
}

/// Whether each of these tiles of a view moves, by column and row; half of the tiles of all views have errors below `usual`.
fn moving_of(tiles: &[TileError], usual: f32) -> HashMap<[u32; 2], bool> {
    // A blurred photo has larger errors all over.
    let usual = usual.max(middle_of(tiles.iter().map(|tile| tile.mean).collect()));
    let least = MOVES.max(TIMES_USUAL * usual);
    let large: HashSet<[u32; 2]> =
        tiles.iter().filter(|tile| tile.exceeds(1.0, least)).map(|tile| tile.place).collect();
    let moves = |tile: &TileError| {
        let [x, y] = tile.place;
        let beside = (y.saturating_sub(1)..=y + 1).flat_map(|y| (x.saturating_sub(1)..=x + 1).map(move |x| [x, y]));
        let neighbours = beside.filter(|place| *place != [x, y] && large.contains(place)).count();
        large.contains(&[x, y]) && (neighbours >= NEIGHBOURS || tile.exceeds(LARGE, least))
    };
    tiles.iter().map(|tile| (tile.place, moves(tile))).collect()
}

/// The tiles of a view that something is known of, by what is known of their blocks of `side` x `side`.
fn tiles_of(tiles: ViewTiles, side: u32, blocks: &HashMap<[u32; 2], bool>) -> Vec<PhotoTile> {
    let of_tile = |place: [u32; 2]| {
        let moves = *blocks.get(&place.map(|at| at / side))?;
        Some(PhotoTile { middle: place.map(|at| at * tiles.side + tiles.side / 2), moves })
    };
    tiles.places().filter_map(of_tile).collect()
}

/// The middle one of these; 0 where there are none.
fn middle_of(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f32::total_cmp).1 }
}

/// Intercept and slope of the line through `[colour, error]` of a photo's tiles; no line through fewer than two.
fn line_of(mut tiles: Vec<[f32; 2]>) -> [f32; 2] {
    tiles.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let some = || tiles.iter().step_by(tiles.len().div_ceil(TILES_OF_LINE).max(1));
    let [colours, errors] = [0, 1].map(|k| some().map(|tile| f64::from(tile[k])).collect::<Vec<f64>>());
    LINE.line(&colours, &errors).map_or([0.0; 2], |line| [line.intercept, line.slope].map(|of| of as f32))
}

#[cfg(test)]
mod tests {
    use super::super::moving_tests::filmed;
    use super::*;
    use field_core::rng::Rng;

    /// The colour of a pixel in all photos: brighter to the right, and of a fine texture.
    fn colour([x, y]: [u32; 2]) -> f32 {
        0.1 + 0.02 * x as f32 + 0.03 * (y % 3) as f32
    }

    /// Errors of all pixels of all views.
    fn of(error: impl Fn(usize, [u32; 2], f32) -> f32) -> Residuals {
        let data = filmed(32);
        let mut residuals = Residuals::new(&data);
        for step in 0..40 {
            let mut batch = Batch::default();
            data.draw_among(5, step, 1 << 12, None, &mut batch).unwrap();
            let noise = Rng::new(4, 2).substream(step);
            let compared = (0..batch.len()).map(|i| {
                let at = batch.pixel[i].map(u32::from);
                let error = error(batch.view[i] as usize, at, noise.uniform_at(i as u64) - 0.5);
                Compared { shown: [colour(at) + error; 3], truth: [colour(at); 3] }
            });
            residuals.learn(step, &batch, compared);
        }
        residuals
    }

    #[test]
    fn a_tile_that_errs_to_one_side_moves_and_no_noise_brightness_contrast_or_blur_does() {
        let residuals = of(|view, [x, y], noise| {
            let checks = if (x / 4 + y / 4) % 2 == 0 { 0.04 } else { -0.04 };
            let photo = match view {
                2 => 0.3,
                3 => 0.25 * colour([x, y]),
                4 => checks,
                5 => 0.05 - 0.2 * colour([x, y]),
                _ => 0.0,
            };
            let moved = if view == 5 && x < 8 { 0.2 } else { 0.0 };
            0.1 * noise + photo + moved
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
        assert!(mistaken < 4, "{mistaken} of 1264 tiles at rest");
    }

    #[test]
    fn tiles_of_which_two_pixels_were_seen_are_judged_in_blocks() {
        let data = filmed(32);
        let mut residuals = Residuals::new(&data);
        // Of each tile two pixels; in a photo something errs in a quarter.
        for (view, tile) in (0..data.len()).flat_map(|view| (0..128).map(move |tile| (view, tile))) {
            let at = [tile % 8 * 4 + 1, tile / 8 % 8 * 4 + 2];
            let error = if view == 5 && at[0] < 16 && at[1] < 16 { 0.2 } else { 0.0 };
            let noise = Rng::new(4, view as u64).uniform_at(u64::from(tile)) - 0.5;
            let mut batch = Batch::default();
            batch.view.push(view as u32);
            batch.pixel.push(at.map(|at| at as u16));
            batch.weight.push(1.0);
            let compared = Compared { shown: [colour(at) + error + 0.02 * noise; 3], truth: [colour(at); 3] };
            residuals.learn(0, &batch, [compared].into_iter());
        }
        for (view, tiles) in residuals.tiles().into_iter().enumerate() {
            assert_eq!(tiles.len(), 64, "each has the verdict of its block");
            for tile in tiles {
                assert_eq!(tile.moves, view == 5 && tile.middle.iter().all(|at| *at < 16), "view {view}: {tile:?}");
            }
        }
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
