//! What is worked out once, and kept until the networks change.

use super::fusion::ToneOf;
use crate::views::DrawnCloud;
use rayon::prelude::*;
use splat_core::Gaussians;

/// What was worked out since the networks last changed.
#[derive(Default)]
pub(crate) struct Cached {
    /// The code of the mean appearance.
    pub(crate) mean: Option<Vec<f32>>,
    /// Those of the last picture.
    pub(crate) tones: Option<CloudTones>,
}

/// The tones of all Gaussians of a cloud in one appearance.
pub(crate) struct CloudTones {
    pub(crate) code: Vec<f32>,
    /// Its [`fingerprint`].
    pub(crate) cloud: u64,
    pub(crate) tones: Vec<ToneOf>,
}

/// Tells clouds apart by what tones depend on.
pub(crate) fn fingerprint(cloud: &DrawnCloud<'_>) -> u64 {
    const FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;
    let mix = |sum: u64, x: u64| (sum ^ x).wrapping_mul(FACTOR).rotate_left(29);
    let of = |values: &[f32]| -> u64 {
        let chunks: Vec<u64> = values
            .par_chunks(1 << 14)
            .map(|chunk| chunk.iter().fold(chunk.len() as u64, |sum, x| mix(sum, x.to_bits().into())))
            .collect();
        chunks.into_iter().fold(0, mix)
    };
    let Gaussians { mean, dc, .. } = &cloud.gaussians;
    [of(mean), of(dc), of(cloud.extra)].into_iter().fold(cloud.gaussians.len() as u64, mix)
}
