//! Settings of the fast field for photos from the wild: where rays begin and end, and what is empty before the first step.

use crate::data::Dataset;
use crate::layout::{NEAR_SHARE, nearest_depth};
use crate::plan::{Ground, Shown, ngp_settings};
use crate::space::SpaceKind;
use crate::static_scene::ngp::NgpConfig;
use glam::DVec3;
use render_core::camera::Camera;
use scene_io::Scene;

/// Settings of `ngp` for photos from the wild: what one photo alone shows must not find a place right before its camera.
pub(super) fn field_settings(ground: &mut Ground, scene: &Scene, data: &Dataset) -> NgpConfig {
    let mut config = ngp_settings(&ground.layout, data, (Shown::Scene, ground.transparent), &mut ground.lines);
    if ground.layout.kind == SpaceKind::Contracted {
        config.sky = true;
        ground.lines.push("sky: every ray ends at infinity, in a colour of its direction".into());
        let features: usize = data.views().iter().map(|v| v.points.len()).sum();
        config.free_space = features > 0;
        if config.free_space {
            let line = format!("free space: what lies before the points of {features} features of the photos is empty");
            ground.lines.push(line);
        }
        let (near, why) = nearest(scene, data, ground.layout.centre);
        let near = (near / ground.layout.radius) as f32;
        if near.is_finite() && near > config.near {
            config.near = near;
            ground.lines.push(format!("near: {near:.2} radii ({why})"));
        }
    }
    config
}

/// Where rays begin in open scenes, world units, and why: what stands before all that the photos have in common is a
/// stranger.
fn nearest(scene: &Scene, data: &Dataset, centre: DVec3) -> (f64, String) {
    let cameras: Vec<Camera> = data.views().iter().filter(|v| v.level == 0).map(|v| v.camera).collect();
    let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
    if let Some(nearest) = cameras.iter().filter_map(|camera| nearest_depth(camera, &points)).reduce(f64::min) {
        return (nearest, format!("{NEAR_SHARE} of the nearest points' depth"));
    }
    let nearest = cameras.iter().map(|c| c.pose.c.distance(centre)).fold(f64::INFINITY, f64::min);
    (CAMERA_SHARE * nearest, format!("{CAMERA_SHARE} of the nearest camera's distance from the centre"))
}

/// Without points rays begin at this share of the nearest camera's distance from the centre.
const CAMERA_SHARE: f64 = 0.35;
