//! Metrics over the pixels a mask keeps.
//!
//! Letters: `m` mask `[height][width]`, 1 keeps a pixel and 0 leaves it out (values between weigh it), the same for all
//! channels.

use super::{
    MetricError,
    image::{Image, check_len, check_pair, check_side},
    psnr::psnr_of_mse,
    ssim::{Moments, Window},
};
use alloc::{vec, vec::Vec};

/// Under this a sum of mask values counts as this.
const MASK_EPS: f64 = 1e-6;

/// How a window that the mask cuts is renormalised, and which windows count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MaskedSsim {
    /// As DyCheck measures: each one-dimensional pass multiplies by `11 / kept taps`, and windows without a kept pixel
    /// count as 1 in the mean, which flatters small masks. Comparable with published numbers.
    DyCheck,
    /// Windows are renormalised by the Gaussian mass that is kept, and only windows with a kept pixel count.
    Corrected,
}

/// `sum(m (a - b)^2) / max(sum(m), 1e-6)`, `m` repeated over channels; 0 where the mask keeps nothing.
///
/// # Errors
/// [`MetricError::Shape`] unless the mask holds `width * height` values, [`MetricError::Mask`] unless they are in `[0, 1]`;
/// [`MetricError::Mismatch`], [`MetricError::TooSmall`], [`MetricError::Channels`] as [`mse`](super::mse).
///
/// # Source
/// Gao et al., "Monocular dynamic view synthesis: a reality check" (DyCheck), 2022, as released.
pub fn masked_mse(a: &Image<'_>, b: &Image<'_>, m: &[f32]) -> Result<f64, MetricError> {
    check_pair("masked MSE", a, b)?;
    check_mask(a, m)?;
    let (mut total, mut kept) = (0.0, 0.0);
    for i in 0..a.len() {
        let (m, d) = (f64::from(m[i / a.channels()]), a.value(i) - b.value(i));
        total += m * d * d;
        kept += m;
    }
    Ok(total / kept.max(MASK_EPS))
}

/// `-10 log10(masked_mse)` in dB; `inf` where the images agree under the mask.
///
/// # Errors
/// [`MetricError::EmptyMask`] where the mask keeps nothing; else as [`masked_mse`].
pub fn masked_psnr(a: &Image<'_>, b: &Image<'_>, m: &[f32]) -> Result<f64, MetricError> {
    let mse = masked_mse(a, b, m)?;
    if m.iter().all(|&m| m == 0.0) { Err(MetricError::EmptyMask) } else { Ok(psnr_of_mse(mse)) }
}

/// SSIM whose windows see only kept pixels: 11x11 Gaussian windows inside the image, per channel, then averaged.
///
/// # Errors
/// [`MetricError::TooSmall`] where a side is below 11; [`MetricError::EmptyMask`] where the mask keeps nothing
/// ([`MaskedSsim::Corrected`] only: DyCheck counts that as 1); else as [`masked_mse`].
///
/// # Source
/// Gao et al., "Monocular dynamic view synthesis: a reality check" (DyCheck), 2022, as released.
pub fn masked_ssim(a: &Image<'_>, b: &Image<'_>, m: &[f32], variant: MaskedSsim) -> Result<f64, MetricError> {
    check_pair("masked SSIM", a, b)?;
    check_side("masked SSIM", a, Window::Eleven.side())?;
    check_mask(a, m)?;
    let taps = Window::Eleven.taps();
    let blur = Blur { taps: &taps, width: a.width(), height: a.height(), variant };
    let m: Vec<f64> = m.iter().map(|&m| f64::from(m)).collect();
    let windows = (a.width() - taps.len() + 1) * (a.height() - taps.len() + 1);

    let (mut total, mut count) = (0.0, 0_usize);
    for c in 0..a.channels() {
        let (a, b) = (a.plane(c).data, b.plane(c).data);
        let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).collect::<Vec<_>>();
        let (mean_a, seen) = blur.run(&a, &m);
        let [mean_b, mean_aa, mean_bb, mean_ab] =
            [b.clone(), product(&a, &a), product(&b, &b), product(&a, &b)].map(|z| blur.run(&z, &m).0);
        for i in (0..windows).filter(|&i| variant == MaskedSsim::DyCheck || seen[i] > 0.0) {
            let moments = Moments { a: mean_a[i], b: mean_b[i], aa: mean_aa[i], bb: mean_bb[i], ab: mean_ab[i] };
            total += moments.similarity().0;
            count += 1;
        }
    }
    if count == 0 { Err(MetricError::EmptyMask) } else { Ok(total / count as f64) }
}

/// A Gaussian over the kept pixels only, along x, then along y.
struct Blur<'a> {
    taps: &'a [f64],
    width: usize,
    height: usize,
    variant: MaskedSsim,
}

impl Blur<'_> {
    /// Window means of `z`, and what the mask keeps of each window (0 where the mean is made up as 0).
    fn run(&self, z: &[f64], m: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let side = self.taps.len();
        let out_width = self.width - side + 1;
        let (z, m) = self.pass(z, m, self.height, out_width, |y, x| (y * self.width + x, 1));
        self.pass(&z, &m, self.height - side + 1, out_width, |y, x| (y * out_width + x, out_width))
    }

    /// One direction. `at(y, x)` is the first input of output `(y, x)` and the step to the next.
    fn pass(
        &self,
        z: &[f64],
        m: &[f64],
        rows: usize,
        columns: usize,
        at: impl Fn(usize, usize) -> (usize, usize),
    ) -> (Vec<f64>, Vec<f64>) {
        let (mut out, mut seen) = (vec![0.0; rows * columns], vec![0.0; rows * columns]);
        for i in 0..rows * columns {
            let (start, step) = at(i / columns, i % columns);
            let (mut sum, mut mass, mut kept) = (0.0, 0.0, 0.0);
            for (k, g) in self.taps.iter().enumerate() {
                let j = start + k * step;
                sum += g * z[j] * m[j];
                mass += g * m[j];
                kept += m[j];
            }
            (out[i], seen[i]) = match self.variant {
                _ if kept == 0.0 => (0.0, 0.0),
                MaskedSsim::DyCheck => (sum * self.taps.len() as f64 / kept, 1.0),
                // The mass goes on as the mask of the second pass: together the Gaussian mass of the window.
                MaskedSsim::Corrected => (sum / mass, mass),
            };
        }
        (out, seen)
    }
}

fn check_mask(a: &Image<'_>, m: &[f32]) -> Result<(), MetricError> {
    check_len("mask", [a.width(), a.height(), 1], m.len())?;
    match m.iter().position(|m| !(0.0..=1.0).contains(m)) {
        Some(index) => Err(MetricError::Mask { index, value: m[index] }),
        None => Ok(()),
    }
}
