//! One camera's pictures of the stage: poses, times, and the scene they make.

use super::{Orbit, OrbitMotion};
use crate::random::random;
use crate::synthetic::snapshot::film::{Filming, GOLDEN, SnapshotView, frames, points, radical_inverse, views};
use crate::{Dialect, LayoutHint, Scene, Split};
use glam::DVec3;
use render_core::camera::Pose;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// Distance of the cameras from what they look at, world units.
const DISTANCE: f64 = 4.0;
/// What the cameras look at: the middle of the stage's ball.
const CENTRE: DVec3 = DVec3::new(0.0, 0.0, 0.3);
/// Radius of a ball around [`CENTRE`] that holds everything: the rim of the stage lies at 1.12.
const RADIUS: f64 = 1.2;

/// How the camera moves from picture to picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OrbitCamera {
    /// It jumps: each picture from somewhere else (D-NeRF).
    #[default]
    Jumping,
    /// It walks half way round, as a hand would; held-out pictures are taken off its way.
    Walking,
    /// It stands still, for held-out pictures too.
    Frozen,
}

/// Size, number, motion and seed of the pictures of [`orbit`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Training pictures, at the times `i / (train - 1)`; a single one at time 0.
    pub train: usize,
    /// Validation pictures, at the times `(i + 0.25) / val`.
    pub val: usize,
    /// Test pictures, from other places at the times `(i + 0.5) / test`.
    pub test: usize,
    /// Varies colours, phases and where the cameras stand.
    pub seed: u64,
    /// Horizontal angle of view, radians.
    pub angle: f64,
    /// Rays of a pixel along each side: the square of it in all.
    pub rays: u32,
    /// What moves.
    pub motion: OrbitMotion,
    /// How the camera moves.
    pub camera: OrbitCamera,
}

impl Default for OrbitOptions {
    /// 80 training and 12 test pictures of 128 x 128 pixels, 3 x 3 rays each; some things move, the camera jumps.
    fn default() -> Self {
        Self {
            width: 128,
            height: 128,
            train: 80,
            val: 0,
            test: 12,
            seed: 0,
            angle: 0.60,
            rays: 3,
            motion: OrbitMotion::Some,
            camera: OrbitCamera::Jumping,
        }
    }
}

impl OrbitOptions {
    /// A film: 24 training pictures by a camera that walks, as many as the films have that scene flow was published with, and 8 validation
    /// pictures. From one to the next things go more than a pixel far, where they go a third of one in 80.
    #[must_use]
    pub fn walk() -> Self {
        Self { train: 24, val: 8, camera: OrbitCamera::Walking, ..Self::default() }
    }
}

/// Poses and times of the pictures of some options: training, validation, test.
///
/// # Panics
/// If a side is 0, or the angle is not in `(0, pi)`.
#[must_use]
pub fn orbit_views(options: &OrbitOptions) -> Vec<SnapshotView> {
    let size = [options.width, options.height];
    let filming = Filming { size, angle: options.angle, counts: [options.train, options.val, options.test] };
    views("orbit", &filming, |i, n| (i as f64 + 0.5) / n as f64, |split, i, n| pose(split, i, n, options))
}

/// Where picture `i` of `n` is taken from: 15 to 60 degrees above the ground, held-out pictures 18 to 57.
fn pose(split: Split, i: usize, n: usize, options: &OrbitOptions) -> Pose {
    let (offset, stream) = match split {
        Split::Val => (0.236, 62_000),
        Split::Test => (0.618, 61_000),
        _ => (0.0, 60_000),
    };
    let (low, high) = if split == Split::Train { (15.0_f64, 60.0_f64) } else { (18.0, 57.0) };
    let jitter = |k: usize| random(options.seed, stream + (2 * i + k) as u64) - 0.5;
    // Two sequences that fill their range evenly however many there are, and are far from their last value each time.
    let golden = GOLDEN * i as f64 + offset;
    let (round, up) = match options.camera {
        OrbitCamera::Jumping => {
            (golden + 0.02 * jitter(0), (radical_inverse(i + 1) + 0.06 * jitter(1)).clamp(0.0, 1.0))
        }
        OrbitCamera::Walking => {
            let way = (i as f64 + if split == Split::Train { 0.0 } else { 0.5 }) / n as f64;
            let aside = if split == Split::Train { 0.0 } else { 0.08 };
            (0.5 * way + aside * jitter(0), 0.45 + 0.25 * (TAU * way).sin() + aside)
        }
        OrbitCamera::Frozen => (0.0, 0.4),
    };
    let turn = TAU * (round + random(options.seed, 60_900_000));
    let z = low.to_radians().sin() + (high.to_radians().sin() - low.to_radians().sin()) * up;
    // A frozen camera does not know what its pictures are for.
    let z = if options.camera == OrbitCamera::Frozen { 0.5 } else { z };
    let flat = (1.0 - z * z).sqrt();
    let eye = CENTRE + DVec3::new(flat * turn.cos(), flat * turn.sin(), z) * DISTANCE;
    // Never `None`: the eye is 4 units away, and not above.
    Pose::look_at(eye, CENTRE, DVec3::Z).unwrap_or(Pose::IDENTITY)
}

/// Pictures of an [`Orbit`]: RGBA on an empty background, one pose and one time each; points of what never moves. All frames
/// carry the truth about what moves; test frames carry exact flow to the test frame nearby; validation and test frames carry
/// exact depth (for training frames, which have none to train on, see
/// [`Snapshot::truth`](crate::synthetic::Snapshot::truth)) and exact scene flow, one training frame on. The same options give the
/// same bytes.
///
/// # Panics
/// If `rays` is 0, a side is 0, or the angle is not in `(0, pi)`.
#[must_use]
pub fn orbit(options: &OrbitOptions) -> Scene {
    let stage = Orbit::new(options.seed, options.motion);
    let views = orbit_views(options);
    Scene {
        name: "orbit".to_owned(),
        root: PathBuf::new(),
        dialect: Dialect::Synthetic,
        frames: frames(|time| stage.at(time), &views, options.rays, &[Split::Test]),
        points: points(|time| stage.at(time), &views),
        layout: LayoutHint::Object { near: DISTANCE - RADIUS, far: DISTANCE + RADIUS },
        bounds: Some(stage.bounds()),
        notes: Vec::new(),
    }
}
