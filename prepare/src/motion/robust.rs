//! A relation of two pictures from matches of which some are wrong or move by themselves.
//!
//! Relations through a few matches, drawn at random, are compared over all matches; the best of them are fitted again to the matches that obey
//! them. The score is GRIC, and less is better. It is the mean squared distance in units of the flow's noise, where a match counts for no more than
//! a limit (a greater distance is not noise), plus a cost of the kind of relation. So relations of two kinds can be compared, too: the one that
//! allows more has to fit better.
//!
//! # Source
//! Torr, "Geometric motion segmentation and model selection", 1998; Torr, Fitzgibbon and Zisserman, "The problem of degeneracy in structure and
//! motion recovery from uncalibrated image sequences", 1999.

use super::judge::LEAST_DISTANCE;
use super::relation::{Match, Relation};
use rayon::prelude::*;
use render_core::float_core::rng::Rng;

/// Standard deviation of flow vectors, pixels. At two of them, [`LEAST_DISTANCE`], nothing counts as moving yet.
const NOISE: f64 = LEAST_DISTANCE / 2.0;
/// Dimensions of matches.
const SPACE: f64 = 4.0;
/// Relations that are drawn. Where 60 % of the matches are right, about 8 of 500 draws of eight are of right matches alone.
const DRAWS: u32 = 500;
/// How many of the best draws are fitted again.
const REFINED: usize = 5;
/// Rounds of fitting again: each takes the matches whose squared distance is below this many times the limit.
const REACHES: [f64; 8] = [16.0, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0];
/// Matches that are needed.
const LEAST_MATCHES: usize = 50;
/// Seed of what is drawn; each kind of relation has the stream of its number of matches.
const SEED: u64 = 9;

/// A relation that was found, and how well it fits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted<R> {
    pub(super) relation: R,
    /// GRIC for each match; of two relations the one with less is to be preferred.
    pub(super) gric: f64,
    /// Share of the matches that are within [`LEAST_DISTANCE`].
    pub(super) share: f64,
}

/// The relation of the least GRIC that was found; `None` where there are hardly any matches, or they determine none. The same bits with any number
/// of threads.
pub(super) fn robust<R: Relation>(matches: &[Match]) -> Option<Fitted<R>> {
    if matches.len() < LEAST_MATCHES {
        return None;
    }
    let rng = Rng::new(SEED, R::SAMPLE as u64);
    let draw = |k: u32| -> Option<Candidate<R>> {
        let drawn = sample::<R>(matches, rng.substream(k.into()));
        Some(Candidate::new(R::through(&drawn, |_| 1.0)?, matches))
    };
    let drawn: Vec<Option<Candidate<R>>> = (0..DRAWS).into_par_iter().map(draw).collect();
    let mut candidates: Vec<Candidate<R>> = drawn.into_iter().flatten().collect();
    candidates.sort_by(|a, b| a.gric.total_cmp(&b.gric));
    candidates.truncate(REFINED);
    let refined = candidates.into_iter().map(|candidate| candidate.refined(matches));
    let Candidate { relation, gric } = refined.min_by(|a, b| a.gric.total_cmp(&b.gric))?;
    let is_near = |of: &&Match| relation.squared(of).is_some_and(|s| s < LEAST_DISTANCE * LEAST_DISTANCE);
    let share = matches.iter().filter(is_near).count() as f64 / matches.len() as f64;
    Some(Fitted { relation, gric, share })
}

/// Different matches, as many as determine a relation. There are more than that.
fn sample<R: Relation>(matches: &[Match], rng: Rng) -> Vec<Match> {
    let n = u32::try_from(matches.len()).unwrap_or(u32::MAX);
    let mut drawn: Vec<u32> = Vec::with_capacity(R::SAMPLE);
    let mut index = 0;
    while drawn.len() < R::SAMPLE {
        let i = rng.below_at(index, n);
        if !drawn.contains(&i) {
            drawn.push(i);
        }
        index += 1;
    }
    drawn.iter().map(|i| matches[*i as usize]).collect()
}

/// A relation and its GRIC for each match.
#[derive(Clone, Copy)]
struct Candidate<R> {
    relation: R,
    gric: f64,
}

impl<R: Relation> Candidate<R> {
    /// Squared distance beyond which a match counts for no more, in units of the squared noise.
    const MOST: f64 = 2.0 * (SPACE - R::DIMENSIONS);

    fn new(relation: R, matches: &[Match]) -> Self {
        let n = matches.len() as f64;
        let of = |of: &Match| relation.squared(of).map_or(Self::MOST, |s| (s / (NOISE * NOISE)).min(Self::MOST));
        let distances: f64 = matches.iter().map(of).sum();
        let gric = distances / n + R::DIMENSIONS * SPACE.ln() + R::PARAMETERS * (SPACE * n).ln() / n;
        Self { relation, gric }
    }

