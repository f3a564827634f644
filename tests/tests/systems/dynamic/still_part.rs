//! A still part beside what moves: it keeps the bits, what moves is found, and it is held where that is asked for.

use super::{floats, of_sixty, planned, scene_of, schedules, stage, system, trained};
use image::{GrayImage, Luma};
use scene_io::Split;
use systems::registry::{Family, names};
use tests::{assert_same_bits, state_after, try_system, views};

/// A still part for half of the schedule, then what moves beside it.
const STATIC: [&str; 2] = ["background=static", "moving_from=0.5"];

#[test]
fn each_system_can_have_a_still_part_with_the_same_bits_for_1_2_and_4_threads_and_after_a_resume() {
    // These have one anyway, and a cloud is no field: training.rs compares their bits.
    let always = ["nsff", "dynamic-nerf", "two-parts", "4dgs", "degauss"];
    for name in names(Family::Moving).into_iter().filter(|name| *name != "ngp" && !always.contains(name)) {
        println!("{name}");
        let scene = scene_of(name);
        let own = schedules(name).iter().filter(|set| !set.starts_with("horizon"));
        let long = ["horizon=60", "batch_rays=512", "batch_samples=8192"];
        let set: Vec<&str> = own.chain(&STATIC).chain(&long).copied().collect();
        assert_same_bits(|steps, state| {
            let (train, _) = views(&scene, 1);
            state_after(system(name, &scene, &train, &set), &train, of_sixty(steps), state)
        });
        let (train, _) = views(&scene, 1);
        let state = trained(name, &scene, &train, &set, 40);
        // All of the tissue moves: where all of a photo is off, nothing of it is off by more than is usual.
        let finds = name != "endo-nerf";
        assert!(
            state.contains_key("moving.cells") || !finds,
            "{name}: a still field of thirty steps explains all photos"
        );
    }
}

#[test]
fn systems_with_a_still_part_find_what_moves_in_their_schedules() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for name in ["nsff", "dynamic-nerf", "two-parts"] {
        let state = trained(name, &scene, &train, schedules(name), 60);
        assert!(state.contains_key("moving.cells"), "{name}: nothing moves, so nothing of what moves was tested");
        let problem = try_system(name, &scene, &train, &["flow_share=0"]).err().map(|e| e.to_string());
        assert!(problem.as_deref().is_some_and(|p| p.contains("flow_share")), "{name}: {problem:?}");
    }
}

/// They are read again at each resume.
#[test]
fn motion_masks_say_what_moves_without_scene_flow_with_the_same_bits_for_1_2_and_4_threads_and_after_a_resume() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = stage();
    for (k, frame) in scene.frames.iter_mut().enumerate().filter(|(_, frame)| frame.split == Split::Train) {
        let path = folder.path().join(format!("{k}.png"));
        GrayImage::from_fn(32, 32, |x, _| Luma([if x < 12 { 255 } else { 0 }])).save(&path).unwrap();
        frame.priors.motion.mask = Some(path);
    }
    let set = schedules("two-parts");
    let (train, _) = views(&scene, 1);
    let (_, plan) = planned("two-parts", &scene, &train, set);
    let movers: Vec<&String> = plan.lines.iter().filter(|line| line.starts_with("movers:")).collect();
    assert_eq!(movers, ["movers: as the motion masks of all photos say"]);
    assert_same_bits(|steps, state| {
        let (train, _) = views(&scene, 1);
        state_after(system("two-parts", &scene, &train, set), &train, of_sixty(steps), state)
    });
    let state = trained("two-parts", &scene, &train, set, 31);
    assert!(state.contains_key("moving.cells") && !state.contains_key("residuals.tiles"), "it is looked for once");
}

/// The still part of `dynamic-nerf` is held once something moves, that of `nsff` is not.
#[test]
fn a_still_part_is_held_where_that_is_asked_for() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for (name, held) in [("nsff", false), ("dynamic-nerf", true)] {
        let [before, after] = [30, 60].map(|steps| trained(name, &scene, &train, schedules(name), steps));
        for of in ["field.density", "field.grid"] {
            let same = floats(&before, of).to_vec() == floats(&after, of).to_vec();
            assert_eq!(same, held, "{name}: {of}");
        }
    }
}
