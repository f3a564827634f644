//! `d-nerf` with `field=mlp`: the published shapes and parameter counts, and small networks that learn, resume and do not mind
//! threads.

use engine::data::Dataset;
use engine::options::{Background, RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::system::{Canonical, LayerRequest, Query, System};
use scene_io::Scene;
use scene_io::synthetic::{OrbitOptions, orbit};
use systems::registry::{build, find};
use tests::{assert_same_bits, state_after, state_of, system, try_system, views};

/// Small networks whose schedules all have something to do within six steps.
const SMALL: [&str; 15] = [
    "field=mlp",
    "width=16",
    "depth=3",
    "coarse=8",
    "fine=8",
    "batch_rays=64",
    "position_octaves=4",
    "warp_width=16",
    "warp_depth=6",
    "warp_octaves=2",
    "time_octaves=2",
    "lr=5e-3",
    "horizon=8",
    "precrop_share=0.3",
    "curriculum_share=0.6",
];

/// A small stage, all of whose pictures are of different times.
fn stage() -> (Scene, Dataset, Dataset) {
    let scene = orbit(&OrbitOptions { width: 24, height: 24, train: 16, test: 2, rays: 1, ..OrbitOptions::default() });
    let (train, test) = views(&scene, 1);
    (scene, train, test)
}

/// [`SMALL`] with other settings over it.
fn with<'s>(more: &[&'s str]) -> Vec<&'s str> {
    SMALL.iter().chain(more).copied().collect()
}

/// Mean squared error of the held-out views at their times.
fn error(system: &dyn System, views: &Dataset) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for v in 0..views.len() {
        let query = Query { time: views.view(v).time, ..plain_query([1.0; 3], 0.0) };
        let out = render(system, &views.view(v).camera, &query).layers;
        let image = views.image(v).unwrap();
        for (rgb, photo) in out.rgb.iter().zip(image.data.chunks(usize::from(image.channels))) {
            let a = photo.get(3).map_or(1.0, |&a| f32::from(a) / 255.0);
            for (value, photo) in rgb.iter().zip(photo) {
                let truth = f32::from(*photo) / 255.0 * a + 1.0 - a;
                sum += f64::from(value.clamp(0.0, 1.0) - truth).powi(2);
                n += 1.0;
            }
        }
    }
    sum / n
}

#[test]
fn shapes_and_parameter_counts_are_the_published_ones() {
    let (scene, train, _) = stage();
    let (d_nerf, plan) = system("d-nerf", &scene, &train, &["field=mlp"]);
    // The network of `nerf`, and one of the same trunk that sees the time besides: the point alone comes in once more.
    let before = ((63 + 21) * 256 + 256) + 4 * (256 * 256 + 256);
    let after = ((63 + 256) * 256 + 256) + 2 * (256 * 256 + 256) + (256 * 3 + 3);
    assert_eq!(d_nerf.parameter_count(), 595_844 + before + after);
    for (name, value) in [
        ("field", "\"mlp\""),
        ("origin", "\"tied\""),
        ("coarse", "64"),
        ("fine", "128"),
        ("position_octaves", "10"),
        ("direction_octaves", "4"),
        ("warp_octaves", "10"),
        ("time_octaves", "10"),
        ("horizon", "800000"),
        ("curriculum_share", "0.125"),
    ] {
        assert_eq!(plan.config[name].to_string(), value, "{name}");
    }
    let claim = find("d-nerf").unwrap().claim_with(&plan.config);
    assert!(claim.mark.contains("published networks") && plan.lines.contains(&claim.line().unwrap()));
    let (two, _) = system("d-nerf", &scene, &train, &["field=mlp", "fine_networks=true"]);
    assert_eq!(two.parameter_count(), 2 * d_nerf.parameter_count());
    // What there is without a word is the fast field.
    let (_, usual) = system("d-nerf", &scene, &train, &["occupancy=16"]);
    assert!(usual.config["field"].as_str() == Some("ngp") && usual.config.contains_key("planes"));
}

