//! `mip-nerf`: the published shapes and settings, and a small one that learns, resumes, does not mind threads, works in
//! normalised device coordinates and in contracted space, and sees the footprint of its pixels.

use engine::render::{plain_query, render};
use engine::system::{LayerRequest, Normals, Query};
use scene_io::{Scene, Split};
use std::sync::Arc;
use tests::{assert_same_bits, psnr, state_after, system, table, try_system, views};

const SMALL: [&str; 10] = [
    "width=32",
    "depth=4",
    "coarse=24",
    "fine=24",
    "batch_rays=96",
    "lr=3e-3",
    "lr_final=1e-3",
    "lr_steps=2000",
    "warmup_steps=20",
    "position_octaves=8",
];

#[test]
fn shapes_and_settings_are_the_published_ones() {
    let scene = table(8);
    let (train, _) = views(&scene, 1);
    let (system, plan) = system("mip-nerf", &scene, &train, &[]);
    // As `nerf`, but 96 channels of position and one network for both levels.
    let trunk = (96 * 256 + 256) + 6 * (256 * 256 + 256) + ((256 + 96) * 256 + 256);
    let heads = 257 + (256 * 256 + 256) + ((256 + 27) * 128 + 128) + (128 * 3 + 3);
    assert_eq!(system.parameter_count(), trunk + heads);
    assert_eq!(system.name(), "mip-nerf");
    for (name, value) in [("coarse", "128"), ("fine", "128"), ("position_octaves", "16"), ("lr_steps", "1000000")] {
        assert_eq!(plan.config[name].to_string(), value, "{name}");
    }
}

#[test]
fn a_small_one_learns_the_table_at_two_scales() {
    let scene = table(32);
    let (train, test) = views(&scene, 2);
    let (mut system, _) = system("mip-nerf", &scene, &train, &SMALL);
    let half = test.at_level(1);
    let before = psnr(system.as_ref(), &test);
    for step in 0..400 {
        let stats = system.step(&train, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "step {step}: {stats:?}");
        assert_eq!(stats.rays, 96);
    }
    let (after, after_half) = (psnr(system.as_ref(), &test), psnr(system.as_ref(), &half));
    println!("mip-nerf on the table: {before:.2} dB, after 400 steps {after:.2} dB, at half size {after_half:.2} dB");
    assert!(after > before + 5.0 && after > 18.0, "{before:.2} dB, then {after:.2} dB");
    // Larger pixels are easier.
    assert!(after_half > after, "{after:.2} dB, at half size {after_half:.2} dB");

    // The footprint is seen: without it the same rays give another picture, and not a better one at half size.
    let camera = &half.view(0).camera;
    let query = Query {
        layers: LayerRequest { normals: Normals::Compute, ..LayerRequest::default() },
        ..plain_query([1.0; 3], 0.0)
    };
    let cones = render(system.as_ref(), camera, &query).layers;
    let prepared = camera.prepare();
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let rays: Vec<_> =
        pixels.map(|(x, y)| prepared.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap()).collect();
    let lines = system.render(&rays, &query);
    assert_ne!(cones.rgb, lines.rgb);
    for layers in [&cones, &lines] {
        assert!(layers.rgb.iter().flatten().all(|c| (-0.01..=1.01).contains(c)), "colours past the padding");
        assert!(layers.opacity.iter().all(|o| (0.0..=1.0).contains(o)));
        for (n, o) in layers.normal.iter().zip(&layers.opacity) {
            let length = n.iter().map(|x| x * x).sum::<f32>().sqrt();
            assert!(length < 1.0 + 1e-5 && (length > 0.99 || *o < 1e-3), "{n:?} at opacity {o}");
        }
    }
    // Where the table is, there is something; far above it there is nothing.
    let mut sigma = [0.0; 2];
    let [low, high] = system.bounds();
    let middle = [0, 1, 2].map(|a| 0.5 * (low[a] + high[a]));
    system.density(&[middle, [1e3; 3]], 0.0, &mut sigma);
    assert!(sigma[0] >= 0.0 && sigma[0].is_finite() && sigma[1] == 0.0, "{sigma:?}");
}

#[test]
fn every_space_can_be_trained_in() {
    let scene = table(16);
    let (train, test) = views(&scene, 1);
    for space in ["box", "contracted"] {
        let space_word = format!("space={space}");
        let (mut system, _) = system("mip-nerf", &scene, &train, &[&SMALL[..], &[space_word.as_str()]].concat());
        let first = system.step(&train, 0).unwrap();
        let mut last = first;
        for step in 1..60 {
            last = system.step(&train, step).unwrap();
        }
        assert!(last.loss.is_finite() && last.loss < first.loss, "{space}: {first:?}, then {last:?}");
        assert!(psnr(system.as_ref(), &test).is_finite());
    }
}

#[test]
fn forward_facing_cameras_get_cylinders_and_learn() {
    let scene = forward_facing();
    let (train, test) = views(&scene, 1);
    let (mut system, plan) = system("mip-nerf", &scene, &train, &SMALL);
    assert_eq!(plan.config["space"].as_str(), Some("ndc"), "{:?}", plan.lines);
    let before = psnr(system.as_ref(), &test);
    for step in 0..150 {
        let stats = system.step(&train, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0);
    }
    let after = psnr(system.as_ref(), &test);
    assert!(after > before + 3.0, "{before:.2} dB, then {after:.2} dB");
}

/// A striped wall at depth 4, seen by a row of cameras.
fn forward_facing() -> Scene {
    use render_core::camera::{Camera, Pose};
    use scene_io::{Dialect, Frame, Image, ImageSource, LayoutHint};
    let frames = (0..10).map(|i| {
        let c = glam::DVec3::new(0.06 * (f64::from(i) - 4.5), 0.03 * f64::from(i % 3), 0.0);
        let camera = Camera::pinhole(16, 16, 16.0, 16.0, 8.0, 8.0, Pose { r: glam::DMat3::IDENTITY, c });
        let mut data = Vec::new();
        for y in 0..16 {
            for x in 0..16 {
                let ray = camera.ray(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
                let p = ray.at(4.0 / ray.d.z);
                data.extend([(p.x * 2.0).sin(), (p.y * 2.0).cos(), 0.3].map(|v| (127.0 + 100.0 * v) as u8));
            }
        }
        let image = Image::rgb(16, 16, data).unwrap();
        let mut frame = Frame::new(format!("view_{i}"), ImageSource::Memory(Arc::new(image)), camera);
        frame.split = if i == 5 { Split::Test } else { Split::Train };
        frame.z_bounds = Some([3.5, 4.5]);
        frame
    });
    Scene {
        name: "wall".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: Vec::new(),
        layout: LayoutHint::ForwardFacing,
        bounds: None,
        notes: Vec::new(),
    }
}

#[test]
fn it_gives_the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let scene = table(16);
    let (train, _) = views(&scene, 2);
    assert_same_bits(|steps, state| state_after(system("mip-nerf", &scene, &train, &SMALL).0, &train, steps, state));
}

#[test]
fn settings_that_cannot_work_are_refused_by_name() {
    let scene = table(8);
    let (train, _) = views(&scene, 1);
    for (set, name) in [("coarse=0", "coarse"), ("fine=0", "fine"), ("lr_final=0.0", "lr_final"), ("width=1", "width")]
    {
        let error = try_system("mip-nerf", &scene, &train, &[set]).err().unwrap().to_string();
        assert!(error.contains(&format!("`{name}`")), "{error}");
    }
}
