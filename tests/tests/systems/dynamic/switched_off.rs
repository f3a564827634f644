//! What a part adds is nothing where the part is switched off.

use super::{floats, scene_of, seen, stage, stopped, system, trained};
use engine::system::{TensorData, TensorMap};
use tests::{state_of, views};

/// Write over a part of an array.
fn spoil(state: &mut TensorMap, name: &str, from: usize) {
    match &mut state.get_mut(name).unwrap().data {
        TensorData::F32(data) => {
            let values = data.to_mut()[from..].iter_mut().enumerate();
            values.for_each(|(i, value)| *value = 0.3 * (i as f32).sin());
        }
        TensorData::U64(_) => panic!("{name} holds counters"),
    }
}

#[test]
fn a_deformation_that_does_nothing_is_the_static_system_bit_for_bit() {
    let scene = stopped();
    let (train, _) = views(&scene, 1);
    // So that both keep the same samples, and densities see the same.
    let set = [
        "occupancy_every=3",
        "train_faint=0.0",
        "planes_seen_by=warp",
        "plane_tv=0.0",
        "plane_smoothness=0.0",
        // Nothing moves at time 0.
        "origin=tied",
    ];
    let mut still = system("ngp", &scene, &train, &set[..2]);
    let mut moving = system("d-nerf", &scene, &train, &set);
    for step in 0..20 {
        let [a, b] = [&mut still, &mut moving].map(|s| s.step(&train, step).unwrap());
        assert_eq!(a, b, "step {step}");
    }
    let [a, b] = [&still, &moving].map(|s| state_of(s.as_ref()));
    for (name, tensor) in &a {
        assert!(b.get(name) == Some(tensor), "{name} differs");
    }
    assert!(b.len() > a.len(), "what moves is there, and has not moved");
    let fresh = state_of(system("d-nerf", &scene, &train, &set).as_ref());
    assert_eq!(floats(&b, "deform.networks"), floats(&fresh, "deform.networks"));
    assert_eq!(seen(still.as_ref(), &train, 0.0), seen(moving.as_ref(), &train, 0.0));

    // With times it is another system.
    let mut scene = scene;
    let last = scene.frames.len() as f64 - 1.0;
    scene.frames.iter_mut().enumerate().for_each(|(i, frame)| frame.time = Some(i as f64 / last));
    let (train, _) = views(&scene, 1);
    let other = trained("d-nerf", &scene, &train, &set, 20);
    assert_ne!(floats(&other, "field.grid"), floats(&b, "field.grid"));
}

#[test]
fn the_canonical_time_needs_no_deformation() {
    for name in ["d-nerf", "endo-nerf"] {
        let scene = scene_of(name);
        let (train, _) = views(&scene, 1);
        let mut system = system(name, &scene, &train, &["planes_seen_by=warp", "origin=tied"]);
        for step in 0..10 {
            system.step(&train, step).unwrap();
        }
        let before = [0.0, 0.5].map(|t| seen(system.as_ref(), &train, t));
        let mut state = state_of(system.as_ref());
        spoil(&mut state, "deform.networks", 0);
        system.load_state(&state).unwrap();
        let after = [0.0, 0.5].map(|t| seen(system.as_ref(), &train, t));
        assert!(before[0] == after[0], "{name}: t = 0 is the canonical scene whatever the parameters are");
        assert!(before[1] != after[1], "{name}: at other times they matter");
    }
}

#[test]
fn ambient_coordinates_are_nothing_before_they_come_in() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    // Parameters of the warp come first, then the ambient network's; without planes nothing comes behind them.
    let warp = floats(&trained("nerfies", &scene, &train, &["planes=[]"], 0), "deform.networks").len();
    for (from, in_use) in [("ambient_from=0.5", false), ("ambient_from=0.0", true)] {
        let set = ["planes=[]", from, "ambient_anneal=0.0"];
        let mut system = system("hypernerf", &scene, &train, &set);
        let start = state_of(system.as_ref());
        for step in 0..6 {
            system.step(&train, step).unwrap();
        }
        let mut state = state_of(system.as_ref());
        let [begun, now] = [&start, &state].map(|s| floats(s, "deform.networks"));
        assert_ne!(begun[..warp], now[..warp], "the warp learns");
        assert_eq!(begun[warp..] != now[warp..], in_use, "{set:?}: the ambient network learns");
        let before = seen(system.as_ref(), &train, 0.5);
        spoil(&mut state, "deform.networks", warp);
        system.load_state(&state).unwrap();
        assert_eq!(before != seen(system.as_ref(), &train, 0.5), in_use, "{set:?}: what it says is seen");
    }
}

#[test]
fn losses_without_weight_change_nothing() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let off = ["elastic=0.0", "background_loss=0.0"];
    let plain = trained("nerfies", &scene, &train, &off, 8);
    for set in [
        &["elastic_scale=0.5"][..],
        &["elastic_at=all"],
        &["background_points=7"],
        &["elastic_at=all", "elastic_scale=1.0", "background_points=0"],
    ] {
        let set: Vec<&str> = off.iter().chain(set).copied().collect();
        assert!(trained("nerfies", &scene, &train, &set, 8) == plain, "{set:?}");
    }
    for set in [["elastic=1.0", "background_loss=0.0"], ["elastic=0.0", "background_loss=1.0"]] {
        assert!(trained("nerfies", &scene, &train, &set, 8) != plain, "{set:?}: with weight it does");
    }
    // Nothing is held where no point of the background is known.
    let mut bare = scene;
    bare.points.clear();
    let (train, _) = views(&bare, 1);
    assert!(trained("nerfies", &bare, &train, &["elastic=0.0", "background_loss=1.0"], 8) == plain);
    let plain = trained("d-nerf", &bare, &train, &["coherence=0.0"], 8);
    let set = ["coherence=0.0", "coherence_reach=0.1", "coherence_scale=0.5"];
    assert!(trained("d-nerf", &bare, &train, &set, 8) == plain, "coherence without a factor");
    for (name, small) in [("d-nerf", "horizon=40"), ("tineuvox", "voxels=24"), ("nerfies", "horizon=40")] {
        let with = |set: &str| trained(name, &bare, &train, &[small, set], 8);
        assert!(with("coherence=1.0") != with("coherence=0.0"), "{name}: with a factor it does something");
    }
    let set = ["coherence=1.0", "warp=none"];
    let still = trained("d-nerf", &bare, &train, &["coherence=0.0", "warp=none"], 8);
    assert!(trained("d-nerf", &bare, &train, &set, 8) == still, "nothing is moved, so nothing is held together");
    // The same of measured depth, where there is none.
    let plain = trained("d-nerf", &bare, &train, &[], 8);
    assert!(trained("d-nerf", &bare, &train, &["depth=1.0", "refine_every=3"], 8) == plain);
}
