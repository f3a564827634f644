//! A photo reduced to what the checks of a capture compare: a small grey picture, its brightness, its sharpness.

use crate::picture::scaling_bytes;
use crate::{Image, Size};

/// Longest side of the grey picture, pixels: small enough that a few pixels of parallax do not matter.
const SIDE: u32 = 32;
/// Longest side at which sharpness is measured, pixels: above it sensors, below it focus and motion decide.
const SHARP_SIDE: u32 = 400;
/// Pixels darker than this, of either picture, say nothing about exposure.
const DARK: f32 = 0.08;

/// What is kept of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Thumb {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Grey values in `[0, 1]`, row by row, over mid grey where the photo has alpha; NaN where its mask ignores the pixel.
    pub grey: Vec<f32>,
    /// Energy of the Laplacian over the variance of the grey values at some 400 pixels: larger is sharper. 0 for a photo of one
    /// colour.
    pub sharpness: f32,
}

impl Thumb {
    /// Most bytes that [`Thumb::of`] takes beside a photo that is so many columns wide: a small picture and what scaling takes.
    pub(crate) fn work_bytes(width: u32) -> u64 {
        5 * u64::from(SHARP_SIDE * SHARP_SIDE) + scaling_bytes(width, SHARP_SIDE)
    }

    /// Reduce a decoded photo.
    ///
    /// # Panics
    /// If the photo has no pixels, or holds less than its size says.
    #[must_use]
    pub fn of(image: &Image) -> Self {
        let Size { width, height } = fitted(image, SIDE);
        let small = image.resized(width, height);
        let used = |x: u32, y: u32| small.is_used(x, y);
        let grey = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| if used(x, y) { luma(small.pixel(x, y)) } else { f32::NAN })
            .collect();
        Self { width, height, grey, sharpness: sharpness(image) }
    }

    /// The value at a place in pixels of this picture, between pixel centres; `None` outside and where a pixel is ignored.
    ///
    /// # Panics
    /// If the picture has no pixels, or `grey` has not a value for each.
    #[must_use]
    pub fn at(&self, u: f64, v: f64) -> Option<f32> {
        let (x, y) = (u - 0.5, v - 0.5);
        let inside = x >= 0.0 && y >= 0.0 && x <= f64::from(self.width - 1) && y <= f64::from(self.height - 1);
        if !inside {
            return None;
        }
        let (x0, y0) = (x as u32, y as u32);
        let (x1, y1) = ((x0 + 1).min(self.width - 1), (y0 + 1).min(self.height - 1));
        let (fx, fy) = ((x - f64::from(x0)) as f32, (y - f64::from(y0)) as f32);
        let get = |x: u32, y: u32| self.grey[(y * self.width + x) as usize];
        let row = |y: u32| get(x0, y) * (1.0 - fx) + get(x1, y) * fx;
        let value = row(y0) * (1.0 - fy) + row(y1) * fy;
        (!value.is_nan()).then_some(value)
    }
}

/// Size of an image whose longest side is at most `side`.
fn fitted(image: &Image, side: u32) -> Size {
    let longest = image.size().longest_side().max(1);
    let fit = |n: u32| if longest <= side { n } else { (u64::from(n) * u64::from(side) / u64::from(longest)) as u32 };
    Size::new(fit(image.width).max(1), fit(image.height).max(1))
}

/// Brightness over mid grey.
fn luma(pixel: &[u8]) -> f32 {
    let grey = (0.299 * f32::from(pixel[0]) + 0.587 * f32::from(pixel[1]) + 0.114 * f32::from(pixel[2])) / 255.0;
    let alpha = pixel.get(3).map_or(1.0, |a| f32::from(*a) / 255.0);
    grey * alpha + 0.5 * (1.0 - alpha)
}

fn sharpness(image: &Image) -> f32 {
    let Size { width, height } = fitted(image, SHARP_SIDE);
    let picture;
    let image = if (width, height) == (image.width, image.height) {
        image
    } else {
        picture = image.resized(width, height);
        &picture
    };
    let at = |x: u32, y: u32| luma(image.pixel(x, y));
    let (mut energy, mut sum, mut squares, mut n) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            if !image.is_used(x, y) {
                continue;
            }
            let centre = at(x, y);
            let laplacian = 4.0 * centre - at(x - 1, y) - at(x + 1, y) - at(x, y - 1) - at(x, y + 1);
            energy += f64::from(laplacian * laplacian);
            sum += f64::from(centre);
            squares += f64::from(centre * centre);
            n += 1.0;
        }
    }
    let variance = (squares - sum * sum / n.max(1.0)).max(0.0);
    if variance <= 1e-4 * n.max(1.0) { 0.0 } else { (energy / variance) as f32 }
}