#[test]
fn photos_with_alpha_are_before_white_unless_something_else_is_said() {
    let (scene, train, _) = stage();
    let background = |background| {
        let set = with(&[]).iter().map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 3, background, error_budget: None, stop: None, set };
        build("d-nerf", &scene, &train, &run).unwrap().1
    };
    let transparent = train.image(0).unwrap().channels == 4;
    let plan = background(None);
    assert_eq!(plan.background == Background::White, transparent, "{:?}", plan.lines);
    assert_eq!(background(Some(Background::Black)).background, Background::Black);
}

#[test]
fn small_networks_learn_what_moves_and_say_what_they_leave_out() {
    let (scene, train, test) = stage();
    let other = &["horizon=300", "origin=exact", "warp_variation=1e-3", "fine_networks=true"];
    for more in [&["horizon=300"][..], other] {
        let (mut d_nerf, _) = system("d-nerf", &scene, &train, &with(more));
        let before = error(d_nerf.as_ref(), &test);
        for step in 0..300 {
            let stats = d_nerf.step(&train, step).unwrap();
            assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{more:?}, step {step}: {stats:?}");
        }
        let after = error(d_nerf.as_ref(), &test);
        println!("{more:?}: squared error {before:.4}, after 300 steps {after:.4}");
        assert!(after < 0.6 * before, "{more:?}: {before} {after}");
        let rows = d_nerf.skips();
        let still = rows.iter().find(|row| row.what.contains("canonical time")).unwrap();
        assert!(still.skipped > 0 && still.skipped < still.total, "{still:?}");
        // Something has learnt to move, and nothing moves at the canonical time.
        let layers = LayerRequest { canonical: Canonical::Compute, ..LayerRequest::default() };
        let moved = |time: f64| {
            let query = Query { time, layers, ..plain_query([1.0; 3], 0.0) };
            let camera = train.view(0).camera;
            let out = render(d_nerf.as_ref(), &camera, &query).layers;
            let mut there = [[0.0; 3]];
            d_nerf.canonical(&[[0.1, 0.0, 0.2]], time, &mut there);
            assert_eq!(out.canonical.len(), out.rgb.len());
            there[0] != [0.1, 0.0, 0.2]
        };
        assert!(moved(0.7) && !moved(0.0), "{more:?}");
    }
}

#[test]
fn the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let (scene, train, _) = stage();
    for more in [&[] as &[&str], &["origin=exact", "warp_variation=1e-3", "fine_networks=true", "density_noise=0.5"]] {
        let set = with(more);
        assert_same_bits(|steps, state| state_after(system("d-nerf", &scene, &train, &set).0, &train, steps, state));
    }
}

#[test]
fn each_setting_changes_what_is_learnt_and_a_variation_of_0_nothing() {
    let (scene, train, _) = stage();
    let learnt = |more: &[&str]| state_after(system("d-nerf", &scene, &train, &with(more)).0, &train, 0..8, None);
    let plain = learnt(&[]);
    assert!(learnt(&["warp_variation=0.0"]) == plain, "nothing is added");
    for other in ["warp_variation=10.0", "precrop_share=0.0", "curriculum_share=0.0", "origin=exact", "horizon=80"] {
        assert!(learnt(&[other]) != plain, "{other}");
    }
}

#[test]
fn what_cannot_be_is_refused_by_name_and_a_state_of_another_field_too() {
    let (scene, train, _) = stage();
    for (setting, named) in [
        ("warp_width=0", "`warp_width` = 0"),
        ("time_octaves=33", "`time_octaves` = 33"),
        ("precrop_share=2.0", "`precrop_share` = 2"),
        ("horizon=0", "`horizon` = 0"),
        ("lr_decay_share=0.0", "`lr_decay_share` = 0"),
        ("origin=free", "free"),
        ("planes=[4]", "`set` = planes"),
        ("field=grid", "grid"),
    ] {
        let Err(error) = try_system("d-nerf", &scene, &train, &with(&[setting])) else { panic!("{setting} is taken") };
        assert!(error.to_string().contains(named), "{setting}: {error}");
    }
    let (hybrid, _) = system("d-nerf", &scene, &train, &["occupancy=16", "levels=2", "log2_table=8"]);
    let (mut networks, _) = system("d-nerf", &scene, &train, &with(&[]));
    let error = networks.load_state(&state_of(hybrid.as_ref())).unwrap_err().to_string();
    assert!(error.contains("networks"), "{error}");
}
