//! The homography of two pictures: what a camera that only turns, or one before a plane, shows of points that stay.

use super::relation::{Match, Normal, Relation, Squares, unit};
use glam::{DMat3, DVec2};

/// A homography of length 1 for places in pixels; third coordinates of what both pictures show are above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Homography(DMat3);

impl Relation for Homography {
    const SAMPLE: usize = 4;
    const PARAMETERS: f64 = 8.0;
    const DIMENSIONS: f64 = 2.0;

    /// By the direct linear transform, normalised.
    ///
    /// # Source
    /// Hartley and Zisserman, "Multiple View Geometry", 2004, algorithm 4.2.
    fn through(matches: &[Match], weight: impl Fn(&Match) -> f64) -> Option<Self> {
        let here = Normal::of(matches.iter().map(|of| of.from))?;
        let there = Normal::of(matches.iter().map(|of| of.to))?;
        let mut squares = Squares::EMPTY;
        for of in matches {
            let (p, q, weight) = (here.at(of.from), there.at(of.to), weight(of));
            squares.add([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x], weight);
            squares.add([0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y], weight);
        }
        let normalised = squares.solution()?;
        // The middle of the places is seen.
        let normalised = if normalised.z_axis.z < 0.0 { -normalised } else { normalised };
        unit(there.inverse() * normalised * here.matrix()).map(Self)
    }

    /// Of the distance in the second picture.
    fn weight(&self, of: &Match) -> f64 {
        let third = self.0.row(2).dot(of.from.extend(1.0));
        if third > 0.0 { 1.0 / third } else { 0.0 }
    }

    /// `None` where the place is not before the second camera.
    ///
    /// # Source
    /// Hartley and Zisserman, equation 4.11.
    fn squared(&self, of: &Match) -> Option<f64> {
        let (p, q) = (of.from.extend(1.0), of.to);
        let [a, b, c] = [0, 1, 2].map(|i| self.0.row(i));
        let third = c.dot(p);
        if third <= 0.0 {
            return None;
        }
        let error = q * third - DVec2::new(a.dot(p), b.dot(p));
        // Its derivatives along the place in the first picture; those along the place in the second are `third`.
        let (of_x, of_y) = ((c * q.x - a).truncate(), (c * q.y - b).truncate());
        let (xx, xy, yy) =
            (of_x.length_squared() + third * third, of_x.dot(of_y), of_y.length_squared() + third * third);
        let sum = yy * error.x * error.x - 2.0 * xy * error.x * error.y + xx * error.y * error.y;
        let squared = sum / (xx * yy - xy * xy);
        squared.is_finite().then_some(squared.max(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn true_one() -> DMat3 {
        let rows = [1.03, -0.02, 7.0, 0.015, 0.98, -4.0, 2e-4, -1e-4, 1.0];
        DMat3::from_cols_array(&rows).transpose()
    }

    fn matches() -> Vec<Match> {
        let place = |k: u32| DVec2::new(f64::from(k * 37 % 160) + 0.5, f64::from(k * k * 29 % 120) + 0.5);
        let there = |place: DVec2| {
            let to = true_one() * place.extend(1.0);
            to.truncate() / to.z
        };
        (0..30).map(place).map(|from| Match { from, to: there(from) }).collect()
    }

    #[test]
    fn matches_give_back_the_one_they_were_made_with() {
        let all = matches();
        let want = unit(true_one()).unwrap();
        for of in [&all[..4], &all[..]] {
            let found = Homography::through(of, |_| 1.0).unwrap();
            assert!((found.0 - want).to_cols_array().iter().all(|x| x.abs() < 1e-9), "{found:?}");
            assert!(all.iter().all(|of| found.squared(of).unwrap() < 1e-14));
        }
        assert!(Homography::through(&all[..3], |_| 1.0).is_none());
        // All on a line.
        let on_a_line = [0.0, 1.0, 2.0, 3.0].map(|x| Match { from: DVec2::new(x, x), to: DVec2::new(x, 2.0 * x) });
        assert!(Homography::through(&on_a_line, |_| 1.0).is_none());
    }

    #[test]
    fn a_way_of_its_own_shows_by_its_part_of_both_pictures() {
        // Where pictures are shifted alone, half of the square of the way is the other picture's.
        let shift = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 5.0, -2.0, 1.0]);
        let shifted = Homography(unit(shift).unwrap());
        let of = |way: [f64; 2]| {
            let from = DVec2::new(60.0, 40.0);
            shifted.squared(&Match { from, to: from + DVec2::new(5.0, -2.0) + DVec2::from_array(way) }).unwrap()
        };
        for (way, want) in [([0.0, 0.0], 0.0), ([3.0, 0.0], 4.5), ([0.0, -2.0], 2.0), ([3.0, 4.0], 12.5)] {
            assert!((of(way) - want).abs() < 1e-9, "{way:?}: {}", of(way));
        }
    }

    #[test]
    fn what_is_behind_the_second_camera_has_no_distance() {
        let rows = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.01, 0.0, 1.0];
        let turned = Homography(unit(DMat3::from_cols_array(&rows).transpose()).unwrap());
        let of = |x: f64| Match { from: DVec2::new(x, 3.0), to: DVec2::new(x, 3.0) };
        assert!(turned.squared(&of(99.0)).is_some() && turned.weight(&of(99.0)) > 0.0);
        assert!(turned.squared(&of(101.0)).is_none() && turned.weight(&of(101.0)) == 0.0);
    }
}
