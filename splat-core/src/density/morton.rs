//! Morton order: neighbours in space become neighbours in memory.

use alloc::vec::Vec;

use super::Rows;
use super::rows::countable;
use crate::{Gaussians, SplatError};

/// Bits per coordinate.
const BITS: u32 = 16;

/// The rows sorted along a Morton curve (the interleaved bits of the three coordinates), ties by index.
///
/// The Gaussians of one tile are then close together in memory, and threads share fewer cache lines. Pictures do not change. Positions
/// that are not finite come last.
///
/// # Errors
/// [`SplatError::Shape`], [`SplatError::TooMany`].
pub fn morton_order(cloud: &Gaussians) -> Result<Rows, SplatError> {
    cloud.check()?;
    let n = cloud.len();
    countable(n)?;
    let row = |axis: usize| &cloud.mean[axis * n..][..n];
    let bounds = [0, 1, 2].map(|axis| {
        let finite = row(axis).iter().filter(|x| x.is_finite());
        finite.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &x| [low.min(x), high.max(x)])
    });
    let cell = |axis: usize, i: usize| {
        let ([low, high], x) = (bounds[axis], row(axis)[i]);
        // Halves, since the difference of two finite numbers may overflow.
        let fraction = (0.5 * x - 0.5 * low) / (0.5 * high - 0.5 * low);
        if fraction.is_finite() { (fraction * ((1 << BITS) - 1) as f32) as u64 } else { 0 }
    };
    let key = |i: usize| {
        if (0..3).any(|axis| !row(axis)[i].is_finite()) {
            return u64::MAX;
        }
        let cells = [0, 1, 2].map(|axis| cell(axis, i));
        (0..BITS).rev().fold(0, |key, bit| cells.iter().fold(key, |key, cell| key << 1 | (cell >> bit & 1)))
    };
    let mut order: Vec<(u64, u32)> = (0..n).map(|i| (key(i), i as u32)).collect();
    order.sort_unstable();
    Ok(Rows::of(n, order.into_iter().map(|(_, i)| (i, false))))
}
