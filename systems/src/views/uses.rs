//! Gaussians that no photo needs: the most that any photo showed of each, and which of them are dropped.
//!
//! ```text
//! u_i = max over photos of what the picture says of Gaussian i       since the last time; dropped where u_i < least
//! ```
//!
//! Wang et al., "DeGauss", 2025, supplement. Photos are shown in turns: at the end of each all have been seen once.

use splat_core::SplatError;
use splat_core::density::{Fresh, Rows};

/// Never fewer Gaussians than this are left.
const FLOOR: usize = 100;
/// Of what has not been looked at since the last time.
const USED: f32 = 1.0;

/// When Gaussians are dropped that no photo needs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct UsePruning {
    /// Those with less than this; 0: none are.
    pub(crate) least: f32,
    /// From this step of the schedule on.
    pub(crate) from: u64,
}

/// What photos showed of each Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Uses {
    rules: UsePruning,
    /// `[n]`, or nothing where none are dropped.
    most: Vec<f32>,
}

impl Uses {
    /// Of `n` Gaussians that are all needed, as far as is known.
    pub(super) fn new(rules: UsePruning, n: usize) -> Self {
        Self { rules, most: if rules.least > 0.0 { vec![USED; n] } else { Vec::new() } }
    }

    /// What a photo showed, `[n]`.
    pub(super) fn see(&mut self, shown: &[f32]) {
        self.most.iter_mut().zip(shown).for_each(|(most, shown)| *most = most.max(*shown));
    }

    /// The rows that are left where step `step` ends a turn of `photos` photos, at `position` of the schedule; `None`: none are dropped.
    /// The next turn begins with it.
    pub(super) fn left(&mut self, step: u64, position: u64, photos: usize) -> Result<Option<Rows>, SplatError> {
        let n = self.most.len();
        if n == 0 || position < self.rules.from || !(step + 1).is_multiple_of(photos.max(1) as u64) {
            return Ok(None);
        }
        let most = std::mem::replace(&mut self.most, vec![0.0; n]);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| most[b].total_cmp(&most[a]).then(a.cmp(&b)));
        let mut keeps: Vec<bool> = most.iter().map(|most| *most >= self.rules.least).collect();
        order.iter().take(FLOOR).for_each(|&i| keeps[i] = true);
        if keeps.iter().all(|keeps| *keeps) {
            return Ok(None);
        }
        Rows::keep(n, |i| keeps[i]).map(Some)
    }

    /// Rows have changed; new ones are as those they come from.
    pub(super) fn follow(&mut self, rows: &Rows) -> Result<(), SplatError> {
        if self.rules.least > 0.0 {
            self.most = rows.apply("uses", &self.most, 1, Fresh::Copied)?;
        }
        Ok(())
    }

    /// `[n]`, where anything is counted.
    pub(super) fn counted(&self) -> Option<&[f32]> {
        (self.rules.least > 0.0).then_some(&self.most[..])
    }

    /// What [`counted`](Self::counted) gave.
    pub(super) fn put(&mut self, most: Vec<f32>) {
        self.most = most;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: UsePruning = UsePruning { least: 0.01, from: 10 };

    #[test]
    fn what_no_photo_of_a_turn_shows_is_dropped_at_its_end() {
        let n = FLOOR + 6;
        let mut uses = Uses::new(RULES, n);
        let shown: Vec<f32> = (0..n).map(|i| if i < 3 { 0.001 } else { 0.5 }).collect();
        // Nothing before its time, nothing in the midst of a turn; and the first turn says nothing of what came before it.
        assert!(uses.left(3, 3, 4).unwrap().is_none() && uses.left(13, 13, 4).unwrap().is_none());
        uses.see(&vec![0.0; n]);
        assert!(uses.left(11, 11, 4).unwrap().is_none());
        uses.see(&shown);
        uses.see(&vec![0.0; n]);
        let left = uses.left(15, 15, 4).unwrap().unwrap();
        uses.follow(&left).unwrap();
        assert_eq!((left.len(), uses.counted().unwrap().len()), (n - 3, n - 3));
    }

    #[test]
    fn a_cloud_that_shows_nothing_is_dropped_to_a_floor_and_no_further() {
        let mut uses = Uses::new(RULES, 5 * FLOOR);
        for turn in 3..9 {
            if let Some(left) = uses.left(4 * turn + 3, 4 * turn + 3, 4).unwrap() {
                uses.follow(&left).unwrap();
            }
            let n = uses.counted().unwrap().len();
            uses.see(&vec![1e-3; n]);
        }
        assert_eq!(uses.counted().unwrap().len(), FLOOR);
        for n in [0, 1] {
            assert!(Uses::new(RULES, n).left(15, 15, 4).unwrap().is_none());
        }
    }

    #[test]
    fn where_none_are_dropped_nothing_is_counted() {
        let mut uses = Uses::new(UsePruning::default(), 7);
        uses.see(&[0.0; 7]);
        assert!(uses.counted().is_none() && uses.left(15, 15, 4).unwrap().is_none());
        uses.follow(&Rows::keep(7, |i| i > 2).unwrap()).unwrap();
    }
}
