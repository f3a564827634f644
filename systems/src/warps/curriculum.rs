//! Views that come in one after the other, in the order of time.

use super::Times;

/// Views that a curriculum begins with.
const LEAST: usize = 3;

/// The first views in time come first (D-NeRF, section 4.2: the canonical scene is learnt before what is far from it).
#[derive(Clone, Debug)]
pub(crate) struct Curriculum {
    /// Steps after which all training views have come in; 0: they are there from the start.
    pub(super) steps: u64,
    /// Training views in the order of time.
    order: Vec<u32>,
}

impl Curriculum {
    /// All views from the start.
    pub(super) fn new(times: &Times) -> Self {
        Self { steps: 0, order: times.in_order() }
    }

    /// Views that come in within `steps` steps; 0: all are there from the start.
    pub(crate) fn over(times: &Times, steps: u64) -> Self {
        Self { steps, ..Self::new(times) }
    }

    /// The views that have come in after `taken` steps; `None`: all.
    pub(crate) fn open(&self, taken: u64) -> Option<&[u32]> {
        let all = self.order.len();
        let open = (u128::from(taken) * all as u128).checked_div(self.steps.into());
        let open = open.map_or(all, |open| open as usize);
        (open < all).then(|| &self.order[..open.max(LEAST).min(all)])
    }
}
