//! Masks of what stands still, from clues: tracks of image features, errors of a half-trained model, segments of the photo.
//!
//! Letters: a mask is `[height][width]` bytes, rows top to bottom, any value but 0 = static (as in a mask file); written as 0
//! or 1. `h_sfm` static where feature tracks say so; `r` error of each pixel of a training view, from a model trained for a few
//! thousand steps; `h_cr` static where the error is at most its mean, `h_most` where it is at most its 0.95 quantile.
//!
//! 1. long tracks of [`points`] prompt segments, or discs: `h_sfm`;
//! 2. [`residual_masks`] give `h_cr` and `h_most`, which holds `h_cr`;
//! 3. [`combine`] them, `h = (h_sfm or h_cr) and h_most`;
//! 4. [`smooth`] over 7x7;
//! 5. [`vote`] by segment: one is static as a whole if half of it is;
//! 6. [`erode`] by 5x5, so that outlines err on the careful side.
//!
//! [`StaticMask`] is all of it. Everything is a function of one image. Tracks fail on what has no texture, errors on fine
//! texture and on what moves slowly past the model's patience: together they fail less. Errors of test views must not be used.
//! A model trained too long has fitted the occluders, one trained too little errs on texture.
//!
//! Source: Chen et al., "NeRF-HuGS: improved neural radiance fields in non-static scenes using heuristics-guided segmentation",
//! 2024, section 3, and as released.

mod component;
mod extent;
mod morphology;
pub mod points;
mod residual;
pub mod superpixels;
mod vote;

pub use component::take_component;
pub use extent::Extent;
pub use morphology::{ERODE_SIDE, GAP_SIDE, SMOOTH_SIDE, close, erode, fill_gaps, grow, smooth};
pub use residual::{MEAN_SLACK, combine, residual_masks};
pub use vote::{Segments, VoteScratch, vote};

use crate::LossError;
use alloc::vec::Vec;

/// The static mask of an image from its clues. `default()` is as published.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StaticMask {
    /// Errors above this share of the image's are never static, `[0, 1]`: 0.95.
    pub quantile: f32,
    /// Share of a segment that has to be static, `(0, 1]`: 0.5.
    pub share: f32,
    /// Side of the smoothing window, odd: 7; 1 is none.
    pub smooth: usize,
    /// Side of the erosion window, odd: 5; 1 is none.
    pub erode: usize,
}

impl Default for StaticMask {
    fn default() -> Self {
        Self { quantile: 0.95, share: 0.5, smooth: SMOOTH_SIDE, erode: ERODE_SIDE }
    }
}

/// Memory of [`StaticMask::run`], kept from image to image.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    errors: Vec<f32>,
    h_cr: Vec<u8>,
    h_most: Vec<u8>,
    rows: Vec<u32>,
    vote: VoteScratch,
}

impl StaticMask {
    float_core::setters! {
        with_quantile quantile: f32;
        with_share share: f32;
        with_smooth smooth: usize;
        with_erode erode: usize;
    }

    /// Steps 2 to 6.
    ///
    /// # Shapes and units
    /// * `h_sfm` mask; all 0 where the image has no tracks: errors alone decide
    /// * `r` `[height][width]` errors `>= 0`, any unit; NaN is never static by its error
    /// * `segments` of the photo
    /// * `out` mask, written
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for a parameter outside its range.
    pub fn run(
        &self,
        extent: Extent,
        h_sfm: &[u8],
        r: &[f32],
        segments: Segments<'_>,
        scratch: &mut Scratch,
        out: &mut [u8],
    ) -> Result<(), LossError> {
        extent.check("h_sfm", h_sfm.len())?;
        extent.check("r", r.len())?;
        extent.check("out", out.len())?;
        let Scratch { errors, h_cr, h_most, rows, vote: voting } = scratch;
        h_cr.clear();
        h_cr.resize(r.len(), 0);
        h_most.clear();
        h_most.resize(r.len(), 0);
        residual_masks(r, self.quantile, errors, h_cr, h_most)?;
        combine(h_sfm, h_cr, h_most, out)?;
        smooth(extent, self.smooth, out, rows, h_cr)?;
        vote(extent, segments, h_cr, self.share, voting, h_most)?;
        erode(extent, self.erode, h_most, rows, out)
    }
}
