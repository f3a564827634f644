//! Methods on the fast field: the same bits with any number of threads and after a resume, appearance that changes colours only, and
//! photos that say little.

use engine::data::Dataset;
use engine::halt::Halt;
use engine::options::{Background, RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::system::{Appearance, Fit, Query, System, SystemError};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageSource, PerturbationKind, Scene, perturb};
use std::sync::Arc;
use systems::registry::build;
use tests::{assert_same_bits, state_after, views};

/// Small batches.
const SMALL: [&str; 2] = ["batch_rays=512", "batch_samples=8192"];

/// Settings with which a survey comes after two steps.
fn soon(name: &str) -> &'static [&'static str] {
    match name {
        "robust-nerf" | "wild-gaussians" | "gs-w" | "wild-gs" => &["judge_first=2"],
        "hugs" => &["warmup_steps=2"],
        _ => &[],
    }
}

fn scene(views: usize) -> Scene {
    let options =
        TabletopOptions { width: 24, height: 24, train: views, test: 1, rays: 1, ..TabletopOptions::default() };
    perturb(tabletop(&options), PerturbationKind::Both, 3)
}

fn train_of(scene: &Scene) -> Dataset {
    views(scene, 1).0
}

fn system(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    let small: &[&str] = if ["wild-gaussians", "spotless", "gs-w", "wild-gs", "degauss"].contains(&name) {
        &["start_count=300", "max_splats=500"]
    } else {
        &SMALL
    };
    let set = small.iter().chain(soon(name)).chain(set).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    Ok(build(name, scene, train, &run)?.0)
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    for (name, set) in [
        ("nerf-w", &[][..]),
        ("nerf-u", &["mixture=proportional"]),
        ("robust-nerf", &["judging=photos"]),
        ("robust-nerf", &["judging=batch"]),
        ("robust-nerf", &["kernel=gemanmcclure", "appearance=codes"]),
        ("hugs", &["restart=on"]),
        ("hugs", &["restart=anew"]),
    ] {
        println!("{name} {set:?}");
        assert_same_bits(|steps, state| {
            let scene = scene(8);
            let train = train_of(&scene);
            state_after(system(name, &scene, &train, set).unwrap(), &train, steps, state)
        });
    }
}

#[test]
fn appearance_changes_colours_and_nothing_else() {
    let scene = scene(8);
    let train = train_of(&scene);
    let mut system = system("nerf-w", &scene, &train, &[]).unwrap();
    for step in 0..60 {
        system.step(&train, step).unwrap();
    }
    let camera = train.view(0).camera;
    let shown = |appearance| {
        let query = Query { appearance, ..plain_query([1.0; 3], 0.0) };
        render(system.as_ref(), &camera, &query).layers
    };
    let [a, b] = [0, 1].map(|view| shown(Appearance::View(view)));
    assert!(a.depth == b.depth && a.opacity == b.opacity && a.median_depth == b.median_depth);
    assert!(a.rgb != b.rgb, "two photos of different appearance are the same");
    let code: Arc<[f32]> = system.appearance_code(&Appearance::View(1)).unwrap().into();
    assert!(shown(Appearance::Code(code)).rgb == b.rgb);
}

/// Pixels of a photo rendered with a planted code: the fit finds it, but for what it leaves out. Its samples are those of a training
/// step, and of mist (the field is hardly trained) the faintest hold a part of the colour; a render with a budget of 0 has all.
#[test]
fn a_fit_finds_the_code_that_was_planted() {
    let scene = scene(8);
    let train = train_of(&scene);
    let field = ["field=mlp", "width=32", "depth=2", "coarse=8", "fine=8", "batch_rays=512", "lr=5e-3"];
    for (set, what) in [(&SMALL[..], "ngp"), (&field, "mlp")] {
        let set = set.iter().chain(&["appearance_dims=2", "code_lr=1.0"]).map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
        let mut system = build("nerf-a", &scene, &train, &run).unwrap().0;
        for step in 0..80 {
            system.step(&train, step).unwrap();
        }
        let mean = system.appearance_code(&Appearance::Mean).unwrap();
        let planted = [mean[0] + 0.5, mean[1] - 0.4];
        let view = train.view(0);
        let rays: Vec<_> = view.rays(0..view.camera.height).map(Option::unwrap).collect();
        let query = Query { appearance: Appearance::Code(Arc::from(planted)), ..plain_query([1.0; 3], 0.0) };
        let rgb = system.render(&rays, &query).rgb;
        let fit = Fit {
            rays: &rays,
            rgb: &rgb,
            time: 0.0,
            background: [1.0; 3],
            steps: 600,
            lr: 0.05,
            seed: 1,
            halt: &Halt::NEVER,
        };
        let found = system.fit_appearance(&fit).unwrap();
        let far = found.iter().zip(planted).map(|(found, planted)| (found - planted).abs()).fold(0.0, f32::max);
        let again = Query { appearance: Appearance::Code(Arc::from(&found[..])), ..query.clone() };
        let off = |code: &Query| {
            let squares = system
                .render(&rays, code)
                .rgb
                .iter()
                .zip(&rgb)
                .flat_map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).powi(2)))
                .sum::<f32>();
            (squares / (3 * rgb.len()) as f32).sqrt()
        };
        let (found_off, mean_off) = (off(&again), off(&Query { appearance: Appearance::Mean, ..query }));
        println!("{what}: {far} from the planted code; colours off by {found_off}, with the mean code by {mean_off}");
        let least = if what == "mlp" { 0.02 } else { 0.1 };
        assert!(far < least, "{what}: {found:?}, planted {planted:?}, mean {mean:?}");
        assert!(found_off < 0.05 * mean_off, "{what}: colours off by {found_off}, with the mean code by {mean_off}");
    }
}

