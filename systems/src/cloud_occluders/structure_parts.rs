//! How alike the structure of two pictures is, pixel by pixel, at several scales.
//!
//! ```text
//! l = (2 m_x m_y + C1) / (m_x^2 + m_y^2 + C1)        luminance, m: means under a Gaussian window of 11 pixels, deviation 1.5
//! c = (2 s_x s_y + C2) / (s_x^2 + s_y^2 + C2)        contrast, s: deviations
//! t = (s_xy + C2/2) / (s_x s_y + C2/2)               structure, s_xy: covariance
//! ```
//!
//! The likeness is the product of `l` at full size and of `c` and `t` at all sizes, mean over channels.
//!
//! # Source
//! Wang et al., "Multiscale structural similarity for image quality assessment", 2003, equations 5 to 7; as WildGaussians has it: exponents of 1,
//! sizes halved while both sides are above 80 pixels, maps interpolated.

use losses::metrics::{self, Window};
use rayon::prelude::*;

const C1: f32 = metrics::C1 as f32;
const C2: f32 = metrics::C2 as f32;
const REACH: usize = Window::Eleven.side() / 2;
/// Both sides of a picture that is halved are longer than this.
const SMALLEST: usize = 80;

/// A plane `[rows][columns]`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plane {
    pub(super) size: [usize; 2],
    pub(super) values: Vec<f32>,
}

impl Plane {
    fn new(size: [usize; 2], of: impl Fn(usize, usize) -> f32) -> Self {
        let values = (0..size[0] * size[1]).map(|i| of(i % size[0], i / size[0])).collect();
        Self { size, values }
    }

    fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.size[0] + x]
    }

    /// Means over squares of `side` pixels; what is left over at the right and at the bottom is left out.
    pub(super) fn smaller(&self, side: usize) -> Self {
        let size = self.size.map(|n| (n / side).max(1));
        let [w, h] = self.size;
        Self::new(size, |x, y| {
            let (xs, ys) = (x * side..((x + 1) * side).min(w), y * side..((y + 1) * side).min(h));
            let count = (xs.len() * ys.len()).max(1) as f32;
            ys.map(|y| xs.clone().map(|x| self.at(x, y)).sum::<f32>()).sum::<f32>() / count
        })
    }

    /// The value at a place of another picture of `size`, linearly between pixels.
    pub(super) fn interpolated(&self, size: [usize; 2]) -> Self {
        if size == self.size {
            return self.clone();
        }
        let along = |k: usize| -> Vec<(usize, usize, f32)> {
            let (n, of) = (size[k], self.size[k]);
            (0..n)
                .map(|i| {
                    let at = ((i as f32 + 0.5) * of as f32 / n as f32 - 0.5).clamp(0.0, (of - 1) as f32);
                    let low = at as usize;
                    (low, (low + 1).min(of - 1), at - low as f32)
                })
                .collect()
        };
        let (columns, rows) = (along(0), along(1));
        Self::new(size, |x, y| {
            let ((x0, x1, fx), (y0, y1, fy)) = (columns[x], rows[y]);
            let row = |y: usize| self.at(x0, y) * (1.0 - fx) + self.at(x1, y) * fx;
            row(y0) * (1.0 - fy) + row(y1) * fy
        })
    }

    /// Weighted means under the window; beyond the edge there is 0.
    fn blurred(&self, taps: &[f32]) -> Self {
        let [w, h] = self.size;
        let mut along = vec![0.0; w * h];
        for (out, row) in along.chunks_exact_mut(w.max(1)).zip(self.values.chunks_exact(w.max(1))) {
            for (k, tap) in taps.iter().enumerate() {
                // Column x takes column x + k - REACH.
                let (to, from) = if k < REACH { (REACH - k, 0) } else { (0, k - REACH) };
                let (to, from) = (out.get_mut(to..).unwrap_or_default(), row.get(from..).unwrap_or_default());
                to.iter_mut().zip(from).for_each(|(sum, x)| *sum += tap * x);
            }
        }
        let mut values = vec![0.0; w * h];
        for (y, out) in values.chunks_exact_mut(w.max(1)).enumerate() {
            for (k, tap) in taps.iter().enumerate() {
                let Some(from) = (y + k).checked_sub(REACH).filter(|from| *from < h) else { continue };
                out.iter_mut().zip(&along[from * w..][..w]).for_each(|(sum, x)| *sum += tap * x);
            }
        }
        Self { size: self.size, values }
    }

    fn zip(&self, other: &Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(&a, &b)| of(a, b)).collect();
        Self { size: self.size, values }
    }
}

/// Weights of the window along one axis.
fn window() -> Vec<f32> {
    Window::Eleven.taps().into_iter().map(|tap| tap as f32).collect()
}

