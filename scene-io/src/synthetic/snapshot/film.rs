//! Pictures of things that move: when and from where they are taken, and the frames of a scene that they make.

use super::Snapshot;
use crate::priors::{FlowPlace, FlowTruth, TruthMask, one_frame_on};
use crate::synthetic::surface::to_byte;
use crate::{DepthSource, Frame, ImageSource, Point, Split, Truth};
use glam::DVec2;
use render_core::camera::{Camera, Pose};
use std::f64::consts::PI;
use std::sync::Arc;

/// Rays along each side of a training picture that look for points.
const POINT_RAYS: u32 = 6;

/// The golden ratio's fractional part: its multiples fill `[0, 1)` evenly however many there are.
pub(in crate::synthetic) const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// A picture that is yet to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct SnapshotView {
    /// `train/r_000`.
    pub name: String,
    /// What for.
    pub split: Split,
    /// When.
    pub time: f64,
    /// From where.
    pub camera: Camera,
}

/// How many pictures are taken, and through what lens.
pub(in crate::synthetic) struct Filming {
    /// Columns and rows.
    pub(in crate::synthetic) size: [u32; 2],
    /// Horizontal angle of view, radians.
    pub(in crate::synthetic) angle: f64,
    /// Training, validation and test pictures.
    pub(in crate::synthetic) counts: [usize; 3],
}

/// Training, validation and test pictures of the scene `name`. Picture `i` of the `n` of a split is taken from
/// `pose(split, i, n)`: training pictures at the times `i / (n - 1)` (a single one at 0), validation pictures at
/// `(i + 0.25) / n`, test pictures at `test_time(i, n)`.
///
/// # Panics
/// If a side is 0, or the angle is not in `(0, pi)`.
pub(in crate::synthetic) fn views(
    name: &str,
    filming: &Filming,
    test_time: impl Fn(usize, usize) -> f64,
    pose: impl Fn(Split, usize, usize) -> Pose,
) -> Vec<SnapshotView> {
    let Filming { size: [width, height], angle, counts: [train, val, test] } = *filming;
    assert!(width > 0 && height > 0, "{name}: pictures of {width} x {height} pixels");
    assert!(angle > 0.0 && angle < PI, "{name}: angle of view {angle}");
    let (w, h) = (f64::from(width), f64::from(height));
    let focal = 0.5 * w / (0.5 * angle).tan();
    let splits = [(Split::Train, train), (Split::Val, val), (Split::Test, test)];
    let all = splits.into_iter().flat_map(|(split, n)| (0..n).map(move |i| (split, i, n)));
    let view = |(split, i, n): (Split, usize, usize)| SnapshotView {
        name: format!("{}/r_{i:03}", split.name()),
        split,
        time: match split {
            Split::Train if n == 1 => 0.0,
            Split::Train => i as f64 / (n - 1) as f64,
            Split::Val => (i as f64 + 0.25) / n as f64,
            _ => test_time(i, n),
        },
        camera: Camera::pinhole(width, height, focal, focal, 0.5 * w, 0.5 * h, pose(split, i, n)),
    };
    all.map(view).collect()
}

/// Van der Corput's sequence in base 2: `1/2, 1/4, 3/4, 1/8, ..`.
pub(in crate::synthetic) fn radical_inverse(i: usize) -> f64 {
    (i as u64).reverse_bits() as f64 / 2_f64.powi(64)
}

/// Frames of some views of what `at` says is there at each time, `rays * rays` rays for a pixel. All frames carry the truth about
/// what moves; validation and test frames carry exact depth and exact scene flow, one training frame on; those of the splits in
/// `followed` carry exact flow to the frame of their split that is nearby.
///
/// # Panics
/// If `rays` is 0.
pub(in crate::synthetic) fn frames(
    at: impl Fn(f64) -> Snapshot,
    views: &[SnapshotView],
    rays: u32,
    followed: &[Split],
) -> Vec<Frame> {
    let filmed = views.iter().filter(|v| v.split == Split::Train).count();
    let frame = |view: &SnapshotView| {
        let snapshot = at(view.time);
        let (image, moving) = snapshot.render(&view.camera, rays);
        let depth = (view.split != Split::Train).then(|| DepthSource::memory(snapshot.truth(&view.camera).depth_map()));
        let other = partner(view, views).filter(|_| followed.contains(&view.split));
        let on = one_frame_on(view.time, filmed).filter(|_| view.split.is_measured());
        Frame {
            split: view.split,
            time: Some(view.time),
            depth,
            truth: Truth {
                moving: Some(TruthMask::Memory(Arc::new(moving))),
                flow: other.map(|other| flow(&snapshot, view, &at(other.time), other)),
                scene_flow: on.map(|time| Arc::new(snapshot.scene_flow(&view.camera, &at(time)))),
                ..Truth::default()
            },
            ..Frame::new(view.name.clone(), ImageSource::Memory(Arc::new(image)), view.camera)
        }
    };
    views.iter().map(frame).collect()
}

/// The view of the same split taken nearest to a view, the next one of those that are: what both of them see is most then.
fn partner<'v>(view: &SnapshotView, views: &'v [SnapshotView]) -> Option<&'v SnapshotView> {
    let all: Vec<&SnapshotView> = views.iter().filter(|v| v.split == view.split).collect();
    let at = all.iter().position(|v| *v == view)?;
    let others = (1..all.len()).map(|k| all[(at + k) % all.len()]);
    let distance = |v: &SnapshotView| (v.camera.pose.c - view.camera.pose.c).length();
    others.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Where `other` shows what `view` does; each with what is there when it is taken.
fn flow(now: &Snapshot, view: &SnapshotView, then: &Snapshot, other: &SnapshotView) -> FlowTruth {
    let flow = now.flow_to(&view.camera, then, &other.camera).to_flow();
    FlowTruth { to: other.name.clone(), place: FlowPlace::Memory(Arc::new(flow)) }
}

/// Points of what never moves, as structure from motion would find them: where a lattice of rays of each training picture
/// meets it.
pub(in crate::synthetic) fn points(at: impl Fn(f64) -> Snapshot, views: &[SnapshotView]) -> Vec<Point> {
    let mut found = Vec::new();
    for view in views.iter().filter(|v| v.split == Split::Train) {
        let (snapshot, camera) = (at(view.time), view.camera.prepare());
        let size = DVec2::new(f64::from(view.camera.width), f64::from(view.camera.height)) / f64::from(POINT_RAYS);
        let lattice =
            (0..POINT_RAYS).flat_map(|j| (0..POINT_RAYS).map(move |i| DVec2::new(f64::from(i), f64::from(j))));
        let hits = lattice.filter_map(|p| snapshot.trace(&camera.ray((p + 0.5) * size)?));
        found.extend(
            hits.filter(|hit| !hit.moves).map(|hit| Point { xyz: hit.x, rgb: hit.rgb.to_array().map(to_byte) }),
        );
    }
    found
}
