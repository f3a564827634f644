//! `ha-nerf` and its ablations: that they learn, resume, do not mind threads, and what they refuse.

use engine::data::Dataset;
use engine::options::{Background, RunOptions, parse_set};
use engine::system::{Appearance, System, SystemError};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Image, ImageSource, PerturbationKind, Scene, perturb};
use std::sync::Arc;
use systems::registry::build;
use tests::{assert_same_bits, state_after, views};

fn train_of(scene: &Scene) -> Dataset {
    views(scene, 1).0
}

fn table(size: u32, views: usize) -> Scene {
    let options =
        TabletopOptions { width: size, height: size, train: views, test: 1, rays: 1, ..TabletopOptions::default() };
    tabletop(&options)
}

fn data(size: u32, views: usize, what: PerturbationKind) -> (Scene, Dataset) {
    let scene = perturb(table(size, views), what, 3);
    let train = train_of(&scene);
    (scene, train)
}

fn try_system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    let set = [&["batch_rays=1024", "batch_samples=16384"], set].concat();
    let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    Ok(build(name, scene, train, &run)?.0)
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    for (name, set) in [
        ("ha-nerf", &["view_every=1", "encoder_photos=4"][..]),
        ("ha-nerf", &["lattices=3", "lattice=16"]),
        ("ha-nerf-t", &[]),
    ] {
        println!("{name} {set:?}");
        assert_same_bits(|steps, state| {
            let (scene, train) = data(24, 12, PerturbationKind::Both);
            state_after(try_system(name, &scene, &train, set).unwrap(), &train, steps, state)
        });
    }
}

#[test]
fn codes_follow_the_appearance_of_photos_and_photos_that_were_not_trained_on_have_one() {
    let (scene, train) = data(24, 12, PerturbationKind::Colour);
    let mut system = try_system("ha-nerf-a", &scene, &train, &[]).unwrap();
    assert_eq!(system.name(), "ha-nerf-a");
    let mut errors = Vec::new();
    for step in 0..150 {
        let stats = system.step(&train, step).unwrap();
        assert_eq!(stats.nonfinite, 0, "step {step}");
        errors.push(stats.mse);
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    assert!(mean(&errors[130..]) < 0.3 * mean(&errors[..10]), "{errors:?}");
    // The cached code of a photo is what the encoder says of it, but for the last few steps.
    for view in 0..train.len() {
        let cached = system.appearance_code(&Appearance::View(view)).unwrap();
        let now = system.encode_appearance(&train.image(view).unwrap()).unwrap();
        let far = cached.iter().zip(&now).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let size = now.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
        assert!(far < 0.2 * size.max(0.1), "view {view}: {cached:?} {now:?}");
    }
    // A part of a photo, a photo of another shape, one without anything in it.
    for (width, height) in [(16, 24), (100, 40)] {
        let photo = Image::rgb(width, height, vec![77; (width * height * 3) as usize]).unwrap();
        let code = system.encode_appearance(&photo).unwrap();
        assert!(code.iter().all(|v| v.is_finite()), "{code:?}");
    }
    assert!(system.encode_appearance(&Image::rgb(100, 12, vec![77; 3600]).unwrap()).is_none());
}

#[test]
fn what_stands_in_one_photo_is_left_out() {
    let (scene, train) = data(40, 20, PerturbationKind::Occluder);
    let mut system = try_system("ha-nerf-t", &scene, &train, &["mask_size_steps=150"]).unwrap();
    for step in 0..400 {
        system.step(&train, step).unwrap();
    }
    let (mut hidden, mut bars, mut lost, mut rest) = (0, 0, 0, 0);
    for view in 0..train.len() {
        let seen = system.visibility(&train, view).unwrap().unwrap();
        assert!(seen.len() == 1600 && seen.iter().all(|&v| v == 0.0 || v == 1.0));
        let frame = &scene.frames[train.view(view).frame];
        let mask = frame.perturbation.as_ref().and_then(|p| p.bars.as_ref()).map(|b| b.mask());
        for (i, &v) in seen.iter().enumerate() {
            let gone = usize::from(v == 0.0);
            if mask.as_ref().is_some_and(|m| m.get(i as u32 % 40, i as u32 / 40)) {
                (hidden, bars) = (hidden + gone, bars + 1);
            } else {
                (lost, rest) = (lost + gone, rest + 1);
            }
        }
    }
    println!("{hidden} of {bars} pixels of bars left out, {lost} of {rest} others");
    // What is hard to learn is left out with the occluders in so short a training.
    assert!(10 * hidden > 9 * bars && 10 * lost < 3 * rest, "{hidden} of {bars}, {lost} of {rest}");
}

#[test]
fn a_map_that_keeps_all_is_the_plain_loss() {
    // Nothing is worth leaving out at this price, so the two differ by little; without visibility, by nothing.
    let (scene, train) = data(24, 6, PerturbationKind::Colour);
    let run = |name: &str, set: &[&str]| {
        let mut system = try_system(name, &scene, &train, set).unwrap();
        (0..60).map(|step| system.step(&train, step).unwrap().mse).sum::<f64>() / 60.0
    };
    let dear = run("ha-nerf-t", &["mask_size=100.0", "mask_size_start=100.0", "rays_per_side=1"]);
    let plain = run("plain", &["rays_per_side=1", "huber=0.0"]);
    assert!((dear / plain - 1.0).abs() < 0.2, "{dear} {plain}");
}

#[test]
fn one_photo_and_photos_without_anything_in_them() {
    let (scene, train) = data(24, 1, PerturbationKind::Both);
    let mut system = try_system("ha-nerf", &scene, &train, &[]).unwrap();
    for step in 0..3 {
        assert_eq!(system.step(&train, step).unwrap().nonfinite, 0);
    }
    let mut scene = table(24, 3);
    for frame in &mut scene.frames {
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(24, 24, vec![90; 24 * 24 * 3]).unwrap()));
    }
    let train = train_of(&scene);
    let mut system = try_system("ha-nerf", &scene, &train, &[]).unwrap();
    for step in 0..3 {
        assert_eq!(system.step(&train, step).unwrap().nonfinite, 0);
    }
    for view in 0..3 {
        assert!(system.appearance_code(&Appearance::View(view)).unwrap().iter().all(|v| v.is_finite()));
    }
}