/// How two lists of grey values agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Agreement {
    /// Normalised correlation in `[-1, 1]`: blind to gain and offset. 0 where either list is of one value.
    pub(super) correlation: f32,
    /// How many stops the second list is brighter: the median over pairs of which neither is dark.
    pub(super) stops: f32,
}

/// Compare pairs of grey values.
pub(super) fn agreement(pairs: &[(f32, f32)]) -> Agreement {
    let n = pairs.len().max(1) as f64;
    let mean = |f: &dyn Fn(&(f32, f32)) -> f64| pairs.iter().map(f).sum::<f64>() / n;
    let (a, b) = (mean(&|p| f64::from(p.0)), mean(&|p| f64::from(p.1)));
    let aa = mean(&|p| (f64::from(p.0) - a).powi(2));
    let bb = mean(&|p| (f64::from(p.1) - b).powi(2));
    let ab = mean(&|p| (f64::from(p.0) - a) * (f64::from(p.1) - b));
    // A deviation below half a percent is noise of the sensor.
    let flat = 2.5e-5;
    let correlation = if aa < flat || bb < flat { 0.0 } else { ab / (aa * bb).sqrt() };
    let lit = pairs.iter().filter(|(a, b)| *a > DARK && *b > DARK);
    let mut ratios: Vec<f32> = lit.map(|(a, b)| (b / a).log2()).collect();
    ratios.sort_unstable_by(f32::total_cmp);
    let stops = ratios.get(ratios.len() / 2).copied().unwrap_or(0.0);
    Agreement { correlation: correlation as f32, stops }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(pixel: impl Fn(u32, u32) -> u8) -> Image {
        let data = (0..60).flat_map(|y| (0..80).map(move |x| (x, y))).flat_map(|(x, y)| [pixel(x, y); 3]).collect();
        Image::rgb(80, 60, data).unwrap()
    }

    #[test]
    fn a_thumb_is_small_and_keeps_the_shape() {
        let thumb = Thumb::of(&photo(|x, _| (3 * x) as u8));
        assert_eq!((thumb.width, thumb.height, thumb.grey.len()), (32, 24, 768));
        assert!(thumb.at(0.2, 5.0).is_none() && thumb.at(31.6, 5.0).is_none());
        let [a, b] = [thumb.at(8.0, 5.0), thumb.at(24.0, 5.0)].map(Option::unwrap);
        assert!((b - a - 3.0 * 40.0 / 255.0).abs() < 0.02, "{a} {b}");
    }

    #[test]
    fn blur_lowers_the_sharpness_and_exposure_does_not_change_it() {
        let sharp = photo(|x, y| if (x / 3 + y / 3) % 2 == 0 { 200 } else { 40 });
        let soft = photo(|x, y| (120.0 + 80.0 * (f64::from(x) / 9.0).sin() * (f64::from(y) / 9.0).cos()) as u8);
        let dark = photo(|x, y| if (x / 3 + y / 3) % 2 == 0 { 100 } else { 20 });
        let [sharp, soft, dark] = [sharp, soft, dark].map(|image| Thumb::of(&image).sharpness);
        assert!(sharp > 2.0 * soft, "{sharp} {soft}");
        assert!((dark / sharp - 1.0).abs() < 0.02, "{sharp} {dark}");
        assert_eq!(Thumb::of(&photo(|_, _| 90)).sharpness, 0.0);
    }

    #[test]
    fn agreement_is_blind_to_exposure_and_says_how_large_it_is() {
        let pairs: Vec<(f32, f32)> = (0..50).map(|i| (0.01 * i as f32, 0.02 * i as f32)).collect();
        let found = agreement(&pairs);
        assert!(found.correlation > 0.999 && (found.stops - 1.0).abs() < 1e-5, "{found:?}");
        assert_eq!(agreement(&[]).correlation, 0.0);
        assert_eq!(agreement(&[(0.5, 0.1), (0.5, 0.9)]).correlation, 0.0);
    }
}
