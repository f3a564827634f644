//! What kind of place a scene is, from its cameras and points: the box, the forward view, or the open world.

use crate::space::{Space, SpaceKind};
use engine::data::Dataset;
use engine::scene_points::nearest_point;
use glam::DVec3;
use render_core::bounds::{depth_ranges, percentile, robust_box};
use render_core::camera::{Camera, Pose};
use render_core::rig::{focus_point, mean_centre, mean_pose, rms_distance};
use scene_io::{DepthMap, LayoutHint, Scene};

/// An object is found from this many points at least; this share of them at each end of an axis may be strays; the cube is
/// larger than the rest by this factor.
const FEWEST_POINTS: usize = 16;
const STRAY: f64 = 0.002;
const OBJECT_MARGIN: f64 = 1.15;
/// Points tell where the place is if there are this many; a cube that holds this share of them is it. The cameras stand far off
/// where it is smaller than this part of their distance.
const FEWEST_PLACE_POINTS: usize = 100;
const PLACE_PERCENTILE: f64 = 0.95;
const SMALL_PLACE: f64 = 0.5;
/// What is nearer than this part of the depth of a photo's nearest points does not belong to the place.
pub(crate) const NEAR_SHARE: f64 = 0.7;
/// Forward-facing: the mean of the unit viewing directions is at least this long (all within about 26 degrees).
const SAME_WAY: f64 = 0.9;
/// The near plane of NDC, as a part of the nearest depth seen.
const NEAR_PLANE: f64 = 0.9;
/// Cascades double up to this extent at most, internal units.
const WIDEST: f64 = 64.0;
/// Extent of an unbounded scene without points, internal units.
const UNKNOWN_EXTENT: f64 = 16.0;
/// Measured depths that are used, of all photos together.
const DEPTHS: usize = 1 << 24;
/// Points nearer than this percentile decide where an unbounded scene ends.
const FAR_PERCENTILE: f64 = 0.98;

/// The arrangement of a scene: what [`Space`] is built from, and what it was concluded from.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// The kind of space.
    pub kind: SpaceKind,
    /// Centre, world units.
    pub centre: DVec3,
    /// World length of the internal unit.
    pub radius: f64,
    /// Cubes of the occupancy grid.
    pub cascades: usize,
    /// Size of a pixel at the typical distance of the scene, internal units.
    pub footprint: f64,
    /// Reference of NDC: pose and near plane in world units.
    pub reference: Option<(Pose, f64)>,
    /// Why, in words.
    pub why: String,
}

/// The layout of a scene, from its cameras and points.
#[must_use]
pub fn layout(scene: &Scene, data: &Dataset) -> Layout {
    let cameras: Vec<Camera> = data.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect();
    let poses: Vec<Pose> = cameras.iter().map(|c| c.pose).collect();
    let focal = cameras.iter().map(|c| 0.5 * (c.fx + c.fy)).sum::<f64>() / cameras.len().max(1) as f64;
    let cut_out = || silhouettes(scene, data).and_then(|points| masked_object(&cameras, &poses, focal, &points));
    if let Some(layout) = still_camera(data, &poses, focal) {
        return layout;
    }
    match scene.layout {
        LayoutHint::Object { near, far } => object(&cameras, &poses, focal, near, far),
        LayoutHint::ForwardFacing => cut_out()
            .or_else(|| forward_facing(scene, data, &cameras, &poses))
            .unwrap_or_else(|| open(scene, data, &poses, focal, "cameras do not look the same way")),
        _ => cut_out()
            .unwrap_or_else(|| open(scene, data, &poses, focal, "the format does not say where the scene ends")),
    }
}

/// Points of an object that masks cut out of the photos: those inside the masks of three in four photos that have them in
/// the picture: no two masks are drawn alike. `None` without such masks.
fn silhouettes(scene: &Scene, data: &Dataset) -> Option<Vec<DVec3>> {
    if !data.is_cut_out() {
        return None;
    }
    let mut votes = vec![(0_u32, 0_u32); scene.points.len()];
    for (i, view) in data.views().iter().enumerate().filter(|(_, v)| v.level == 0) {
        let image = data.image(i).ok()?;
        let camera = view.camera.prepare();
        for (point, (inside, seen)) in scene.points.iter().zip(&mut votes) {
            let Some(p) = camera.project(point.xyz) else { continue };
            if p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(image.width) && p.y < f64::from(image.height) {
                *seen += 1;
                *inside += u32::from(image.pixel(p.x as u32, p.y as u32).get(3).is_none_or(|alpha| *alpha >= 128));
            }
        }
    }
    let kept = scene.points.iter().zip(&votes).filter(|(_, (inside, seen))| *seen >= 2 && 4 * inside >= 3 * seen);
    Some(kept.map(|(point, _)| point.xyz).collect())
}

