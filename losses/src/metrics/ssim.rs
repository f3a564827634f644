//! Structural similarity, in the variants that publications use.
//!
//! Letters: `mu` local mean, `var` local variance (biased), `cov` local covariance, under a Gaussian window.

use super::{
    MetricError,
    image::{Image, Plane, check_pair, check_side},
};
use alloc::{vec, vec::Vec};
use core::fmt;
use float_core::m64;

/// `(K1 * peak)^2`, `K1 = 0.01`: keeps the luminance term finite on black.
pub const C1: f64 = 0.01 * 0.01;
/// `(K2 * peak)^2`, `K2 = 0.03`: keeps the structure term finite on flat areas.
pub const C2: f64 = 0.03 * 0.03;
/// Width of the Gaussian, pixels.
const SIGMA: f64 = 1.5;

/// Size of the Gaussian window; its width is 1.5 pixels in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Window {
    /// 11x11, as in the paper.
    Eleven,
    /// 3x3, as Ha-NeRF, CR-NeRF and SF-NeRF evaluate.
    Three,
}

/// What the window sees past the edge of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Border {
    /// Nothing: only windows inside the image count.
    Valid,
    /// The image mirrored at its outermost pixels, which are not repeated.
    Reflect,
    /// Black.
    Zero,
}

/// Whether values of the map are clipped before they are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Clamp {
    /// No: anticorrelated windows count below 0.
    No,
    /// To `[0, 1]`.
    Yes,
}

/// Which SSIM. Numbers of different variants are not comparable; `Display` gives a name to keep with the number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct SsimVariant {
    /// Size of the window.
    pub window: Window,
    /// Edge of the image.
    pub border: Border,
    /// Clipping of the map.
    pub clamp: Clamp,
}

impl SsimVariant {
    /// The paper's: 11x11, windows inside the image, not clipped. This project reports it unless it says otherwise.
    pub const REFERENCE: Self = Self { window: Window::Eleven, border: Border::Valid, clamp: Clamp::No };
    /// 11x11 with zero padding: the one of 3D Gaussian splatting and of EndoNeRF.
    pub const ZERO_PADDED: Self = Self { window: Window::Eleven, border: Border::Zero, clamp: Clamp::No };
    /// 3x3 with zero padding, clipped to `[0, 1]`: the one of Ha-NeRF, CR-NeRF and SF-NeRF.
    pub const SMALL_WINDOW: Self = Self { window: Window::Three, border: Border::Zero, clamp: Clamp::Yes };

    float_core::setters! {
        with_window window: Window;
        with_border border: Border;
        with_clamp clamp: Clamp;
    }
}

impl fmt::Display for SsimVariant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let border = match self.border {
            Border::Valid => "valid",
            Border::Reflect => "reflect",
            Border::Zero => "zero",
        };
        let clamp = if self.clamp == Clamp::Yes { ", clamped" } else { "" };
        write!(f, "SSIM (window {}, {border}{clamp})", self.window.side())
    }
}

impl Window {
    /// Pixels a side.
    #[must_use]
    pub const fn side(self) -> usize {
        match self {
            Self::Eleven => 11,
            Self::Three => 3,
        }
    }

    /// The one-dimensional Gaussian; its sum is 1.
    #[must_use]
    pub fn taps(self) -> Vec<f64> {
        let centre = (self.side() / 2) as f64;
        let raw = |i: usize| m64::exp(-0.5 * m64::powi((i as f64 - centre) / SIGMA, 2));
        let total: f64 = (0..self.side()).map(raw).sum();
        (0..self.side()).map(|i| raw(i) / total).collect()
    }
}

/// Mean structural similarity, per channel, then averaged: 1 for equal images, down to -1.
///
/// `((2 mu_a mu_b + C1) (2 cov + C2)) / ((mu_a^2 + mu_b^2 + C1) (var_a + var_b + C2))`, Gaussian window of 1.5 pixels,
/// `C1 = 0.01^2`, `C2 = 0.03^2`, peak 1.
///
/// # Numerics
/// Separable, in `f64`, because `E[x^2] - mu^2` cancels; variances are floored at 0 and covariances held to
/// `±sqrt(var_a var_b)`. Works in a band of window height, `5 * side * width` numbers beside the planes.
///
/// # Errors
/// [`MetricError::Mismatch`]; [`MetricError::TooSmall`] where a side is below the window's (for every border);
/// [`MetricError::Channels`] without channels.
///
/// # Source
/// Wang et al., "Image quality assessment: from error visibility to structural similarity", 2004, eq. 13.
pub fn ssim(a: &Image<'_>, b: &Image<'_>, variant: SsimVariant) -> Result<f64, MetricError> {
    check_pair("SSIM", a, b)?;
    check_side("SSIM", a, variant.window.side())?;
    let total: f64 = (0..a.channels()).map(|c| means(&a.plane(c), &b.plane(c), variant).ssim).sum();
    Ok(total / a.channels() as f64)
}

