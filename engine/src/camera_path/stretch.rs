//! The part of a path that stays where the photos were.

use super::BOUND;
use super::rig::best;
use super::sight::Sight;
use crate::error::RunError;
use crate::time_path::TimePath;
use render_core::camera::{Camera, Pose};
use render_core::path::{Arc, Ends, Rail};
use std::f64::consts::TAU;

/// Places of a path that are measured, the first and each next time.
const PLACES: [usize; 3] = [24, 20, 29];
/// What a place must have beyond [`BOUND`]: frames between two places may have less.
const MARGIN: f64 = 0.015;

/// Frames of a path that are measured, at most: of longer ones some, evenly spread, and the others get what lies between.
pub(super) const MEASURED_FRAMES: usize = 240;

/// How many frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Frames(pub(super) usize);

/// Measures which share of a frame two photos saw.
#[derive(Clone, Copy)]
pub(super) struct Coverage<'a> {
    pub(super) sight: &'a Sight<'a>,
    pub(super) time: TimePath,
}

impl Coverage<'_> {
    /// The share of each frame that two photos saw. Frames that are all one are measured once.
    pub(super) fn shares(&self, cameras: &[Camera]) -> Result<Vec<f64>, RunError> {
        let n = cameras.len();
        if self.time.is_still() && cameras.windows(2).all(|w| w[0] == w[1]) {
            let first = cameras.first().map(|c| self.sight.share(c, self.time.at(0, 1))).transpose()?;
            return Ok(first.into_iter().cycle().take(n).collect());
        }
        let measured = n.min(MEASURED_FRAMES);
        let place = |k: usize| k * (n - 1) / (measured - 1).max(1);
        let shares: Vec<f64> = (0..measured)
            .map(|k| self.sight.share(&cameras[place(k)], self.time.at(place(k), n)))
            .collect::<Result<_, _>>()?;
        Ok(spread(&shares, place, n))
    }
}

/// `shares` at the `place` of each of `n` frames, and straight lines between them.
fn spread(shares: &[f64], place: impl Fn(usize) -> usize, n: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(n);
    for (k, pair) in shares.windows(2).enumerate() {
        let (from, to) = (place(k), place(k + 1));
        out.extend((from..to).map(|i| pair[0] + (pair[1] - pair[0]) * (i - from) as f64 / (to - from) as f64));
    }
    out.extend(shares.last());
    out
}

/// A path that a part can be taken of. Places are parts of its length, `0..=1`.
pub(super) trait Track: Sized {
    fn ends(&self) -> Ends;
    fn at(&self, place: f64) -> Option<Pose>;
    /// From one place to another; a closed path goes on beyond 1.
    fn part(&self, from: f64, to: f64) -> Self;
    fn frames(&self, n: Frames) -> Vec<Pose>;
}

impl Track for Rail {
    fn ends(&self) -> Ends {
        Rail::ends(self)
    }

    fn at(&self, place: f64) -> Option<Pose> {
        Some(self.pose(place * self.length()))
    }

    fn part(&self, from: f64, to: f64) -> Self {
        Rail::part(self, from * self.length(), to * self.length())
    }

    fn frames(&self, n: Frames) -> Vec<Pose> {
        self.poses(n.0)
    }
}

impl Track for Arc {
    fn ends(&self) -> Ends {
        self.ends
    }

    fn at(&self, place: f64) -> Option<Pose> {
        self.pose(self.from + place * (self.to - self.from))
    }

    fn part(&self, from: f64, to: f64) -> Self {
        let at = |place: f64| self.from + place * (self.to - self.from);
        Arc::part(self, at(from), at(to).min(at(from) + TAU))
    }

    fn frames(&self, n: Frames) -> Vec<Pose> {
        self.poses(n.0)
    }
}

/// A track, and what is left of it.
pub(super) struct SeenPart<T> {
    pub(super) track: T,
    /// Part of its length that is kept.
    pub(super) share: f64,
    /// Whether all of what is kept was seen.
    pub(super) passed: bool,
}

/// The longest part of a track that two photos saw; all of it where no two places next to each other pass.
pub(super) fn seen_part<T: Track>(
    mut track: T,
    camera: impl Fn(Pose) -> Camera,
    coverage: Coverage<'_>,
) -> Result<SeenPart<T>, RunError> {
    let mut share = 1.0;
    for n in PLACES {
        let ends = track.ends();
        let steps = if ends == Ends::Closed { n } else { n - 1 } as f64;
        let cameras: Option<Vec<Camera>> = (0..n).map(|i| track.at(i as f64 / steps).map(&camera)).collect();
        let Some(cameras) = cameras else { return Ok(SeenPart { track, share, passed: false }) };
        let passes: Vec<bool> = coverage.shares(&cameras)?.iter().map(|s| *s >= BOUND + MARGIN).collect();
        if passes.iter().all(|p| *p) {
            return Ok(SeenPart { track, share, passed: true });
        }
        let Some([first, last]) = longest_run(&passes, ends).filter(|[first, last]| last > first) else {
            return Ok(SeenPart { track, share, passed: false });
        };
        track = track.part(first as f64 / steps, last as f64 / steps);
        share *= (last - first) as f64 / steps;
    }
    Ok(SeenPart { track, share, passed: true })
}

/// First and last index of the longest run of `true`; around the end of a closed path the last is `n` or more.
fn longest_run(passes: &[bool], ends: Ends) -> Option<[usize; 2]> {
    let n = passes.len();
    let reach = |first: usize| {
        let most = if ends == Ends::Closed { n } else { n - first };
        (0..most).take_while(|k| passes[(first + k) % n]).count()
    };
    let first = best(0..n, |&i| reach(i) as f64)?;
    (reach(first) > 0).then(|| [first, first + reach(first) - 1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_between_measured_ones_lie_on_straight_lines() {
        let every = |step: usize| move |k: usize| k * step;
        assert_eq!(spread(&[1.0, 0.5, 0.7], every(1), 3), [1.0, 0.5, 0.7]);
        assert_eq!(spread(&[1.0, 0.5], every(2), 3), [1.0, 0.75, 0.5]);
        assert_eq!(spread(&[0.3], every(1), 1), [0.3]);
        assert!(spread(&[], every(1), 0).is_empty());
    }

    #[test]
    fn the_longest_run_goes_round_a_closed_path_only() {
        let passes = [true, true, false, true, false, true];
        assert_eq!(longest_run(&passes, Ends::Open), Some([0, 1]));
        assert_eq!(longest_run(&passes, Ends::Closed), Some([5, 7]));
        assert_eq!(longest_run(&[false, true, true, true], Ends::Open), Some([1, 3]));
        assert_eq!(longest_run(&[false; 3], Ends::Closed), None);
        assert_eq!(longest_run(&[], Ends::Open), None);
    }
}
