//! Which pixels to cast rays through, where tools hide a part of every frame.
//!
//! Letters: `M_i` the mask of frame `i`, 1 on tissue; `K` how often a pixel is hidden, over all frames; `V_i` the importance
//! of the pixels of frame `i`.
//!
//! ```text
//! P = K / |K|,  K = sum_i (1 - M_i)          V_i = M_i (1 + P)
//! ```
//!
//! A pixel under a tool has importance exactly 0 and is never drawn (the released code leaves it a little). Tissue that is
//! often hidden is drawn more often while it can be seen. Where no tool ever appears, `|K| = 0` and `P = 0`.
//!
//! Memory: one number a pixel for the whole sequence, and one for every [`BLOCK`] pixels of each frame.
//!
//! Source: Wang et al., "Neural rendering for stereo 3D reconstruction of deformable tissues in robotic surgery"
//! (EndoNeRF), 2022, mask-guided ray casting.

use crate::error::{RenderError, check_len};
use alloc::vec;
use alloc::vec::Vec;
use float_core::m64;

/// Pixels under one number of a [`Sampler`].
pub const BLOCK: usize = 64;

/// How often each pixel is hidden in a sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenCounts {
    counts: Vec<u32>,
}

impl HiddenCounts {
    /// Of no frames yet, over pictures of `pixels` pixels.
    ///
    /// # Panics
    /// If there is no memory for `pixels` numbers.
    #[must_use]
    pub fn new(pixels: usize) -> Self {
        Self { counts: vec![0; pixels] }
    }

    /// Count one frame. `mask` `[pixels]`, 0 = hidden by a tool, anything else = seen. The order of frames does not
    /// matter.
    ///
    /// # Errors
    /// [`RenderError::Shape`] where the picture has another size.
    pub fn add(&mut self, mask: &[u8]) -> Result<(), RenderError> {
        check_len("mask", self.counts.len(), mask.len())?;
        for (count, &m) in self.counts.iter_mut().zip(mask) {
            *count += u32::from(m == 0);
        }
        Ok(())
    }

    /// Frames that hide each pixel, `[pixels]`.
    #[must_use]
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// `1 + P`: what a pixel counts where it is seen, `[pixels]`, in `[1, 2]`.
    #[must_use]
    pub fn boost(&self) -> Vec<f32> {
        let squares: f64 = self.counts.iter().map(|&c| f64::from(c) * f64::from(c)).sum();
        // No tool anywhere: K / |K| would be 0/0.
        let scale = if squares > 0.0 { 1.0 / m64::sqrt(squares) } else { 0.0 };
        self.counts.iter().map(|&c| (1.0 + f64::from(c) * scale) as f32).collect()
    }
}

/// The importance `V` of the pixels of one frame.
///
/// # Shapes and units
/// * `boost` `[n]` from [`HiddenCounts::boost`]; `mask` `[n]`, 0 = hidden
/// * `out` `[n]`, written: exactly 0 where hidden
///
/// # Errors
/// [`RenderError::Shape`] where lengths disagree.
pub fn importance(boost: &[f32], mask: &[u8], out: &mut [f32]) -> Result<(), RenderError> {
    check_len("mask", boost.len(), mask.len())?;
    check_len("out", boost.len(), out.len())?;
    for ((out, &m), &b) in out.iter_mut().zip(mask).zip(boost) {
        *out = if m == 0 { 0.0 } else { b };
    }
    Ok(())
}

/// Draws indices with probabilities proportional to weights, without storing a number for each: the weights are asked for
/// again when an index is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampler {
    /// Sum of all weights up to the end of each block.
    ends: Vec<f64>,
    len: usize,
}

impl Sampler {
    /// Over `len` weights, each finite and `>= 0`.
    ///
    /// # Errors
    /// [`RenderError::NonFinite`] for a weight that is negative, NaN or infinite.
    pub fn new(len: usize, weight: impl Fn(usize) -> f32) -> Result<Self, RenderError> {
        let mut ends = Vec::with_capacity(len.div_ceil(BLOCK));
        let mut sum = 0.0;
        for i in 0..len {
            let w = weight(i);
            if !(w >= 0.0 && w.is_finite()) {
                return Err(RenderError::NonFinite { what: "weight", index: i });
            }
            sum += f64::from(w);
            if (i + 1) % BLOCK == 0 || i + 1 == len {
                ends.push(sum);
            }
        }
        Ok(Self { ends, len })
    }

    /// Over the pixels of one frame: [`importance`] without the map.
    ///
    /// # Errors
    /// As [`Sampler::new`]; [`RenderError::Shape`] where lengths disagree.
    pub fn of_frame(boost: &[f32], mask: &[u8]) -> Result<Self, RenderError> {
        check_len("mask", boost.len(), mask.len())?;
        Self::new(boost.len(), |i| if mask[i] == 0 { 0.0 } else { boost[i] })
    }

    /// Sum of all weights: 0 where nothing can be drawn.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }

    /// The index where the running sum of weights passes the share `u` of their total: a step function of `u` in `[0, 1)`,
    /// non-decreasing. Never one of weight 0; `None` where all weights are 0. `weight` answers as it did for
    /// [`Sampler::new`].
    #[must_use]
    pub fn draw(&self, u: f64, weight: impl Fn(usize) -> f32) -> Option<usize> {
        let total = self.total();
        if total <= 0.0 {
            return None;
        }
        // Below the total even for u = 1: the last index with weight passes it.
        let target = (u * total).max(0.0).min(total.next_down());
        let block = self.ends.partition_point(|&end| end <= target).min(self.ends.len() - 1);
        let mut sum = if block == 0 { 0.0 } else { self.ends[block - 1] };
        let start = block * BLOCK;
        let mut last = None;
        for i in start..(start + BLOCK).min(self.len) {
            let w = weight(i);
            if w > 0.0 {
                sum += f64::from(w);
                last = Some(i);
                // The same additions in the same order as in `new`: the block's end is reached, hence `target` passed.
                if sum > target {
                    break;
                }
            }
        }
        last
    }

    /// [`Sampler::draw`] from the pixels of one frame, which [`Sampler::of_frame`] was made of.
    ///
    /// # Panics
    /// If `boost` or `mask` is shorter than that.
    #[must_use]
    pub fn draw_pixel(&self, u: f64, boost: &[f32], mask: &[u8]) -> Option<usize> {
        self.draw(u, |i| if mask[i] == 0 { 0.0 } else { boost[i] })
    }
}
