//! What the engine says of real systems: fog before a cloud, points of a filmed frame.

use crate::plan::made;
use crate::registry::build;
use engine::data::Dataset;
use engine::eval::{fog, opacity_before};
use engine::halt::Halt;
use engine::options::RunOptions;
use engine::render::plain_query;
use engine::scene_points::nearest_point;
use engine::surface::POINT_OPACITY;
use engine::surface::frame_points;
use scene_io::synthetic::{TissueOptions, tissue};
use scene_io::{ImageStore, Split, StoreOptions};
use std::sync::Arc;

#[test]
fn fog_of_a_cloud_is_what_is_drawn_of_nearer_gaussians() {
    let (scene, data) = made::capture(made::Points::WithTracks);
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: Default::default() };
    let (system, _) = build("splat", &scene, &data, &run).unwrap();
    let camera = &data.view(0).camera;
    let before = |depth| opacity_before(system.as_ref(), camera, depth, 0.0).unwrap();
    let nearest = nearest_point(camera, &data.view(0).points).unwrap();
    assert!(before(0.5 * nearest) < 1e-6, "{}", before(0.5 * nearest));
    assert!(before(100.0 * nearest) > 0.05, "{}", before(100.0 * nearest));
    assert!(fog(system.as_ref(), data.view(0), &Halt::NEVER).is_some_and(|fog| fog < 0.02));
    let (_, data) = made::capture(made::Points::None);
    assert_eq!(fog(system.as_ref(), data.view(0), &Halt::NEVER), None);
}

#[test]
fn points_lie_on_the_rays_of_their_camera_within_the_range_of_depths() {
    let scene = tissue(&TissueOptions { width: 24, height: 18, frames: 6, ..TissueOptions::default() });
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: toml::Table::default() };
    let (mut system, _) = crate::registry::build("endo-nerf", &scene, &data, &run).unwrap();
    for step in 0..30 {
        system.step(&data, step).unwrap();
    }
    let query = plain_query([0.0; 3], 1e-3);
    for smooth in [false, true] {
        let view = data.view(1);
        let cloud = frame_points(system.as_ref(), view, &query, smooth);
        assert!(!cloud.positions.is_empty() && cloud.colours.len() == cloud.positions.len());
        assert!(cloud.confidence.iter().all(|a| (POINT_OPACITY..=1.0).contains(a)));
        for x in &cloud.positions {
            let seen = view.camera.pose.to_camera(glam::DVec3::from_array(*x));
            assert!(seen[2] > 0.0, "in front of the camera: {seen:?}");
        }
    }
}