#[test]
fn what_cannot_work_is_named() {
    let (scene, train) = data(12, 3, PerturbationKind::Both);
    let error = try_system("ha-nerf", &scene, &train, &[]).err().unwrap().to_string();
    assert_eq!(
        error,
        "`appearance` = encoder: photo `train/r_000` is 12x12 pixels and the encoder needs 16 on each side; use `codes`"
    );
    assert!(try_system("ha-nerf-t", &scene, &train, &[]).is_ok(), "the map has no smallest photo");
    let (scene, train) = data(24, 3, PerturbationKind::Both);
    for (set, line) in [
        (
            "encoder_side=8",
            "`encoder_side` = 8: must be at least 16, as the encoder halves a photo once for each further channel",
        ),
        ("encoder_channels=[]", "`encoder_channels` = []: `layers` is 0, expected at least 1"),
        ("encoder_channels=[8,0]", "`encoder_channels` = [8, 0]: must be 1 to 8 numbers in 1..=1024"),
        ("lattice=1", "`lattice` = 1: must be in 2..=256"),
        (
            "lattice=8",
            "`lattice` = 8: must be at least 16, as renders are encoded; or set `view_weight` and `mode_weight` to 0",
        ),
        ("encoder_photos=0", "`encoder_photos` = 0: must be in 1..=4096"),
        ("encoder_tilts=[99.0]", "`encoder_tilts` = [99.0]: must be at most 16 numbers in -50..=50"),
        ("view_every=0", "`view_every` = 0: must be at least 1"),
        ("view_weight=-1.0", "`view_weight` = -1: must be in 0..=1000"),
        ("visibility_width=0", "`visibility_width` = 0: must be in 1..=1024"),
        ("visibility_dims=0", "`visibility_dims` = 0: must be in 1..=512"),
        ("mask_size=0.0", "`mask_size` = 0: must be above 0 and at most 1000"),
        ("visibility_lr=-1.0", "`visibility_lr` = -1: must be above 0 and at most 1000"),
    ] {
        let error = try_system("ha-nerf", &scene, &train, &[set]).err().unwrap().to_string();
        assert_eq!(error, line, "{set}");
    }
}