/// Means over one channel.
pub(super) struct Means {
    /// Of the whole product.
    pub(super) ssim: f64,
    /// Of the contrast-structure term alone.
    pub(super) contrast: f64,
}

/// Local moments of a pair under one window.
#[derive(Clone, Copy)]
pub(super) struct Moments {
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) aa: f64,
    pub(super) bb: f64,
    pub(super) ab: f64,
}

impl Moments {
    /// `(luminance * contrast, contrast)`.
    #[inline(always)]
    pub(super) fn similarity(self) -> (f64, f64) {
        let (mu_aa, mu_bb, mu_ab) = (self.a * self.a, self.b * self.b, self.a * self.b);
        let (var_a, var_b) = ((self.aa - mu_aa).max(0.0), (self.bb - mu_bb).max(0.0));
        let bound = m64::sqrt(var_a * var_b);
        let cov = (self.ab - mu_ab).clamp(-bound, bound);
        let contrast = (2.0 * cov + C2) / (var_a + var_b + C2);
        ((2.0 * mu_ab + C1) / (mu_aa + mu_bb + C1) * contrast, contrast)
    }
}

/// Moments a window has: those of [`Moments`].
const MOMENTS: usize = 5;

/// SSIM of one channel; both planes have the same size, at least the window's.
pub(super) fn means(a: &Plane, b: &Plane, variant: SsimVariant) -> Means {
    let taps = variant.window.taps();
    let side = taps.len();
    let pad = if variant.border == Border::Valid { 0 } else { side / 2 };
    let (padded_width, padded_height) = (a.width + 2 * pad, a.height + 2 * pad);
    let out_width = padded_width + 1 - side;

    let mut padded = [vec![0.0; padded_width], vec![0.0; padded_width]];
    let mut products = vec![0.0; padded_width];
    // The last `side` rows, filtered along x: [row % side][moment][out_width].
    let mut band = vec![0.0; side * MOMENTS * out_width];
    let mut window = vec![0.0; MOMENTS * out_width];
    let (mut total_ssim, mut total_contrast, mut count) = (0.0, 0.0, 0_usize);

    for y in 0..padded_height {
        let [row_a, row_b] = &mut padded;
        pad_row(a, y, pad, variant.border, row_a);
        pad_row(b, y, pad, variant.border, row_b);
        let slot = &mut band[y % side * MOMENTS * out_width..][..MOMENTS * out_width];
        for (m, out) in slot.chunks_exact_mut(out_width).enumerate() {
            for ((p, &a), &b) in products.iter_mut().zip(&*row_a).zip(&*row_b) {
                *p = [a, b, a * a, b * b, a * b][m];
            }
            out.fill(0.0);
            for (k, &g) in taps.iter().enumerate() {
                axpy(g, &products[k..k + out_width], out);
            }
        }
        if y + 1 < side {
            continue;
        }
        window.fill(0.0);
        for (k, &g) in taps.iter().enumerate() {
            axpy(g, &band[(y + 1 + k) % side * MOMENTS * out_width..][..MOMENTS * out_width], &mut window);
        }
        for x in 0..out_width {
            let at = |m: usize| window[m * out_width + x];
            let (ssim, contrast) = Moments { a: at(0), b: at(1), aa: at(2), bb: at(3), ab: at(4) }.similarity();
            total_ssim += if variant.clamp == Clamp::Yes { ssim.clamp(0.0, 1.0) } else { ssim };
            total_contrast += contrast;
            count += 1;
        }
    }
    Means { ssim: total_ssim / count as f64, contrast: total_contrast / count as f64 }
}

/// Row `y` of the padded plane.
fn pad_row(plane: &Plane, y: usize, pad: usize, border: Border, out: &mut [f64]) {
    let Some(y) = source(y, pad, plane.height, border) else {
        out.fill(0.0);
        return;
    };
    let row = &plane.data[y * plane.width..][..plane.width];
    out[pad..pad + plane.width].copy_from_slice(row);
    for x in (0..pad).chain(pad + plane.width..out.len()) {
        out[x] = source(x, pad, plane.width, border).map_or(0.0, |x| row[x]);
    }
}

/// Which of `n` pixels stands at `i` of the padded axis; none where it is black.
fn source(i: usize, pad: usize, n: usize, border: Border) -> Option<usize> {
    let inside = (pad..pad + n).contains(&i);
    match border {
        _ if inside => Some(i - pad),
        Border::Reflect if i < pad => Some(pad - i),
        Border::Reflect => Some(2 * (n - 1) - (i - pad)),
        _ => None,
    }
}

#[inline(always)]
fn axpy(g: f64, x: &[f64], y: &mut [f64]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += g * x;
    }
}
