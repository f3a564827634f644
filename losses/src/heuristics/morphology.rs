//! Windows over a mask: fill what is mostly static, shrink what is.

use super::extent::Extent;
use crate::LossError;
use alloc::vec;
use alloc::vec::Vec;

/// Window of [`smooth`].
pub const SMOOTH_SIDE: usize = 7;
/// Window of [`fill_gaps`].
pub const GAP_SIDE: usize = 5;
/// Window of [`erode`].
pub const ERODE_SIDE: usize = 5;

/// `mask or [mean of mask over side x side >= 1/2]`: never takes anything out.
///
/// Beyond the edge the picture is mirrored, without repeating the edge itself.
///
/// # Shapes and units
/// * `side` odd, pixels; usually [`SMOOTH_SIDE`]; 1 copies
/// * `mask` in, `out` written; `scratch` is kept by the caller
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an even side.
pub fn smooth(
    extent: Extent,
    side: usize,
    mask: &[u8],
    scratch: &mut Vec<u32>,
    out: &mut [u8],
) -> Result<(), LossError> {
    let half = check(extent, side, mask, out)?;
    counts(extent, half, mask, mirror, scratch);
    let area = (side * side) as u32;
    // Twice the count against the area: exact.
    let columns = columns(extent, half, mirror, scratch);
    for (i, out) in out.iter_mut().enumerate() {
        *out = u8::from(mask[i] != 0 || 2 * columns(i) >= area);
    }
    Ok(())
}

/// [`smooth`] with the window [`GAP_SIDE`], for unions of segments with slits between them.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn fill_gaps(extent: Extent, mask: &[u8], scratch: &mut Vec<u32>, out: &mut [u8]) -> Result<(), LossError> {
    smooth(extent, GAP_SIDE, mask, scratch, out)
}

/// Static where all of the window is. What lies beyond the edge doesn't count: the edge of a photo is not an outline.
///
/// # Shapes and units
/// As [`smooth`]; `side` usually [`ERODE_SIDE`].
///
/// # Errors
/// As [`smooth`].
pub fn erode(
    extent: Extent,
    side: usize,
    mask: &[u8],
    scratch: &mut Vec<u32>,
    out: &mut [u8],
) -> Result<(), LossError> {
    let half = check(extent, side, mask, out)?;
    counts(extent, half, mask, nearest, scratch);
    let area = (side * side) as u32;
    let columns = columns(extent, half, nearest, scratch);
    for (i, out) in out.iter_mut().enumerate() {
        *out = u8::from(columns(i) == area);
    }
    Ok(())
}

/// What is not static, closed: gaps of it narrower than `side` are taken for part of it. What lies beyond the edge doesn't
/// count.
///
/// # Shapes and units
/// As [`erode`].
///
/// # Errors
/// As [`erode`].
pub fn close(
    extent: Extent,
    side: usize,
    mask: &[u8],
    scratch: &mut Vec<u32>,
    out: &mut [u8],
) -> Result<(), LossError> {
    let mut wide = vec![0; mask.len()];
    erode(extent, side, mask, scratch, &mut wide)?;
    wide.iter_mut().for_each(|m| *m = u8::from(*m == 0));
    erode(extent, side, &wide, scratch, out)?;
    out.iter_mut().for_each(|m| *m = u8::from(*m == 0));
    Ok(())
}

/// What hangs together with what is not static, by side or corner, and errs by more than `threshold`, is not static either:
/// the weaker of two thresholds counts only beside the stronger one (hysteresis).
///
/// # Shapes and units
/// * `r` `[height][width]` errors, any unit; NaN is never grown into
/// * `mask` in and out
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn grow(extent: Extent, r: &[f32], threshold: f32, mask: &mut [u8]) -> Result<(), LossError> {
    extent.check("r", r.len())?;
    extent.check("mask", mask.len())?;
    let Extent { width, height } = extent;
    let mut open: Vec<usize> = (0..mask.len()).filter(|&i| mask[i] == 0).collect();
    while let Some(i) = open.pop() {
        let (x, y) = (i % width, i / width);
        for y in y.saturating_sub(1)..(y + 2).min(height) {
            for x in x.saturating_sub(1)..(x + 2).min(width) {
                let at = y * width + x;
                if mask[at] != 0 && r[at] > threshold {
                    mask[at] = 0;
                    open.push(at);
                }
            }
        }
    }
    Ok(())
}

/// Half the window.
fn check(extent: Extent, side: usize, mask: &[u8], out: &[u8]) -> Result<usize, LossError> {
    extent.check("mask", mask.len())?;
    extent.check("out", out.len())?;
    if side.is_multiple_of(2) {
        return Err(LossError::Parameter { what: "side of a window", value: side as f32, range: "an odd number" });
    }
    Ok(side / 2)
}

/// `scratch[y][x]`: static pixels of row `y` within `half` of column `x`.
fn counts(extent: Extent, half: usize, mask: &[u8], beyond: Beyond, scratch: &mut Vec<u32>) {
    scratch.clear();
    for row in mask.chunks_exact(extent.width.max(1)) {
        let at = |x: usize| u32::from(row[x] != 0);
        for x in 0..extent.width {
            scratch.push(window(x, half, extent.width, beyond).map(at).sum());
        }
    }
}

/// Sums of columns of row counts.
fn columns(extent: Extent, half: usize, beyond: Beyond, rows: &[u32]) -> impl Fn(usize) -> u32 {
    move |i| {
        let (y, x) = (i / extent.width, i % extent.width);
        window(y, half, extent.height, beyond).map(|y| rows[y * extent.width + x]).sum()
    }
}

/// Which of `n` places stands for the place `i`, that may lie beyond them.
type Beyond = fn(isize, usize) -> usize;

/// The places within `half` of `i`.
fn window(i: usize, half: usize, n: usize, beyond: Beyond) -> impl Iterator<Item = usize> {
    let (i, half) = (i as isize, half as isize);
    (i - half..=i + half).map(move |i| beyond(i, n))
}

/// Mirrored at the first and the last place, as often as needed.
fn mirror(i: isize, n: usize) -> usize {
    let period = 2 * (n as isize - 1);
    if period == 0 {
        return 0;
    }
    let i = i.rem_euclid(period);
    i.min(period - i) as usize
}

/// The first or the last place.
fn nearest(i: isize, n: usize) -> usize {
    i.clamp(0, n as isize - 1) as usize
}

#[cfg(test)]
mod tests {
    use super::{mirror, nearest};

    #[test]
    fn places_beyond_the_edge() {
        assert_eq!([-3, -1, 0, 3, 4, 6].map(|i| mirror(i, 4)), [3, 1, 0, 3, 2, 0]);
        assert_eq!([-7, -1, 0, 1, 9].map(|i| mirror(i, 1)), [0; 5]);
        assert_eq!([-2, 0, 1, 5].map(|i| mirror(i, 2)), [0, 0, 1, 1]);
        assert_eq!([-3, 0, 3, 9].map(|i| nearest(i, 4)), [0, 0, 3, 3]);
    }
}
