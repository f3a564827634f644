//! One patch, and the search for it in the other picture.
//!
//! A patch `T` at `x` is looked for at `x + u`, its mean brightness aside:
//! ```text
//! u <- u - H^-1 sum(g r),   r = (I(x + u) - mean) - (T(x) - mean),   g = grad T - mean,   H = sum(g g^T)
//! ```
//! `g` and `H` belong to the patch and are worked out once: the inverse search.
//!
//! # Source
//! Kroeger et al., "Fast optical flow using dense inverse search", 2016, section 2.1 and equation 2.

use super::grid::SIDE;
use crate::flow::plane::{Plane, cell, nearest};

const AREA: usize = SIDE * SIDE;
/// Steps of a search at most.
const MOST_STEPS: usize = 16;
/// A step shorter than this is the last, pixels: what comes later is finer.
const SHORT: f32 = 0.01;
/// Added to `H` for each pixel, squared levels per pixel: where a patch does not say where it is (along an edge, where all is one grey),
/// the search stays where it is.
const DAMPING: f32 = 0.05;

/// The first picture with its derivatives.
pub(super) struct Source<'a> {
    grey: &'a Plane,
    along_x: Plane,
    along_y: Plane,
}

impl<'a> Source<'a> {
    pub(super) fn new(grey: &'a Plane) -> Self {
        Self { grey, along_x: grey.along_x(), along_y: grey.along_y() }
    }
}

/// A patch of the first picture.
pub(super) struct Template {
    corner: [usize; 2],
    size: [usize; 2],
    /// `T - mean`, row by row, of `size` pixels; the rest is 0.
    grey: [f32; AREA],
    /// `g`.
    gradient: [[f32; 2]; AREA],
    /// `H^-1`: xx, xy, yy.
    inverse: [f32; 3],
}

/// Where a patch was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    pub(super) flow: [f32; 2],
    /// Sum of the squares of `r`.
    pub(super) cost: f32,
}

impl Template {
    pub(super) fn new(source: &Source<'_>, corner: [usize; 2], size: [usize; 2]) -> Self {
        let (mut grey, mut gradient) = ([0.0; AREA], [[0.0; 2]; AREA]);
        let rows = corner[1]..corner[1] + size[1];
        let places = rows.flat_map(|y| (corner[0]..corner[0] + size[0]).map(move |x| (x, y)));
        let pixels = grey.iter_mut().zip(&mut gradient).zip(places);
        let (mut count, mut mean, mut mean_gradient) = (0.0, 0.0, [0.0; 2]);
        for ((grey, gradient), (x, y)) in pixels {
            *grey = source.grey.at(x, y);
            *gradient = [source.along_x.at(x, y), source.along_y.at(x, y)];
            count += 1.0;
            mean += *grey;
            mean_gradient = [mean_gradient[0] + gradient[0], mean_gradient[1] + gradient[1]];
        }
        mean /= count;
        let [gx, gy] = mean_gradient.map(|sum: f32| sum / count);
        let mut h = [DAMPING * count, 0.0, DAMPING * count];
        for (grey, gradient) in grey.iter_mut().zip(&mut gradient).take(size[0] * size[1]) {
            *grey -= mean;
            *gradient = [gradient[0] - gx, gradient[1] - gy];
            let [x, y] = *gradient;
            h = [h[0] + x * x, h[1] + x * y, h[2] + y * y];
        }
        // Never 0: the damping.
        let determinant = h[0] * h[2] - h[1] * h[1];
        let inverse = [h[2] / determinant, -h[1] / determinant, h[0] / determinant];
        Self { corner, size, grey, gradient, inverse }
    }

    /// `r` of each pixel at a flow, and the sum of their squares.
    fn residuals(&self, other: &Plane, flow: [f32; 2], out: &mut [f32; AREA]) -> f32 {
        let (x, tx) = cell(self.corner[0] as f32 + flow[0], other.width());
        let (y, ty) = cell(self.corner[1] as f32 + flow[1], other.height());
        let columns: [usize; SIDE + 1] = std::array::from_fn(|i| nearest(x + i as isize, other.width()));
        let [width, height] = self.size;
        let out = &mut out[..width * height];
        for (y, line) in (y..).zip(out.chunks_exact_mut(width)) {
            let [above, below] = [y, y + 1].map(|y| other.row(nearest(y, other.height())));
            for (value, pair) in line.iter_mut().zip(columns.windows(2)) {
                let [top, bottom] = [above, below].map(|row| row[pair[0]] + (row[pair[1]] - row[pair[0]]) * tx);
                *value = top + (bottom - top) * ty;
            }
        }
        let mean = out.iter().sum::<f32>() / out.len() as f32;
        let mut cost = 0.0;
        for (value, grey) in out.iter_mut().zip(&self.grey) {
            *value -= mean + grey;
            cost += *value * *value;
        }
        cost
    }

    /// How well a flow fits.
    pub(super) fn fit(&self, other: &Plane, flow: [f32; 2]) -> Match {
        Match { flow, cost: self.residuals(other, flow, &mut [0.0; AREA]) }
    }

    /// The best place that steps from `start` lead to, no farther from there than a patch is long.
    pub(super) fn search(&self, other: &Plane, start: [f32; 2]) -> Match {
        let mut residuals = [0.0; AREA];
        let mut best = Match { flow: start, cost: self.residuals(other, start, &mut residuals) };
        for _ in 0..MOST_STEPS {
            let step = self.step(&residuals);
            let flow = [best.flow[0] - step[0], best.flow[1] - step[1]];
            if (flow[0] - start[0]).hypot(flow[1] - start[1]) > SIDE as f32 {
                break;
            }
            let cost = self.residuals(other, flow, &mut residuals);
            if cost >= best.cost {
                break;
            }
            best = Match { flow, cost };
            if step[0].hypot(step[1]) < SHORT {
                break;
            }
        }
        best
    }

    /// `H^-1 sum(g r)`.
    fn step(&self, residuals: &[f32; AREA]) -> [f32; 2] {
        let mut sum = [0.0_f32; 2];
        for (gradient, residual) in self.gradient.iter().zip(residuals) {
            sum = [sum[0] + gradient[0] * residual, sum[1] + gradient[1] * residual];
        }
        let [xx, xy, yy] = self.inverse;
        [xx * sum[0] + xy * sum[1], xy * sum[0] + yy * sum[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(x: f32, y: f32) -> f32 {
        128.0 + 40.0 * (0.7 * x + 0.2 * y).sin() + 40.0 * (0.3 * x - 0.6 * y).cos()
    }

    #[test]
    fn a_patch_is_found_where_it_went_whatever_its_brightness() {
        let first = Plane::from_fn(32, 32, |x, y| texture(x as f32, y as f32));
        let second = Plane::from_fn(32, 32, |x, y| 9.0 + texture(x as f32 - 1.4, y as f32 + 0.8));
        let found = Template::new(&Source::new(&first), [12, 13], [8, 8]).search(&second, [0.0, 0.0]);
        // Straight lines between pixels: good to a few hundredths.
        assert!((found.flow[0] - 1.4).abs() < 0.1 && (found.flow[1] + 0.8).abs() < 0.1, "{found:?}");
    }

    #[test]
    fn what_is_all_one_grey_stays() {
        let plane = Plane::from_fn(16, 16, |_, _| 55.0);
        let found = Template::new(&Source::new(&plane), [4, 4], [8, 8]).search(&plane, [1.0, -2.0]);
        assert_eq!((found.flow, found.cost), ([1.0, -2.0], 0.0));
    }
}
