//! Area averaging: each target pixel is the mean of the source area it covers.
//!
//! Weights are integers (overlaps in units of `1 / (source * target)`), so integer factors give the exact box mean and
//! sums do not depend on order. Colours are averaged as stored (sRGB values); with alpha they are premultiplied first,
//! so that invisible colours do not bleed.

use super::image::Image;
use crate::Size;

impl Image {
    /// The image at another size: each pixel is the mean of the area it covers, colours weighted with their opacity. A pixel
    /// of the mask is used where half of its area is.
    ///
    /// # Panics
    /// If `data` or `mask` is shorter than the size says, or there are fewer than three channels.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) { self.clone() } else { scaled(self, width, height) }
    }
}

/// Size after fitting the longest side into `longest`; never larger than the original, never 0.
pub(crate) fn fitted(size: Size, longest: Option<u32>) -> Size {
    let side = size.longest_side();
    match longest {
        Some(longest) if longest < side => {
            // Rounded half up, in integers: w * longest / side.
            let scale = |x: u32| {
                let (x, l, s) = (u64::from(x), u64::from(longest), u64::from(side));
                u32::try_from((2 * x * l + s) / (2 * s)).unwrap_or(u32::MAX).max(1)
            };
            Size::new(scale(size.width), scale(size.height))
        }
        _ => size,
    }
}

/// One source cell's shares: it overlaps targets `first ..`, by these weights.
///
/// Source `i` covers `[i * target, (i + 1) * target)` and target `j` covers `[j * source, (j + 1) * source)`.
fn overlaps(i: u64, source: u64, target: u64) -> impl Iterator<Item = (usize, u64)> {
    let (start, end) = (i * target, (i + 1) * target);
    let first = start / source;
    let last = (end - 1) / source;
    (first..=last).map(move |j| {
        let overlap = end.min((j + 1) * source) - start.max(j * source);
        (j as usize, overlap)
    })
}

/// Area-weighted sums of `channels` interleaved values of a picture of size `from`, for one of size `to`;
/// `sum / from.pixels()` is the mean.
///
/// `value(pixel, channel)` must be at most `2^17`: with images below `2^46` pixels nothing overflows.
fn area_sums<const C: usize>(
    from: Size,
    to: Size,
    value: impl Fn(usize) -> [u64; C],
    mut row_done: impl FnMut(usize, &[[u64; C]]),
) {
    let (w, h) = (u64::from(from.width), u64::from(from.height));
    let (tw, th) = (u64::from(to.width), u64::from(to.height));
    if w == 0 || h == 0 || tw == 0 || th == 0 {
        return;
    }
    let columns: Vec<(usize, usize, u64)> =
        (0..w).flat_map(|i| overlaps(i, w, tw).map(move |(j, share)| (i as usize, j, share))).collect();
    let mut acc = vec![[0_u64; C]; tw as usize];
    let mut row = vec![[0_u64; C]; tw as usize];
    let mut current = 0;
    for y in 0..h {
        row.fill([0; C]);
        let start = (y * w) as usize;
        for &(i, j, share) in &columns {
            let v = value(start + i);
            for c in 0..C {
                row[j][c] += share * v[c];
            }
        }
        for (j, share) in overlaps(y, h, th) {
            if j != current {
                row_done(current, &acc);
                acc.fill([0; C]);
                current = j;
            }
            for (a, r) in acc.iter_mut().zip(&row) {
                for c in 0..C {
                    a[c] += share * r[c];
                }
            }
        }
    }
    row_done(current, &acc);
}

fn divide_rounded(sum: u64, by: u64) -> u8 {
    // Means of 8-bit values are 8-bit values.
    ((sum + by / 2) / by).min(255) as u8
}

/// Bytes that scaling takes beside both images: shares of the columns and two rows of sums.
pub(crate) fn scaling_bytes(from_width: u32, to_width: u32) -> u64 {
    // Shares are collected into a list that grows by doubling.
    4096 + 2 * 24 * (u64::from(from_width) + u64::from(to_width)) * 3 / 2 + 2 * 32 * u64::from(to_width)
}

/// The image at another size, its mask with it.
pub(crate) fn resize(image: Image, width: u32, height: u32) -> Image {
    if (width, height) == (image.width, image.height) { image } else { scaled(&image, width, height) }
}

/// A new image of another size.
fn scaled(image: &Image, width: u32, height: u32) -> Image {
    let (from, to) = (image.size(), Size::new(width, height));
    let area = from.pixels();
    let pixels = width as usize * height as usize;
    let mut data = Vec::with_capacity(pixels * usize::from(image.channels));
    if image.channels == 4 {
        let at = |p: usize| {
            let v = &image.data[4 * p..4 * p + 4];
            let a = u64::from(v[3]);
            [u64::from(v[0]) * a, u64::from(v[1]) * a, u64::from(v[2]) * a, a]
        };
        area_sums(from, to, at, |_, row| {
            for s in row {
                let rgb = [s[0], s[1], s[2]].map(|c| if s[3] == 0 { 0 } else { divide_rounded(c, s[3]) });
                data.extend_from_slice(&rgb);
                data.push(divide_rounded(s[3], area));
            }
        });
    } else {
        let at = |p: usize| {
            let v = &image.data[3 * p..3 * p + 3];
            [u64::from(v[0]), u64::from(v[1]), u64::from(v[2])]
        };
        area_sums(from, to, at, |_, row| {
            for s in row {
                data.extend(s.map(|c| divide_rounded(c, area)));
            }
        });
    }
    let mask = image.mask.as_ref().map(|m| resize_mask(m, from, to));
    Image { width, height, channels: image.channels, data, mask }
}

