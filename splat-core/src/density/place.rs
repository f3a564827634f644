//! Neighbours in space as neighbours in memory.

use alloc::vec::Vec;

use super::Rows;
use super::rows::countable;
use crate::{Gaussians, SplatError};

/// Bits of a coordinate on the curve.
const BITS: u32 = 16;

/// The rows along a curve through space (that of Morton: the bits of three coordinates in turn), equal places in their order.
///
/// A tile of a picture shows what lies together: then it finds that together in memory, too, and threads wait less for each other's
/// cache lines. Nothing that is drawn depends on it. Positions that are not finite come last.
///
/// # Errors
/// [`SplatError::Shape`], [`SplatError::TooMany`].
pub fn by_place(cloud: &Gaussians) -> Result<Rows, SplatError> {
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
        // Halves: the difference of two finite numbers may not be one.
        let share = (0.5 * x - 0.5 * low) / (0.5 * high - 0.5 * low);
        if share.is_finite() { (share * ((1 << BITS) - 1) as f32) as u64 } else { 0 }
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
