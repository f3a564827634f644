//! Pooling.

use super::{Extent, Size};
use crate::FieldError;
use crate::error::check_len;
use core::ops::Range;

/// Mean of each channel of each image.
///
/// # Shapes
/// * `x` `[images][channels][height][width]`, `y` `[images][channels]`: written
///
/// # Errors
/// [`FieldError::Shape`] for other lengths, [`FieldError::Config`] for images without pixels.
///
/// # Panics
/// May do so where a product of the extents does not fit `usize`.
pub fn global_mean(x: &[f32], channels: usize, size: Size, y: &mut [f32]) -> Result<(), FieldError> {
    adaptive_mean(x, channels, size, Extent::new(1, 1), y)
}

/// Gradient of [`global_mean`]: adds into `x_bar`.
///
/// # Errors
/// As [`global_mean`].
///
/// # Panics
/// As [`global_mean`].
pub fn global_mean_backward(y_bar: &[f32], channels: usize, size: Size, x_bar: &mut [f32]) -> Result<(), FieldError> {
    adaptive_mean_backward(y_bar, channels, size, Extent::new(1, 1), x_bar)
}

/// Extent of what [`max_pool`] makes: halves, rounded down.
#[must_use]
pub const fn max_pool_size(size: Size) -> Size {
    Size { images: size.images, height: size.height / 2, width: size.width / 2 }
}

/// Largest of every 2 x 2 pixels, step 2. A last odd row or column is left out.
///
/// # Shapes
/// * `x` `[images][channels][height][width]`, `y` the same of extent [`max_pool_size`]: written
///
/// # Errors
/// [`FieldError::Shape`] for other lengths.
///
/// # Panics
/// May do so where a product of the extents does not fit `usize`.
pub fn max_pool(x: &[f32], channels: usize, size: Size, y: &mut [f32]) -> Result<(), FieldError> {
    let to = check_max_pool(x.len(), "x", y.len(), "y", channels, size)?;
    for (map, y) in y.chunks_mut(to.pixels().max(1)).enumerate() {
        for (i, y) in y.iter_mut().enumerate() {
            *y = x[largest(x, map * size.pixels(), size.width, i / to.width, i % to.width)];
        }
    }
    Ok(())
}

/// Gradient of [`max_pool`]: adds to the pixel that was largest, the first one where several are.
///
/// # Errors
/// As [`max_pool`].
///
/// # Panics
/// As [`max_pool`].
pub fn max_pool_backward(
    x: &[f32],
    channels: usize,
    size: Size,
    y_bar: &[f32],
    x_bar: &mut [f32],
) -> Result<(), FieldError> {
    let to = check_max_pool(x.len(), "x", y_bar.len(), "y_bar", channels, size)?;
    check_len("x_bar", x_bar.len(), x.len())?;
    for (map, bars) in y_bar.chunks(to.pixels().max(1)).enumerate() {
        for (i, bar) in bars.iter().enumerate() {
            x_bar[largest(x, map * size.pixels(), size.width, i / to.width, i % to.width)] += bar;
        }
    }
    Ok(())
}

fn check_max_pool(
    x: usize,
    what_x: &'static str,
    y: usize,
    what_y: &'static str,
    channels: usize,
    size: Size,
) -> Result<Size, FieldError> {
    let to = max_pool_size(size);
    check_len(what_x, x, size.len(channels))?;
    check_len(what_y, y, to.len(channels))?;
    Ok(to)
}

/// Index of the largest of the four pixels that become pixel `(i, j)` of a map.
fn largest(x: &[f32], map: usize, width: usize, i: usize, j: usize) -> usize {
    let first = map + 2 * i * width + 2 * j;
    let mut best = first;
    for at in [first + 1, first + width, first + width + 1] {
        if x[at] > x[best] {
            best = at;
        }
    }
    best
}

/// Mean over the cells of a grid of any size: cell `i` of `n` covers the pixels `floor(i H / n) .. ceil((i + 1) H / n)`, so
/// neighbours share a pixel where the sizes do not divide.
///
/// # Shapes
/// * `x` `[images][channels][height][width]`, `y` `[images][channels][cells.height][cells.width]`: written
///
/// # Errors
/// [`FieldError::Shape`] for other lengths, [`FieldError::Config`] for images without pixels or a grid without cells.
///
/// # Panics
/// May do so where a product of the extents does not fit `usize`.
pub fn adaptive_mean(x: &[f32], channels: usize, size: Size, cells: Extent, y: &mut [f32]) -> Result<(), FieldError> {
    check_adaptive(size, cells)?;
    check_len("x", x.len(), size.len(channels))?;
    check_len("y", y.len(), size.with_extent(cells).len(channels))?;
    for (map, y) in y.chunks_exact_mut(cells.len()).enumerate() {
        let x = &x[map * size.pixels()..];
        for (i, y) in y.iter_mut().enumerate() {
            let cell = Cell::new(size, cells, i);
            // In f64: a map of a million pixels keeps its digits.
            *y = (cell.rows().flat_map(|row| &x[row]).map(|&x| f64::from(x)).sum::<f64>() * cell.share()) as f32;
        }
    }
    Ok(())
}

/// Gradient of [`adaptive_mean`]: adds into `x_bar`.
///
/// # Errors
/// As [`adaptive_mean`].
///
/// # Panics
/// As [`adaptive_mean`].
pub fn adaptive_mean_backward(
    y_bar: &[f32],
    channels: usize,
    size: Size,
    cells: Extent,
    x_bar: &mut [f32],
) -> Result<(), FieldError> {
    check_adaptive(size, cells)?;
    check_len("x_bar", x_bar.len(), size.len(channels))?;
    check_len("y_bar", y_bar.len(), size.with_extent(cells).len(channels))?;
    for (map, bars) in y_bar.chunks_exact(cells.len()).enumerate() {
        let x_bar = &mut x_bar[map * size.pixels()..];
        for (i, &bar) in bars.iter().enumerate() {
            let cell = Cell::new(size, cells, i);
            let each = (f64::from(bar) * cell.share()) as f32;
            for row in cell.rows() {
                x_bar[row].iter_mut().for_each(|x| *x += each);
            }
        }
    }
    Ok(())
}

fn check_adaptive(size: Size, cells: Extent) -> Result<(), FieldError> {
    for (what, n) in [("height", size.height), ("width", size.width), ("cells", cells.len())] {
        if n == 0 {
            return Err(FieldError::Config { what, got: 0.0, accepts: "at least 1" });
        }
    }
    Ok(())
}

/// The pixels of one cell.
struct Cell {
    y: Range<usize>,
    x: Range<usize>,
    width: usize,
}

impl Cell {
    fn new(size: Size, cells: Extent, i: usize) -> Self {
        let span = |i: usize, n: usize, pixels: usize| i * pixels / n..((i + 1) * pixels).div_ceil(n);
        Self {
            y: span(i / cells.width, cells.height, size.height),
            x: span(i % cells.width, cells.width, size.width),
            width: size.width,
        }
    }

    fn rows(&self) -> impl Iterator<Item = Range<usize>> {
        self.y.clone().map(|y| y * self.width + self.x.start..y * self.width + self.x.end)
    }

    fn share(&self) -> f64 {
        1.0 / (self.y.len() * self.x.len()) as f64
    }
}
