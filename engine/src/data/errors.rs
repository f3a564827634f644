//! Where the pictures are wrong still: pixels there are drawn more often (Müller, "Instant Neural Graphics Primitives", 2022, the
//! released code's error map).
//!
//! What stands still is seen in every photo; what moves is seen as it is at one time step by one photo alone, so its pixels have to
//! come more often to be learnt as fast.

use super::batch::Drawn;
use super::{Batch, Dataset, DrawnFrom};
use crate::error::SystemError;
use crate::tensors::{Tensor, TensorMap, f32_tensor, take_numbers, take_u64, u64_tensor};
use field_core::rng::Rng;
use scene_io::SceneError;

/// Stream of random numbers.
const DRAWN: u64 = 0x6572_726f;
/// Side of a tile, pixels.
const TILE: u32 = 8;
/// Part of the batch that goes where errors are; the rest goes anywhere.
const SHARE: f64 = 0.5;
/// Error of a tile before it was measured: it is taken for wrong.
const FIRST: f32 = 0.05;
/// Weight of a new error in a tile's running mean.
const NEWS: f32 = 0.1;
/// Steps between one sum over all tiles and the next.
const RENEWED: u64 = 16;

/// Running means of squared errors over tiles of all views.
#[derive(Clone, Debug)]
pub struct ErrorMap {
    /// Tiles of the views before each, and all of them.
    first: Vec<usize>,
    columns: Vec<u32>,
    error: Vec<f32>,
    /// Sums of errors up to each tile.
    ends: Vec<f64>,
}

impl ErrorMap {
    /// Nothing is known yet.
    #[must_use]
    pub fn new(data: &Dataset) -> Self {
        let sizes = data.views().iter().map(|v| [v.camera.width, v.camera.height].map(|side| side.div_ceil(TILE)));
        let (mut first, mut columns) = (vec![0], Vec::new());
        for [width, height] in sizes {
            columns.push(width);
            first.push(first[first.len() - 1] + (width * height) as usize);
        }
        let error = vec![FIRST; first[first.len() - 1]];
        let mut map = Self { first, columns, ends: Vec::new(), error };
        map.renew();
        map
    }

    fn renew(&mut self) {
        let mut sum = 0.0;
        self.ends.clear();
        self.ends.extend(self.error.iter().map(|&e| {
            sum += f64::from(e);
            sum
        }));
    }

    /// Learn from the pixels of a batch, whose squared errors are `errors`, those that count.
    ///
    /// # Panics
    /// If there are more errors than pixels, or `batch` is of other views than those it was made for.
    pub fn learn(&mut self, step: u64, batch: &Batch, errors: impl Iterator<Item = f32>) {
        for (i, error) in errors.enumerate().filter(|(i, e)| batch.weight[*i] > 0.0 && e.is_finite()) {
            let (view, [x, y]) = (batch.view[i] as usize, batch.pixel[i].map(u32::from));
            let tile = self.first[view] + (y / TILE * self.columns[view] + x / TILE) as usize;
            self.error[tile] += NEWS * (error - self.error[tile]);
        }
        if step.is_multiple_of(RENEWED) {
            self.renew();
        }
    }

    /// A tile as likely as its error: view, and first column and row.
    fn draw(&self, u: f64) -> (usize, u32, u32) {
        let total = self.ends.last().copied().unwrap_or(0.0);
        let tile = self.ends.partition_point(|&end| end <= u * total).min(self.error.len().saturating_sub(1));
        let view = self.first.partition_point(|&first| first <= tile) - 1;
        let (at, columns) = ((tile - self.first[view]) as u32, self.columns[view]);
        (view, at % columns * TILE, at / columns * TILE)
    }

    /// Everything later draws depend on: the errors, and the sums as of the last renewal.
    pub fn state(&self) -> Vec<Tensor<'_>> {
        let ends: Vec<u64> = self.ends.iter().map(|end| end.to_bits()).collect();
        vec![f32_tensor("errors.tiles", &self.error), u64_tensor("errors.sums", ends)]
    }

    /// Put back what [`ErrorMap::state`] gave.
    ///
    /// # Errors
    /// [`SystemError`] where an array is missing or of another length.
    pub fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let error = take_numbers(state, "errors.tiles", self.error.len())?;
        let ends = take_u64(state, "errors.sums", self.ends.len())?;
        let ends: Vec<f64> = ends.into_iter().map(f64::from_bits).collect();
        let sums = |ends: &[f64]| ends.iter().all(|end| end.is_finite() && *end >= 0.0) && ends.is_sorted();
        let refused =
            |name: &str, want: &str| Err(SystemError::State { name: name.into(), problem: format!("expected {want}") });
        if error.iter().any(|e| *e < 0.0) {
            return refused("errors.tiles", "errors that are not negative");
        }
        if !sums(&ends) {
            return refused("errors.sums", "sums that never decrease and are not negative");
        }
        (self.error, self.ends) = (error, ends);
        Ok(())
    }
}

