//! The error of the field at a place in most photos. Texture, gloss and a field that has not learnt enough cause errors in all
//! photos alike, an occluder in one.

use crate::photo_model::PhotoAndRender;

/// Cells along each axis of the field's unit cube.
const CELLS: usize = 32;
/// Least number of squares that show a cell; with fewer the median over all places stands for it.
const LEAST: usize = 24;
/// The expected error is at least this share of the median over all places.
const FLOOR: f32 = 0.5;
/// And at least this, colour units: photos are not more exact.
const NOISE: f32 = 0.04;

/// Errors of all photos of a survey, by the place at which rays end.
#[derive(Default)]
pub(crate) struct ExpectedError {
    /// `(cell, error)`
    errors: Vec<(u32, f32)>,
    /// `[CELLS^3 + 1]`, the expected error of each; the last is of rays that end nowhere.
    cells: Vec<f32>,
}

fn cell_of(place: [f32; 3]) -> usize {
    if place.iter().any(|x| x.is_nan()) {
        return CELLS * CELLS * CELLS;
    }
    let [x, y, z] = place.map(|x| ((x * CELLS as f32) as usize).min(CELLS - 1));
    (z * CELLS + y) * CELLS + x
}

impl ExpectedError {
    /// Add the errors of a photo, `[pixels]`. Transparent pixels are left out: nothing stands there.
    pub(crate) fn add(&mut self, seen: &PhotoAndRender<'_>, errors: &[f32]) {
        let counts = |i: &usize| seen.alpha[*i] > 0.0 && errors[*i].is_finite();
        self.errors.extend((0..errors.len()).filter(counts).map(|i| (cell_of(seen.place[i]) as u32, errors[i])));
    }

    /// After all photos: the error of each cell that the share `quantile` of its squares does not exceed.
    pub(crate) fn settle(&mut self, quantile: f32) {
        let at = |errors: &[f32]| {
            errors.get(((errors.len() as f32 * quantile) as usize).min(errors.len().max(1) - 1)).copied()
        };
        let mut all: Vec<f32> = self.errors.iter().map(|e| e.1).collect();
        all.sort_unstable_by(f32::total_cmp);
        let overall = at(&all).unwrap_or(0.0);
        let floor = (FLOOR * overall).max(NOISE);
        self.cells = vec![overall.max(floor); CELLS * CELLS * CELLS + 1];
        self.errors.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        for cell in self.errors.chunk_by(|a, b| a.0 == b.0).filter(|cell| cell.len() >= LEAST) {
            all.clear();
            all.extend(cell.iter().map(|e| e.1));
            self.cells[cell[0].0 as usize] = at(&all).unwrap_or(0.0).max(floor);
        }
        self.errors.clear();
    }

    /// The expected error at a place, `> 0`.
    pub(crate) fn at(&self, place: [f32; 3]) -> f32 {
        self.cells.get(cell_of(place)).copied().unwrap_or(NOISE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo_model::Pixel;

    #[test]
    fn the_expected_error_is_that_of_most_photos_and_one_occluder_does_not_count() {
        let mut expected = ExpectedError::default();
        let places: Vec<[f32; 3]> = (0..90).map(|i| if i < 45 { [0.1; 3] } else { [0.9; 3] }).collect();
        // Texture errs by 0.3, everything else by 0.05; an occluder before either errs by 0.8.
        for photo in 0..5 {
            let error = |i: usize| {
                if photo == 2 && i % 45 < 9 {
                    0.8
                } else if i < 45 {
                    0.3
                } else {
                    0.05
                }
            };
            let errors: Vec<f32> = (0..90).map(error).collect();
            let pixels = vec![Pixel::default(); 90];
            let (truth, alpha) = (vec![[0.0; 3]; 90], vec![1.0; 90]);
            let (size, view, stride) = ([90, 1], photo, 1);
            let seen =
                PhotoAndRender { view, size, stride, pixels: &pixels, truth: &truth, alpha: &alpha, place: &places };
            expected.add(&seen, &errors);
        }
        expected.settle(0.5);
        assert_eq!(expected.at([0.1; 3]), 0.3);
        assert_eq!(expected.at([0.9; 3]), 0.15, "half of the median over all");
        assert_eq!(expected.at([0.5; 3]), 0.3, "nothing known: as all together");
        assert!(expected.at([f32::NAN; 3]) > 0.0 && expected.at([1.0; 3]) > 0.0);
    }

    #[test]
    fn nothing_seen_expects_no_less_than_noise() {
        let mut expected = ExpectedError::default();
        assert_eq!(expected.at([0.5; 3]), NOISE);
        expected.settle(0.5);
        assert_eq!(expected.at([0.5; 3]), NOISE);
    }
}
