//! Training pixels that are drawn but not rendered, counted for the table of skips. Their weight in the loss is 0, so leaving
//! them out is exact.

use engine::data::Batch;
use engine::system::SkipRow;

/// Pixels drawn, and those of them that are not rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LeftOut {
    drawn: u64,
    /// No other was found instead of them: a file's mask ignores them, or the lens has no ray for them.
    ignored: u64,
    /// The photo model's masks say that they show occluders.
    occluders: u64,
}

/// Pixels of a batch that do not count.
pub(crate) fn unweighted(batch: &Batch) -> u64 {
    batch.weight.iter().filter(|weight| **weight == 0.0).count() as u64
}

impl LeftOut {
    /// Count a batch from which the photo model has taken what it leaves out; `ignored` of its pixels did not count before.
    pub(crate) fn count(&mut self, batch: &Batch, ignored: u64) {
        self.drawn += batch.len() as u64;
        self.ignored += ignored;
        self.occluders += unweighted(batch) - ignored;
    }

    /// Pixels that the photo model's masks left out.
    pub(crate) fn occluders(&self) -> u64 {
        self.occluders
    }

    /// The row of ignored pixels; `None` where there were none.
    pub(crate) fn ignored_row(&self) -> Option<SkipRow> {
        self.row("training: pixels that files' masks ignore", self.ignored)
    }

    /// The row of occluders; `None` where no mask left out any.
    pub(crate) fn occluders_row(&self) -> Option<SkipRow> {
        self.row("training: pixels of occluders, by the photo model's masks", self.occluders)
    }

    fn row(&self, what: &'static str, count: u64) -> Option<SkipRow> {
        let bound = "0: they have no part in the loss";
        (count > 0).then(|| SkipRow::counted(what, count, self.drawn, "pixels", bound.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pixel_is_counted_once_and_nothing_has_no_row() {
        let ray = render_core::ray::Ray { o: glam::DVec3::ZERO, d: glam::DVec3::Z };
        let mut batch = Batch::of_rays(&[ray; 5], &[[0.0; 3]; 5]);
        let mut left_out = LeftOut::default();
        left_out.count(&batch, unweighted(&batch));
        assert!(left_out.ignored_row().is_none() && left_out.occluders_row().is_none());
        batch.weight[1] = 0.0;
        let ignored = unweighted(&batch);
        // One that is ignored anyhow, and two that are not.
        for i in [1, 2, 4] {
            batch.weight[i] = 0.0;
        }
        left_out.count(&batch, ignored);
        assert_eq!(left_out, LeftOut { drawn: 10, ignored: 1, occluders: 2 });
        let counts = |row: Option<SkipRow>| row.map(|row| (row.skipped, row.total));
        assert_eq!(counts(left_out.ignored_row()), Some((1, 10)));
        assert_eq!(counts(left_out.occluders_row()), Some((2, 10)));
    }
}
