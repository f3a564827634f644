//! How alike the structure of two pictures is: what of their structural similarity knows neither brightness nor contrast.
//!
//! ```text
//! r = max((cov_xy + C3) / (sd_x sd_y + C3), 0),  sd = sqrt(max(var, 0) + 1e-8),  C3 = 4.5e-4
//! mean g r      over pixels and channels
//! ```
//!
//! Moments are those of 11x11 Gaussian windows of 1.5 pixels that see black beyond the edge, as in [`crate::dssim`]; `g` are weights of the
//! pixels. Sums are `f64` in index order; NaN in gives NaN out.
//!
//! Source: Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004, equation 10; Wang et al.,
//! "DeGauss", 2025, equation 2, which calls its standard deviations variances.

use crate::metrics::Window;
use crate::{LossError, error::same};
use alloc::vec;
use alloc::vec::Vec;
use float_core::m64;

/// Half of the third constant of structural similarity's second, for values up to 1.
const C3: f64 = 4.5e-4;
/// Added to variances: their roots have a derivative everywhere.
const LEAST_VARIANCE: f64 = 1e-8;

/// Two pictures of one size.
#[derive(Clone, Copy, Debug)]
pub struct Pictures<'a> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// `[channels][rows][columns]` each.
    pub x: &'a [f32],
    /// The other one.
    pub y: &'a [f32],
    /// `[rows][columns]`; `None`: 1 each.
    pub weights: Option<&'a [f32]>,
}

impl Pictures<'_> {
    fn check(&self) -> Result<(usize, usize), LossError> {
        let pixels = self.size[0] * self.size[1];
        let channels = self.x.len() / pixels.max(1);
        same("x", channels * pixels, self.x.len())?;
        same("y", self.x.len(), self.y.len())?;
        self.weights.map_or(Ok(()), |weights| same("weights", pixels, weights.len()))?;
        Ok((pixels, channels))
    }

    /// The window's mean at every pixel of a plane; its own transpose.
    fn filtered(&self, plane: &[f64]) -> Vec<f64> {
        let [w, h] = self.size;
        let taps = Window::Eleven.taps();
        let reach = taps.len() / 2;
        let along = |from: &[f64], count: usize, at: usize, stride: usize, first: usize| -> f64 {
            let range = at.saturating_sub(reach)..(at + reach + 1).min(count);
            range.map(|k| taps[k + reach - at] * from[first + k * stride]).sum()
        };
        let mut rows = vec![0.0; plane.len()];
        rows.iter_mut().enumerate().for_each(|(i, out)| *out = along(plane, w, i % w, 1, i - i % w));
        (0..plane.len()).map(|i| along(&rows, h, i / w, w, i % w)).collect()
    }

    /// `r` at every pixel of a channel, and its derivatives with respect to the five moments `x, y, xx, yy, xy` where these are wanted.
    fn likeness(&self, x: &[f64], y: &[f64], mut derivative: Option<&mut [Vec<f64>; 5]>) -> Vec<f64> {
        let product = |a: &[f64], b: &[f64]| -> Vec<f64> { a.iter().zip(b).map(|(a, b)| a * b).collect() };
        let moments = [x.to_vec(), y.to_vec(), product(x, x), product(y, y), product(x, y)];
        let [mx, my, xx, yy, xy] = moments.map(|plane| self.filtered(&plane));
        let mut out = Vec::with_capacity(x.len());
        for i in 0..x.len() {
            let (mx, my) = (mx[i], my[i]);
            let [var_x, var_y] = [xx[i] - mx * mx, yy[i] - my * my];
            // Not `max`, which would replace NaN.
            let sd = [var_x, var_y].map(|var| m64::sqrt(if var < 0.0 { 0.0 } else { var } + LEAST_VARIANCE));
            let below = sd[0] * sd[1] + C3;
            let r = (xy[i] - mx * my + C3) / below;
            out.push(if r < 0.0 { 0.0 } else { r });
            let Some(to) = derivative.as_deref_mut() else { continue };
            let counts = if r < 0.0 { 0.0 } else { 1.0 };
            let cov = counts / below;
            let of_var = |var: f64, own: f64, other: f64| if var < 0.0 { 0.0 } else { -r * cov * other / (2.0 * own) };
            let (vx, vy) = (of_var(var_x, sd[0], sd[1]), of_var(var_y, sd[1], sd[0]));
            to[0][i] = -2.0 * mx * vx - my * cov;
            to[1][i] = -2.0 * my * vy - mx * cov;
            (to[2][i], to[3][i], to[4][i]) = (vx, vy, cov);
        }
        out
    }

    fn planes(&self, channel: usize, pixels: usize) -> [Vec<f64>; 2] {
        [self.x, self.y].map(|planes| planes[channel * pixels..][..pixels].iter().map(|&v| f64::from(v)).collect())
    }

    fn weight(&self, i: usize) -> f64 {
        self.weights.map_or(1.0, |weights| f64::from(weights[i]))
    }
}

