//! Truth about where the surface points that a photo shows go, for scoring.

use glam::{DVec2, DVec3};
use render_core::camera::Prepared;

/// A frame is past the end of the sequence only by more than this: times are sums of fractions.
const ROUNDING: f64 = 1e-9;

/// Exact scene flow of surface points that a frame shows. For scoring; nothing that trains may read it.
///
/// Drawn scenes carry it, in memory alone: their files do not hold it.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFlow {
    /// The time that the points go to, in `[0, 1]`: one frame on, or one frame back where the sequence ends before.
    pub to: f64,
    /// Points that the frame shows at its pixel centres, in the order of its pixels: of things that move, then of things that do not;
    /// at most [`SceneFlow::MOST`] of each, spread evenly.
    pub points: Vec<FollowedPoint>,
}

/// A surface point and where it goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowedPoint {
    /// Where it is at the frame's time, world units.
    pub x: [f64; 3],
    /// Where it is at the other time minus `x`, world units.
    pub way: [f64; 3],
    /// Whether its thing moves at some time; it may rest at these two.
    pub moves: bool,
}

impl SceneFlow {
    /// The most points of things that move, and of things that do not.
    pub const MOST: usize = 512;

    /// The scene flow of all points of a frame to the time `to`, reduced to [`SceneFlow::MOST`] of each kind.
    pub(crate) fn of(to: f64, all: impl Iterator<Item = FollowedPoint>) -> Self {
        let (moving, still): (Vec<_>, Vec<_>) = all.partition(|point| point.moves);
        Self { to, points: [moving, still].iter().flat_map(|kind| spread(kind)).collect() }
    }
}

/// At most [`SceneFlow::MOST`] of some points, evenly.
fn spread(all: &[FollowedPoint]) -> impl Iterator<Item = FollowedPoint> + '_ {
    let n = all.len().min(SceneFlow::MOST);
    (0..n).map(move |i| all[i * all.len() / n])
}

impl FollowedPoint {
    /// Its optical flow in the picture of a camera that stays where it is, pixels: x to the right, y down. `None` where it is behind
    /// the camera at one of the times.
    #[must_use]
    pub fn optical_flow(&self, camera: &Prepared) -> Option<DVec2> {
        let [x, way] = [self.x, self.way].map(DVec3::from);
        Some(camera.project(x + way)? - camera.project(x)?)
    }
}

/// The time one frame on from a time in `[0, 1]`, where `frames` frames are spread evenly over the sequence; one frame back where
/// that is past its end. `None` with less than two frames.
pub(crate) fn one_frame_on(time: f64, frames: usize) -> Option<f64> {
    let gaps = frames.checked_sub(1).filter(|gaps| *gaps > 0)?;
    let step = 1.0 / gaps as f64;
    let on = time + step;
    Some(if on > 1.0 + ROUNDING { (time - step).max(0.0) } else { on.min(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_frame_on_stays_in_the_sequence() {
        assert_eq!([one_frame_on(0.3, 0), one_frame_on(0.3, 1)], [None; 2]);
        let on = [0.0, 0.25, 0.75, 0.9, 1.0].map(|time| one_frame_on(time, 5));
        assert_eq!(on, [0.25, 0.5, 1.0, 0.65, 0.75].map(Some));
        // A frame is all of the sequence.
        assert_eq!([0.0, 0.5, 1.0].map(|time| one_frame_on(time, 2)), [1.0, 0.0, 0.0].map(Some));
        // Fractions do not add up to 1 exactly: the end is still the end.
        let last = (0..10).fold(0.0, |time, _| one_frame_on(time, 11).unwrap());
        assert!((last - 1.0).abs() < 1e-12 && last <= 1.0, "{last}");
    }

    #[test]
    fn points_of_both_kinds_are_kept_and_spread_evenly() {
        let point = |k: usize| FollowedPoint { x: [k as f64, 0.0, 0.0], way: [0.0; 3], moves: k.is_multiple_of(4) };
        let few = SceneFlow::of(0.5, (0..8).map(point));
        assert!(few.points.iter().map(|p| p.x[0]).eq([0.0, 4.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0]), "{few:?}");
        let many = SceneFlow::of(0.5, (0..8000).map(point));
        assert_eq!(many.points.len(), 2 * SceneFlow::MOST);
        let (moving, still) = many.points.split_at(SceneFlow::MOST);
        assert!(moving.iter().all(|p| p.moves) && still.iter().all(|p| !p.moves));
        for kind in [moving, still] {
            assert!(kind.windows(2).all(|pair| pair[1].x[0] - pair[0].x[0] < 20.0), "no gap of more than a few points");
        }
        assert!(SceneFlow::of(0.5, std::iter::empty()).points.is_empty());
    }
}
