//! A plane of numbers: a grey picture, or a derivative of one.

use rayon::prelude::*;
use scene_io::Image;

/// Grey behind what is not opaque: neither black nor white, which the things themselves often are.
const BEHIND: f32 = 127.5;
/// Shares of red, green and blue in the grey of a display-referred colour (ITU-R BT.601).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// A number for each pixel of a picture, row by row from the top.
///
/// Places between pixels are in **index coordinates**: the centre of pixel `(i, j)` is `(i, j)`, not `(i + 0.5, j + 0.5)` as for cameras. Flow
/// vectors are differences, and the same in both. Beyond its border a plane goes on as its nearest pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl Plane {
    /// The numbers of a function of column and row.
    #[must_use]
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize, usize) -> f32 + Sync) -> Self {
        let mut data = vec![0.0; width * height];
        data.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.iter_mut().enumerate().for_each(|(x, out)| *out = value(x, y));
        });
        Self { width, height, data }
    }

    /// How bright each pixel of a photo is, `0..=255`: a linear function of its 8-bit values, which are display-referred, because the noise
    /// of photos is much the same everywhere in these. What is not opaque lies on grey.
    #[must_use]
    pub fn grey(image: &Image) -> Self {
        let (width, channels) = (image.width as usize, usize::from(image.channels));
        Self::from_fn(width, image.height as usize, |x, y| {
            let at = (y * width + x) * channels;
            let pixel = &image.data[at..at + channels];
            let grey: f32 = LUMA.iter().zip(pixel).map(|(share, level)| share * f32::from(*level)).sum();
            let alpha = pixel.get(3).map_or(1.0, |alpha| f32::from(*alpha) / 255.0);
            grey * alpha + BEHIND * (1.0 - alpha)
        })
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// The number of a pixel.
    ///
    /// # Panics
    /// Outside the plane.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> f32 {
        self.row(row)[column]
    }

    /// A row, from the left.
    pub(super) fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Between pixels, by Catmull and Rom's cubic: what is smooth keeps its derivatives, so that no place within a pixel is
    /// preferred.
    pub(super) fn cubic(&self, x: f32, y: f32) -> f32 {
        let ((x0, tx), (y0, ty)) = (cell(x, self.width), cell(y, self.height));
        let columns = [-1, 0, 1, 2].map(|k| nearest(x0 + k, self.width));
        let across = catmull_rom(tx);
        let mut sum = 0.0;
        for (k, weight) in (-1..).zip(catmull_rom(ty)) {
            let row = self.row(nearest(y0 + k, self.height));
            let line: f32 = columns.iter().zip(across).map(|(column, share)| row[*column] * share).sum();
            sum += weight * line;
        }
        sum
    }

    /// Derivative along x, per pixel: five taps, exact for polynomials up to degree 4.
    pub(super) fn along_x(&self) -> Self {
        Self::from_fn(self.width, self.height, |x, y| {
            let row = self.row(y);
            five_taps(|k| row[nearest(x as isize + k, self.width)])
        })
    }

    /// Derivative along y.
    pub(super) fn along_y(&self) -> Self {
        Self::from_fn(self.width, self.height, |x, y| five_taps(|k| self.row(nearest(y as isize + k, self.height))[x]))
    }
}

fn five_taps(at: impl Fn(isize) -> f32) -> f32 {
    (8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / 12.0
}

/// The pixel at or before a place along an axis of `n` pixels, and how far behind it the place is, in `[0, 1)`. Places far outside
/// count as just outside: there is nothing new.
pub(super) fn cell(place: f32, n: usize) -> (isize, f32) {
    let place = place.clamp(-2.0, n as f32 + 1.0);
    let before = place.floor();
    (before as isize, place - before)
}

/// The pixel of `n` that is nearest to an index; `n > 0`.
pub(super) fn nearest(index: isize, n: usize) -> usize {
    (index.max(0) as usize).min(n - 1)
}

/// Shares of four neighbours, a share `t` of a pixel behind the second.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (2.0 * t2 - t3 - t), 0.5 * (2.0 - 5.0 * t2 + 3.0 * t3), 0.5 * (t + 4.0 * t2 - 3.0 * t3), 0.5 * (t3 - t2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greys_weigh_colours_and_lie_on_grey() {
        let image = Image::rgba(2, 1, vec![255, 255, 255, 255, 0, 0, 0, 0]).unwrap();
        let grey = Plane::grey(&image);
        assert!((grey.at(0, 0) - 255.0).abs() < 1e-3 && (grey.at(1, 0) - 127.5).abs() < 1e-3, "{grey:?}");
    }

    #[test]
    fn a_quadratic_is_interpolated_and_derived_exactly() {
        let of = |x: f32, y: f32| 3.0 + 0.5 * x * x - 0.25 * y * y + x * y;
        let plane = Plane::from_fn(12, 10, |x, y| of(x as f32, y as f32));
        for (x, y) in [(4.0, 5.0), (4.3, 5.8), (6.5, 3.25)] {
            assert!((plane.cubic(x, y) - of(x, y)).abs() < 1e-4, "({x}, {y}): {}", plane.cubic(x, y));
        }
        let (dx, dy) = (plane.along_x(), plane.along_y());
        assert!((dx.at(5, 4) - 9.0).abs() < 1e-4 && (dy.at(5, 4) - 3.0).abs() < 1e-4);
    }

    #[test]
    fn beyond_the_border_it_goes_on() {
        let plane = Plane::from_fn(2, 1, |x, _| x as f32);
        for (place, value) in [(-1e30, 0.0), (-5.0, 0.0), (7.0, 1.0), (1e30, 1.0)] {
            assert!((plane.cubic(place, place) - value).abs() < 1e-6, "{place}");
        }
    }
}