/// The mean likeness of structure: 1 for equal pictures, 0 where one is the other's negative; 0 for an empty picture.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn structure(of: &Pictures<'_>) -> Result<f64, LossError> {
    let (pixels, channels) = of.check()?;
    let mut sum = 0.0;
    for channel in 0..channels {
        let [x, y] = of.planes(channel, pixels);
        sum += of.likeness(&x, &y, None).iter().enumerate().map(|(i, r)| of.weight(i) * r).sum::<f64>();
    }
    Ok(sum / of.x.len().max(1) as f64)
}

/// Backward twin of [`structure`], which it returns: adds into `x_bar` and `y_bar`, `[channels][rows][columns]`. Weights have no gradient.
///
/// # Errors
/// As [`structure`].
pub fn structure_backward(
    of: &Pictures<'_>,
    loss_bar: f64,
    x_bar: &mut [f32],
    y_bar: &mut [f32],
) -> Result<f64, LossError> {
    let (pixels, channels) = of.check()?;
    same("x_bar", of.x.len(), x_bar.len())?;
    same("y_bar", of.y.len(), y_bar.len())?;
    let share = 1.0 / of.x.len().max(1) as f64;
    let mut sum = 0.0;
    for channel in 0..channels {
        let [x, y] = of.planes(channel, pixels);
        let mut derivatives = [(); 5].map(|()| vec![0.0; pixels]);
        let likeness = of.likeness(&x, &y, Some(&mut derivatives));
        sum += likeness.iter().enumerate().map(|(i, r)| of.weight(i) * r).sum::<f64>();
        let [mx, my, xx, yy, xy] = derivatives.map(|mut plane| {
            plane.iter_mut().enumerate().for_each(|(i, d)| *d *= loss_bar * share * of.weight(i));
            of.filtered(&plane)
        });
        let first = channel * pixels;
        for i in 0..pixels {
            x_bar[first + i] += (mx[i] + 2.0 * x[i] * xx[i] + y[i] * xy[i]) as f32;
            y_bar[first + i] += (my[i] + 2.0 * y[i] * yy[i] + x[i] * xy[i]) as f32;
        }
    }
    Ok(sum * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use testkit::gradient::central_difference;

    const SIZE: [usize; 2] = [7, 5];

    /// Channels of numbers in `[0, 1)`.
    fn planes(channels: usize, stream: u64) -> Vec<f32> {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(stream + 1);
        let next = |state: &mut u64| {
            *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*state >> 40) as f32 / (1_u64 << 24) as f32
        };
        (0..channels * SIZE[0] * SIZE[1]).map(|_| next(&mut state)).collect()
    }

    /// The definition, window by window, in `f64`.
    fn twin(x: &[f64], y: &[f64], weights: &[f32]) -> f64 {
        let (taps, [w, h]) = (Window::Eleven.taps(), SIZE);
        let mut sum = 0.0;
        for (x, y) in x.chunks_exact(w * h).zip(y.chunks_exact(w * h)) {
            for (i, weight) in weights.iter().enumerate() {
                let mean = |f: &dyn Fn(usize) -> f64| -> f64 {
                    (0..w * h)
                        .map(|k| {
                            let off = |a: usize, b: usize| (a + 5).checked_sub(b).and_then(|t| taps.get(t)).copied();
                            let tap = off(k % w, i % w).unwrap_or(0.0) * off(k / w, i / w).unwrap_or(0.0);
                            tap * f(k)
                        })
                        .sum()
                };
                let (mx, my) = (mean(&|k| x[k]), mean(&|k| y[k]));
                let sd = |m: f64, v: &[f64]| ((mean(&|k| v[k] * v[k]) - m * m).max(0.0) + 1e-8).sqrt();
                let cov = mean(&|k| x[k] * y[k]) - mx * my;
                sum += f64::from(*weight) * ((cov + 4.5e-4) / (sd(mx, x) * sd(my, y) + 4.5e-4)).max(0.0);
            }
        }
        sum / x.len() as f64
    }

    #[test]
    fn value_and_gradient_are_those_of_the_definition() {
        let (x, y, weights) = (planes(2, 1), planes(2, 2), planes(1, 3));
        let of = Pictures { size: SIZE, x: &x, y: &y, weights: Some(&weights) };
        let [x64, y64] = [&x, &y].map(|v| v.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>());
        let want = twin(&x64, &y64, &weights);
        let mut bars = [vec![0.5; x.len()], vec![0.0; y.len()]];
        let [x_bar, y_bar] = &mut bars;
        let got = structure_backward(&of, 3.0, x_bar, y_bar).unwrap();
        assert!((got - want).abs() < 1e-9 && got == structure(&of).unwrap(), "{got} {want}");
        let of_x = central_difference(&x64, |x| 3.0 * twin(x, &y64, &weights));
        let of_y = central_difference(&y64, |y| 3.0 * twin(&x64, y, &weights));
        for (k, (got, want)) in bars[0].iter().zip(&of_x).enumerate() {
            assert!((f64::from(*got) - 0.5 - want).abs() < 1e-5 * (1.0 + want.abs()), "x {k}: {got} {want}");
        }
        for (k, (got, want)) in bars[1].iter().zip(&of_y).enumerate() {
            assert!((f64::from(*got) - want).abs() < 1e-5 * (1.0 + want.abs()), "y {k}: {got} {want}");
        }
    }

    #[test]
    fn equal_pictures_are_alike_and_brightness_does_not_matter_much() {
        let x = planes(1, 4);
        let likeness = |y: &[f32]| structure(&Pictures { size: SIZE, x: &x, y, weights: None }).unwrap();
        assert!((likeness(&x) - 1.0).abs() < 1e-6);
        let half: Vec<f32> = x.iter().map(|x| 0.5 * x).collect();
        let negative: Vec<f32> = x.iter().map(|x| -x).collect();
        assert!(likeness(&half) > 0.98 && likeness(&negative) == 0.0);
    }

    #[test]
    fn nothing_flat_pictures_and_wrong_lengths() {
        let empty = Pictures { size: [0, 0], x: &[], y: &[], weights: None };
        assert_eq!(structure_backward(&empty, 1.0, &mut [], &mut []).unwrap(), 0.0);
        for value in [0.0, 0.5, 1e6, -1e6] {
            let flat = vec![value; 35];
            let of = Pictures { size: SIZE, x: &flat, y: &flat, weights: None };
            let mut bars = [vec![0.0; 35], vec![0.0; 35]];
            let [x_bar, y_bar] = &mut bars;
            let got = structure_backward(&of, 1.0, x_bar, y_bar).unwrap();
            assert!(got.is_finite() && bars.iter().flatten().all(|g| g.is_finite()), "{value}: {got}");
        }
        let of = Pictures { size: SIZE, x: &[0.0; 35], y: &[0.0; 34], weights: None };
        assert!(structure(&of).is_err());
    }
}
