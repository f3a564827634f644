//! Where rays begin in open scenes: what one photo alone shows must not find a place right before its camera.

use super::ground::Ground;
use super::ngp_settings::Shown;
use crate::layout::{NEAR_SHARE, nearest_depth, stated_depths};
use crate::space::{SpaceConfig, SpaceKind};
use engine::data::Dataset;
use glam::DVec3;

/// With neither points nor depths rays begin at this share of the nearest camera's distance from the centre.
const CAMERA_SHARE: f64 = 0.35;

/// Set the near plane of `config` where something says how near things are, and say why.
pub(crate) fn set_near(config: &mut SpaceConfig, ground: &mut Ground, data: &Dataset, shown: Shown) {
    if ground.layout.kind != SpaceKind::Contracted {
        return;
    }
    let Some((near, why)) = nearest(data, ground.layout.centre, shown) else { return };
    let near = (near / ground.layout.radius) as f32;
    if near.is_finite() && near > config.near {
        config.near = near;
        ground.lines.push(format!("near: {near:.2} radii ({why})"));
    }
}

/// Where rays begin, world units, and why: a bound for all cameras. By the points, else by the depths that the file states, else by
/// how far the cameras stand off. What moves may be nearer than any point and anywhere between the cameras: there only depths of
/// the file count.
fn nearest(data: &Dataset, centre: DVec3, shown: Shown) -> Option<(f64, String)> {
    let views = || data.views().iter().filter(|v| v.level == 0);
    let of_points = || views().filter_map(|v| nearest_depth(&v.camera, &v.points)).reduce(f64::min);
    if let Some(nearest) = (shown == Shown::Scene).then(of_points).flatten() {
        return Some((nearest, format!("{NEAR_SHARE} of the nearest points' depth")));
    }
    if let Some([near, _]) = stated_depths(data) {
        return Some((NEAR_SHARE * near, format!("{NEAR_SHARE} of the nearest depth in the file")));
    }
    let nearest = views().map(|v| v.camera.pose.c.distance(centre)).fold(f64::INFINITY, f64::min);
    let why = format!("{CAMERA_SHARE} of the nearest camera's distance from the centre");
    (shown == Shown::Scene).then_some((CAMERA_SHARE * nearest, why))
}
