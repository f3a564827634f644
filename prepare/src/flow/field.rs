//! A vector for each pixel.

use super::plane::{cell, nearest};
use rayon::prelude::*;

/// Flow vectors of all pixels, row by row from the top: pixels of the level of the pyramid that it belongs to, x to the right, y down.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    width: usize,
    height: usize,
    vectors: Vec<[f32; 2]>,
}

impl Field {
    pub(super) fn from_fn(width: usize, height: usize, vector: impl Fn(usize, usize) -> [f32; 2] + Sync) -> Self {
        let mut vectors = vec![[0.0; 2]; width * height];
        vectors.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = vector(x, y));
        });
        Self { width, height, vectors }
    }

    pub(super) fn zero(width: usize, height: usize) -> Self {
        Self { width, height, vectors: vec![[0.0; 2]; width * height] }
    }

    pub(super) fn width(&self) -> usize {
        self.width
    }

    pub(super) fn height(&self) -> usize {
        self.height
    }

    pub(super) fn vectors(&self) -> &[[f32; 2]] {
        &self.vectors
    }

    pub(super) fn at(&self, x: usize, y: usize) -> [f32; 2] {
        self.vectors[y * self.width + x]
    }

    /// Between pixels, in index coordinates, by straight lines: a flow has edges.
    pub(super) fn linear(&self, x: f32, y: f32) -> [f32; 2] {
        let ((x0, tx), (y0, ty)) = (cell(x, self.width), cell(y, self.height));
        let [left, right] = [x0, x0 + 1].map(|x| nearest(x, self.width));
        let [above, below] = [y0, y0 + 1].map(|y| nearest(y, self.height));
        let mix = |a: [f32; 2], b: [f32; 2], t: f32| [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t];
        mix(
            mix(self.at(left, above), self.at(right, above), tx),
            mix(self.at(left, below), self.at(right, below), tx),
            ty,
        )
    }

    /// The same for pictures of twice the size, which is `width x height`.
    pub(super) fn doubled(&self, width: usize, height: usize) -> Self {
        // Two pixels for each one here: the centre of pixel i lies at (i + 1/2) / 2 - 1/2.
        let place = |i: usize| 0.5 * i as f32 - 0.25;
        Self::from_fn(width, height, |x, y| self.linear(place(x), place(y)).map(|length| 2.0 * length))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubled_fields_keep_straight_lines() {
        let half = Field::from_fn(8, 6, |x, y| [x as f32, 1.0 - y as f32]);
        let full = half.doubled(16, 12);
        for (x, y) in [(4, 4), (5, 7), (9, 8)] {
            let [u, v] = full.at(x, y);
            let (at_x, at_y) = (0.5 * x as f32 - 0.25, 0.5 * y as f32 - 0.25);
            assert!((u - 2.0 * at_x).abs() < 1e-5 && (v - 2.0 * (1.0 - at_y)).abs() < 1e-5, "({x}, {y}): {u}, {v}");
        }
    }
}