/// An object cut out by masks: a cube around its points.
fn masked_object(cameras: &[Camera], poses: &[Pose], focal: f64, points: &[DVec3]) -> Option<Layout> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let bounds = robust_box(points, STRAY)?;
    let (centre, radius) = (bounds.centre(), OBJECT_MARGIN * 0.5 * bounds.size().max_element());
    let layout = object(cameras, poses, focal, 0.0, 2.0 * radius);
    (radius > 0.0).then(|| Layout {
        centre,
        radius,
        footprint: rms_distance(poses, centre).max(f64::MIN_POSITIVE) / radius / focal,
        why: format!(
            "masks cut out an object; a cube of side {:.3} around its {} points, empty where masks are black",
            2.0 * radius,
            points.len()
        ),
        ..layout
    })
}

/// Cameras around an object: the cube they see in full.
fn object(cameras: &[Camera], poses: &[Pose], focal: f64, near: f64, far: f64) -> Layout {
    let centre = focus_point(poses).or(mean_centre(poses)).unwrap_or(DVec3::ZERO);
    let distance = rms_distance(poses, centre).max(f64::MIN_POSITIVE);
    let widest = |c: &Camera| (f64::from(c.width) / (2.0 * c.fx)).max(f64::from(c.height) / (2.0 * c.fy));
    let half_view = cameras.iter().map(widest).fold(0.0, f64::max);
    let radius = (distance * half_view).min(0.5 * (far - near)).max(1e-6 * distance);
    Layout {
        kind: SpaceKind::Box,
        centre,
        radius,
        cascades: 1,
        footprint: distance / radius / focal,
        reference: None,
        why: format!("an object on an empty background; a cube of side {:.3} is what the cameras see", 2.0 * radius),
    }
}

fn forward_facing(scene: &Scene, data: &Dataset, cameras: &[Camera], poses: &[Pose]) -> Option<Layout> {
    let axis: DVec3 = cameras.iter().map(Camera::optical_axis).sum::<DVec3>() / cameras.len().max(1) as f64;
    if axis.length() < SAME_WAY {
        return None;
    }
    let reference = mean_pose(poses)?;
    let nearest = match stated_depths(data) {
        Some([near, _]) => near,
        None => {
            let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
            depth_ranges(cameras, &points, 0.01, 10)?.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min)
        }
    };
    // Depths are measured from cameras that may stand before or behind the reference.
    let behind = poses.iter().map(|p| reference.to_camera(p.c).z).fold(f64::INFINITY, f64::min);
    let near = (nearest + behind) * NEAR_PLANE;
    if !(near > 0.0 && near.is_finite()) {
        return None;
    }
    Space::ndc(reference, near, cameras)?;
    let width = cameras.iter().map(|c| f64::from(c.width.max(c.height))).sum::<f64>() / cameras.len() as f64;
    Some(Layout {
        kind: SpaceKind::Ndc,
        centre: reference.c,
        radius: 1.0,
        cascades: 1,
        footprint: 2.0 / width,
        reference: Some((reference, near)),
        why: format!(
            "cameras look the same way (mean direction {:.2} of 1); near plane at depth {near:.3}",
            axis.length()
        ),
    })
}

/// A cube.
struct Cube {
    centre: DVec3,
    /// Half the side.
    radius: f64,
}

/// Where the points are: a cube about their middle that holds nearly all of them.
fn place(scene: &Scene) -> Option<Cube> {
    if scene.points.len() < FEWEST_PLACE_POINTS {
        return None;
    }
    let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
    let centre = robust_box(&points, 0.5)?.centre();
    let half = percentile(&reach(scene, centre, 1.0), PLACE_PERCENTILE)?;
    (half > 0.0).then_some(Cube { centre, radius: OBJECT_MARGIN * half })
}

/// Largest coordinates of the points about `centre`, in units of `radius`, sorted.
fn reach(scene: &Scene, centre: DVec3, radius: f64) -> Vec<f64> {
    let mut reach: Vec<f64> =
        scene.points.iter().map(|p| (p.xyz - centre).abs().max_element() / radius).filter(|r| r.is_finite()).collect();
    reach.sort_unstable_by(f64::total_cmp);
    reach
}

/// Depth along the axis before which a photo shows nothing of the place, world units: a share of that of its nearest points.
/// `None` where it shows too few.
pub(crate) fn nearest_depth(camera: &Camera, points: &[DVec3]) -> Option<f64> {
    nearest_point(camera, points).map(|depth| NEAR_SHARE * depth)
}

/// The nearest and the farthest depth that the file states for a training photo, world units: LLFF's bounds. `None` where it states
/// none.
pub(crate) fn stated_depths(data: &Dataset) -> Option<[f64; 2]> {
    let bounds = data.views().iter().filter_map(|v| v.source.z_bounds);
    let [near, far] = bounds.fold([f64::INFINITY, 0.0], |[near, far], b| [near.min(b[0]), far.max(b[1])]);
    (near > 0.0 && near < far && far.is_finite()).then_some([near, far])
}