#[test]
fn photos_that_say_little_are_trained_on_all_the_same() {
    let black = |mut scene: Scene| {
        for frame in &mut scene.frames {
            if let ImageSource::Memory(image) = &mut frame.image {
                let mut dark = (**image).clone();
                dark.data.fill(0);
                *image = Arc::new(dark);
            }
        }
        scene
    };
    let mut identical = scene(4);
    let first = identical.frames[0].clone();
    for frame in &mut identical.frames {
        (frame.image, frame.camera, frame.perturbation) =
            (first.image.clone(), first.camera, first.perturbation.clone());
    }
    // No photo shows what any other does.
    let mut unrelated = scene(4);
    for (k, frame) in unrelated.frames.iter_mut().enumerate() {
        if let ImageSource::Memory(image) = &mut frame.image {
            let mut noise = (**image).clone();
            let value = |i: usize| ((i * (2 * k + 3) * 40_503) >> 7) as u8;
            noise.data.iter_mut().enumerate().for_each(|(i, v)| *v = value(i));
            *image = Arc::new(noise);
        }
    }
    // A mask ignores all of one photo.
    let mut covered = scene(4);
    if let ImageSource::Memory(image) = &mut covered.frames[0].image {
        let mut masked = (**image).clone();
        masked.mask = Some(vec![0; (masked.width * masked.height) as usize]);
        *image = Arc::new(masked);
    }
    for (what, scene, set) in [
        ("one photo", scene(1), &[][..]),
        ("nothing but occluders", unrelated, &[]),
        ("a mask over all of a photo", covered, &[]),
        ("black photos", black(scene(4)), &[]),
        ("identical photos", identical, &["accept_no_parallax=true"]),
    ] {
        let train = train_of(&scene);
        for name in [
            "auto",
            "nerf-w",
            "robust-nerf",
            "hugs",
            "ha-nerf",
            "sf-nerf",
            "wild-gaussians",
            "spotless",
            "gs-w",
            "wild-gs",
        ] {
            let soonest = || system(name, &scene, &train, &[set, &["judge_first=2"]].concat());
            let built = match name {
                // It surveys only where it has chosen to leave outliers out.
                "auto" => soonest().or_else(|_| system(name, &scene, &train, set)),
                _ => system(name, &scene, &train, set),
            };
            let mut system = built.unwrap_or_else(|e| panic!("{what}, {name}: {e}"));
            for step in 0..4 {
                let stats = system.step(&train, step).unwrap();
                assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{what}, {name}: {stats:?}");
            }
            if let Some(mask) = system.visibility(&train, 0).unwrap() {
                assert!(mask.iter().all(|&v| v == 0.0 || v == 1.0), "{what}, {name}");
            }
            let uncertainty = system.uncertainty(&train, 0).unwrap();
            assert_eq!(uncertainty.is_some(), name == "nerf-w", "{what}, {name}");
            assert!(uncertainty.iter().flatten().all(|&x| x > 0.0 && x.is_finite()), "{what}, {name}");
        }
    }
}

#[test]
fn one_photo_may_lack_the_files_that_others_have() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = scene(4);
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        let file = |kind: &str| folder.path().join(format!("{k}.{kind}.png"));
        if k != 1 {
            // Four segments.
            let labels =
                image::ImageBuffer::from_fn(24, 24, |x, y| image::Luma([1 + x as u16 / 12 + 2 * (y as u16 / 12)]));
            labels.save(file("segs")).unwrap();
            frame.priors.segments = Some(file("segs"));
        }
        if k != 2 {
            let mask = image::GrayImage::from_fn(24, 24, |x, _| image::Luma([if x < 2 { 0 } else { 255 }]));
            mask.save(file("mask")).unwrap();
            frame.mask = Some(file("mask"));
        }
    }
    let train = train_of(&scene);
    for name in ["hugs", "robust-nerf", "nerf-w"] {
        let mut system = system(name, &scene, &train, &[]).unwrap();
        for step in 0..8 {
            let stats = system.step(&train, step).unwrap();
            assert!(stats.loss.is_finite() && stats.nonfinite == 0, "{name}, step {step}");
        }
        for view in 0..train.len() {
            assert_eq!(system.visibility(&train, view).unwrap().unwrap().len(), 24 * 24, "{name}, photo {view}");
        }
    }
}
