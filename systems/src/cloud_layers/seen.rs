//! Both clouds as a photo's camera sees them, and what a cost says of that.

use super::composite::{Composed, ComposedBar};
use crate::views::RenderedPicture;

/// Both clouds as a photo's camera sees them.
pub(super) struct Seen<'a> {
    pub(super) composed: &'a [Composed],
    pub(super) behind: RenderedPicture<'a>,
    /// `None`: it has not begun.
    pub(super) front: Option<RenderedPicture<'a>>,
}

/// Gradients of a part of the cost.
#[derive(Clone, Debug, Default)]
pub(super) struct CostBars {
    /// `[pixels]`
    pub(super) composed: Vec<ComposedBar>,
    /// `[pixels]`, with respect to the composited depths, and to the transmittance of the front.
    pub(super) behind_depth: Vec<f32>,
    pub(super) front_depth: Vec<f32>,
    pub(super) front_transmittance: Vec<f32>,
}

impl CostBars {
    pub(super) fn begin(&mut self, pixels: usize) {
        self.composed.clear();
        self.composed.resize(pixels, ComposedBar::default());
        for plane in [&mut self.behind_depth, &mut self.front_depth, &mut self.front_transmittance] {
            plane.clear();
            plane.resize(pixels, 0.0);
        }
    }

    /// Add those of another part.
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, more) in self.composed.iter_mut().zip(&other.composed) {
            for c in 0..3 {
                sum.colour[c] += more.colour[c];
                sum.front[c] += more.front[c];
                sum.behind[c] += more.behind[c];
            }
            sum.share += more.share;
            sum.brightness += more.brightness;
        }
        let planes = [
            (&mut self.behind_depth, &other.behind_depth),
            (&mut self.front_depth, &other.front_depth),
            (&mut self.front_transmittance, &other.front_transmittance),
        ];
        for (sum, more) in planes {
            sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        }
    }
}

/// Gradients of both parts of the cost, to be added to.
pub(super) struct PartBars<'a> {
    /// Of what says where Gaussians are needed.
    pub(super) main: &'a mut CostBars,
    /// Of the rest.
    pub(super) utility: &'a mut CostBars,
}
