//! Work that pictures skip, counted: rows of the table of skips.

use engine::system::SkipRow;
use splat_core::DrawStats;

/// Work that pictures skipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Skipped {
    /// Gaussians that no pixel can see, of all.
    pub(crate) culled: [u64; 2],
    /// Pairs of Gaussian and tile behind what is finished, of all.
    pub(crate) hidden: [u64; 2],
    /// Tiles with nothing over them, of all.
    pub(crate) empty: [u64; 2],
    /// Photos that masks leave nothing of, of all that were shown.
    pub(crate) blank: [u64; 2],
    /// Gaussians that stand still and are not asked where they are, of all in scenes that move; in steps.
    pub(crate) resting: [u64; 2],
}

impl Skipped {
    /// A picture of `gaussians`, of which `visible` were drawn.
    pub(crate) fn count(&mut self, gaussians: usize, visible: usize, drawn: &DrawStats) {
        self.add(&Self {
            culled: [(gaussians - visible) as u64, gaussians as u64],
            hidden: [drawn.hidden, drawn.pairs],
            empty: [drawn.empty_tiles, drawn.tiles],
            ..Self::default()
        });
    }

    pub(crate) fn add(&mut self, more: &Self) {
        for (sum, more) in [
            (&mut self.culled, more.culled),
            (&mut self.hidden, more.hidden),
            (&mut self.empty, more.empty),
            (&mut self.blank, more.blank),
            (&mut self.resting, more.resting),
        ] {
            *sum = [sum[0] + more[0], sum[1] + more[1]];
        }
    }

    /// Rows of the table of skips, of a training and its pictures.
    pub(crate) fn rows(&self) -> Vec<SkipRow> {
        let row = |what, skipped_of: [u64; 2], unit, bound: String| {
            SkipRow::counted(what, skipped_of[0], skipped_of[1], unit, bound)
        };
        let mut rows = vec![
            row("Gaussians that no pixel sees", self.culled, "Gaussians", "0".into()),
            row(
                "Gaussians behind finished tiles",
                self.hidden,
                "pairs",
                "0 in training (part of the model), the budget in pictures".into(),
            ),
            row("tiles with nothing over them", self.empty, "tiles", "0".into()),
            row("photos that masks leave nothing of", self.blank, "photos", "0".into()),
        ];
        if self.resting[1] > 0 {
            let bound = "what it moved when it was found to rest: below `motion_rest` of its size".into();
            rows.push(row("Gaussians that stand still, not asked where they are", self.resting, "Gaussians", bound));
        }
        rows
    }
}
