//! A spiral among cameras that face one way.

use super::BOUND;
use super::rig::Rig;
use super::stretch::{Coverage, Frames};
use crate::error::RunError;
use render_core::camera::{Camera, Pose};
use render_core::path::Spiral;
use render_core::rig::focus_point;
use scene_io::{LayoutHint, Scene};

/// Sizes tried, as parts of the cameras' extent, until every frame stays where photos were.
const SIZES: [f64; 5] = [1.0, 0.75, 0.55, 0.4, 0.25];
/// Frames measured for each.
const PLACES: usize = 16;
/// Depths of points before cameras that are used.
const SEEN: usize = 1 << 24;

/// Frames of a spiral, and a line about it; `None` where the cameras have none.
pub(super) fn spiral(
    scene: &Scene,
    rig: &Rig,
    frames: Frames,
    coverage: Option<Coverage<'_>>,
) -> Result<Option<(Vec<Camera>, String)>, RunError> {
    let Some([near, far]) = depths(scene, &rig.poses) else { return Ok(None) };
    let Some(whole) = Spiral::fit(&rig.poses, near, far) else { return Ok(None) };
    let mut taken = (1.0, whole);
    if let Some(coverage) = coverage {
        for size in SIZES {
            let smaller = Spiral { radii: whole.radii * size, ..whole };
            let cameras: Vec<Camera> = smaller.poses(PLACES).into_iter().map(|pose| rig.camera(pose)).collect();
            if coverage.shares(&cameras)?.iter().all(|share| *share >= BOUND) {
                taken = (size, smaller);
                break;
            }
        }
    }
    let (size, spiral) = taken;
    let line = match size < 1.0 {
        true => format!("a spiral {:.0} % as wide as the photos: the part that two photos saw", 100.0 * size),
        false => "a spiral as wide as the photos".into(),
    };
    let cameras: Vec<Camera> = spiral.poses(frames.0).into_iter().map(|pose| rig.camera(pose)).collect();
    Ok((cameras.len() == frames.0).then_some((cameras, line)))
}

/// Smallest and largest z depth of what the cameras see.
fn depths(scene: &Scene, poses: &[Pose]) -> Option<[f64; 2]> {
    let bounds: Vec<[f64; 2]> = scene.frames.iter().filter_map(|f| f.z_bounds).collect();
    if !bounds.is_empty() {
        let low = bounds.iter().map(|b| b[0]).fold(f64::INFINITY, f64::min);
        let high = bounds.iter().map(|b| b[1]).fold(0.0, f64::max);
        return (low > 0.0 && high >= low).then_some([low, high]);
    }
    if let LayoutHint::Object { near, far } = scene.layout {
        return Some([near, far]);
    }
    let every = scene.points.len().saturating_mul(poses.len()).div_ceil(SEEN).max(1);
    let mut seen: Vec<f64> = scene
        .points
        .iter()
        .step_by(every)
        .flat_map(|point| poses.iter().map(|pose| pose.to_camera(point.xyz).z))
        .filter(|&z| z > 0.0)
        .collect();
    if !seen.is_empty() {
        seen.sort_by(f64::total_cmp);
        let at = |share: f64| seen[((seen.len() - 1) as f64 * share) as usize];
        return Some([at(0.02), at(0.98)]);
    }
    let focus = focus_point(poses)?;
    let distance = poses.iter().map(|p| p.c.distance(focus)).sum::<f64>() / poses.len() as f64;
    Some([distance * 0.5, distance * 2.0])
}