    /// Fitted to the matches that obey it by their distances: to squared algebraic errors that are weighted anew each time.
    fn refined(self, matches: &[Match]) -> Self {
        let mut best = self;
        for reach in REACHES {
            let most = reach * Self::MOST * NOISE * NOISE;
            let near: Vec<Match> =
                matches.iter().copied().filter(|of| best.relation.squared(of).is_some_and(|s| s < most)).collect();
            if near.len() < R::SAMPLE {
                continue;
            }
            let again = R::through(&near, |of| best.relation.weight(of)).map(|relation| Self::new(relation, matches));
            if let Some(again) = again.filter(|again| again.gric < best.gric) {
                best = again;
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::super::fundamental::Fundamental;
    use super::super::homography::Homography;
    use super::*;
    use glam::DVec2;

    const WIDTH: f64 = 160.0;
    const HEIGHT: f64 = 120.0;

    /// How the second picture differs from the first.
    #[derive(Clone, Copy)]
    struct World {
        /// The way of the camera, in units of the depth.
        way: [f64; 3],
        /// What is at the left of the picture moves so far besides, pixels.
        own: [f64; 2],
        /// Share of the picture that this is.
        moving: f64,
        /// All vectors are wrong by so much at most, pixels.
        noise: f64,
    }

    const STILL: World = World { way: [0.0; 3], own: [0.0; 2], moving: 0.0, noise: 0.1 };

    /// 1500 matches of a camera that turns a little; at depths between 2 and 4 where it goes away, too.
    fn matches(world: World) -> Vec<Match> {
        let rng = Rng::new(3, 1);
        let noise = |k: u64| world.noise * (2.0 * f64::from(rng.uniform_at(k)) - 1.0);
        let one = |k: u64| {
            let [x, y] = [0, 1].map(|i| f64::from(rng.uniform_at(10_000 + 2 * k + i)));
            let from = DVec2::new(WIDTH * x, HEIGHT * y);
            let depth = 3.0 + (8.0 * x).sin() * (7.0 * y).cos();
            let ray = (from - DVec2::new(80.0, 60.0)) / 150.0;
            let [a, b, c] = world.way;
            // Turned about y by 0.03 and about z by 0.015.
            let [u, v, w] = [ray.x + 0.03 - 0.015 * ray.y, ray.y + 0.015 * ray.x, 1.0 - 0.03 * ray.x];
            let [u, v, w] = [u + a / depth, v + b / depth, w + c / depth];
            let stays = DVec2::new(150.0 * u / w + 80.0, 150.0 * v / w + 60.0);
            let own = if x < world.moving { DVec2::from_array(world.own) } else { DVec2::ZERO };
            Match { from, to: stays + own + DVec2::new(noise(2 * k), noise(2 * k + 1)) }
        };
        (0..1500).map(one).collect()
    }

    fn both(world: World) -> (Fitted<Fundamental>, Fitted<Homography>) {
        let matches = matches(world);
        (robust(&matches).unwrap(), robust(&matches).unwrap())
    }

    #[test]
    fn a_camera_that_only_turns_has_a_homography_although_a_fundamental_matrix_fits_more() {
        for moving in [0.0, 0.1, 0.25] {
            let (lines, plane) = both(World { own: [3.0, 2.0], moving, ..STILL });
            assert!((plane.share - (1.0 - moving)).abs() < 0.05, "{plane:?} of {moving}");
            // The epipole may lie where the lines lead the way of what moves: it fits all.
            assert!(lines.share > plane.share - 0.01 && plane.gric < lines.gric, "{lines:?} and {plane:?} of {moving}");
        }
    }

    #[test]
    fn a_camera_that_goes_away_among_things_of_all_depths_has_a_fundamental_matrix() {
        for moving in [0.0, 0.1, 0.25] {
            let world = World { way: [0.3, 0.1, 0.15], own: [-1.0, 6.0], moving, ..STILL };
            let (lines, plane) = both(world);
            assert!((lines.share - (1.0 - moving)).abs() < 0.07, "{lines:?} of {moving}");
            assert!(plane.share < 0.6 && lines.gric < plane.gric, "{lines:?} and {plane:?} of {moving}");
            // What stays is on its lines to the noise.
            let still = matches(World { moving: 0.0, noise: 0.0, ..world });
            let worst = still.iter().map(|of| lines.relation.squared(of).unwrap()).fold(0.0, f64::max).sqrt();
            assert!(worst < 0.35, "{worst} pixels off the lines, {moving} moves");
        }
    }

    #[test]
    fn matches_without_sense_fit_neither() {
        let rng = Rng::new(4, 1);
        let place = |k: u64| {
            let [x, y] = [0, 1].map(|i| f64::from(rng.uniform_at(2 * k + i)));
            DVec2::new(WIDTH * x, HEIGHT * y)
        };
        let matches: Vec<Match> = (0..1000).map(|k| Match { from: place(k), to: place(k + 1000) }).collect();
        let (lines, plane) = (robust::<Fundamental>(&matches), robust::<Homography>(&matches));
        assert!(lines.is_none_or(|lines| lines.share < 0.3) && plane.is_none_or(|plane| plane.share < 0.3));
        assert!(robust::<Homography>(&matches[..LEAST_MATCHES - 1]).is_none());
    }

    #[test]
    fn the_number_of_threads_changes_no_bit() {
        let matches = matches(World { way: [0.3, 0.1, 0.15], own: [0.0, 6.0], moving: 0.1, ..STILL });
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let lines: Fitted<Fundamental> = pool.install(|| robust(&matches)).unwrap();
            (lines.relation, lines.gric.to_bits(), lines.share.to_bits())
        };
        let one = with(1);
        assert!([2, 4].into_iter().all(|threads| with(threads) == one));
    }
}
