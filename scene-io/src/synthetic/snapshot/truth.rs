//! What is known exactly about a snapshot: depth, normals, which thing, and where each point goes.

use super::{Snapshot, SnapshotHit};
use crate::DepthMap;
use crate::bit_mask::BitMask;
use crate::priors::{Flow, FollowedPoint, SceneFlow};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Prepared};
use render_core::ray::Ray;

/// Two points this close are the same surface point seen twice, world units.
const SAME: f64 = 1e-7;

/// Exact numbers of one picture, at the pixel centres, `[height * width]`.
#[derive(Clone, Debug, PartialEq)]
pub struct SnapshotTruth {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Depth along the optical axis, world units; 0 where nothing is seen.
    pub z: Vec<f64>,
    /// Outward normals in the world; zero where nothing is seen.
    pub normal: Vec<DVec3>,
    /// Index of the thing that is seen.
    pub thing: Vec<Option<usize>>,
    /// Whether it moves at some time.
    pub moving: Vec<bool>,
}

impl SnapshotTruth {
    /// The depths as frames carry them.
    #[must_use]
    pub fn depth_map(&self) -> DepthMap {
        DepthMap { width: self.width, height: self.height, z: self.z.iter().map(|z| *z as f32).collect() }
    }
}

/// What another picture shows of a surface point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sight {
    /// The point itself.
    Seen,
    /// Something in front of it.
    Hidden,
    /// Nothing: it is beside the picture or behind the camera.
    Outside,
    /// The first picture shows no surface here.
    Empty,
}

/// Exact optical and scene flow from one picture to another, at the first one's pixel centres, `[height * width]`.
#[derive(Clone, Debug, PartialEq)]
pub struct FlowMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Way of the point in the picture, pixels: x to the right, y down. Zero unless `sight` is `Seen` or `Hidden` (or
    /// `Outside` and before the camera).
    pub flow: Vec<DVec2>,
    /// Way of the point in the world, world units; zero where there is none.
    pub moved: Vec<DVec3>,
    /// Whether the other picture shows the point: the flow's validity.
    pub sight: Vec<Sight>,
}

impl FlowMap {
    /// The flow as frames carry it.
    #[must_use]
    pub fn to_flow(&self) -> Flow {
        let (width, height) = (self.width, self.height);
        let seen = |x: u32, y: u32| self.sight[y as usize * width as usize + x as usize] == Sight::Seen;
        let vectors = self.flow.iter().map(|way| way.as_vec2().to_array()).collect();
        Flow { width, height, vectors, seen: BitMask::from_fn(width, height, seen) }
    }
}

impl Snapshot {
    /// What is seen at a place of a picture, pixels.
    #[must_use]
    pub fn hit(&self, camera: &Camera, pixel: DVec2) -> Option<SnapshotHit> {
        camera.ray(pixel).and_then(|ray| self.trace(&ray))
    }

    /// Where a surface point of another snapshot (or this one) is now.
    ///
    /// # Panics
    /// If there is no such thing.
    #[must_use]
    pub fn place(&self, hit: &SnapshotHit) -> DVec3 {
        self.placement(hit.thing).place(hit.material)
    }

    /// Where a camera shows a surface point of another snapshot (or this one), pixels, and whether it is seen there. `None`
    /// behind the camera.
    ///
    /// # Panics
    /// As [`Snapshot::place`].
    #[must_use]
    pub fn find(&self, hit: &SnapshotHit, camera: &Camera) -> (Option<DVec2>, Sight) {
        self.find_prepared(hit, &camera.prepare())
    }

    fn find_prepared(&self, hit: &SnapshotHit, prepared: &Prepared) -> (Option<DVec2>, Sight) {
        let camera = prepared.camera();
        let x = self.place(hit);
        let Some(pixel) = prepared.project(x) else { return (None, Sight::Outside) };
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        if !(0.0..w).contains(&pixel.x) || !(0.0..h).contains(&pixel.y) {
            return (Some(pixel), Sight::Outside);
        }
        let away = x - camera.pose.c;
        let first = self.trace(&Ray { o: camera.pose.c, d: away.normalize() });
        // At a grazing angle rounding moves the intersection along the ray by much more than across it.
        let seen =
            first.is_some_and(|first| first.thing == hit.thing && (first.material - hit.material).length() < SAME);
        (Some(pixel), if seen { Sight::Seen } else { Sight::Hidden })
    }

    /// Exact depth, normals and things of a camera.
    #[must_use]
    pub fn truth(&self, camera: &Camera) -> SnapshotTruth {
        let hits = self.centres(camera);
        let axis = camera.optical_axis();
        let each = hits.iter();
        SnapshotTruth {
            width: camera.width,
            height: camera.height,
            z: each.clone().map(|h| h.map_or(0.0, |h| (h.x - camera.pose.c).dot(axis))).collect(),
            normal: each.clone().map(|h| h.map_or(DVec3::ZERO, |h| h.normal)).collect(),
            thing: each.clone().map(|h| h.map(|h| h.thing)).collect(),
            moving: each.map(|h| h.is_some_and(|h| h.moves)).collect(),
        }
    }

    /// Exact flow from what `camera` shows of this snapshot to what `other_camera` shows of another one.
    ///
    /// # Panics
    /// If `other` lacks a thing that is seen, being of another scene.
    #[must_use]
    pub fn flow_to(&self, camera: &Camera, other: &Self, other_camera: &Camera) -> FlowMap {
        let prepared = other_camera.prepare();
        let width = u64::from(camera.width);
        let one = |(i, hit): (usize, &Option<SnapshotHit>)| {
            let Some(hit) = hit else { return (DVec2::ZERO, DVec3::ZERO, Sight::Empty) };
            let centre = DVec2::new((i as u64 % width) as f64 + 0.5, (i as u64 / width) as f64 + 0.5);
            let (pixel, sight) = other.find_prepared(hit, &prepared);
            (pixel.map_or(DVec2::ZERO, |pixel| pixel - centre), other.place(hit) - hit.x, sight)
        };
        let all: Vec<_> = self.centres(camera).par_iter().enumerate().map(one).collect();
        FlowMap {
            width: camera.width,
            height: camera.height,
            flow: all.iter().map(|a| a.0).collect(),
            moved: all.iter().map(|a| a.1).collect(),
            sight: all.iter().map(|a| a.2).collect(),
        }
    }

    /// Exact scene flow of what a camera shows of this snapshot, to another one.
    ///
    /// # Panics
    /// As [`Snapshot::flow_to`].
    #[must_use]
    pub fn scene_flow(&self, camera: &Camera, other: &Self) -> SceneFlow {
        let hits = self.centres(camera);
        let followed = hits.iter().flatten().map(|hit| FollowedPoint {
            x: hit.x.to_array(),
            way: (other.place(hit) - hit.x).to_array(),
            moves: hit.moves,
        });
        SceneFlow::of(other.time(), followed)
    }

    /// What is seen at each pixel centre.
    pub(in crate::synthetic) fn centres(&self, camera: &Camera) -> Vec<Option<SnapshotHit>> {
        let prepared = camera.prepare();
        let (w, h) = (u64::from(camera.width), u64::from(camera.height));
        let centre = |i: u64| {
            let ray = prepared.ray(DVec2::new((i % w) as f64 + 0.5, (i / w) as f64 + 0.5));
            ray.and_then(|ray| self.trace(&ray))
        };
        (0..w * h).into_par_iter().map(centre).collect()
    }
}
