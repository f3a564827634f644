//! Systems for scenes that move: each learns, shows the time asked for, and makes the same bits with any number of threads
//! and after a resume. What a part adds is nothing where the part is switched off.

use engine::data::Dataset;
use engine::options::{Background, DataOptions, Plan, RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::source::load_in_order;
use engine::system::{Layers, Query, System, SystemError, TensorData, TensorMap};
use scene_io::synthetic::{OrbitOptions, TissueOptions, orbit, tissue};
use scene_io::{Image, ImageSource, Point, Scene};
use std::ops::Range;
use std::sync::Arc;
use systems::registry::{Family, build, names};
use tests::{assert_same_bits, state_after, state_of, views};

/// Settings with which a step takes milliseconds; a system takes those that its parts have.
const SMALL: [&str; 14] = [
    // What photos need is found out by a training.
    "appearance=none",
    "levels=4",
    "log2_table=12",
    "n_max=64",
    "width=16",
    "geometry=8",
    "occupancy=16",
    "batch_rays=512",
    "batch_samples=8192",
    "warp_width=16",
    "warp_depth=2",
    "ambient_width=16",
    "ambient_depth=2",
    "cue_samples=16",
];

/// What each system needs to be small, so that each of its schedules has something to do within six steps.
fn schedules(name: &str) -> &'static [&'static str] {
    match name {
        "d-nerf" => &[
            "horizon=6",
            "curriculum=0.8",
            "planes=[4,8]",
            "plane_features=2",
            "plane_times=4",
            "levels_anneal=4",
            "coherence=0.5",
        ],
        "nerfies" => &[
            "horizon=6",
            "warp_anneal=0.67",
            "elastic=0.5",
            "elastic_at=all",
            "background_loss=1.0",
            "background_points=32",
            "appearance=codes",
        ],
        "hypernerf" => {
            &["horizon=6", "warp_anneal=0.67", "ambient_from=0.3", "ambient_anneal=0.5", "background_points=32"]
        }
        // Doubled after steps 2, 4 and 6.
        "tineuvox" => &["horizon=6", "voxels=24", "voxels_every=0.33", "voxel_variation=0.01"],
        "k-planes" => &["plane_vertices=8", "plane_scales=[1,2]", "plane_features=4"],
        // Depths give way before steps 2 and 4.
        "endo-nerf" => &["refine_every=2", "refine_share=0.3"],
        // What moves comes after half of the steps, from enough pixels to be found; then chains come, and priors fade three times.
        "nsff" | "dynamic-nerf" => &[
            "batch_rays=1024",
            "batch_samples=16384",
            "horizon=60",
            "moving_from=0.5",
            "flow_chain_from=0.67",
            "flow_fades_in=0.17",
            "planes=[4,8]",
            "plane_features=2",
            "plane_times=4",
        ],
        _ => &[],
    }
}

/// A small stage, with a few points of what stays where it is.
fn stage() -> Scene {
    let options = OrbitOptions { width: 32, height: 32, train: 20, test: 1, rays: 1, ..OrbitOptions::default() };
    let mut scene = orbit(&options);
    let at = |k: u32| [f64::from(k % 4) * 0.2 - 0.3, f64::from(k / 4) * 0.2 - 0.3, 0.0];
    scene.points = (0..16).map(|k| Point { xyz: at(k).into(), rgb: [90; 3] }).collect();
    scene
}

/// Tissue behind a tool, with stereo depth.
fn operation() -> Scene {
    tissue(&TissueOptions { width: 32, height: 24, frames: 6, rays: 1, ..TissueOptions::default() })
}

/// The scene a system is for.
fn scene_of(name: &str) -> Scene {
    if name == "endo-nerf" { operation() } else { stage() }
}

