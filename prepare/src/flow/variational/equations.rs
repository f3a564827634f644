//! The linear equations of each pixel: what the pictures and the neighbours want.

use crate::flow::field::Field;
use crate::flow::plane::Plane;
use rayon::prelude::*;

/// Weights of the terms (Kroeger et al., 2016: delta, gamma, alpha).
const DATA: f32 = 5.0;
const DETAIL: f32 = 10.0;
const SMOOTHNESS: f32 = 10.0;
/// `eps`: what is less than a hundredth of a pixel is no error.
const NO_ERROR: f32 = 0.01;
/// Square of the derivative that says nothing, levels per pixel: 8 bits are not finer.
const NO_CHANGE: f32 = 1.0;

/// The equation of a pixel with flow `U`, and of its neighbours to the right and below:
/// `A U + sum(w (U - U')) = b`, over the neighbours `U'`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pixel {
    /// `A`: xx, xy, yy.
    pub(super) matrix: [f32; 3],
    /// `b`.
    pub(super) wanted: [f32; 2],
    /// `w` of the pixel to the right; 0 at the border.
    pub(super) right: f32,
    /// `w` of the pixel below.
    pub(super) below: f32,
}

/// Both pictures at one warp.
pub(super) struct Equations {
    base: Field,
    /// `I(x + u) - T(x)`, and its derivatives along x and y.
    difference: Plane,
    difference_x: Plane,
    difference_y: Plane,
    /// First and second derivatives of the mean of both pictures.
    x: Plane,
    y: Plane,
    xx: Plane,
    xy: Plane,
    yy: Plane,
}

/// `A` and `b` of the pictures alone.
struct Sums {
    matrix: [f32; 3],
    wanted: [f32; 2],
}

impl Sums {
    /// Adds `weight (r + g (U - base))^2`, with the derivatives `g` of the residual `r`.
    fn add(&mut self, weight: f32, gradient: [f32; 2], residual: f32) {
        let [x, y] = gradient;
        let [xx, xy, yy] = self.matrix;
        self.matrix = [xx + weight * x * x, xy + weight * x * y, yy + weight * y * y];
        self.wanted = [self.wanted[0] - weight * x * residual, self.wanted[1] - weight * y * residual];
    }
}

impl Equations {
    /// With `second` warped by the flow `base`.
    pub(super) fn new(first: &Plane, second: &Plane, base: Field) -> Self {
        let (width, height) = (first.width(), first.height());
        let warped = Plane::from_fn(width, height, |x, y| {
            let [u, v] = base.at(x, y);
            second.cubic(x as f32 + u, y as f32 + v)
        });
        let mean = Plane::from_fn(width, height, |x, y| 0.5 * (first.at(x, y) + warped.at(x, y)));
        let difference = Plane::from_fn(width, height, |x, y| warped.at(x, y) - first.at(x, y));
        let (x, y) = (mean.along_x(), mean.along_y());
        Self {
            difference_x: difference.along_x(),
            difference_y: difference.along_y(),
            xx: x.along_x(),
            xy: x.along_y(),
            yy: y.along_y(),
            base,
            difference,
            x,
            y,
        }
    }

