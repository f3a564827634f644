//! Points of a photo on three planes about a scene: two pictures of each, as it is seen from either side.
//!
//! A plane has seven channels: the colours of the points nearest to it from below, those from above, and 1 where there is any point. Cells
//! without one are 0, which is grey. Of two points that are as near the first counts.

use super::back_projection::Shown;
use super::settings::{CHANNELS, PLANES};
use crate::cloud_reference::{Places, Tap};
use crate::views::DrawnCloud;
use rayon::prelude::*;

/// The axes along the columns and the rows of each plane, and the one across it.
const AXES: [[usize; 3]; PLANES] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

/// What the planes reach over; in an axis without an extent all lies in the middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PlaneBox {
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
}

impl PlaneBox {
    /// Numbers of a box.
    pub(super) const NUMBERS: usize = 6;

    /// Of points, of which a share `crop` lies beyond either end along each axis. Without extent where there are fewer than two places.
    ///
    /// # Source
    /// Xu et al., "Wild-GS", 2024: planes are cropped to what the reference photo shows.
    pub(super) fn of(points: &[Shown], crop: f64) -> Self {
        let mut found = Self::default();
        let Some(last) = points.len().checked_sub(1) else { return found };
        let beyond = (crop * last as f64) as usize;
        for axis in 0..3 {
            let mut x: Vec<f32> = points.iter().map(|point| point.x[axis]).collect();
            x.sort_unstable_by(f32::total_cmp);
            (found.low[axis], found.high[axis]) = (x[beyond], x[last - beyond]);
        }
        found
    }

    /// As [`numbers`](Self::numbers) wrote it.
    pub(super) fn read(numbers: &[f32]) -> Self {
        let mut found = Self::default();
        found.low.copy_from_slice(&numbers[..3]);
        found.high.copy_from_slice(&numbers[3..]);
        found
    }

    pub(super) fn numbers(&self) -> [f32; Self::NUMBERS] {
        let [a, b, c] = self.low;
        let [d, e, f] = self.high;
        [a, b, c, d, e, f]
    }

    /// Whether it has an extent along any axis.
    pub(super) fn is_any(&self) -> bool {
        (0..3).any(|axis| self.high[axis] > self.low[axis])
    }

    /// -1 to 1 from end to end of an axis.
    fn coordinate(&self, axis: usize, x: f32) -> f32 {
        let extent = self.high[axis] - self.low[axis];
        if extent > 0.0 { 2.0 * (x - self.low[axis]) / extent - 1.0 } else { 0.0 }
    }
}

/// Gaussians read each plane where they lie before it, at its border where they lie beyond.
impl Places for PlaneBox {
    fn tap(&self, cloud: &DrawnCloud<'_>, i: usize, map: usize, side: usize) -> Option<Tap> {
        let n = cloud.gaussians.len();
        let [column, row, _] = AXES[map].map(|axis| self.coordinate(axis, cloud.gaussians.mean[axis * n + i]));
        self.is_any().then(|| Tap::at_coordinates([column, row], side))
    }
}

