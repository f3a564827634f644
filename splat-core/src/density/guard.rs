//! Limits on a cloud: number of Gaussians, finite values, ranges.

use alloc::vec::Vec;

use float_core::m64;
use float_core::rng::Rng;

use super::Rows;
use super::rows::countable;
use crate::chunks::for_each;
use crate::{Gaussians, SplatError};

/// Smallest logarithm of a scale: below it, only the blur of a pixel would show.
pub const LOG_SCALE_MIN: f32 = -20.0;
/// Largest absolute logit: opacities stay 1e-6 from 0 and 1, so that their gradient does not vanish.
pub const LOGIT_MAX: f32 = 13.8;
/// Rows per task.
const CHUNK: usize = 4096;

/// Keep the `max` most opaque Gaussians, in their order.
///
/// Ties are broken at random: at the start all points of a scene have the same opacity, and the first rows are often one corner of it.
///
/// # Errors
/// [`SplatError::Shape`], [`SplatError::TooMany`].
pub fn keep_strongest(cloud: &Gaussians, max: usize, rng: Rng) -> Result<Rows, SplatError> {
    cloud.check()?;
    let n = cloud.len();
    if n <= max {
        return Rows::unchanged(n);
    }
    countable(n)?;
    // NaN counts as the most transparent; -0 and 0 are equal.
    let strength =
        |i: u32| if cloud.logit[i as usize].is_nan() { f32::NEG_INFINITY } else { cloud.logit[i as usize] + 0.0 };
    let mut order: Vec<_> = (0..n as u32).map(|i| (strength(i), rng.u64_at(u64::from(i)), i)).collect();
    order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut kept: Vec<u32> = order[..max].iter().map(|&(_, _, i)| i).collect();
    kept.sort_unstable();
    Ok(Rows::of(n, kept.into_iter().map(|i| (i, false))))
}

/// Remove Gaussians with a parameter that is not finite. `None` if there are none.
///
/// # Errors
/// [`SplatError::Shape`], [`SplatError::TooMany`].
pub fn without_non_finite(cloud: &Gaussians) -> Result<Option<Rows>, SplatError> {
    cloud.check()?;
    let n = cloud.len();
    let mut bad: Vec<Vec<usize>> = alloc::vec![Vec::new(); n.div_ceil(CHUNK)];
    for_each(&mut bad, |k, bad| {
        let (from, to) = (k * CHUNK, ((k + 1) * CHUNK).min(n));
        for (_, field) in cloud.fields() {
            for row in field.chunks_exact(n) {
                let part = &row[from..to];
                // 0 x is 0 only for finite x: one sum without branches finds the rows to search.
                if part.iter().map(|x| 0.0 * x).sum::<f32>() != 0.0 {
                    bad.extend((from..to).filter(|&i| !row[i].is_finite()));
                }
            }
        }
        bad.sort_unstable();
        bad.dedup();
    });
    let mut bad = bad.into_iter().flatten().peekable();
    if bad.peek().is_none() {
        return Ok(None);
    }
    let gone: Vec<usize> = bad.collect();
    Rows::keep(n, |i| gone.binary_search(&i).is_err()).map(Some)
}

/// Clamp scales to `exp(`[`LOG_SCALE_MIN`]`)` and ten times the scene's extent (world units), and logits to `±`[`LOGIT_MAX`]. NaN stays
/// NaN: see [`without_non_finite`].
///
/// # Errors
/// [`SplatError::Value`] for an extent that is not a positive number, [`SplatError::Shape`].
pub fn keep_in_range(cloud: &mut Gaussians, extent: f64) -> Result<(), SplatError> {
    cloud.check()?;
    if !(extent > 0.0 && extent.is_finite()) {
        return Err(SplatError::Value { what: "extent", got: extent, accepts: "a positive distance" });
    }
    let most = (m64::ln(10.0 * extent) as f32).max(LOG_SCALE_MIN);
    for x in &mut cloud.log_scale {
        *x = x.clamp(LOG_SCALE_MIN, most);
    }
    for x in &mut cloud.logit {
        *x = x.clamp(-LOGIT_MAX, LOGIT_MAX);
    }
    Ok(())
}
