//! Gaussians of the sky: there where a field sees beyond the scene, or photos may show it; not for things that are cut out.

use crate::wild_clouds::{check_named, planned, scene as table, system};
use engine::data::Dataset;
use engine::render::plain_query;
use engine::system::System;
use glam::Vec3;
use scene_io::synthetic::{PlazaOptions, plaza};
use scene_io::{PerturbationKind, Scene};
use tests::{assert_same_bits, state_after, views};

const NAME: &str = "wild-gaussians";
const OF_FIELD: [&str; 4] = ["start=field", "field_steps=3", "judge_first=1", "sky_splats=300"];
const OF_CAMERAS: [&str; 2] = ["sky=yes", "sky_splats=300"];

fn square() -> Scene {
    plaza(&PlazaOptions { width: 40, height: 30, train: 8, test: 1, rays: 1, ..PlazaOptions::default() })
}

/// How many Gaussians are as far as the sky.
fn of_sky(system: &dyn System, train: &Dataset) -> usize {
    let cameras = (0..train.len()).map(|view| train.view(view).camera.pose.c.as_vec3());
    let reach = cameras.map(Vec3::length).fold(0.0, f32::max);
    let cloud = system.splats(&plain_query([0.0; 3], 0.0)).unwrap().gaussians;
    let n = cloud.len();
    let far = |i: &usize| Vec3::from([0, 1, 2].map(|axis| cloud.mean[axis * n + i])).length() > 5.0 * reach;
    (0..n).filter(far).count()
}

#[test]
fn a_cloud_with_a_sky_has_the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let often = ["densify_from=1", "densify_every=2", "densify_gradient=1e-6", "sky=yes"];
    for set in [&OF_FIELD[..], &OF_CAMERAS[1..]] {
        assert_same_bits(|steps, state| {
            let scene = square();
            let train = views(&scene, 1).0;
            state_after(system(NAME, &scene, &train, &[set, &often].concat()), &train, steps, state)
        });
    }
}

#[test]
fn there_is_a_sky_where_it_was_asked_for_and_seen() {
    let scene = square();
    let train = views(&scene, 1).0;
    let with = |set: &[&str]| {
        let (mut system, plan) = planned(NAME, &scene, &train, set).unwrap();
        for step in 0..4 {
            system.step(&train, step).unwrap();
        }
        let line = plan.lines.iter().find(|line| line.starts_with("sky:")).cloned().unwrap_or_default();
        (of_sky(system.as_ref(), &train), line)
    };
    let (of_cameras, line) = with(&OF_CAMERAS);
    assert!((20..300).contains(&of_cameras) && line.contains("of 301 points"), "{of_cameras}: {line}");
    assert!(line.contains(&of_cameras.to_string()), "{of_cameras}: {line}");
    // After three steps a field sees no surface anywhere.
    let (of_field, line) = with(&[&OF_FIELD[..], &["sky=auto"]].concat());
    assert!(of_field > 20 && line.contains("unless the field sees"), "{of_field}: {line}");
    assert_eq!(with(&["sky=no"]), (0, String::new()));
    let (none, line) = with(&["sky=auto"]);
    assert!(none == 0 && line.contains("no field says"), "{line}");
}

#[test]
fn a_thing_that_is_cut_out_has_no_sky_and_what_cannot_work_is_named() {
    let scene = table(4, PerturbationKind::Both);
    let train = views(&scene, 1).0;
    let (_, plan) = planned(NAME, &scene, &train, &["sky=yes"]).unwrap();
    assert!(plan.lines.iter().any(|line| line.contains("sky: no Gaussians, as the thing is cut out")), "{plan:?}");
    check_named(NAME, &["sky=maybe", "sky_splats=0"]);
}
