//! Views that come in one after the other, in the order of time.

use super::Times;

/// Views that a curriculum begins with.
const LEAST: usize = 3;

/// The first views in time come first (D-NeRF, section 4.2: the canonical scene is learnt before what is far from it).
#[derive(Clone, Debug)]
pub(crate) struct Curriculum {
    /// Share of the schedule after which all training views have come in; 0: they are there from the start.
    pub(super) share: f64,
    /// Training views in the order of time.
    order: Vec<u32>,
}

impl Curriculum {
    /// All views from the start.
    pub(super) fn new(times: &Times) -> Self {
        Self { share: 0.0, order: times.in_order() }
    }

    /// Views that come in within a share of the schedule; 0: all are there from the start.
    pub(crate) fn over(times: &Times, share: f64) -> Self {
        Self { share, ..Self::new(times) }
    }

    /// The views that have come in once the share `done` of the schedule is over; `None`: all.
    pub(crate) fn open(&self, done: f64) -> Option<&[u32]> {
        if done >= self.share {
            return None;
        }
        let all = self.order.len();
        let open = (done / self.share * all as f64) as usize;
        (open < all).then(|| &self.order[..open.max(LEAST).min(all)])
    }
}