    /// The equations where the flow is `now`, row by row.
    pub(super) fn at(&self, now: &Field) -> Vec<Pixel> {
        let (width, height) = (now.width(), now.height());
        let smoothness = smoothness(now);
        let mut pixels = vec![Pixel::default(); width * height];
        pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let Sums { matrix, wanted } = self.of_pictures(x, y, now.at(x, y));
                let between = |other: f32| 0.5 * (smoothness.at(x, y) + other);
                let right = if x + 1 < width { between(smoothness.at(x + 1, y)) } else { 0.0 };
                let below = if y + 1 < height { between(smoothness.at(x, y + 1)) } else { 0.0 };
                *pixel = Pixel { matrix, wanted, right, below };
            }
        });
        pixels
    }

    /// What the pictures want of a pixel: nothing where it goes out of the picture.
    fn of_pictures(&self, x: usize, y: usize, now: [f32; 2]) -> Sums {
        let base = self.base.at(x, y);
        let mut sums = Sums { matrix: [0.0; 3], wanted: [0.0; 2] };
        if !is_inside(x, base[0], self.x.width()) || !is_inside(y, base[1], self.x.height()) {
            return sums;
        }
        let added = [now[0] - base[0], now[1] - base[1]];
        let residual = |r: f32, g: [f32; 2]| r + g[0] * added[0] + g[1] * added[1];
        let pixels = |g: [f32; 2]| 1.0 / (g[0] * g[0] + g[1] * g[1] + NO_CHANGE);

        let (g, r) = ([self.x.at(x, y), self.y.at(x, y)], self.difference.at(x, y));
        let (n, error) = (pixels(g), residual(r, g));
        sums.add(DATA * n * robust(n * error * error), g, r);

        let (gx, rx) = ([self.xx.at(x, y), self.xy.at(x, y)], self.difference_x.at(x, y));
        let (gy, ry) = ([self.xy.at(x, y), self.yy.at(x, y)], self.difference_y.at(x, y));
        let (nx, ny) = (pixels(gx), pixels(gy));
        let (error_x, error_y) = (residual(rx, gx), residual(ry, gy));
        let weight = DETAIL * robust(nx * error_x * error_x + ny * error_y * error_y);
        sums.add(weight * nx, gx, rx);
        sums.add(weight * ny, gy, ry);

        // Of the flow itself, not of what is added to it.
        let [xx, xy, yy] = sums.matrix;
        sums.wanted[0] += xx * base[0] + xy * base[1];
        sums.wanted[1] += xy * base[0] + yy * base[1];
        sums
    }
}

/// Whether a pixel of an axis of `n` pixels stays in the picture: on it, not only at a centre.
fn is_inside(pixel: usize, flow: f32, n: usize) -> bool {
    (-0.5..=n as f32 - 0.5).contains(&(pixel as f32 + flow))
}

/// Derivative of `2 P`: `1 / sqrt(x + eps^2)`.
fn robust(squared: f32) -> f32 {
    1.0 / (squared + NO_ERROR * NO_ERROR).sqrt()
}

/// `SMOOTHNESS / sqrt(|grad u|^2 + |grad v|^2 + eps^2)`, squared differences to both sides averaged.
fn smoothness(now: &Field) -> Plane {
    let (width, height) = (now.width(), now.height());
    let squared = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
    Plane::from_fn(width, height, |x, y| {
        let here = now.at(x, y);
        let sides = [
            now.at(x.saturating_sub(1), y),
            now.at((x + 1).min(width - 1), y),
            now.at(x, y.saturating_sub(1)),
            now.at(x, (y + 1).min(height - 1)),
        ];
        SMOOTHNESS * robust(0.5 * sides.iter().map(|side| squared(here, *side)).sum::<f32>())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_the_flow_is_right_it_is_what_is_wanted() {
        // The second picture is the first, shifted by whole pixels: nothing is interpolated.
        let of = |x: f32, y: f32| 100.0 + 30.0 * (0.5 * x).sin() + 30.0 * (0.4 * y + 0.2 * x).cos();
        let first = Plane::from_fn(24, 20, |x, y| of(x as f32, y as f32));
        let second = Plane::from_fn(24, 20, |x, y| of(x as f32 - 2.0, y as f32 + 1.0));
        let truth = Field::from_fn(24, 20, |_, _| [2.0, -1.0]);
        let pixels = Equations::new(&first, &second, truth.clone()).at(&truth);
        for (x, y) in [(8, 8), (12, 10), (15, 9)] {
            let Pixel { matrix: [xx, xy, yy], wanted, .. } = pixels[y * 24 + x];
            let scale = xx + yy;
            assert!(scale > 1.0, "{scale}");
            assert!((2.0 * xx - xy - wanted[0]).abs() < 1e-3 * scale, "({x}, {y})");
            assert!((2.0 * xy - yy - wanted[1]).abs() < 1e-3 * scale, "({x}, {y})");
        }
        // The last row and column have no neighbour there.
        assert_eq!((pixels[23].right, pixels[19 * 24].below), (0.0, 0.0));
        assert!(pixels[22].right > 0.0 && pixels[18 * 24].below > 0.0);
    }
}
