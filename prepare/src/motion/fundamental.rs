//! The fundamental matrix of two pictures: pixels of points that stay lie on each other's epipolar lines.

use super::relation::{Match, Normal, Relation, Squares, unit};
use glam::{DMat3, DVec3};
use render_core::symmetric::eigen;

/// Squared length of the derivative of `q^T F p` below which both places are epipoles: every line goes through them.
const EPIPOLE: f64 = 1e-18;

/// Distance of two homogeneous places (third coordinate 1) from such that obey `q^T F p = 0`, to first order, in their unit: 0 for a point
/// that stays, about 0.7 of the distance from the epipolar line for one that moves. At the epipole it is 0.
///
/// # Source
/// Hartley and Zisserman, "Multiple View Geometry", 2004, equation 11.9.
pub(super) fn sampson(fundamental: DMat3, p: DVec3, q: DVec3) -> f64 {
    derivative(fundamental, p, q).map_or(0.0, |derivative| q.dot(fundamental * p).abs() / derivative)
}

/// Length of the derivative of `q^T F p` along both places; `None` at the epipoles.
fn derivative(fundamental: DMat3, p: DVec3, q: DVec3) -> Option<f64> {
    let (line, line_back) = (fundamental * p, fundamental.transpose() * q);
    let squared = line.truncate().length_squared() + line_back.truncate().length_squared();
    (squared > EPIPOLE).then(|| squared.sqrt())
}

/// A fundamental matrix of length 1 for places in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fundamental(DMat3);

impl Relation for Fundamental {
    const SAMPLE: usize = 8;
    const PARAMETERS: f64 = 7.0;
    const DIMENSIONS: f64 = 3.0;

    /// By eight points, normalised.
    ///
    /// # Source
    /// Hartley, "In defence of the eight-point algorithm", 1997.
    fn through(matches: &[Match], weight: impl Fn(&Match) -> f64) -> Option<Self> {
        let here = Normal::of(matches.iter().map(|of| of.from))?;
        let there = Normal::of(matches.iter().map(|of| of.to))?;
        let mut squares = Squares::EMPTY;
        for of in matches {
            let (p, q) = (here.at(of.from), there.at(of.to));
            squares.add([q.x * p.x, q.x * p.y, q.x, q.y * p.x, q.y * p.y, q.y, p.x, p.y, 1.0], weight(of));
        }
        let normalised = of_rank_two(squares.solution()?);
        unit(there.matrix().transpose() * normalised * here.matrix()).map(Self)
    }

    fn weight(&self, of: &Match) -> f64 {
        derivative(self.0, of.from.extend(1.0), of.to.extend(1.0)).map_or(0.0, |derivative| 1.0 / derivative)
    }

    fn squared(&self, of: &Match) -> Option<f64> {
        let distance = sampson(self.0, of.from.extend(1.0), of.to.extend(1.0));
        Some(distance * distance)
    }
}

/// The nearest matrix that takes one direction to 0.
fn of_rank_two(m: DMat3) -> DMat3 {
    let (_, directions) = eigen((m.transpose() * m).to_cols_array_2d());
    let lost = DVec3::from_array(directions[0]);
    let image = m * lost;
    m - DMat3::from_cols(image * lost.x, image * lost.y, image * lost.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use std::path::Path;
    use testkit::golden::{Golden, Record, assert_close};

    fn golden() -> Golden {
        Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/cameras.json")).unwrap()
    }

    fn matches(record: &Record) -> Vec<Match> {
        let places =
            |name: &str| -> Vec<DVec2> { record.input(name).data.chunks_exact(2).map(DVec2::from_slice).collect() };
        places("p1").into_iter().zip(places("p2")).map(|(from, to)| Match { from, to }).collect()
    }

    #[test]
    fn eight_points_give_what_independent_code_does() {
        let golden = golden();
        for record in golden.op("eight_point") {
            let found = Fundamental::through(&matches(record), |_| 1.0).unwrap();
            let mut rows = found.0.transpose().to_cols_array();
            let want = &record.output("F_unit").data;
            // Its sign is free.
            if rows.iter().zip(want).map(|(a, b)| a * b).sum::<f64>() < 0.0 {
                rows = rows.map(|x| -x);
            }
            assert_close(&record.label(), &rows, want, 1e-10, 0.0);
            assert!(found.0.determinant().abs() < 1e-14, "{}", found.0.determinant());
        }
    }

    #[test]
    fn distances_are_what_independent_code_says() {
        let golden = golden();
        for record in golden.op("sampson") {
            let rows: [f64; 9] = record.input("F").data.as_slice().try_into().unwrap();
            let f = DMat3::from_cols_array(&rows).transpose();
            let found: Vec<f64> =
                matches(record).iter().map(|of| sampson(f, of.from.extend(1.0), of.to.extend(1.0)).powi(2)).collect();
            assert_close(&record.label(), &found, &record.output("sampson").data, 1e-9, 1e-15);
            // The length of the matrix says nothing.
            let scaled: Vec<f64> =
                matches(record).iter().map(|of| Fundamental(unit(f).unwrap()).squared(of).unwrap()).collect();
            assert_close(&record.label(), &scaled, &found, 1e-9, 1e-15);
        }
    }

    #[test]
    fn weights_make_distances_of_algebraic_errors() {
        let golden = golden();
        let record = golden.record("sampson", "noise1.0");
        let rows: [f64; 9] = record.input("F").data.as_slice().try_into().unwrap();
        let f = Fundamental(DMat3::from_cols_array(&rows).transpose());
        for of in matches(record) {
            let algebraic = of.to.extend(1.0).dot(f.0 * of.from.extend(1.0));
            let (found, want) = ((algebraic * f.weight(&of)).powi(2), f.squared(&of).unwrap());
            assert!((found - want).abs() < 1e-12 * (1.0 + want), "{found} and {want}");
        }
    }

    #[test]
    fn matches_of_a_camera_that_stays_determine_none() {
        let places = |k: u32| DVec2::new(f64::from(k * 37 % 160), f64::from(k * 53 % 120));
        let still: Vec<Match> = (0..40).map(|k| Match { from: places(k), to: places(k) }).collect();
        assert!(Fundamental::through(&still, |_| 1.0).is_none());
        // Nor do too few.
        assert!(Fundamental::through(&still[..7], |_| 1.0).is_none() && Fundamental::through(&[], |_| 1.0).is_none());
    }
}