/// A mask at another size: 255 where at least half of the covered area is used (`>= 128`), else 0.
pub(crate) fn resize_mask(mask: &[u8], from: Size, to: Size) -> Vec<u8> {
    let binary = |v: u8| if v >= 128 { 255 } else { 0 };
    if from == to {
        return mask.iter().map(|&v| binary(v)).collect();
    }
    let area = from.pixels();
    let mut out = Vec::with_capacity(to.width as usize * to.height as usize);
    area_sums(
        from,
        to,
        |p| [u64::from(mask[p] >= 128)],
        |_, row| {
            out.extend(row.iter().map(|s| if 2 * s[0] >= area { 255 } else { 0 }));
        },
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition: integrate the source over the target's area, premultiplied, in `f64`.
    fn naive(image: &Image, width: u32, height: u32) -> Vec<f64> {
        let (sx, sy) = (f64::from(image.width) / f64::from(width), f64::from(image.height) / f64::from(height));
        let channels = usize::from(image.channels);
        let mut out = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let (mut sum, mut alpha) = ([0.0; 3], 0.0);
                for v in 0..image.height {
                    for u in 0..image.width {
                        let cover = |i: u32, j: u32, s: f64| {
                            let (lo, hi) = (f64::from(j) * s, f64::from(j + 1) * s);
                            (hi.min(f64::from(i + 1)) - lo.max(f64::from(i))).max(0.0)
                        };
                        let weight = cover(u, x, sx) * cover(v, y, sy) / (sx * sy);
                        let pixel = image.pixel(u, v);
                        let a = if channels == 4 { f64::from(pixel[3]) / 255.0 } else { 1.0 };
                        alpha += weight * a;
                        for c in 0..3 {
                            sum[c] += weight * a * f64::from(pixel[c]);
                        }
                    }
                }
                out.extend(sum.map(|s| if alpha > 1e-12 { s / alpha } else { 0.0 }));
                if channels == 4 {
                    out.push(alpha * 255.0);
                }
            }
        }
        out
    }

    fn any_image() -> impl Strategy<Value = Image> {
        (1_u32..12, 1_u32..12, prop::bool::ANY).prop_flat_map(|(w, h, alpha)| {
            let channels: u8 = if alpha { 4 } else { 3 };
            let n = (w * h * u32::from(channels)) as usize;
            prop::collection::vec(prop_oneof![Just(0_u8), Just(255), any::<u8>()], n).prop_map(move |data| Image {
                width: w,
                height: h,
                channels,
                data,
                mask: None,
            })
        })
    }

    proptest! {
        #![proptest_config(testkit::property::cases(96))]

        #[test]
        fn resize_matches_naive(image in any_image(), w in 1_u32..9, h in 1_u32..9) {
            // At its own size an image is left alone, invisible colours included.
            prop_assume!((w, h) != (image.width, image.height));
            let want = naive(&image, w, h);
            let got = resize(image, w, h);
            prop_assert_eq!(got.data.len(), want.len());
            for (i, (&g, &e)) in got.data.iter().zip(&want).enumerate() {
                // Rounded to 8 bits: half a step, and the f64 twin's own rounding.
                prop_assert!((f64::from(g) - e).abs() <= 0.5 + 1e-6, "value {i}: {g} against {e}");
            }
        }

        #[test]
        fn constant_images_stay_constant(w in 1_u32..40, h in 1_u32..40, tw in 1_u32..40, th in 1_u32..40, v: [u8; 3]) {
            let image = Image::rgb(w, h, v.repeat((w * h) as usize)).unwrap();
            let small = resize(image, tw, th);
            prop_assert!(small.data.chunks(3).all(|p| p == v));
        }

        #[test]
        fn fitted_keeps_the_longest_side(w in 1_u32..5000, h in 1_u32..5000, longest in 1_u32..5000) {
            let Size { width: tw, height: th } = fitted(Size::new(w, h), Some(longest));
            prop_assert_eq!(tw.max(th), longest.min(w.max(h)));
            prop_assert!(tw >= 1 && th >= 1 && tw <= w && th <= h);
        }
    }

    #[test]
    fn integer_factors_give_the_exact_box_mean() {
        let image = Image::rgb(2, 2, vec![0, 10, 255, 1, 20, 255, 2, 30, 255, 4, 41, 254]).unwrap();
        // Means 1.75, 25.25, 254.75.
        assert_eq!(resize(image, 1, 1).data, [2, 25, 255]);
    }

    #[test]
    fn invisible_colours_do_not_bleed() {
        let image = Image::rgba(2, 1, vec![200, 100, 50, 255, 0, 255, 0, 0]).unwrap();
        assert_eq!(resize(image, 1, 1).data, [200, 100, 50, 128]);
    }

    #[test]
    fn masks_are_cut_at_one_half() {
        let mask = [255, 0, 0, 0, 255, 255, 127, 128];
        assert_eq!(resize_mask(&mask, Size::new(4, 2), Size::new(2, 1)), [255, 0]);
        assert_eq!(resize_mask(&mask, Size::new(4, 2), Size::new(4, 2)), [255, 0, 0, 0, 255, 255, 0, 255]);
        assert_eq!(resize_mask(&[255, 0], Size::new(2, 1), Size::new(4, 1)), [255, 255, 0, 0]);
    }
}
