//! What kind of place a scene is, from its cameras and points: the box, the forward view, or the open world.

use crate::data::Dataset;
use crate::space::{Space, SpaceKind};
use glam::DVec3;
use render_core::bounds::{depth_ranges, percentile};
use render_core::camera::{Camera, Pose};
use render_core::rig::{focus_point, mean_centre, mean_pose, rms_distance};
use scene_io::{LayoutHint, Scene};

/// Forward-facing: the mean of the unit viewing directions is at least this long (all within about 26 degrees).
const SAME_WAY: f64 = 0.9;
/// The near plane of NDC, as a part of the nearest depth seen.
const NEAR_PLANE: f64 = 0.9;
/// Cascades double up to this extent at most, internal units.
const WIDEST: f64 = 64.0;
/// Extent of an unbounded scene without points, internal units.
const UNKNOWN_EXTENT: f64 = 16.0;
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
    /// Why, for people.
    pub why: String,
}

/// Look at cameras and points.
#[must_use]
pub fn layout(scene: &Scene, data: &Dataset) -> Layout {
    let cameras: Vec<Camera> = data.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect();
    let poses: Vec<Pose> = cameras.iter().map(|c| c.pose).collect();
    let focal = cameras.iter().map(|c| 0.5 * (c.fx + c.fy)).sum::<f64>() / cameras.len().max(1) as f64;
    match scene.layout {
        LayoutHint::Object { near, far } => object(&cameras, &poses, focal, near, far),
        LayoutHint::ForwardFacing => forward_facing(scene, data, &cameras, &poses, focal)
            .unwrap_or_else(|| open(scene, &poses, focal, "cameras do not look the same way")),
        _ => open(scene, &poses, focal, "the format does not say where the scene ends"),
    }
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

fn forward_facing(scene: &Scene, data: &Dataset, cameras: &[Camera], poses: &[Pose], focal: f64) -> Option<Layout> {
    let axis: DVec3 = cameras.iter().map(Camera::optical_axis).sum::<DVec3>() / cameras.len().max(1) as f64;
    if axis.length() < SAME_WAY {
        return None;
    }
    let reference = mean_pose(poses)?;
    let bounds = data.views().iter().filter_map(|v| scene.frames[v.frame].z_bounds).map(|b| b[0]);
    let nearest = bounds.fold(f64::INFINITY, f64::min);
    let nearest = if nearest.is_finite() {
        nearest
    } else {
        let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
        depth_ranges(cameras, &points, 0.01, 10)?.iter().map(|r| r[0]).fold(f64::INFINITY, f64::min)
    };
    // Depths are measured from cameras that may stand before or behind the reference.
    let behind = poses.iter().map(|p| reference.to_camera(p.c).z).fold(f64::INFINITY, f64::min);
    let near = (nearest + behind) * NEAR_PLANE;
    if !(near > 0.0 && near.is_finite()) {
        return None;
    }
    Space::ndc(reference, near, cameras)?;
    let width = cameras.iter().map(|c| f64::from(c.width.max(c.height))).sum::<f64>() / cameras.len() as f64;
    let _ = focal;
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

/// An inner cube around what the cameras look at, and the rest contracted.
fn open(scene: &Scene, poses: &[Pose], focal: f64, reason: &str) -> Layout {
    let in_front = |p: &DVec3| poses.iter().filter(|c| (*p - c.c).dot(c.r.z_axis) > 0.0).count() * 2 > poses.len();
    let middle = mean_centre(poses).unwrap_or(DVec3::ZERO);
    let focus = focus_point(poses).filter(in_front);
    let centre = focus.unwrap_or(middle);
    let mut distances: Vec<f64> = poses.iter().map(|p| (p.c - centre).length()).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let radius = percentile(&distances, 0.5).filter(|r| *r > 0.0).unwrap_or(1.0);
    let mut reach: Vec<f64> =
        scene.points.iter().map(|p| (p.xyz - centre).abs().max_element() / radius).filter(|r| r.is_finite()).collect();
    reach.sort_unstable_by(f64::total_cmp);
    let stated = scene.bounds.map(|b| (b.min - centre).abs().max((b.max - centre).abs()).max_element() / radius);
    let (extent, how) = match (percentile(&reach, FAR_PERCENTILE), stated) {
        (Some(far), _) => ((1.5 * far).clamp(2.0, WIDEST), "from its points"),
        (None, Some(stated)) => (stated.clamp(2.0, WIDEST), "from the box in the file"),
        (None, None) => (UNKNOWN_EXTENT, "no points to tell"),
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
