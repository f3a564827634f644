//! What kinds of appearance from a reference photo differ in: what is made of the photo, and where Gaussians read it.

use super::reference::Reference;
use super::sampling::{Tap, Texels};
use crate::views::DrawnCloud;
use field_core::rng::Rng;
use std::ops::Range;

/// Makes the code of a photo: maps, then other numbers.
pub(crate) trait PhotoCode: Send + Sync {
    /// Names in checkpoints: of its parameters, of those of the network of tones, of the photos.
    const NAMES: [&'static str; 3];
    /// Whether depths of what a photo shows are part of the reference.
    const READS_DEPTH: bool;
    /// What the way back needs.
    type Memory: Default + Send + Sync;

    /// Numbers of a code.
    fn code_len(&self) -> usize;

    /// Parameters at the start.
    fn init(&self, rng: Rng) -> Vec<f32>;

    /// The code of a photo.
    fn forward(&self, params: &[f32], reference: &Reference, memory: &mut Self::Memory) -> Vec<f32>;

    /// After [`forward`](Self::forward): the gradient with respect to the parameters, from that with respect to the code.
    fn backward(&self, params: &[f32], code_bar: &[f32], memory: &mut Self::Memory) -> Vec<f32>;

    /// Numbers that a memory holds of a photo.
    fn memory_len(&self) -> usize;

    /// A code as Gaussians read it.
    ///
    /// # Panics
    /// For a code of another length: it is of another system.
    fn reading<'a>(&'a self, code: &'a [f32]) -> Reading<'a>;

    /// Whether a step of the schedule reads depths.
    fn depth_from(&self) -> u64 {
        0
    }

    /// Add what extra rows of a cloud cost by themselves to their gradient.
    fn regularise(&self, _cloud: &DrawnCloud<'_>, _extra_bar: &mut [f32]) {}
}

/// How features of several maps become those of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Joined {
    Beside,
    Sum,
}

/// A code, to be read.
pub(crate) struct Reading<'a> {
    pub(crate) code: &'a [f32],
    /// Its first numbers.
    pub(crate) texels: Texels,
    pub(crate) joined: Joined,
    pub(crate) places: Box<dyn Places + 'a>,
    /// Numbers of the photo as a whole, the same for all Gaussians: where they lie in the code.
    pub(crate) whole: Range<usize>,
}

impl Reading<'_> {
    /// Numbers that a Gaussian reads in maps.
    pub(crate) fn features(&self) -> usize {
        match self.joined {
            Joined::Beside => self.texels.maps() * self.texels.channels(),
            Joined::Sum => self.texels.channels(),
        }
    }
}

/// Where Gaussians read maps.
pub(crate) trait Places: Send + Sync {
    /// Where Gaussian `i` reads map `map`, of a side; `None`: nowhere, it has zeros.
    fn tap(&self, cloud: &DrawnCloud<'_>, i: usize, map: usize, side: usize) -> Option<Tap>;

    /// The first of two extra rows of a cloud that hold its coordinates in a map, where it learns them.
    fn learnt_rows(&self, _map: usize) -> Option<usize> {
        None
    }
}
