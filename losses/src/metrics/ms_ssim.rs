//! SSIM over five scales.

use super::{
    MetricError,
    image::{Image, Plane, check_pair, check_side},
    ssim::{SsimVariant, means},
};
use float_core::m64;

/// Exponents of the scales, finest first.
pub const MS_SSIM_WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// Smallest side: `10 * 2^4 + 1` pixels, so that the coarsest scale still holds the 11x11 window.
pub const MS_SSIM_MIN_SIDE: usize = 161;

/// Multi-scale SSIM, per channel, then averaged: 1 for equal images, at least 0.
///
/// `prod_{j < 4} contrast_j^w_j * ssim_4^w_4` with [`MS_SSIM_WEIGHTS`]: means of the contrast-structure term at the four fine
/// scales, of the whole SSIM at the coarsest; [`SsimVariant::REFERENCE`] windows. From one scale to the next, means of
/// 2x2 pixels.
///
/// # Numerics
/// Negative means count as 0: a fractional power of them is not a number. An odd side gets a row of zeros in front
/// before it is halved, counted in the means, as the widespread PyTorch implementation does.
///
/// # Errors
/// [`MetricError::TooSmall`] below [`MS_SSIM_MIN_SIDE`]; [`MetricError::Mismatch`]; [`MetricError::Channels`].
///
/// # Source
/// Wang, Simoncelli, Bovik, "Multi-scale structural similarity for image quality assessment", 2003, eq. 7.
pub fn ms_ssim(a: &Image<'_>, b: &Image<'_>) -> Result<f64, MetricError> {
    check_pair("MS-SSIM", a, b)?;
    check_side("MS-SSIM", a, MS_SSIM_MIN_SIDE)?;
    let total: f64 = (0..a.channels()).map(|c| channel(a.plane(c), b.plane(c))).sum();
    Ok(total / a.channels() as f64)
}

fn channel(mut a: Plane, mut b: Plane) -> f64 {
    let mut product = 1.0;
    for (scale, &weight) in MS_SSIM_WEIGHTS.iter().enumerate() {
        if scale > 0 {
            (a, b) = (halve(&a), halve(&b));
        }
        let means = means(&a, &b, SsimVariant::REFERENCE);
        let term = if scale + 1 < MS_SSIM_WEIGHTS.len() { means.contrast } else { means.ssim };
        product *= m64::powf(term.max(0.0), weight);
    }
    product
}

/// Means of 2x2 pixels, with a zero row or column in front of an odd side.
fn halve(plane: &Plane) -> Plane {
    let (pad_x, pad_y) = (plane.width % 2, plane.height % 2);
    let (width, height) = ((plane.width + pad_x) / 2, (plane.height + pad_y) / 2);
    let at = |x: usize, y: usize| {
        if x < pad_x || y < pad_y { 0.0 } else { plane.data[(y - pad_y) * plane.width + x - pad_x] }
    };
    let quad = |x: usize, y: usize| at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1);
    let data = (0..width * height).map(|i| 0.25 * quad(2 * (i % width), 2 * (i / width))).collect();
    Plane { width, height, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn halve_averages_and_pads_odd_sides_in_front() {
        let even = Plane { width: 2, height: 2, data: vec![1.0, 2.0, 3.0, 6.0] };
        assert_eq!(halve(&even).data, [3.0]);
        let odd = Plane { width: 3, height: 1, data: vec![4.0, 8.0, 12.0] };
        let half = halve(&odd);
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!(half.data, [1.0, 5.0]);
    }
}