impl Dataset {
    /// [`Dataset::draw`], half of it where a map says the errors are. Where the views do not all fit in the image memory, as
    /// without a map.
    ///
    /// # Errors
    /// [`SceneError`] when an image cannot be read.
    ///
    /// # Panics
    /// If `map` was made for other views.
    pub fn draw_by_error(
        &self,
        seed: u64,
        step: u64,
        n: usize,
        map: &ErrorMap,
        batch: &mut Batch,
    ) -> Result<(), SceneError> {
        if self.is_empty() || !self.fits {
            return self.draw(seed, step, n, batch);
        }
        batch.resize(n);
        self.ready(seed, step, batch)?;
        let Some(images) = self.resident.get() else { return self.draw(seed, step, n, batch) };
        let (anywhere, there) = (self.pixels_of(seed, step), Rng::new(seed, DRAWN).substream(step));
        batch.fill(|i, pool| {
            let unit = |bits: u32| f64::from(bits) / 4_294_967_296.0;
            let bits = there.block_at(i);
            if unit(bits[0]) >= SHARE {
                return self.draw_one(&anywhere, i, pool, DrawnFrom::ALL);
            }
            let (v, x, y) = map.draw((unit(bits[1]) + unit(bits[2]) / 4_294_967_296.0).min(1.0 - f64::EPSILON));
            let camera = &self.views[v].camera;
            let within = |first: u32, side: u32, bits: u32| first + bits % TILE.min(side - first);
            let (x, y) = (within(x, camera.width, bits[3] & 0xffff), within(y, camera.height, bits[3] >> 16));
            let drawn: Drawn = self.pixel(v, &images[v], x, y);
            if drawn.weight > 0.0 { drawn } else { self.draw_one(&anywhere, i, pool, DrawnFrom::ALL) }
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(error: &[f32]) -> ErrorMap {
        let mut map = ErrorMap { first: vec![0, 2, 6], columns: vec![2, 2], error: error.to_vec(), ends: Vec::new() };
        map.renew();
        map
    }

    #[test]
    fn tiles_come_as_often_as_they_are_wrong() {
        let map = map(&[0.0, 1.0, 0.0, 0.0, 3.0, 0.0]);
        assert_eq!(map.draw(0.0), (0, TILE, 0));
        assert_eq!(map.draw(0.24), (0, TILE, 0));
        assert_eq!(map.draw(0.26), (1, 0, TILE));
        assert_eq!(map.draw(0.999), (1, 0, TILE));
    }

    #[test]
    fn what_no_map_holds_is_refused_by_the_name_of_its_array() {
        let state = |tiles: [f32; 6], sums: [f64; 6]| -> TensorMap {
            let sums = sums.map(f64::to_bits).to_vec();
            let arrays = [f32_tensor("errors.tiles", &tiles), u64_tensor("errors.sums", sums)];
            arrays.into_iter().map(|array| (array.name.clone(), array.into_owned())).collect()
        };
        let mut own = map(&[0.0; 6]);
        own.load_state(&state([1.0; 6], [1.0; 6])).unwrap();
        let rising = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
        let negative = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0];
        let falling = [1.0, 0.0, 2.0, 3.0, 4.0, 5.0];
        for (name, tiles, sums) in [("errors.tiles", negative, rising), ("errors.sums", [0.0; 6], falling)] {
            let error = own.load_state(&state(tiles, sums)).unwrap_err();
            assert!(matches!(&error, SystemError::State { name: of, .. } if of == name), "{error}");
        }
    }

    #[test]
    fn where_nothing_is_wrong_any_tile_will_do() {
        let map = map(&[0.0; 6]);
        let (view, x, y) = map.draw(0.5);
        assert!(view < 2 && x <= TILE && y <= TILE);
    }
}
