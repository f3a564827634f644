//! Settings of absent parts, what the data measure and say, and times from the order of images.

use super::{operation, planned, stage, system, trained};
use engine::options::DataOptions;
use engine::source::load_in_order;
use tests::{try_system, views};

#[test]
fn settings_of_parts_that_are_not_there_are_refused_in_one_line_and_optional_parts_train() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for (name, setting) in [
        ("ngp", "warp_lr=0.1"),
        ("ngp", "planes=[4]"),
        ("ngp", "coherence=0.1"),
        ("t-nerf", "coherence=0.1"),
        ("t-nerf", "warp=rigid"),
        ("d-nerf", "elastic=0.1"),
        ("d-nerf", "background_loss=1.0"),
        ("d-nerf", "ambient=2"),
        ("nerfies", "ambient=2"),
        ("nerfies", "sees=time"),
        ("tineuvox", "planes=[4]"),
        ("tineuvox", "elastic=0.1"),
        ("endo-nerf", "elastic=0.1"),
    ] {
        let Err(error) = try_system(name, &scene, &train, &[setting]) else { panic!("{name} takes {setting}") };
        let (line, key) = (error.to_string(), setting.split('=').next().unwrap());
        assert!(line.contains(&format!("`set` = {key}: there is no such setting; there are ")), "{name}: {line}");
        assert!(!line.contains('\n'), "{name}: {line}");
    }
    for (name, set) in [
        ("ngp", &["depth=1.0", "guided=true"][..]),
        ("t-nerf", &["time_input=codes"]),
        ("t-nerf", &["planes=[]"]),
        ("d-nerf", &["warp=rigid", "planes=[]"]),
        ("d-nerf", &["origin=tied", "sees=time"]),
        ("d-nerf", &["coherence=0.1", "coherence_reach=0.05"]),
        ("tineuvox", &["coherence=0.1", "voxels=24"]),
        ("nerfies", &["warp=translation", "time_input=time", "origin=tied"]),
        ("hypernerf", &["elastic=0.1", "sees=point", "ambient=0"]),
    ] {
        let mut system = system(name, &scene, &train, set);
        let stats = system.step(&train, 0).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{name} {set:?}: {stats:?}");
    }
}

#[test]
fn measured_depth_and_masks_are_followed_and_it_is_said() {
    let scene = operation();
    let (train, _) = views(&scene, 1);
    let (_, plan) = planned("endo-nerf", &scene, &train, &[]);
    let said = plan.lines.join("\n");
    assert!(said.contains("none under the masks") && said.contains("measured depths lead samples"), "{said}");
    let state = |set: &[&str]| trained("endo-nerf", &scene, &train, set, 6);
    let usual = state(&[]);
    for set in ["depth=0.0", "cue_samples=0", "guided=false", "cue_spread=0.5", "depth_delta=0.01"] {
        assert!(state(&[set]) != usual, "{set} changes nothing");
    }
    let bare = stage();
    let (train, _) = views(&bare, 1);
    let (_, plan) = planned("endo-nerf", &bare, &train, &[]);
    let said = plan.lines.join("\n");
    assert!(said.contains("rays: anywhere") && said.contains("depth: none is measured"), "{said}");
}

#[test]
fn images_that_say_nothing_of_time_are_in_its_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut timeless = stage();
    timeless.frames.iter_mut().for_each(|frame| frame.time = None);
    scene_io::synthetic::write_blender(&timeless, folder.path()).unwrap();
    let path = folder.path().to_str().unwrap();
    let scene = load_in_order(path, &DataOptions::default()).unwrap();
    let n = scene.frames.len();
    for (i, frame) in scene.frames.iter().enumerate() {
        assert_eq!(frame.time, Some(i as f64 / (n - 1) as f64), "{}", frame.name);
    }
    let note = format!("no times in the files: the order of the {n} frames is taken for it");
    assert!(scene.notes.contains(&note), "{:?}", scene.notes);
    // Nobody else is told a time.
    let scene = engine::source::load(path, &DataOptions::default()).unwrap();
    assert!(scene.frames.iter().all(|frame| frame.time.is_none()));
    // Times that are there stay.
    let scene = load_in_order("synthetic:orbit", &DataOptions::default()).unwrap();
    assert!(scene.notes.is_empty() && scene.frames[3].time == Some(3.0 / 79.0), "{:?}", scene.frames[3].time);
}
