//! Each system trains: it learns, shows the time asked for, keeps its bits, and stays finite under strong losses.

use super::{floats, of_sixty, operation, planned, scene_of, schedules, seen, stage, system, trained};
use engine::data::Dataset;
use engine::render::{plain_query, render};
use engine::system::{Behind, LayerRequest, Query, System, TensorData};
use std::ops::Range;
use systems::registry::{Family, names};
use tests::{assert_same_bits, state_after, state_of, views};

#[test]
fn each_system_learns_and_shows_the_time_asked_for() {
    for name in names(Family::Moving) {
        let scene = scene_of(name);
        let (train, _) = views(&scene, 1);
        let small: &[&str] = match name {
            "tineuvox" => &["voxels=24"],
            "nsff" | "dynamic-nerf" | "two-parts" => &["horizon=40", "moving_from=0.5", "batch_rays=1024"],
            "4dgs" => &[
                "start=random",
                "start_count=2000",
                "max_splats=2000",
                "horizon=40",
                "motion_from=0.1",
                "lr_mean=0.002",
                "lr_dc=0.02",
                "plane_vertices=16",
            ],
            "degauss" => &[
                "start=random",
                "start_count=2000",
                "max_splats=2000",
                "horizon=40",
                "front_from=0.1",
                "front_count=1000",
                "motion_from=0.1",
                "lr_mean=0.002",
                "lr_dc=0.02",
                "plane_vertices=16",
            ],
            _ => &[],
        };
        let mut system = system(name, &scene, &train, small);
        let losses: Vec<f64> = (0..40)
            .map(|step| {
                let stats = system.step(&train, step).unwrap();
                assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{name}, step {step}: {stats:?}");
                // Not the loss: scene flow costs what was free before it came.
                stats.mse
            })
            .collect();
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        let (first, last) = (mean(&losses[..3]), mean(&losses[37..]));
        println!("{name}: squared error {first:.5} to {last:.5}");
        assert!(last < 0.7 * first, "{name}: {losses:?}");

        let shown = [0.0, 0.5, 1.0].map(|t| seen(system.as_ref(), &train, t));
        let moves = name != "ngp";
        assert_eq!(shown[0].rgb != shown[1].rgb, moves, "{name}");
        assert_eq!(shown[1].rgb != shown[2].rgb, moves, "{name}");
        assert_eq!(seen(system.as_ref(), &train, 0.5), shown[1], "{name}: the same twice");
        what_stands_still_is_the_same_at_all_times(system.as_ref(), &train);
        // Points of the scene, too.
        let points: Vec<[f64; 3]> = (0..200)
            .map(|i| [0, 1, 2].map(|a| ((i * [17, 31, 57][a]) % 97) as f64 / 97.0))
            .map(|u| {
                let [low, high] = system.bounds();
                [0, 1, 2].map(|a| low[a] + u[a] * (high[a] - low[a]))
            })
            .collect();
        let density = |time| {
            let mut out = vec![0.0; points.len()];
            system.density(&points, time, &mut out);
            assert!(out.iter().all(|d| d.is_finite() && *d >= 0.0), "{name}");
            out
        };
        // Gaussians have no density in space.
        assert_eq!(density(0.2) != density(0.9), moves && !system.is_cloud(), "{name}");
        // Times outside of [0, 1] show something finite, too.
        for time in [-1.0, 2.0] {
            assert!(seen(system.as_ref(), &train, time).rgb.as_flattened().iter().all(|v| v.is_finite()), "{name}");
        }
    }
}

/// Only systems that know it show it alone.
fn what_stands_still_is_the_same_at_all_times(system: &dyn System, train: &Dataset) {
    let name = system.name();
    let [first, last] = [0.0, 1.0].map(|time| {
        let plain = plain_query([1.0; 3], 0.0);
        let query = Query { time, layers: LayerRequest { behind: Behind::Compute, ..plain.layers }, ..plain };
        render(system, &train.view(0).camera, &query).layers
    });
    assert_eq!(system.knows_behind(), name == "degauss");
    assert_eq!(first.behind, last.behind, "{name}");
    let pixels = if system.knows_behind() { first.rgb.len() } else { 0 };
    assert_eq!(first.behind.len(), pixels, "{name}");
    if pixels > 0 {
        assert_ne!(first.behind, first.rgb, "{name}: something is in front");
    }
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    for name in names(Family::Moving) {
        println!("{name}");
        let scene = scene_of(name);
        assert_same_bits(|steps, state| {
            let (train, _) = views(&scene, 1);
            state_after(system(name, &scene, &train, schedules(name)), &train, of_schedule(name, steps), state)
        });
    }
}

/// As many parts of a schedule as these steps are of six: a field must be sharp before it is told what moves.
fn of_schedule(name: &str, steps: Range<u64>) -> Range<u64> {
    if ["nsff", "dynamic-nerf", "two-parts"].contains(&name) { of_sixty(steps) } else { steps }
}

#[test]
fn schedules_do_something_within_the_steps_that_are_compared() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let lens = [1, 2, 4, 6].map(|n| {
        let state = trained("tineuvox", &scene, &train, schedules("tineuvox"), n);
        floats(&state, "field.grid").len()
    });
    assert!(lens.is_sorted_by(|a, b| a < b), "voxels double in number: {lens:?}");
    let scene = operation();
    let (train, _) = views(&scene, 1);
    // Steps 0 and 1, and the round before step 2.
    let [before, after] = [2, 3].map(|n| trained("endo-nerf", &scene, &train, schedules("endo-nerf"), n));
    assert_ne!(floats(&before, "cues.0"), floats(&after, "cues.0"), "some depths have given way");
    let kept = floats(&before, "cues.0").iter().zip(floats(&after, "cues.0")).filter(|(a, b)| a == b).count();
    assert!(kept * 2 > floats(&before, "cues.0").len(), "most have not");
}

/// Forty steps have a finite loss each, and leave a finite state.
fn stays_finite(mut system: Box<dyn System>, train: &Dataset, what: &str) {
    for step in 0..40 {
        let stats = system.step(train, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{what}, step {step}: {stats:?}");
    }
    for (name, tensor) in state_of(system.as_ref()) {
        if let TensorData::F32(data) = &tensor.data {
            assert!(data.iter().all(|v| v.is_finite()), "{what}: {name}");
        }
    }
}

#[test]
fn a_trained_motion_stays_finite_under_a_strong_elastic_loss() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for at in ["elastic_at=all", "elastic_at=middle"] {
        let set = [at, "elastic=10.0", "warp_lr=1.0", "warp_anneal=0.25", "horizon=40"];
        stays_finite(system("nerfies", &scene, &train, &set), &train, at);
    }
}

#[test]
fn a_trained_displacement_stays_finite_under_a_strong_coherence_and_the_plan_says_that_it_is_there() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let set = ["coherence=10.0", "warp_lr=1.0", "horizon=40"];
    let (system, plan) = planned("d-nerf", &scene, &train, &set);
    assert!(plan.lines.iter().any(|line| line.contains("as rigid as possible")), "{:#?}", plan.lines);
    stays_finite(system, &train, set[0]);
    let (_, plan) = planned("d-nerf", &scene, &train, &["coherence=0.0"]);
    assert!(!plan.lines.iter().any(|line| line.contains("as rigid as possible")), "{:#?}", plan.lines);
}
