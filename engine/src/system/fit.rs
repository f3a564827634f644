//! Pixels that an appearance is fitted to.

use crate::halt::Halt;
use render_core::ray::Ray;

/// Pixels an appearance is fitted to.
#[derive(Clone, Copy, Debug)]
pub struct Fit<'a> {
    /// Rays in the scene's frame.
    pub rays: &'a [Ray],
    /// Their colours, on the background.
    pub rgb: &'a [[f32; 3]],
    /// When the photo was taken, `0..=1`. Systems of scenes that stand still know one time only.
    pub time: f64,
    /// What is behind the scene.
    pub background: [f32; 3],
    /// Steps of the fit.
    pub steps: u64,
    /// Learning rate at the start; a tenth of it after each third.
    pub lr: f64,
    /// Seed of the pixels of each step.
    pub seed: u64,
    /// Ends the fit early, with the code as it is.
    pub halt: &'a Halt,
}

impl Fit<'_> {
    /// Bytes of samples that a fit keeps at most, about.
    const KEPT_BYTES: usize = 1 << 26;

    /// The samples along at most `pixels` of the rays, `numbers` of four bytes each. Where mist has samples everywhere, a fit keeps
    /// those of fewer rays. `keep(every, most)` keeps the samples of every `every`-th ray, or gives `None` where these are more than
    /// `most`; of one ray it must keep them.
    pub fn keep<K>(&self, pixels: usize, numbers: usize, keep: impl Fn(usize, usize) -> Option<K>) -> K {
        let most = Self::KEPT_BYTES / (4 * numbers);
        let mut every = self.rays.len().div_ceil(pixels).max(1);
        loop {
            match keep(every, most) {
                Some(kept) => return kept,
                None => every *= 2,
            }
        }
    }
}
