//! Photos of a scene that moves in exposures of their own: codes explain them, the plan finds out that they are needed, photos of one
//! `appearance_id` share one, and an appearance is fitted at the time of its photo.

use engine::data::Dataset;
use engine::halt::Halt;
use engine::render::{plain_query, render};
use engine::system::{Appearance, Fit, Query, System, TensorData};
use scene_io::synthetic::{OrbitOptions, orbit};
use scene_io::{FrameIds, LoadOptions, PerturbationKind, Scene, Split, load, perturb};
use std::sync::Arc;
use testkit::golden::data_or_skip;
use tests::{state_of, system, try_system, views};

/// Settings with which a step takes milliseconds.
const SMALL: [&str; 8] = [
    "levels=4",
    "log2_table=12",
    "n_max=64",
    "width=16",
    "occupancy=16",
    "batch_rays=512",
    "batch_samples=8192",
    "warp_width=16",
];

/// A small stage in equal exposures.
fn stage() -> Scene {
    orbit(&OrbitOptions { width: 32, height: 32, train: 20, test: 1, rays: 1, ..OrbitOptions::default() })
}

/// [`SMALL`] settings and others.
fn small(set: &[&'static str]) -> Vec<&'static str> {
    SMALL.iter().chain(set).copied().collect()
}

/// A field that learns a small stage in a few hundred steps.
const FIELD: [&str; 6] =
    ["levels=8", "log2_table=14", "n_max=128", "occupancy=32", "batch_rays=512", "batch_samples=8192"];

/// A filmed stage whose photos differ in exposure; every seventh is held out, in an exposure of its own.
fn exposed() -> Scene {
    let options = OrbitOptions { width: 48, height: 48, train: 35, test: 0, rays: 1, ..OrbitOptions::default() };
    let mut scene = perturb(orbit(&options), PerturbationKind::Colour, 4);
    for frame in scene.frames.iter_mut().skip(3).step_by(7) {
        frame.split = Split::Test;
    }
    scene
}

/// PSNR of the right halves of photos on white, each at its time and in the appearance that explains its left half best.
fn right_halves(system: &dyn System, photos: &Dataset) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    for (v, view) in photos.views().iter().enumerate() {
        let image = photos.image(v).unwrap();
        let on_white = |x: u32, y: u32| {
            let rgba = image.data.as_chunks::<4>().0[(y * image.width + x) as usize];
            let [r, g, b, a] = rgba.map(|c| f32::from(c) / 255.0);
            [r, g, b].map(|c| c * a + 1.0 - a)
        };
        let middle = image.width / 2;
        let left: Vec<(u32, u32)> = (0..image.height).flat_map(|y| (0..middle).map(move |x| (x, y))).collect();
        let rays: Vec<_> = left.iter().map(|&(x, y)| view.ray(x, y).unwrap()).collect();
        let rgb: Vec<[f32; 3]> = left.iter().map(|&(x, y)| on_white(x, y)).collect();
        let fit = Fit {
            rays: &rays,
            rgb: &rgb,
            time: view.time,
            background: [1.0; 3],
            steps: 200,
            lr: 0.05,
            seed: 1,
            halt: &Halt::NEVER,
        };
        let code = system.fit_appearance(&fit);
        let appearance = code.map_or(Appearance::Mean, |code| Appearance::Code(Arc::from(code)));
        let query = Query { appearance, time: view.time, ..plain_query([1.0; 3], 0.0) };
        let shown = render(system, &view.camera, &query).layers.rgb;
        for (x, y) in (0..image.height).flat_map(|y| (middle..image.width).map(move |x| (x, y))) {
            let got = shown[(y * image.width + x) as usize];
            sum += (0..3).map(|c| f64::from(got[c].clamp(0.0, 1.0) - on_white(x, y)[c]).powi(2)).sum::<f64>();
            n += 3;
        }
    }
    -10.0 * (sum / f64::from(n)).log10()
}

#[test]
fn codes_explain_exposures_that_one_appearance_cannot() {
    let scene = exposed();
    let (train, test) = views(&scene, 1);
    assert_eq!((train.len(), test.len()), (30, 5));
    for name in ["nerfies", "hypernerf"] {
        let [none, codes] = ["appearance=none", "appearance=codes"].map(|appearance| {
            let set: Vec<&str> = FIELD.iter().copied().chain([appearance]).collect();
            let (mut system, _) = system(name, &scene, &train, &set);
            assert_eq!(system.appearance_code(&Appearance::Mean).is_some(), appearance == "appearance=codes");
            for step in 0..200 {
                system.step(&train, step).unwrap();
            }
            right_halves(system.as_ref(), &test)
        });
        println!("{name}: {none:.2} dB in one appearance, {codes:.2} with codes");
        assert!(codes > none + 1.5, "{name}: {codes:.2} with codes, {none:.2} without");
    }
}

#[test]
fn codes_are_planned_where_exposures_differ_and_it_is_said_why() {
    let lines = |scene: &Scene| {
        let (train, _) = views(scene, 1);
        let (system, plan) = system("nerfies", scene, &train, &FIELD);
        let has = system.appearance_code(&Appearance::Mean).map(|code| code.len());
        (has, plan.config["appearance"].clone(), plan.lines.join("\n"))
    };
    let (has, word, said) = lines(&exposed());
    assert_eq!((has, word.as_str()), (Some(8), Some("codes")), "{said}");
    assert!(said.contains("appearance: a code for each photo (after 80 plain steps photos differ"), "{said}");
    let options = OrbitOptions { width: 48, height: 48, train: 30, test: 0, rays: 1, ..OrbitOptions::default() };
    let (has, word, said) = lines(&orbit(&options));
    assert_eq!((has, word.as_str()), (None, Some("none")), "{said}");
    assert!(said.contains("appearance: one for all (after 80 plain steps"), "{said}");
}

#[test]
fn a_capture_whose_exposure_changes_can_have_codes() {
    let test = "a_capture_whose_exposure_changes_can_have_codes";
    let Some(path) = data_or_skip(env!("CARGO_MANIFEST_DIR"), "nerfies_capture", test) else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    let (train, _) = views(&scene, 1);
    // Found by itself it is not: half of the limit, by what both halves of photos have in common.
    let (_, plan) = system("nerfies", &scene, &train, &FIELD);
    assert!(plan.lines.iter().any(|line| line.starts_with("appearance: one for all (after 80")), "{:#?}", plan.lines);
    let set = [&FIELD[..], &["appearance=codes"]].concat();
    let (mut system, _) = system("nerfies", &scene, &train, &set);
    assert!(system.appearance_code(&Appearance::Mean).is_some());
    assert!(system.step(&train, 0).unwrap().loss.is_finite());
}

#[test]
fn photos_of_one_appearance_id_share_a_code_whatever_the_ids_are() {
    let mut scene = stage();
    for (i, frame) in scene.frames.iter_mut().enumerate() {
        let appearance = [9, u32::MAX, 0][i % 3];
        frame.ids = Some(FrameIds { time: i as u32, appearance, camera: 0 });
    }
    let (train, _) = views(&scene, 1);
    let (mut system, plan) = system("nerfies", &scene, &train, &small(&["appearance=codes"]));
    assert!(plan.lines.iter().any(|line| line.contains("3 codes for 20 photos")), "{:?}", plan.lines);
    for step in 0..3 {
        system.step(&train, step).unwrap();
    }
    match &state_of(system.as_ref())["appearance.codes"].data {
        TensorData::F32(codes) => assert_eq!(codes.len(), 3 * 8),
        TensorData::U64(_) => panic!("codes are numbers"),
    }
    let code = |view| system.appearance_code(&Appearance::View(view)).unwrap();
    assert!(code(0) == code(3) && code(1) == code(4) && code(0) != code(1) && code(1) != code(2));
}

#[test]
fn appearances_that_are_not_built_are_refused_in_one_line() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    for (set, want) in [
        (&["appearance=encoder"][..], "`appearance` = encoder: must be none or codes"),
        (&["appearance=none", "code_lr=0.5"], "`set` = code_lr: is a setting of `appearance = \"codes\"`"),
        (&["appearance=codes", "appearance_dims=0"], "`appearance_dims` = 0: must be in 1..=512"),
        (&["appearance=light"], "light"),
    ] {
        let Err(error) = try_system("hypernerf", &scene, &train, set) else { panic!("taken: {set:?}") };
        let line = error.to_string();
        assert!(line.contains(want) && !line.contains('\n'), "{set:?}: {line}");
    }
    let Err(error) = try_system("d-nerf", &scene, &train, &["appearance=codes"]) else { panic!("d-nerf has codes") };
    assert!(error.to_string().contains("`set` = appearance: there is no such setting"), "{error}");
}

