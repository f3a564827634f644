//! What the flow between two photos says of the camera that took them, where nothing else is known of it.
//!
//! A camera that goes away among things of several depths leaves a fundamental matrix: what stays lies on epipolar lines. One that stands still or
//! only turns, or has a plane before it, leaves a homography, and then there are many fundamental matrices: their epipole is free, and some epipole
//! often lies where the way of what moves leads, so that a fundamental matrix may fit all of the flow and say that nothing moves. So it is not the
//! share of what fits that decides but GRIC, by which a homography is taken unless about a third of the flow leaves it.

use super::fundamental::Fundamental;
use super::homography::Homography;
use super::judge::{Distances, of_pixels};
use super::relation::{Match, Relation};
use super::robust::{Fitted, robust};
use glam::DVec2;
use render_core::float_core::rng::Rng;
use scene_io::Flow;
use serde::{Deserialize, Serialize};

/// Flow vectors that a relation is found by.
const MATCHES: usize = 2000;
/// Share of these that has to be within 0.75 pixels of what the relation says.
const LEAST_SHARE: f64 = 0.5;
/// Seed of which flow vectors are taken.
const SEED: u64 = 8;

/// What the flow of points that stay obeys.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FitKind {
    /// A fundamental matrix: the camera went away.
    Fundamental,
    /// A homography: it stood still or turned, or all that it saw is nearly a plane.
    Homography,
}

/// How well a relation fits a flow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitScore {
    /// Share of the flow vectors within 0.75 pixels of what it says.
    pub share: f64,
    /// GRIC for each flow vector: of two relations the one with less is preferred.
    pub gric: f64,
}

/// What was found about the camera by the flow from a photo to a neighbour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// What tells what moves; `None`: neither fits half of the flow, or hardly any flow is known.
    pub by: Option<FitKind>,
    /// The fundamental matrix, if there is one.
    pub fundamental: Option<FitScore>,
    /// The homography, if there is one.
    pub homography: Option<FitScore>,
}

impl Fit {
    /// The score of what tells what moves.
    #[must_use]
    pub fn score(&self) -> Option<FitScore> {
        match self.by? {
            FitKind::Fundamental => self.fundamental,
            FitKind::Homography => self.homography,
        }
    }
}

/// The relation of two photos.
pub(super) struct TwoViews {
    pub(super) fit: Fit,
    relation: Option<Found>,
}

enum Found {
    Fundamental(Fundamental),
    Homography(Homography),
}

impl TwoViews {
    /// By the flow from one to the other.
    pub(super) fn of(flow: &Flow) -> Self {
        let matches = matches(flow);
        let (lines, plane) = (robust::<Fundamental>(&matches), robust::<Homography>(&matches));
        let (fundamental, homography) = (lines.map(|lines| score(&lines)), plane.map(|plane| score(&plane)));
        let lines = lines.filter(|lines| lines.share >= LEAST_SHARE);
        let plane = plane.filter(|plane| plane.share >= LEAST_SHARE);
        let (by, relation) = match (lines, plane) {
            (Some(lines), plane) if plane.is_none_or(|plane| lines.gric < plane.gric) => {
                (Some(FitKind::Fundamental), Some(Found::Fundamental(lines.relation)))
            }
            (_, Some(plane)) => (Some(FitKind::Homography), Some(Found::Homography(plane.relation))),
            (_, None) => (None, None),
        };
        Self { fit: Fit { by, fundamental, homography }, relation }
    }

    /// How far the flow of each pixel is from what a point that stays could make; `None` where nothing is known of that.
    pub(super) fn distances(&self, flow: &Flow) -> Option<Distances> {
        match self.relation.as_ref()? {
            Found::Fundamental(relation) => distances(relation, flow),
            Found::Homography(relation) => distances(relation, flow),
        }
    }
}

fn score<R>(fitted: &Fitted<R>) -> FitScore {
    FitScore { share: fitted.share, gric: fitted.gric }
}

fn distances(relation: &impl Relation, flow: &Flow) -> Option<Distances> {
    let of = |from: DVec2, way: DVec2| relation.squared(&Match { from, to: from + way }).map(f64::sqrt);
    Distances::of(&of_pixels(flow, of))
}

/// Matches of flow vectors that are known, evenly from all over the picture; which they are is drawn.
fn matches(flow: &Flow) -> Vec<Match> {
    let known: Vec<usize> = flow.seen.iter().enumerate().filter(|(_, is_seen)| *is_seen).map(|(k, _)| k).collect();
    let count = known.len().min(MATCHES);
    let rng = Rng::new(SEED, 0);
    let one = |i: usize| {
        let place = (i as f64 + f64::from(rng.uniform_at(i as u64))) * known.len() as f64 / count as f64;
        let k = known[(place as usize).min(known.len() - 1)];
        let [column, row] = [k % flow.width as usize, k / flow.width as usize];
        let from = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
        let [u, v] = flow.vectors[k].map(f64::from);
        Match { from, to: from + DVec2::new(u, v) }
    };
    (0..count).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::BitMask;

    fn flow(seen: impl Fn(u32, u32) -> bool) -> Flow {
        let vectors = (0..96 * 64).map(|k| [0.01 * (k % 96) as f32, -0.5]).collect();
        Flow { width: 96, height: 64, vectors, seen: BitMask::from_fn(96, 64, seen) }
    }

    #[test]
    fn matches_are_of_known_flow_vectors_from_all_over_the_picture() {
        let all = matches(&flow(|column, _| column < 48));
        assert_eq!(all.len(), MATCHES);
        for of in &all {
            assert!(of.from.x < 48.0 && of.from.x.fract() == 0.5 && of.from.y.fract() == 0.5, "{of:?}");
            let way = DVec2::new(0.01 * of.from.x.floor(), -0.5);
            assert!((of.to - of.from - way).length() < 1e-6, "{of:?}");
        }
        // Of each quarter of what is known about a quarter of the matches.
        let share = |is_in: fn(&Match) -> bool| all.iter().filter(|of| is_in(of)).count() as f64 / 2000.0;
        assert!((share(|of| of.from.x < 24.0 && of.from.y < 32.0) - 0.25).abs() < 0.04);
        assert!((share(|of| of.from.x > 24.0 && of.from.y > 32.0) - 0.25).abs() < 0.04);
        let few = matches(&flow(|column, row| column == 3 && row < 10));
        assert_eq!(few.len(), 10);
        assert_eq!(matches(&flow(|_, _| false)).len(), 0);
    }

    #[test]
    fn figures_are_kept_in_words() {
        let score = FitScore { share: 0.75, gric: 3.5 };
        let fit = Fit { by: Some(FitKind::Homography), fundamental: None, homography: Some(score) };
        let text = serde_json::to_string(&fit).unwrap();
        assert!(text.contains(r#""by":"homography""#), "{text}");
        assert_eq!(serde_json::from_str::<Fit>(&text).unwrap(), fit);
        assert_eq!((fit.score(), Fit { by: None, ..fit }.score()), (Some(score), None));
    }
}
