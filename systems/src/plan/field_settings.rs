//! Settings of the fast field for photos of a scene that stands still: where rays begin and end, and what is empty before the
//! first step. `nerf-static` and `nerf-wild` share them.

use super::ground::Ground;
use super::ngp_settings::{Shown, ngp_settings};
use crate::data::Dataset;
use crate::layout::{NEAR_SHARE, nearest_depth};
use crate::options::Background;
use crate::space::SpaceKind;
use crate::static_scene::ngp::NgpConfig;
use glam::DVec3;

/// Without points rays begin at this share of the nearest camera's distance from the centre.
const CAMERA_SHARE: f64 = 0.35;

/// Settings of `ngp` for a scene, each decision with its line. Where space has no end, what one photo alone shows must not find a
/// place right before its camera: rays begin at `near`, what lies before points is empty, and rays end at the sky.
pub(crate) fn field_settings(ground: &mut Ground, data: &Dataset) -> NgpConfig {
    let mut config = ngp_settings(&ground.layout, data, (Shown::Scene, ground.transparent), &mut ground.lines);
    if ground.layout.kind != SpaceKind::Contracted {
        return config;
    }
    config.sky = !ground.transparent && ground.background == Background::Random;
    if config.sky {
        ground.lines.push("sky: every ray ends at infinity, in a colour of its direction".into());
    }
    let seen: usize = data.views().iter().filter(|v| v.level == 0).map(|v| v.points.len()).sum();
    config.free_space = seen > 0;
    if config.free_space {
        let line = format!("free space: what lies before points is empty ({seen} lines from cameras to points)");
        ground.lines.push(line);
    }
    let (near, why) = nearest(data, ground.layout.centre);
    let near = (near / ground.layout.radius) as f32;
    if near.is_finite() && near > config.near {
        config.near = near;
        ground.lines.push(format!("near: {near:.2} radii ({why})"));
    }
    config
}

/// Where rays begin in open scenes, world units, and why. A bound for all cameras: what lies before the points of one camera is
/// cut away by `free_space`.
fn nearest(data: &Dataset, centre: DVec3) -> (f64, String) {
    let views = || data.views().iter().filter(|v| v.level == 0);
    if let Some(nearest) = views().filter_map(|v| nearest_depth(&v.camera, &v.points)).reduce(f64::min) {
        return (nearest, format!("{NEAR_SHARE} of the nearest points' depth"));
    }
    let nearest = views().map(|v| v.camera.pose.c.distance(centre)).fold(f64::INFINITY, f64::min);
    (CAMERA_SHARE * nearest, format!("{CAMERA_SHARE} of the nearest camera's distance from the centre"))
}
