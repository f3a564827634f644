//! The largest size near cameras.

use alloc::vec::Vec;

use float_core::m32;

use super::guard::LOG_SCALE_MIN;
use crate::chunks::for_each;
use crate::{Gaussians, SplatError};

/// Rows per task.
const CHUNK: usize = 1024;

/// No Gaussian is large beside a camera: no standard deviation is above
///
/// ```text
/// max(least, part distance to the nearest camera)
/// ```
///
/// A Gaussian is drawn by the projection's derivative at its centre, which holds as far as it is small against its depth. A large one
/// beside a camera looks right from the photos that it has learnt, and lies like fog over a picture from anywhere else.
///
/// With `f32` positions of the frame of the cloud, as cameras and distances are. What is not finite stays as it is: see
/// [`without_non_finite`](super::without_non_finite). Without cameras nothing is too large.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SizeLimit {
    /// Part of the distance to the nearest camera.
    pub part: f32,
    /// What is no larger than this may be anywhere.
    pub least: f32,
}

impl SizeLimit {
    /// Three standard deviations reach nine tenths of the way to the nearest camera; a hundredth of a frame's unit may be anywhere.
    pub const DEFAULT: Self = Self { part: 0.3, least: 0.01 };

    float_core::setters! {
        with_part part: f32;
        with_least least: f32;
    }

    /// Whether every setting lies in its range.
    ///
    /// # Errors
    /// [`SplatError::Value`] naming the first setting outside its range.
    pub fn check(&self) -> Result<(), SplatError> {
        for (what, got) in [("part", self.part), ("least", self.least)] {
            if !(got > 0.0 && got.is_finite()) {
                return Err(SplatError::Value { what, got: got.into(), accepts: "a positive number" });
            }
        }
        Ok(())
    }

    /// Lower the standard deviations that are above the limit to it. Returns how many Gaussians were too large.
    ///
    /// # Errors
    /// [`SplatError`] for settings out of range or fields of the wrong length.
    pub fn keep(&self, cloud: &mut Gaussians, cameras: &[[f32; 3]]) -> Result<usize, SplatError> {
        self.check()?;
        cloud.check()?;
        let n = cloud.len();
        let least = m32::ln(self.least);
        let (mean, log_scale) = (&cloud.mean, &cloud.log_scale);
        // Row and limit of each that is too large.
        let mut parts: Vec<Vec<(usize, f32)>> = alloc::vec![Vec::new(); n.div_ceil(CHUNK)];
        for_each(&mut parts, |k, part| {
            for i in k * CHUNK..((k + 1) * CHUNK).min(n) {
                let largest = (0..3).map(|axis| log_scale[axis * n + i]).fold(f32::NEG_INFINITY, f32::max);
                if largest > least {
                    let square = nearest(core::array::from_fn(|axis| mean[axis * n + i]), cameras);
                    let limit = m32::ln(self.part * m32::sqrt(square)).max(least).max(LOG_SCALE_MIN);
                    if largest > limit {
                        part.push((i, limit));
                    }
                }
            }
        });
        let mut count = 0;
        for &(i, limit) in parts.iter().flatten() {
            count += 1;
            for axis in 0..3 {
                let x = &mut cloud.log_scale[axis * n + i];
                // Not `min`, which would replace NaN.
                if *x > limit {
                    *x = limit;
                }
            }
        }
        Ok(count)
    }
}

impl Default for SizeLimit {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Squared distance to the nearest camera; infinite without one, or from what is not finite.
fn nearest(x: [f32; 3], cameras: &[[f32; 3]]) -> f32 {
    let square = |c: &[f32; 3]| (0..3).map(|axis| (x[axis] - c[axis]) * (x[axis] - c[axis])).sum::<f32>();
    cameras.iter().map(square).fold(f32::INFINITY, f32::min)
}
