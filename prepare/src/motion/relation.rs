//! What matches between two pictures obey, and linear systems that find it.

use glam::{DMat3, DVec2, DVec3};
use render_core::symmetric::eigen;
use std::f64::consts::SQRT_2;

/// A linear system has one solution where its second smallest singular value, squared, is above this share of the largest one, squared.
const ONLY: f64 = 1e-12;

/// A place of one picture and the place of another that shows the same, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    pub(super) from: DVec2,
    pub(super) to: DVec2,
}

/// What the matches of points that stay obey.
pub(super) trait Relation: Copy + Send + Sync {
    /// Matches that determine one.
    const SAMPLE: usize;
    /// Parameters of one.
    const PARAMETERS: f64;
    /// Dimensions of the set of matches that obey one; all matches together have four.
    const DIMENSIONS: f64;

    /// The one of the smallest sum of squares of `weight` times algebraic error; `None` where the matches do not determine one.
    fn through(matches: &[Match], weight: impl Fn(&Match) -> f64) -> Option<Self>;

    /// The weight that makes a distance in pixels of the algebraic error of a match.
    fn weight(&self, of: &Match) -> f64;

    /// Squared distance of a match from those that obey, to first order (Sampson), pixels squared; `None` where there is none.
    fn squared(&self, of: &Match) -> Option<f64>;
}

/// Hartley's normalisation of places: their mean at 0, their mean distance from there `sqrt(2)`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Normal {
    middle: DVec2,
    scale: f64,
}

impl Normal {
    /// `None` without places, and where all are one.
    pub(super) fn of(places: impl Iterator<Item = DVec2> + Clone) -> Option<Self> {
        let n = places.clone().count() as f64;
        let middle = places.clone().sum::<DVec2>() / n;
        let distance = places.map(|place| (place - middle).length()).sum::<f64>() / n;
        let scale = SQRT_2 / distance;
        scale.is_finite().then_some(Self { middle, scale })
    }

    /// A normalised place.
    pub(super) fn at(&self, place: DVec2) -> DVec2 {
        (place - self.middle) * self.scale
    }

    /// Homogeneous places to normalised ones.
    pub(super) fn matrix(&self) -> DMat3 {
        let (s, m) = (self.scale, self.middle * self.scale);
        DMat3::from_cols(DVec3::X * s, DVec3::Y * s, DVec3::new(-m.x, -m.y, 1.0))
    }

    /// And back.
    pub(super) fn inverse(&self) -> DMat3 {
        let s = 1.0 / self.scale;
        DMat3::from_cols(DVec3::X * s, DVec3::Y * s, self.middle.extend(1.0))
    }
}

/// Sums of products of the rows of a homogeneous linear system in nine unknowns; the upper triangle.
pub(super) struct Squares([[f64; 9]; 9]);

impl Squares {
    /// Of no rows.
    pub(super) const EMPTY: Self = Self([[0.0; 9]; 9]);

    /// Adds a row times its weight.
    pub(super) fn add(&mut self, row: [f64; 9], weight: f64) {
        let row = row.map(|x| weight * x);
        for (sums, (i, a)) in self.0.iter_mut().zip(row.iter().enumerate()) {
            for (sum, b) in sums.iter_mut().zip(&row).skip(i) {
                *sum += a * b;
            }
        }
    }

    /// The matrix of the nine unknowns, row by row, of length 1 that comes nearest to solving it; `None` where it is not the only one.
    pub(super) fn solution(&self) -> Option<DMat3> {
        let (values, vectors) = eigen(self.0);
        let is_only = values[1] > ONLY * values[8];
        is_only.then(|| DMat3::from_cols_array(&vectors[0]).transpose())
    }
}

/// The matrix at length 1, all its numbers taken as a vector; `None` of 0 and of what is not finite.
pub(super) fn unit(m: DMat3) -> Option<DMat3> {
    let length = m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
    let unit = m * (1.0 / length);
    unit.is_finite().then_some(unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalised_places_have_their_mean_at_zero_and_come_back() {
        let places = [[3.0, 400.0], [90.0, 20.0], [640.0, 0.5]].map(DVec2::from_array);
        let normal = Normal::of(places.iter().copied()).unwrap();
        let normalised = places.map(|place| normal.at(place));
        assert!(normalised.iter().sum::<DVec2>().length() < 1e-12);
        let distance = normalised.iter().map(|place| place.length()).sum::<f64>() / 3.0;
        assert!((distance - SQRT_2).abs() < 1e-12, "{distance}");
        for (place, at) in places.iter().zip(normalised) {
            assert!((normal.matrix() * place.extend(1.0) - at.extend(1.0)).length() < 1e-12);
            assert!((normal.inverse() * at.extend(1.0) - place.extend(1.0)).length() < 1e-9);
        }
        assert!(Normal::of(std::iter::empty()).is_none());
        assert!(Normal::of([DVec2::ONE; 4].into_iter()).is_none());
    }

    #[test]
    fn systems_with_one_solution_are_told_from_others() {
        // Rows at right angles to (1, 2, .., 9), and only then is there one vector left.
        let solution: [f64; 9] = std::array::from_fn(|i| 1.0 + i as f64);
        let row = |k: usize| -> [f64; 9] {
            let free: [f64; 9] = std::array::from_fn(|i| ((1 + k) as f64 * (0.4 + i as f64)).cos());
            let dot = |a: &[f64; 9]| a.iter().zip(&solution).map(|(a, b)| a * b).sum::<f64>();
            std::array::from_fn(|i| free[i] - solution[i] * dot(&free) / dot(&solution))
        };
        let mut squares = Squares::EMPTY;
        for k in 0..7 {
            squares.add(row(k), 1.0 + k as f64);
        }
        assert!(squares.solution().is_none());
        squares.add(row(7), 0.5);
        let found = squares.solution().unwrap().transpose().to_cols_array();
        let scale = found[0];
        assert!(found.iter().zip(&solution).all(|(x, want)| (x / scale - want).abs() < 1e-6), "{found:?}");
    }

    #[test]
    fn matrices_of_length_0_have_no_unit() {
        assert!(unit(DMat3::ZERO).is_none() && unit(DMat3::IDENTITY * f64::NAN).is_none());
        assert!((unit(DMat3::IDENTITY).unwrap().x_axis.x - 1.0 / 3.0_f64.sqrt()).abs() < 1e-15);
    }
}
