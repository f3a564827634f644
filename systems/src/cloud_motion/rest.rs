//! Gaussians that stand still: found from time to time by how far their offsets differ over the film, and not asked for offsets from then
//! on.
//!
//! A Gaussian rests where no offset differs over all times by more than a share of what it is an offset of: positions by that share of
//! its size, rotations by that share of their length, all other numbers (logarithms of sizes, opacities, colours, masks) by the share
//! itself. It keeps the mean of its offsets, so its picture is off by what it moved at most.

use crate::fields::different_times;
use splat_core::{Field, Gaussians};
use std::ops::Range;

/// When it is looked for what rests: after these shares of the time that something moves.
const LOOKS: [f64; 4] = [0.2, 0.35, 0.5, 0.7];
/// The first look is not before this step of motion: networks begin at 0, and where they have not learnt anything yet all seems to rest.
const FIRST: u64 = 100;
/// Times that are looked at, at most: those of photos, evenly.
const TIMES: usize = 24;

/// Whether it is time for the next look, after `looks` of them and `steps` steps of motion, which are the share `done` of all.
pub(super) fn is_due(looks: u64, steps: u64, done: f64) -> bool {
    steps >= FIRST && LOOKS.get(looks as usize).is_some_and(|look| done >= *look)
}

/// The times that are looked at, of those of photos.
pub(super) fn times_of(photos: &[f32]) -> Vec<f32> {
    let times = different_times(photos);
    let every = times.len().div_ceil(TIMES).max(1);
    times.into_iter().step_by(every).collect()
}

/// Offsets `[rows][n]` over some times.
pub(super) struct Offsets {
    n: usize,
    low: Vec<f32>,
    high: Vec<f32>,
    sum: Vec<f32>,
    times: f32,
}

impl Offsets {
    /// Of `n` Gaussians, before the first time.
    pub(super) fn new(rows: usize, n: usize) -> Self {
        let of = |x: f32| vec![x; rows * n];
        Self { n, low: of(f32::INFINITY), high: of(f32::NEG_INFINITY), sum: of(0.0), times: 0.0 }
    }

    /// One more time.
    pub(super) fn see(&mut self, offsets: &[f32]) {
        self.times += 1.0;
        for (k, x) in offsets.iter().enumerate() {
            // `min` and `max` pass over what is no number; the mean does not.
            self.low[k] = self.low[k].min(*x);
            self.high[k] = self.high[k].max(*x);
            self.sum[k] += x;
        }
    }

    /// By how much row `row` of Gaussian `i` differs.
    fn range(&self, row: usize, i: usize) -> f32 {
        self.high[row * self.n + i] - self.low[row * self.n + i]
    }

    /// The mean of row `row` of Gaussian `i`.
    fn mean(&self, row: usize, i: usize) -> f32 {
        self.sum[row * self.n + i] / self.times
    }

    /// The means of all rows of these Gaussians: `[rows][which]`.
    pub(super) fn means(&self, which: &[usize]) -> Vec<f32> {
        (0..self.rows()).flat_map(|row| which.iter().map(move |&i| self.mean(row, i))).collect()
    }

    fn rows(&self) -> usize {
        self.sum.len() / self.n.max(1)
    }

    /// Whether Gaussian `i` of these, which is number `number` of `cloud`, rests: `fields` have these rows, the rest are no parameters of
    /// a Gaussian.
    pub(super) fn rests(
        &self,
        i: usize,
        cloud: &Gaussians,
        number: usize,
        fields: &[(Field, Range<usize>)],
        share: f32,
    ) -> bool {
        let rows = self.rows();
        let is_finite = (0..rows).all(|row| self.mean(row, i).is_finite());
        let of = |field: Field| fields.iter().find(|(name, _)| *name == field).map_or(0..0, |(_, rows)| rows.clone());
        let length = |rows: Range<usize>| rows.map(|row| self.range(row, i).powi(2)).sum::<f32>().sqrt();
        let (places, turns) = (of(Field::Mean), of(Field::Wxyz));
        let others = (0..rows).filter(|row| !places.contains(row) && !turns.contains(row));
        is_finite
            && length(places.clone()) <= share * size(cloud, number)
            && length(turns.clone()) <= share * turn_length(cloud, number)
            && others.fold(0.0, |most: f32, row| most.max(self.range(row, i))) <= share
    }
}

/// The size of a Gaussian: the middle one of its three axes, as a thin one may be seen from its broad side.
fn size(cloud: &Gaussians, i: usize) -> f32 {
    let mut axes = [0, 1, 2].map(|axis| cloud.log_scale[axis * cloud.len() + i]);
    axes.sort_by(f32::total_cmp);
    axes[1].exp()
}

/// The length of what its rotation is made of.
fn turn_length(cloud: &Gaussians, i: usize) -> f32 {
    (0..4).map(|k| cloud.wxyz[k * cloud.len() + i].powi(2)).sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIELDS: [(Field, Range<usize>); 3] = [(Field::Mean, 0..3), (Field::LogScale, 3..6), (Field::Wxyz, 6..10)];
    /// And a mask.
    const ROWS: usize = 11;

    fn one() -> Gaussians {
        let mut cloud = Gaussians::new(2, 0).unwrap();
        for axis in 0..3 {
            // Of axes 0.01, 0.1, 1 the second counts.
            cloud.log_scale[2 * axis + 1] = [0.01_f32, 1.0, 0.1][axis].ln();
        }
        cloud.wxyz[1] = 2.0;
        cloud
    }

    /// Whether the second Gaussian rests whose row `row` goes from 0 to `to`.
    fn rests(row: usize, to: f32) -> bool {
        let mut offsets = Offsets::new(ROWS, 1);
        for x in [0.0, to, 0.5 * to] {
            let mut at = vec![3.0; ROWS];
            at[row] = x;
            offsets.see(&at);
        }
        assert!((offsets.mean(row, 0) - 0.5 * to).abs() < 1e-6 || !to.is_finite());
        offsets.rests(0, &one(), 1, &FIELDS, 0.1)
    }

    #[test]
    fn what_differs_by_a_share_of_what_it_is_does_not_rest() {
        for (row, limit) in [(0, 0.01), (2, 0.01), (4, 0.1), (7, 0.2), (10, 0.1)] {
            for sign in [-1.0, 1.0] {
                assert!(rests(row, sign * 0.99 * limit), "row {row}");
                assert!(!rests(row, sign * 1.01 * limit), "row {row}");
            }
            assert!(!rests(row, f32::NAN) && !rests(row, f32::INFINITY), "row {row}");
        }
    }

    #[test]
    fn it_is_looked_four_times_and_not_before_networks_have_learnt() {
        let due = |looks: u64, done: f64| is_due(looks, FIRST, done);
        assert!(!due(0, 0.19) && due(0, 0.2) && !due(1, 0.2) && due(3, 1.0) && !due(4, 1.0) && !due(u64::MAX, 1.0));
        assert!(!is_due(0, FIRST - 1, 1.0));
    }

    #[test]
    fn times_are_those_of_photos_and_not_too_many() {
        assert_eq!(times_of(&[0.5, -1.0, 0.5, 1.0]), [-1.0, 0.5, 1.0]);
        let many: Vec<f32> = (0..100).map(|k| k as f32).collect();
        assert_eq!(times_of(&many).len(), 20);
        assert!(times_of(&[]).is_empty());
    }
}