/// The planes `[3][7][side][side]` of points within a box.
pub(super) fn scattered(points: &[Shown], within: &PlaneBox, side: usize) -> Vec<f32> {
    let cells = side * side;
    let mut planes = vec![0.0; PLANES * CHANNELS * cells];
    if cells == 0 {
        return planes;
    }
    planes.par_chunks_exact_mut(CHANNELS * cells).zip(AXES).for_each(|(plane, axes)| {
        // Of each cell the points nearest from below and from above.
        let mut nearest: Vec<Option<[usize; 2]>> = vec![None; cells];
        for (i, point) in points.iter().enumerate() {
            let [column, row, _] = axes.map(|axis| within.coordinate(axis, point.x[axis]));
            if [0, 1, 2].iter().any(|axis| within.coordinate(*axis, point.x[*axis]).abs() > 1.0) {
                continue;
            }
            let cell = |x: f32| ((0.5 * (x + 1.0) * side as f32) as usize).min(side - 1);
            let across = |i: usize| points[i].x[axes[2]];
            let kept = nearest[cell(row) * side + cell(column)].get_or_insert([i, i]);
            if across(i) < across(kept[0]) {
                kept[0] = i;
            }
            if across(i) > across(kept[1]) {
                kept[1] = i;
            }
        }
        for (cell, kept) in nearest.iter().enumerate() {
            let Some(kept) = kept else { continue };
            for (from, i) in kept.iter().enumerate() {
                (0..3).for_each(|c| plane[(3 * from + c) * cells + cell] = points[*i].rgb[c]);
            }
            plane[(CHANNELS - 1) * cells + cell] = 1.0;
        }
    });
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;

    const SIDE: usize = 8;

    fn points(n: u64) -> Vec<Shown> {
        let rng = Rng::new(7, 7);
        let at = |i: u64| rng.uniform4_at(i).map(|u| 2.0 * u - 1.0);
        (0..n)
            .map(|i| [at(2 * i), at(2 * i + 1)])
            .map(|[a, b]| Shown { x: [a[0], a[1], a[2]], rgb: [b[0], b[1], b[2]] })
            .collect()
    }

    /// The definition, cell by cell.
    fn plain(points: &[Shown], within: &PlaneBox) -> Vec<f32> {
        let mut out = vec![0.0; PLANES * CHANNELS * SIDE * SIDE];
        let unit = |axis: usize, x: f32| (x - within.low[axis]) / (within.high[axis] - within.low[axis]);
        for (k, axes) in [[0, 1, 2], [1, 2, 0], [2, 0, 1]].into_iter().enumerate() {
            for cell in 0..SIDE * SIDE {
                let mut inside: Vec<&Shown> = points
                    .iter()
                    .filter(|p| (0..3).all(|axis| (0.0..=1.0).contains(&unit(axis, p.x[axis]))))
                    .filter(|p| {
                        let at = [0, 1].map(|j| ((unit(axes[j], p.x[axes[j]]) * SIDE as f32) as usize).min(SIDE - 1));
                        at == [cell % SIDE, cell / SIDE]
                    })
                    .collect();
                inside.sort_by(|a, b| a.x[axes[2]].total_cmp(&b.x[axes[2]]));
                let (Some(below), Some(above)) = (inside.first(), inside.last()) else { continue };
                let channels = below.rgb.iter().chain(&above.rgb).chain(&[1.0]);
                channels.enumerate().for_each(|(c, x)| out[(k * CHANNELS + c) * SIDE * SIDE + cell] = *x);
            }
        }
        out
    }

    #[test]
    fn each_side_shows_what_is_nearest_to_it_whatever_the_order() {
        let mut points = points(300);
        let within = PlaneBox::of(&points, 0.02);
        let planes = scattered(&points, &within, SIDE);
        assert_eq!(planes, plain(&points, &within));
        let (below, above) = planes.split_at(3 * SIDE * SIDE);
        assert!(below != &above[..below.len()], "both sides are the same");
        points.reverse();
        assert_eq!(scattered(&points, &within, SIDE), planes);
        points.swap(3, 200);
        assert_eq!(scattered(&points, &within, SIDE), planes);
    }

    #[test]
    fn the_first_of_points_as_near_counts() {
        let shown = |x: f32, red: f32| Shown { x: [x, 0.0, 0.5], rgb: [red, 0.0, 0.0] };
        let points = [shown(0.0, 0.25), shown(0.0, 0.75), shown(1.0, 1.0)];
        let within = PlaneBox::of(&points, 0.0);
        let planes = scattered(&points, &within, 2);
        // The first plane: columns are x; along the second axis all lies in the middle.
        assert_eq!(planes[..4], [0.0, 0.0, 0.25, 1.0]);
        assert_eq!(planes[12..16], [0.0, 0.0, 0.25, 1.0], "from above");
        assert_eq!(planes[24..28], [0.0, 0.0, 1.0, 1.0], "where there is any");
    }

    #[test]
    fn boxes_leave_out_the_share_that_is_far_off_and_few_points_have_none() {
        let far: Vec<Shown> = (0..101).map(|i| Shown { x: [i as f32, -(i as f32), 3.0], rgb: [0.0; 3] }).collect();
        let found = PlaneBox::of(&far, 0.01);
        assert_eq!((found.low, found.high), ([1.0, -99.0, 3.0], [99.0, -1.0, 3.0]));
        assert_eq!(PlaneBox::read(&found.numbers()), found);
        assert!(found.is_any());
        assert_eq!([found.coordinate(0, 1.0), found.coordinate(0, 99.0), found.coordinate(2, 7.0)], [-1.0, 1.0, 0.0]);
        assert!(!PlaneBox::of(&[], 0.01).is_any() && !PlaneBox::of(&far[..1], 0.01).is_any());
        assert!(scattered(&[], &PlaneBox::default(), SIDE).iter().all(|x| *x == 0.0));
    }
}
