//! Planes behind linear maps, of K-Planes.

use super::{seen, stage, stopped};
use tests::{assert_same_bits, state_after, try_system, views};

/// Small planes behind linear maps.
const EXPLICIT: &[&str] = &[
    "occupancy=16",
    "batch_rays=512",
    "batch_samples=8192",
    "plane_vertices=8",
    "plane_scales=[1,2]",
    "plane_features=4",
    "decoder=explicit",
    "basis_width=16",
    "basis_layers=1",
];

/// The same with proposals in the place of the grid.
const PROPOSED: &[&str] = &[
    "batch_rays=512",
    "batch_samples=8192",
    "plane_vertices=8",
    "plane_scales=[1,2]",
    "plane_features=4",
    "decoder=explicit",
    "basis_width=16",
    "sampler=proposal",
    "proposal_samples=[24,16]",
    "final_samples=12",
];

#[test]
fn linear_maps_have_no_still_part() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let set: Vec<&str> = EXPLICIT.iter().chain(&["background=static"]).copied().collect();
    let problem = try_system("k-planes", &scene, &train, &set).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(problem.contains("background") && problem.contains("decoder=hybrid"), "{problem}");
}

#[test]
fn planes_behind_linear_maps_learn_and_keep_their_bits_after_a_resume() {
    let scene = stage();
    for set in [EXPLICIT, PROPOSED] {
        assert_same_bits(|steps, state| {
            let (train, _) = views(&scene, 1);
            state_after(try_system("k-planes", &scene, &train, set).unwrap().0, &train, steps, state)
        });
        let (train, _) = views(&scene, 1);
        let mut system = try_system("k-planes", &scene, &train, set).unwrap().0;
        let losses: Vec<f64> = (0..40).map(|step| system.step(&train, step).unwrap().loss).collect();
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        assert!(mean(&losses[35..]) < 0.7 * mean(&losses[..5]), "{losses:?}");
        let [early, late] = [0.0, 1.0].map(|time| seen(system.as_ref(), &train, time).rgb);
        assert!(early.as_flattened().iter().all(|v| v.is_finite()) && early != late, "times look alike");
    }
}

#[test]
fn planes_of_a_scene_at_rest_keep_their_bits_behind_linear_maps() {
    let scene = stopped();
    assert_same_bits(|steps, state| {
        let (train, _) = views(&scene, 1);
        state_after(tests::system("k-planes", &scene, &train, EXPLICIT).0, &train, steps, state)
    });
}

#[test]
fn settings_of_a_decoder_are_there_where_it_is() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let refused = |name: &str, set: &[&str]| match try_system(name, &scene, &train, set) {
        Err(e) => e.to_string(),
        Ok(_) => panic!("{name} takes {set:?}"),
    };
    for (name, set, key) in [
        ("k-planes", &["decoder=explicit", "width=8"][..], "width"),
        ("k-planes", &["decoder=hybrid", "basis_width=8"], "basis_width"),
        ("k-planes", &["basis_layers=1"], "basis_layers"),
        ("d-nerf", &["decoder=hybrid"], "decoder"),
        ("ngp", &["sampler=proposal"], "sampler"),
    ] {
        let problem = refused(name, set);
        assert!(problem.contains(&format!("`set` = {key}: there is no such setting")), "{problem}");
    }
    let problem = refused("k-planes", &["decoder=linear"]);
    assert!(problem.contains("linear") && problem.contains("explicit"), "{problem}");
    let (_, plan) = try_system("k-planes", &scene, &train, EXPLICIT).unwrap();
    assert!(plan.config.contains_key("basis_width") && !plan.config.contains_key("geometry"), "{:?}", plan.config);
}
