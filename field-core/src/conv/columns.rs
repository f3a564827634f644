//! Pixels under the kernel, as columns of a matrix: feature `(channel, row, column of the kernel)`, sample = output pixel.

use super::pad::Padded;
use core::ops::Range;

/// The windows of a kernel over a padded image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windows {
    pub(super) padded: Padded,
    pub(super) kernel: usize,
    pub(super) stride: usize,
    /// Output pixels of a row.
    pub(super) out_width: usize,
}

impl Windows {
    /// Write the columns of the output pixels `pixels`, `[channels * kernel * kernel][step]`, first pixel in front.
    pub(super) fn gather(&self, image: &[f32], pixels: Range<usize>, columns: &mut [f32], step: usize) {
        self.each_run(pixels, |feature, pixel, from, n| {
            columns[feature * step + pixel..][..n].copy_from_slice(&image[from..from + n]);
        });
    }

    /// Add the gradients of columns to that of the padded image.
    pub(super) fn scatter(&self, columns_bar: &[f32], pixels: Range<usize>, step: usize, image_bar: &mut [f32]) {
        self.each_run(pixels, |feature, pixel, to, n| {
            let bars = &columns_bar[feature * step + pixel..][..n];
            for (to, bar) in image_bar[to..to + n].iter_mut().zip(bars) {
                *to += bar;
            }
        });
    }

    /// `f(feature, pixel, place, n)` for every run of `n` output pixels of a row, from the range's `pixel`th on: under each
    /// tap of the kernel they see `n` numbers of the padded image from `place` on.
    #[inline(always)]
    fn each_run(&self, pixels: Range<usize>, mut f: impl FnMut(usize, usize, usize, usize)) {
        let k = self.kernel;
        let mut p = pixels.start;
        while p < pixels.end {
            let (y, x) = (p / self.out_width, p % self.out_width);
            let n = (self.out_width - x).min(pixels.end - p);
            for c in 0..self.padded.channels {
                for ky in 0..k {
                    let row = self.padded.row(c, y * self.stride + ky);
                    for kx in 0..k {
                        let place = row + self.padded.column(x * self.stride + kx);
                        f((c * k + ky) * k + kx, p - pixels.start, place, n);
                    }
                }
            }
            p += n;
        }
    }
}