/// The luminance, and contrast times structure, of two planes of one size.
fn parts(a: &Plane, b: &Plane, taps: &[f32]) -> [Plane; 2] {
    let mean = |plane: &Plane| plane.blurred(taps);
    let (ma, mb) = (mean(a), mean(b));
    let variance =
        |plane: &Plane, m: &Plane| mean(&plane.zip(plane, |x, y| x * y)).zip(m, |square, m| (square - m * m).max(0.0));
    let (va, vb) = (variance(a, &ma), variance(b, &mb));
    let products = mean(&a.zip(b, |x, y| x * y));
    let covariance = products.zip(&ma.zip(&mb, |x, y| x * y), |xy, mm| xy - mm);
    let luminance = ma.zip(&mb, |x, y| (2.0 * x * y + C1) / (x * x + y * y + C1));
    let values = (0..va.values.len())
        .map(|i| {
            let (va, vb, cov) = (va.values[i], vb.values[i], covariance.values[i]);
            let both = (va * vb).sqrt();
            (2.0 * both + C2) / (va + vb + C2) * ((cov + 0.5 * C2) / (both + 0.5 * C2))
        })
        .collect();
    [luminance, Plane { size: a.size, values }]
}

/// The likeness of two pictures `[channels]` of one size: 1 where they are the same.
pub(super) fn likeness(a: &[Plane], b: &[Plane]) -> Plane {
    let taps = window();
    let size = a.first().map_or([0; 2], |plane| plane.size);
    let channels: Vec<Plane> = a
        .par_iter()
        .zip(b)
        .map(|(a, b)| {
            let [luminance, structure] = parts(a, b, &taps);
            let mut product = luminance.zip(&structure, |x, y| x * y);
            let (mut a, mut b) = (a.clone(), b.clone());
            while a.size.iter().all(|n| *n > SMALLEST) {
                (a, b) = (a.smaller(2), b.smaller(2));
                let [_, structure] = parts(&a, &b, &taps);
                product = product.zip(&structure.interpolated(size), |x, y| x * y);
            }
            product
        })
        .collect();
    let count = channels.len().max(1) as f32;
    Plane::new(size, |x, y| channels.iter().map(|plane| plane.at(x, y)).sum::<f32>() / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(size: [usize; 2], stream: u64) -> Plane {
        let rng = float_core::rng::Rng::new(3, stream);
        Plane::new(size, |x, y| rng.uniform_at((y * size[0] + x) as u64))
    }

    #[test]
    fn a_picture_is_like_itself_and_not_like_another() {
        let [a, b] = [1, 2].map(|stream| noise([170, 90], stream));
        let same = likeness(&[a.clone(), b.clone()], &[a.clone(), b.clone()]);
        assert!(same.values.iter().all(|x| (x - 1.0).abs() < 1e-3), "{:?}", &same.values[..5]);
        let other = likeness(&[a], &[b]);
        let mean = other.values.iter().sum::<f32>() / other.values.len() as f32;
        assert!(mean.abs() < 0.2, "{mean}");
    }

    #[test]
    fn the_window_is_that_of_the_definition() {
        // One pixel's sums, term by term, in f64.
        let [a, b] = [5, 6].map(|stream| noise([16, 16], stream));
        let [luminance, structure] = parts(&a, &b, &window());
        let weight = |k: i64| (-(k * k) as f64 / 4.5).exp();
        let total: f64 = (-5..=5).map(weight).sum();
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            let each = (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dx, dy)));
            each.map(|(dx, dy): (i64, i64)| {
                let (x, y) = ((8 + dx) as usize, (7 + dy) as usize);
                weight(dx) * weight(dy) / (total * total) * of(a.at(x, y).into(), b.at(x, y).into())
            })
            .sum()
        };
        let (ma, mb) = (sum(&|a, _| a), sum(&|_, b| b));
        let (va, vb) = (sum(&|a, _| a * a) - ma * ma, sum(&|_, b| b * b) - mb * mb);
        let cov = sum(&|a, b| a * b) - ma * mb;
        let (c1, c2) = (1e-4, 9e-4);
        let want_luminance = (2.0 * ma * mb + c1) / (ma * ma + mb * mb + c1);
        let both = (va * vb).sqrt();
        let want = (2.0 * both + c2) / (va + vb + c2) * (cov + c2 / 2.0) / (both + c2 / 2.0);
        assert!((f64::from(luminance.at(8, 7)) - want_luminance).abs() < 1e-5);
        assert!((f64::from(structure.at(8, 7)) - want).abs() < 1e-4, "{} {want}", structure.at(8, 7));
    }

    #[test]
    fn smaller_pictures_are_means_and_come_back_between_pixels() {
        let plane = Plane::new([5, 4], |x, y| (x + 10 * y) as f32);
        let small = plane.smaller(2);
        assert_eq!((small.size, &small.values[..]), ([2, 2], &[5.5, 7.5, 25.5, 27.5][..]));
        let back = small.interpolated([4, 4]);
        assert_eq!((back.at(0, 0), back.at(3, 3), back.at(1, 0)), (5.5, 27.5, 6.0));
        assert_eq!(Plane::new([1, 1], |_, _| 2.0).smaller(4).values, [2.0]);
    }
}
