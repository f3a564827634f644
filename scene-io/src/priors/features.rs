//! Dense features of a photo, as a self-supervised network makes them.

/// A grid of feature vectors over a photo; usually much coarser than it.
#[derive(Clone, Debug, PartialEq)]
pub struct Features {
    /// Length of a vector.
    pub channels: usize,
    /// Columns of the grid.
    pub width: usize,
    /// Rows of the grid.
    pub height: usize,
    /// `[channels][height][width]`, all finite.
    pub data: Vec<f32>,
}

impl Features {
    /// The vector at a place of the photo, `x` and `y` being shares of its width and height; places outside take the
    /// border's. Bilinear between the centres of the grid's cells.
    ///
    /// # Panics
    /// If `out` has not [`Features::channels`] entries, or the grid has no cells.
    pub fn sample(&self, x: f64, y: f64, out: &mut [f32]) {
        assert_eq!(out.len(), self.channels, "a vector of features has {} entries", self.channels);
        let (x0, x1, fx) = between(x, self.width);
        let (y0, y1, fy) = between(y, self.height);
        for (out, plane) in out.iter_mut().zip(self.data.chunks_exact(self.width * self.height)) {
            let at = |x: usize, y: usize| f64::from(plane[y * self.width + x]);
            let above = at(x0, y0) + (at(x1, y0) - at(x0, y0)) * fx;
            let below = at(x0, y1) + (at(x1, y1) - at(x0, y1)) * fx;
            *out = (above + (below - above) * fy) as f32;
        }
    }

    /// The grid at another size, `[channels][height][width]`, sampled at the centres of its cells.
    ///
    /// # Panics
    /// If the grid has no cells, and the new one has some.
    #[must_use]
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let pixels = width * height;
        let mut data = vec![0.0; self.channels * pixels];
        let mut vector = vec![0.0; self.channels];
        for at in 0..pixels {
            let (column, row) = (at % width, at / width);
            let centre = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
            self.sample(centre(column, width), centre(row, height), &mut vector);
            for (c, v) in vector.iter().enumerate() {
                data[c * pixels + at] = *v;
            }
        }
        Self { channels: self.channels, width, height, data }
    }
}

/// The two of `n` cells whose centres lie around a share of the length, and how far from the first.
fn between(share: f64, n: usize) -> (usize, usize, f64) {
    let u = (share * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
    let low = u as usize;
    (low, (low + 1).min(n - 1), u - low as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_features_are_sampled_exactly_between_centres_and_held_outside() {
        // Value 2 * column + 10 * row at the centres of a 4 x 3 grid.
        let data = (0..12).map(|i| (2 * (i % 4) + 10 * (i / 4)) as f32).collect();
        let features = Features { channels: 1, width: 4, height: 3, data };
        let at = |x: f64, y: f64| {
            let mut out = [0.0];
            features.sample(x, y, &mut out);
            out[0]
        };
        assert_eq!(at(0.125, 1.0 / 6.0), 0.0);
        assert!((at(0.25, 0.5) - (1.0 + 10.0)).abs() < 1e-5);
        assert!((at(0.6, 0.4) - (2.0 * (2.4 - 0.5) + 10.0 * (1.2 - 0.5))).abs() < 1e-5);
        assert_eq!((at(-1.0, -1.0), at(2.0, 2.0)), (0.0, 26.0));
        assert_eq!(features.resized(4, 3), features);
    }
}