fn planned(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> (Box<dyn System>, Plan) {
    let small = SMALL.iter().filter(|s| has_part(name, s));
    try_planned(name, scene, train, &small.chain(set).copied().collect::<Vec<_>>())
        .unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn try_planned(
    name: &str,
    scene: &Scene,
    train: &Dataset,
    set: &[&str],
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    build(name, scene, train, &run)
}

/// Whether a system has the part that a setting of [`SMALL`] is of.
fn has_part(name: &str, setting: &str) -> bool {
    let has = |systems: &[&str]| systems.contains(&name);
    match setting.split('=').next().unwrap() {
        "levels" | "log2_table" | "n_max" => !has(&["tineuvox", "k-planes"]),
        "warp_width" => !has(&["ngp", "k-planes"]),
        "warp_depth" => !has(&["ngp", "k-planes", "t-nerf", "nsff", "dynamic-nerf"]),
        "ambient_width" | "ambient_depth" => has(&["hypernerf"]),
        "appearance" => has(&["nerfies", "hypernerf"]),
        _ => true,
    }
}

fn system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Box<dyn System> {
    planned(name, scene, train, set).0
}

/// What the first training camera sees at a time.
fn seen(system: &dyn System, train: &Dataset, time: f64) -> Layers {
    render(system, &train.view(0).camera, &Query { time, ..plain_query([1.0; 3], 0.0) }).layers
}

/// The state after steps of a system's own training.
fn trained(name: &str, scene: &Scene, train: &Dataset, set: &[&str], steps: u64) -> TensorMap {
    state_after(system(name, scene, train, set), train, 0..steps, None)
}

fn floats<'a>(state: &'a TensorMap, name: &str) -> &'a [f32] {
    match &state[name].data {
        TensorData::F32(data) => data,
        TensorData::U64(_) => panic!("{name} holds counters"),
    }
}

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
fn each_system_learns_and_shows_the_time_asked_for() {
    for name in names(Family::Moving) {
        let scene = scene_of(name);
        let (train, _) = views(&scene, 1);
        let small: &[&str] = match name {
            "tineuvox" => &["voxels=24"],
            "nsff" | "dynamic-nerf" => &["horizon=40", "moving_from=0.5", "batch_rays=1024"],
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
        assert_eq!(density(0.2) != density(0.9), moves, "{name}");
        // Times outside of [0, 1] show something finite, too.
        for time in [-1.0, 2.0] {
            assert!(seen(system.as_ref(), &train, time).rgb.as_flattened().iter().all(|v| v.is_finite()), "{name}");
        }
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
    if ["nsff", "dynamic-nerf"].contains(&name) { of_sixty(steps) } else { steps }
}

fn of_sixty(steps: Range<u64>) -> Range<u64> {
    10 * steps.start..10 * steps.end
}

/// A still part for half of the schedule, then what moves beside it.
const STATIC: [&str; 2] = ["background=static", "moving_from=0.5"];

#[test]
fn each_system_can_have_a_still_part_with_the_same_bits_for_1_2_and_4_threads_and_after_a_resume() {
    // Those with scene flow always have one, and their schedules are those above.
    let always = ["nsff", "dynamic-nerf"];
    for name in names(Family::Moving).into_iter().filter(|name| *name != "ngp" && !always.contains(name)) {
        println!("{name}");
        let scene = scene_of(name);
        let own = schedules(name).iter().filter(|set| !set.starts_with("horizon"));
        let long = ["horizon=60", "batch_rays=1024", "batch_samples=16384"];
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
fn systems_with_scene_flow_find_what_moves_in_their_schedules() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for name in ["nsff", "dynamic-nerf"] {
        let state = trained(name, &scene, &train, schedules(name), 60);
        assert!(state.contains_key("moving.cells"), "{name}: nothing moves, so nothing of scene flow was tested");
        let problem = try_planned(name, &scene, &train, &["flow_share=0"]).err().map(|e| e.to_string());
        assert!(problem.as_deref().is_some_and(|p| p.contains("flow_share")), "{name}: {problem:?}");
    }
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

#[test]
fn linear_maps_have_no_still_part() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let set: Vec<&str> = EXPLICIT.iter().chain(&STATIC[..1]).copied().collect();
    let problem = try_planned("k-planes", &scene, &train, &set).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(problem.contains("background") && problem.contains("decoder=hybrid"), "{problem}");
}

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
fn planes_behind_linear_maps_learn_and_keep_their_bits_after_a_resume() {
    let scene = stage();
    for set in [EXPLICIT, PROPOSED] {
        assert_same_bits(|steps, state| {
            let (train, _) = views(&scene, 1);
            state_after(try_planned("k-planes", &scene, &train, set).unwrap().0, &train, steps, state)
        });
        let (train, _) = views(&scene, 1);
        let mut system = try_planned("k-planes", &scene, &train, set).unwrap().0;
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
    let build = |train: &Dataset| {
        let set = EXPLICIT.iter().map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
        systems::registry::build("k-planes", &scene, train, &run).unwrap().0
    };
    assert_same_bits(|steps, state| {
        let (train, _) = views(&scene, 1);
        state_after(build(&train), &train, steps, state)
    });
}

#[test]
fn settings_of_a_decoder_are_there_where_it_is() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let refused = |name: &str, set: &[&str]| match try_planned(name, &scene, &train, set) {
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
    let (_, plan) = try_planned("k-planes", &scene, &train, EXPLICIT).unwrap();
    assert!(plan.config.contains_key("basis_width") && !plan.config.contains_key("geometry"), "{:?}", plan.config);
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

/// The stage before white, without alpha, all of it at time 0.
fn stopped() -> Scene {
    let mut scene = stage();
    scene.points.clear();
    for frame in &mut scene.frames {
        frame.time = Some(0.0);
        let ImageSource::Memory(image) = &frame.image else { panic!("drawn in memory") };
        let over_white = |p: &[u8]| {
            let a = u32::from(p[3]);
            [0, 1, 2].map(|c| ((u32::from(p[c]) * a + 255 * (255 - a)) / 255) as u8)
        };
        let rgb = image.data.chunks_exact(4).flat_map(over_white).collect();
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(image.width, image.height, rgb).unwrap()));
    }
    scene
}

#[test]
fn a_deformation_that_does_nothing_is_the_static_system_bit_for_bit() {
    let scene = stopped();
    let (train, _) = views(&scene, 1);
    // So that both keep the same samples, and densities see the same.
    let set = ["occupancy_every=3", "train_faint=0.0", "planes_seen_by=warp", "plane_tv=0.0", "plane_smoothness=0.0"];
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
        let mut system = system(name, &scene, &train, &["planes_seen_by=warp"]);
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
        let Err(error) = try_planned(name, &scene, &train, &[setting]) else { panic!("{name} takes {setting}") };
        let (line, key) = (error.to_string(), setting.split('=').next().unwrap());
        assert!(line.contains(&format!("`set` = {key}: there is no such setting; there are ")), "{name}: {line}");
        assert!(!line.contains('\n'), "{name}: {line}");
    }
    for (name, set) in [
        ("ngp", &["depth=1.0", "guided=true"][..]),
        ("t-nerf", &["time_input=codes"]),
        ("t-nerf", &["planes=[]"]),
        ("d-nerf", &["warp=rigid", "planes=[]"]),
        ("d-nerf", &["origin=free", "sees=time"]),
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
fn a_trained_motion_stays_finite_under_a_strong_elastic_loss() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for at in ["elastic_at=all", "elastic_at=middle"] {
        let set = [at, "elastic=10.0", "warp_lr=1.0", "warp_anneal=0.25", "horizon=40"];
        let mut system = system("nerfies", &scene, &train, &set);
        for step in 0..40 {
            let stats = system.step(&train, step).unwrap();
            assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{at}, step {step}: {stats:?}");
        }
        for (name, tensor) in state_of(system.as_ref()) {
            if let TensorData::F32(data) = &tensor.data {
                assert!(data.iter().all(|v| v.is_finite()), "{at}: {name}");
            }
        }
    }
}

#[test]
fn a_trained_displacement_stays_finite_under_a_strong_coherence_and_the_plan_says_that_it_is_there() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let set = ["coherence=10.0", "warp_lr=1.0", "horizon=40"];
    let (mut system, plan) = planned("d-nerf", &scene, &train, &set);
    assert!(plan.lines.iter().any(|line| line.contains("as rigid as possible")), "{:#?}", plan.lines);
    for step in 0..40 {
        let stats = system.step(&train, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "step {step}: {stats:?}");
    }
    for (name, tensor) in state_of(system.as_ref()) {
        if let TensorData::F32(data) = &tensor.data {
            assert!(data.iter().all(|v| v.is_finite()), "{name}");
        }
    }
    let (_, plan) = planned("d-nerf", &scene, &train, &["coherence=0.0"]);
    assert!(!plan.lines.iter().any(|line| line.contains("as rigid as possible")), "{:#?}", plan.lines);
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