/// Cameras far from what they have in common: an inner cube around that, which the cameras stand outside of.
fn far_off(scene: &Scene, poses: &[Pose], inner: &Cube, footprint: f64, reason: &str) -> Layout {
    let &Cube { centre, radius } = inner;
    let cameras = poses.iter().map(|p| (p.c - centre).abs().max_element() / radius);
    let points = percentile(&reach(scene, centre, radius), FAR_PERCENTILE).unwrap_or(0.0);
    let cascades = cameras.fold(points, f64::max).clamp(2.0, WIDEST).log2().ceil() as usize + 1;
    Layout {
        kind: SpaceKind::Contracted,
        centre,
        radius,
        cascades,
        footprint,
        reference: None,
        why: format!(
            "{reason}; inner cube of side {:.3} around the points, which the cameras stand far from, the rest contracted; \
             sampled out to {} times that",
            2.0 * radius,
            1_u64 << (cascades - 1),
        ),
    }
}

/// Whether all poses are the same, relative to the distance from the origin, which rounding is relative to.
#[must_use]
pub(crate) fn stands_still(poses: &[Pose]) -> bool {
    let Some((a, rest)) = poses.split_first() else { return false };
    let same = |b: &Pose| a.c.distance(b.c) <= 1e-9 * a.c.length().max(1.0) && a.r.abs_diff_eq(b.r, 1e-9);
    !rest.is_empty() && rest.iter().all(same)
}

/// A camera that stands still and whose photos come with depth: a box around what it sees between the nearest and the furthest
/// of them (EndoNeRF's percentiles). Depth that cannot be read is passed over here.
fn still_camera(data: &Dataset, poses: &[Pose], focal: f64) -> Option<Layout> {
    if !stands_still(poses) {
        return None;
    }
    let maps = data.views().iter().filter_map(|view| view.source.read_depth().ok().flatten());
    let most = (DEPTHS / data.len().max(1)).max(1);
    let some = |map: DepthMap| {
        let every = map.z.len().div_ceil(most).max(1);
        map.z.into_iter().step_by(every).filter(|&z| z > 0.0).map(f64::from).collect::<Vec<f64>>()
    };
    let mut z: Vec<f64> = maps.flat_map(some).collect();
    z.sort_unstable_by(f64::total_cmp);
    let (near, far) = (0.9 * percentile(&z, 0.03)?, 1.1 * percentile(&z, 0.999)?);
    let camera = data.views().first()?.camera;
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let corners = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)].into_iter().flat_map(|(u, v)| {
        [near, far].map(|z| {
            let local = DVec3::new((u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z);
            camera.pose.to_world(local)
        })
    });
    let (min, max) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
    let (centre, radius) = (0.5 * (min + max), 0.51 * (max - min).max_element());
    Some(Layout {
        kind: SpaceKind::Box,
        centre,
        radius,
        cascades: 1,
        footprint: 0.5 * (near + far) / focal / radius,
        reference: None,
        why: format!("the camera stands still and measures depth: a box around {near:.3} to {far:.3}"),
    })
}

/// An inner cube around what the cameras look at, and the rest contracted.
fn open(scene: &Scene, data: &Dataset, poses: &[Pose], focal: f64, reason: &str) -> Layout {
    let in_front = |p: &DVec3| poses.iter().filter(|c| (*p - c.c).dot(c.r.z_axis) > 0.0).count() * 2 > poses.len();
    let middle = mean_centre(poses).unwrap_or(DVec3::ZERO);
    let focus = focus_point(poses).filter(in_front);
    let centre = focus.unwrap_or(middle);
    let distance = |centre: DVec3, share: f64| {
        let mut distances: Vec<f64> = poses.iter().map(|p| (p.c - centre).length()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        percentile(&distances, share).filter(|r| *r > 0.0).unwrap_or(1.0)
    };
    let radius = distance(centre, 0.5);
    if let Some(inner) = place(scene).filter(|inner| inner.radius < SMALL_PLACE * radius) {
        let footprint = distance(inner.centre, 0.25) / inner.radius / focal;
        return far_off(scene, poses, &inner, footprint, reason);
    }
    let reach = reach(scene, centre, radius);
    let stated = scene.bounds.map(|b| (b.min - centre).abs().max((b.max - centre).abs()).max_element() / radius);
    // From a camera that stands off the centre, on its far side.
    let deepest = stated_depths(data).map(|[_, far]| far / radius + 1.0);
    let (extent, how) = match (percentile(&reach, FAR_PERCENTILE), stated, deepest) {
        (Some(far), ..) => ((1.5 * far).clamp(2.0, WIDEST), "from its points"),
        (None, Some(stated), _) => (stated.clamp(2.0, WIDEST), "from the box in the file"),
        (None, None, Some(far)) => (far.clamp(2.0, WIDEST), "from the depths in the file"),
        (None, None, None) => (UNKNOWN_EXTENT, "no points to tell"),
    };
    let cascades = extent.log2().ceil() as usize + 1;
    Layout {
        kind: SpaceKind::Contracted,
        centre,
        radius,
        cascades,
        footprint: 1.0 / focal,
        reference: None,
        why: format!(
            "{reason}; inner cube of side {:.3} around {}, the rest contracted; sampled out to {} times that ({how})",
            2.0 * radius,
            if focus.is_some() { "what the cameras look at" } else { "the cameras" },
            1_u64 << (cascades - 1),
        ),
    }
}