#[test]
fn an_appearance_is_fitted_at_the_time_of_its_photo() {
    let scene = stage();
    let (train, _) = views(&scene, 1);
    let (mut system, _) = system("hypernerf", &scene, &train, &small(&["appearance=codes", "sees=time"]));
    for step in 0..80 {
        system.step(&train, step).unwrap();
    }
    let view = train.view(0);
    let rays: Vec<_> = view.rays(0..view.camera.height).map(Option::unwrap).collect();
    let planted: Arc<[f32]> = system.appearance_code(&Appearance::Mean).unwrap().iter().map(|c| c + 0.4).collect();
    let query = Query { appearance: Appearance::Code(planted), time: 0.8, ..plain_query([1.0; 3], 0.0) };
    let rgb = system.render(&rays, &query).rgb;
    let fitted = |time| {
        let fit = Fit {
            rays: &rays,
            rgb: &rgb,
            time,
            background: [1.0; 3],
            steps: 400,
            lr: 0.05,
            seed: 1,
            halt: &Halt::NEVER,
        };
        system.fit_appearance(&fit).unwrap()
    };
    let off = |appearance: Appearance| {
        let shown = system.render(&rays, &Query { appearance, ..query.clone() }).rgb;
        let squares = shown.iter().zip(&rgb).flat_map(|(a, b)| [0, 1, 2].map(|c| f64::from(a[c] - b[c]).powi(2)));
        (squares.sum::<f64>() / (3 * rgb.len()) as f64).sqrt()
    };
    let (own, other) = (fitted(0.8), fitted(0.1));
    assert_ne!(own, other, "the scene is another at another time");
    let [own, other, mean] = [Appearance::Code(own.into()), Appearance::Code(other.into()), Appearance::Mean].map(off);
    println!(
        "colours off by {own:.5} fitted at its time, by {other:.5} at another, by {mean:.5} in the mean appearance"
    );
    assert!(own < 0.2 * mean && own < other, "{own} {other} {mean}");
}
