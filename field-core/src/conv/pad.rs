//! The border around an image, and the layout that makes strided reads contiguous.

use super::Size;
use crate::FieldError;

/// What lies around an image, and how wide it is on each side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Padding {
    /// Zeros.
    Zero(usize),
    /// The image mirrored at the centres of its outermost pixels, which are not repeated: `c b | a b c | b a`. Takes images
    /// with more pixels than it mirrors.
    Reflect(usize),
}

impl Padding {
    /// Pixels on each side.
    #[must_use]
    pub const fn width(self) -> usize {
        match self {
            Self::Zero(n) | Self::Reflect(n) => n,
        }
    }

    /// Error for images of this size that cannot be padded.
    pub(super) fn check(self, size: Size) -> Result<(), FieldError> {
        for (what, n) in [("height", size.height), ("width", size.width)] {
            let (enough, accepts) = match self {
                Self::Zero(_) => (n > 0, "at least one pixel"),
                Self::Reflect(pad) => (n > pad, "more pixels than the padding mirrors"),
            };
            if !enough {
                return Err(FieldError::Config { what, got: n as f64, accepts });
            }
        }
        Ok(())
    }

    /// Which of `n` pixels lies at place `i` of the padded line; `None` is a zero.
    fn source(self, i: usize, n: usize) -> Option<usize> {
        let pad = self.width();
        match self {
            Self::Zero(_) => i.checked_sub(pad).filter(|&i| i < n),
            Self::Reflect(_) if i < pad => Some(pad - i),
            Self::Reflect(_) if i - pad < n => Some(i - pad),
            Self::Reflect(_) => Some(2 * (n - 1) - (i - pad)),
        }
    }
}

/// A padded image: each row is stored phase by phase, columns `0, stride, 2 stride ..` first, then `1, 1 + stride ..`, so that the
/// pixels which one tap of a strided kernel reads lie side by side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Padded {
    pub(super) channels: usize,
    pub(super) height: usize,
    pub(super) width: usize,
    /// Steps of the kernel along a row.
    stride: usize,
    /// Columns of a phase.
    phase: usize,
    padding: Padding,
}

impl Padded {
    pub(super) fn new(padding: Padding, channels: usize, size: Size, stride: usize) -> Self {
        let (height, width) = (size.height + 2 * padding.width(), size.width + 2 * padding.width());
        Self { channels, height, width, stride, phase: width.div_ceil(stride), padding }
    }

    /// Numbers of a padded image.
    pub(super) fn len(&self) -> usize {
        self.channels * self.height * self.stride * self.phase
    }

    /// Where the row `y` of a channel begins.
    pub(super) fn row(&self, channel: usize, y: usize) -> usize {
        (channel * self.height + y) * self.stride * self.phase
    }

    /// Where column `x` lies in its row. Columns `x, x + stride ..` follow it.
    pub(super) fn column(&self, x: usize) -> usize {
        x % self.stride * self.phase + x / self.stride
    }

    /// Pad one image `[channels][height][width]`; `out` is written.
    pub(super) fn pad(&self, image: &[f32], out: &mut [f32]) {
        let border = 2 * self.padding.width();
        let (height, width) = (self.height - border, self.width - border);
        for c in 0..self.channels {
            for y in 0..self.height {
                let start = self.row(c, y);
                let out = &mut out[start..start + self.stride * self.phase];
                let Some(from) = self.padding.source(y, height) else {
                    out.fill(0.0);
                    continue;
                };
                let from = &image[(c * height + from) * width..][..width];
                for x in 0..self.width {
                    out[self.column(x)] = self.padding.source(x, width).map_or(0.0, |x| from[x]);
                }
            }
        }
    }

    /// Gradient of [`Padded::pad`]: adds.
    pub(super) fn pad_backward(&self, out_bar: &[f32], image_bar: &mut [f32]) {
        let border = 2 * self.padding.width();
        let (height, width) = (self.height - border, self.width - border);
        for c in 0..self.channels {
            for y in 0..self.height {
                let Some(to) = self.padding.source(y, height) else { continue };
                let to = &mut image_bar[(c * height + to) * width..][..width];
                let bar = &out_bar[self.row(c, y)..];
                for x in 0..self.width {
                    if let Some(source) = self.padding.source(x, width) {
                        to[source] += bar[self.column(x)];
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;
    use alloc::vec::Vec;

    fn line(padding: Padding, x: &[f32]) -> Vec<f32> {
        let places = 0..x.len() + 2 * padding.width();
        places.map(|i| padding.source(i, x.len()).map_or(0.0, |i| x[i])).collect()
    }

    #[test]
    fn lines_are_padded_with_zeros_or_mirrored() {
        let x = [1.0, 2.0, 3.0, 4.0];
        assert_eq!(line(Padding::Zero(2), &x), [0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 0.0, 0.0]);
        assert_eq!(line(Padding::Reflect(3), &x), [4.0, 3.0, 2.0, 1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0]);
        assert_eq!(line(Padding::Reflect(0), &x), x);
    }

    #[test]
    fn every_padded_pixel_has_its_own_place_and_holds_its_source() {
        for stride in 1..4 {
            for padding in [Padding::Zero(2), Padding::Reflect(2), Padding::Zero(0)] {
                let size = Size::one(3, 5);
                let p = Padded::new(padding, 2, size, stride);
                let image: Vec<f32> = (0..30).map(|i| i as f32 + 1.0).collect();
                let mut out = vec![f32::NAN; p.len()];
                p.pad(&image, &mut out);
                let mut seen = vec![false; p.len()];
                for c in 0..2 {
                    for y in 0..p.height {
                        for x in 0..p.width {
                            let at = p.row(c, y) + p.column(x);
                            assert!(!core::mem::replace(&mut seen[at], true), "two pixels at {at}");
                            let source = padding.source(y, 3).zip(padding.source(x, 5));
                            let want = source.map_or(0.0, |(y, x)| image[(c * 3 + y) * 5 + x]);
                            assert_eq!(out[at], want, "{padding:?} stride {stride} [{c}][{y}][{x}]");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn too_little_to_mirror_is_refused() {
        assert!(Padding::Reflect(3).check(Size::one(4, 4)).is_ok());
        assert!(Padding::Reflect(3).check(Size::one(3, 9)).is_err());
        assert!(Padding::Reflect(1).check(Size::one(1, 1)).is_err());
        assert!(Padding::Reflect(0).check(Size::one(1, 1)).is_ok());
        assert!(Padding::Zero(3).check(Size::one(1, 1)).is_ok());
        assert!(Padding::Zero(3).check(Size::one(1, 0)).is_err());
    }
}
