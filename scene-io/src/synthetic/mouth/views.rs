//! One camera's pictures of the mouth: poses, times, and the scene they make.

use super::Mouth;
use crate::random::random;
use crate::synthetic::snapshot::film::{Filming, GOLDEN, SnapshotView, frames, points, radical_inverse, views};
use crate::{Dialect, LayoutHint, Scene, Split};
use glam::DVec3;
use render_core::camera::Pose;
use std::path::PathBuf;

/// Distance of the cameras from what they look at, world units.
const DISTANCE: f64 = 4.0;
/// What the cameras look at: between the mouth and the board.
const CENTRE: DVec3 = DVec3::new(0.0, 0.16, 0.0);
/// Radius of a ball around [`CENTRE`] that holds everything: the corners of the board lie at 1.54.
const RADIUS: f64 = 1.56;
/// Cameras stand so far to the left and to the right at most, radians.
const ASIDE: f64 = 0.60;
/// Cameras stand so high, radians: from below to above.
const HEIGHTS: [f64; 2] = [-0.18, 0.34];
/// Held-out pictures are taken within this share of both ranges: between places of training pictures, not beside them.
const HELD_OUT: f64 = 0.85;

/// Size, number and seed of the pictures of [`mouth`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MouthOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Training pictures, at the times `i / (train - 1)`; a single one at time 0.
    pub train: usize,
    /// Validation pictures, from other places at the times `(i + 0.25) / val`.
    pub val: usize,
    /// Test pictures, from other places and spread over all times: by turns at the time of a training picture and half way
    /// from there to the time of the next. With less than two training pictures, at the times `(i + 0.5) / test`.
    pub test: usize,
    /// Varies colours and where the cameras stand.
    pub seed: u64,
    /// Horizontal angle of view, radians.
    pub angle: f64,
    /// Rays of a pixel along each side: the square of it in all.
    pub rays: u32,
}

impl Default for MouthOptions {
    /// 80 training, 8 validation and 12 test pictures of 128 x 128 pixels, 3 x 3 rays each.
    fn default() -> Self {
        Self { width: 128, height: 128, train: 80, val: 8, test: 12, seed: 0, angle: 0.60, rays: 3 }
    }
}

/// Poses and times of the pictures of some options: training, validation, test.
///
/// # Panics
/// If a side is 0, or the angle is not in `(0, pi)`.
#[must_use]
pub fn mouth_views(options: &MouthOptions) -> Vec<SnapshotView> {
    let size = [options.width, options.height];
    let filming = Filming { size, angle: options.angle, counts: [options.train, options.val, options.test] };
    views("mouth", &filming, |i, n| test_time(i, n, options.train), |split, i, _| pose(split, i, options.seed))
}

/// When test picture `i` of `n` is taken: with an even number at the time of one of `train` training pictures, with an odd one
/// half way to the next.
fn test_time(i: usize, n: usize, train: usize) -> f64 {
    let way = (i as f64 + 0.5) / n as f64;
    if train < 2 {
        return way;
    }
    // The same division as for training pictures: the same bits.
    let gaps = (train - 1) as f64;
    let before = (way * gaps).floor();
    (if i.is_multiple_of(2) { before } else { before + 0.5 }) / gaps
}

/// Where picture `i` of a split is taken from: before the mouth, each from somewhere else.
fn pose(split: Split, i: usize, seed: u64) -> Pose {
    let (offset, stream, share) = match split {
        Split::Val => (0.236, 47_000, HELD_OUT),
        Split::Test => (0.618, 46_000, HELD_OUT),
        _ => (0.0, 45_000, 1.0),
    };
    let jitter = |k: usize| random(seed, stream + (2 * i + k) as u64) - 0.5;
    // Two sequences that fill their range evenly however many there are, and are far from their last value each time.
    let across = (GOLDEN * i as f64 + offset + random(seed, 49_000)).fract() + 0.02 * jitter(0);
    let up = radical_inverse(i + 1) + 0.06 * jitter(1);
    let [across, up] = [across, up].map(|x| share * (2.0 * x - 1.0).clamp(-1.0, 1.0));
    let (turn, rise) = (ASIDE * across, 0.5 * (HEIGHTS[0] + HEIGHTS[1] + (HEIGHTS[1] - HEIGHTS[0]) * up));
    let away = DVec3::new(rise.cos() * turn.sin(), -rise.cos() * turn.cos(), rise.sin());
    // Never `None`: the eye is 4 units away, and not above.
    Pose::look_at(CENTRE + away * DISTANCE, CENTRE, DVec3::Z).unwrap_or(Pose::IDENTITY)
}

/// Pictures of a [`Mouth`]: RGBA on an empty background, one pose and one time each; points of what never moves. All frames
/// carry the truth about what moves; validation and test frames carry exact depth, exact scene flow, one training frame on, and
/// exact flow to the frame of their split nearby (for training frames see
/// [`Snapshot::truth`](crate::synthetic::Snapshot::truth)). The same options give the same bytes.
///
/// # Panics
/// If `rays` is 0, a side is 0, or the angle is not in `(0, pi)`.
#[must_use]
pub fn mouth(options: &MouthOptions) -> Scene {
    let mouth = Mouth::new(options.seed);
    let views = mouth_views(options);
    Scene {
        name: "mouth".to_owned(),
        root: PathBuf::new(),
        dialect: Dialect::Synthetic,
        frames: frames(|time| mouth.at(time), &views, options.rays, &[Split::Val, Split::Test]),
        points: points(|time| mouth.at(time), &views),
        layout: LayoutHint::Object { near: DISTANCE - RADIUS, far: DISTANCE + RADIUS },
        bounds: Some(mouth.bounds()),
        notes: Vec::new(),
    }
}
