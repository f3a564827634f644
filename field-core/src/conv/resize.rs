//! Bilinear resampling of feature maps.

use super::{Extent, Size};
use crate::FieldError;
use crate::error::check_len;

/// Two neighbours and the share of the second.
#[derive(Clone, Copy)]
struct Tap {
    a: usize,
    b: usize,
    share: f32,
}

/// Where pixel `i` of `to` lies among `from`: centres are at `+ 0.5`, outside of the outermost centres their value holds.
fn tap(i: usize, from: usize, to: usize) -> Tap {
    let x = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, (from - 1) as f64);
    // Truncation is the floor: x is not negative.
    let a = x as usize;
    Tap { a, b: (a + 1).min(from - 1), share: (x - a as f64) as f32 }
}

fn check(size: Size, to: Extent) -> Result<(), FieldError> {
    for (what, n) in
        [("height", size.height), ("width", size.width), ("new height", to.height), ("new width", to.width)]
    {
        if n == 0 {
            return Err(FieldError::Config { what, got: 0.0, accepts: "at least 1" });
        }
    }
    Ok(())
}

/// Resample maps to another extent, bilinearly between pixel centres (at `+ 0.5`); no smoothing when shrinking.
///
/// # Shapes
/// * `x` `[images][channels][height][width]`, `y` `[images][channels][to.height][to.width]`: written
///
/// # Errors
/// [`FieldError::Shape`] for other lengths, [`FieldError::Config`] for a side of 0.
///
/// # Panics
/// May do so where a product of the extents does not fit `usize`.
pub fn resize(x: &[f32], channels: usize, size: Size, to: Extent, y: &mut [f32]) -> Result<(), FieldError> {
    check(size, to)?;
    check_len("x", x.len(), size.len(channels))?;
    check_len("y", y.len(), size.with_extent(to).len(channels))?;
    for (map, y) in y.chunks_exact_mut(to.len()).enumerate() {
        let x = &x[map * size.pixels()..][..size.pixels()];
        for (i, row) in y.chunks_exact_mut(to.width).enumerate() {
            let v = tap(i, size.height, to.height);
            let (top, bottom) = (&x[v.a * size.width..][..size.width], &x[v.b * size.width..][..size.width]);
            for (j, y) in row.iter_mut().enumerate() {
                let h = tap(j, size.width, to.width);
                let line = |row: &[f32]| row[h.a] + h.share * (row[h.b] - row[h.a]);
                let (top, bottom) = (line(top), line(bottom));
                *y = top + v.share * (bottom - top);
            }
        }
    }
    Ok(())
}

/// Gradient of [`resize`]: adds into `x_bar`.
///
/// # Errors
/// As [`resize`].
///
/// # Panics
/// As [`resize`].
pub fn resize_backward(
    y_bar: &[f32],
    channels: usize,
    size: Size,
    to: Extent,
    x_bar: &mut [f32],
) -> Result<(), FieldError> {
    check(size, to)?;
    check_len("x_bar", x_bar.len(), size.len(channels))?;
    check_len("y_bar", y_bar.len(), size.with_extent(to).len(channels))?;
    for (map, bars) in y_bar.chunks_exact(to.len()).enumerate() {
        let x_bar = &mut x_bar[map * size.pixels()..][..size.pixels()];
        for (i, row) in bars.chunks_exact(to.width).enumerate() {
            let v = tap(i, size.height, to.height);
            for (j, bar) in row.iter().enumerate() {
                let h = tap(j, size.width, to.width);
                for (y, share) in [(v.a, 1.0 - v.share), (v.b, v.share)] {
                    let bar = share * bar;
                    x_bar[y * size.width + h.a] += (1.0 - h.share) * bar;
                    x_bar[y * size.width + h.b] += h.share * bar;
                }
            }
        }
    }
    Ok(())
}
