//! What a deformation left out, and what it counted, for the table of skips.

use super::deform::Deform;
use engine::system::SkipRow;
use std::sync::atomic::{AtomicU64, Ordering};

impl Deform {
    /// Rows of the table of skips: points that were not warped; octaves that were closed; and where space folds over itself.
    pub(crate) fn skips(&self) -> Vec<SkipRow> {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let (all, warped) = (read(&self.counts.all), read(&self.counts.warped));
        let mut rows = Vec::new();
        if self.deformation.origin().rests(0.0) {
            let bound = "exact: nothing is warped at t = 0".to_string();
            let skipped = all.saturating_sub(warped);
            rows.push(SkipRow::counted("points at the canonical time", skipped, all, "points", bound));
        }
        let closed = read(&self.counts.closed);
        if closed > 0 {
            let (bound, all) = ("exact: they are multiplied by 0".to_string(), read(&self.counts.octaves));
            rows.push(SkipRow::counted("octaves of closed windows", closed, all, "octaves of points", bound));
        }
        let elastic = read(&self.counts.elastic);
        if elastic > 0 {
            // Nothing is skipped here: the loss does not depend on the sign of a determinant, so a fold shows nowhere else.
            let bound = "not skipped, counted: the elastic loss does not see it".to_string();
            let folded = read(&self.counts.folded);
            rows.push(SkipRow::counted("points where space folds over", folded, elastic, "points", bound));
        }
        rows
    }
}
