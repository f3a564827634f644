//! Files `transforms*.json`: Blender, instant-ngp, nerfstudio.

use super::{counts, data, has_note, share_in_view, with};
use glam::DVec3;
use scene_io::{
    Depth, Dialect, Holdout, ImageStore, LayoutHint, LoadOptions, PerturbationKind, Split, StoreOptions, TrainPhotos,
    check, load, perturb,
};

#[test]
fn lego_is_a_blender_scene() {
    let Some(path) = data("nerf_synthetic/lego") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Blender);
    assert_eq!(scene.name, "lego");
    assert_eq!(counts(&scene), [100, 10, 25, 0]);
    assert_eq!(scene.layout, LayoutHint::Object { near: 2.0, far: 6.0 });
    let frame = &scene.frames[0];
    assert_eq!(frame.name, "train/r_0");
    assert_eq!((frame.camera.width, frame.camera.height), (400, 400));
    assert!((frame.camera.fx - 555.555_516).abs() < 1e-5, "f = {}", frame.camera.fx);
    assert!(frame.mask.is_none());
    // All cameras stand on a sphere of radius 4 about the origin and look at it: axes and signs are right.
    for frame in &scene.frames {
        let centre = frame.camera.project(DVec3::ZERO).expect("the origin is in front");
        assert!((centre.x - 200.0).abs() < 1.0 && (centre.y - 200.0).abs() < 1.0, "{}: {centre}", frame.name);
        assert!((frame.camera.pose.c.length() - 4.031).abs() < 0.01);
        // World up is up in the image: y points down.
        let above = frame.camera.project(DVec3::Z * 0.1).unwrap();
        assert!(above.y <= centre.y, "{}", frame.name);
    }

    let names: Vec<String> = [0, 24, 48, 72, 96, 120, 144, 168].map(|i| format!("test/r_{i}")).into();
    let scene = load(&path, &with(Holdout::Names(names.clone()))).unwrap();
    assert_eq!(counts(&scene), [100, 10, 8, 17]);
    assert_eq!(scene.held_out_names(), names);

    // 4x4 boxes, RGBA: known values of one file, read by the same decoder at full size.
    let store = ImageStore::new(&scene.frames, StoreOptions::default().with_longest_side(100)).unwrap();
    assert_eq!(store.estimate_bytes(), 135 * 100 * 100 * 4);
    assert!((store.camera(0).fx - 138.888_879).abs() < 1e-5);
    let full = ImageStore::new(&scene.frames[..1], StoreOptions::default()).unwrap().get(0).unwrap();
    let small = store.get(0).unwrap();
    assert_eq!((small.width, small.height, small.channels), (100, 100, 4));
    for (x, y) in [(50, 50), (30, 61), (0, 0), (77, 20)] {
        let (mut rgb, mut alpha) = ([0.0; 3], 0.0);
        for v in 0..4 {
            for u in 0..4 {
                let p = full.pixel(4 * x + u, 4 * y + v);
                alpha += f64::from(p[3]) / 16.0;
                for c in 0..3 {
                    rgb[c] += f64::from(p[c]) * f64::from(p[3]) / 16.0;
                }
            }
        }
        let got = small.pixel(x, y);
        assert!((f64::from(got[3]) - alpha).abs() <= 0.5);
        for c in 0..3 {
            let want = if alpha > 0.0 { rgb[c] / alpha } else { 0.0 };
            assert!((f64::from(got[c]) - want).abs() <= 0.5, "({x}, {y}) {c}");
        }
    }
}

#[test]
fn perturbed_lego_keeps_its_first_view_and_its_test_views() {
    let Some(path) = data("nerf_synthetic/lego") else { return };
    let clean = load(&path, &LoadOptions::default()).unwrap();
    let scene = perturb(clean.clone(), PerturbationKind::Both, 0);
    assert_ne!(scene.fingerprint(), clean.fingerprint());
    let small = StoreOptions::default().with_longest_side(100);
    let [a, b] = [&clean, &scene].map(|s| ImageStore::new(&s.frames, small).unwrap());
    for (i, frame) in scene.frames.iter().enumerate().step_by(7) {
        let same = a.get(i).unwrap() == b.get(i).unwrap();
        assert_eq!(same, i == 0 || frame.split != Split::Train, "{}", frame.name);
        let truth = frame.read_transient().unwrap().map(|mask| mask.count());
        let want = if i == 0 { 0 } else { 100 * 100 };
        assert_eq!(truth, (frame.split == Split::Train).then_some(want), "{}", frame.name);
    }
}

#[test]
fn partial_hdr_hexplane_is_a_blender_scene_with_extensions_and_frame_numbers() {
    let Some(path) = data("hdr_hexplane/lego_partial") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Blender);
    assert_eq!(counts(&scene), [7, 0, 8, 0]);
    assert_eq!(scene.layout, LayoutHint::Object { near: 2.0, far: 15.0 });
    assert_eq!(scene.frames[0].name, "train/0000.png");
    assert_eq!(scene.frames[0].time, Some(1.0 / 35.0));
    has_note(&scene, "times 0 to 35 were mapped to 0 to 1");
    // Order is kept: the last six test frames lie behind every training frame.
    let last = scene.frames.iter().filter(|f| f.split == Split::Train).filter_map(|f| f.time).fold(0.0, f64::max);
    assert_eq!(last, 8.0 / 35.0);
    assert_eq!(scene.frames.iter().filter(|f| f.time > Some(last)).count(), 6);
    has_note(&scene, "7 of 8 test frames lie before the first or after the last training time");
    has_note(&scene, "3 exposures (-3 to 1)");
    has_note(&scene, "no transforms_val.json");
}

#[test]
fn workbench_has_times() {
    let Some(path) = data("blender_rendered/workbench") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(counts(&scene), [120, 10, 20, 0]);
    assert_eq!(scene.frames[119].time, Some(1.0));
    // Times are as written, and test frames have exact depth and moving things.
    assert!(scene.frames[..120].iter().enumerate().all(|(k, f)| f.time == Some(k as f64 / 119.0)));
    assert_eq!(scene.frames[130].time, Some(0.025));
    assert!(!scene.notes.iter().any(|n| n.contains("time")), "{:?}", scene.notes);
    let report = check(&path, &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.problems.is_empty(), "{report}");
    let depth = report.depth.unwrap();
    assert_eq!(depth.maps, 20);
    assert!((0.1..0.9).contains(&depth.holes), "{depth:?}");
    assert!(report.to_string().contains("times: 150 frames"), "{report}");
    let test = &scene.frames[scene.split(Split::Test).next().unwrap()];
    // Depth and moving things are of the same surfaces: where something moves, something is.
    let (depth, moving) = (test.read_depth().unwrap().unwrap(), test.read_moving().unwrap().unwrap());
    let known =
        moving.iter().zip(&depth.z).filter(|(moves, z)| *moves && **z > 0.0).count() as f64 / moving.count() as f64;
    assert!(known > 0.9, "{known} of the moving pixels have a depth");
    assert_eq!(scene.layout, LayoutHint::Object { near: 2.0, far: 6.0 });
}

#[test]
fn yard_trains_on_clutter_or_on_clean_photos_and_its_masks_are_truth() {
    let Some(path) = data("blender_rendered/yard") else { return };
    let clutter = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(counts(&clutter), [60, 0, 20, 0]);
    assert_eq!(clutter.frames[0].name, "train_clutter/000");
    assert_eq!(clutter.layout, LayoutHint::Unknown, "a yard with a sky is not an object on an empty background");
    assert!(clutter.frames.iter().all(|f| f.mask.is_none()));
    has_note(&clutter, "60 of 80 frames have truth masks");
    let shares: Vec<f64> = clutter.frames[..60]
        .iter()
        .map(|f| f.read_transient().unwrap().unwrap().count() as f64 / (200.0 * 200.0))
        .collect();
    let mean = shares.iter().sum::<f64>() / 60.0;
    assert!((mean - 0.132).abs() < 0.001, "{mean} of the pixels are clutter");
    assert!((shares[0] - 0.1565).abs() < 0.001, "{} of the first picture", shares[0]);
    // No mask reaches training.
    let store = ImageStore::new(&clutter.frames, StoreOptions::default()).unwrap();
    assert!(store.get(0).unwrap().mask.is_none());

    let options = LoadOptions::default().with_train_photos(TrainPhotos::Clean);
    let clean = load(&path, &options).unwrap();
    assert_eq!(counts(&clean), [60, 0, 20, 0]);
    assert_eq!(clean.frames[0].name, "train_clean/000");
    assert!(clean.frames.iter().all(|f| f.truth.transient.is_none()));
    assert_eq!(clean.held_out_names(), clutter.held_out_names());
    let file = load(&path.join("transforms_train_clutter.json"), &LoadOptions::default()).unwrap();
    assert_eq!(file.fingerprint(), clutter.fingerprint());
    let error = load(&path.join("transforms_train_clutter.json"), &options).unwrap_err().to_string();
    assert!(error.contains("is not the file of clean photos"), "{error}");
    let report = check(&path, &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.problems.is_empty(), "{report}");
}

#[test]
fn fox_skips_what_is_not_there() {
    let Some(path) = data("instant_ngp/fox") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::InstantNgp);
    assert_eq!(scene.frames.len(), 50);
    assert_eq!(counts(&scene), [43, 0, 7, 0]);
    assert_eq!(scene.layout, LayoutHint::Unbounded);
    has_note(&scene, "17 of 67 listed images are not there and were skipped: images/");
    let camera = &scene.frames[0].camera;
    assert_eq!((camera.width, camera.height), (1080, 1920));
    assert!(!camera.lens.is_pinhole());
    assert!(scene.frames[0].sharpness.unwrap() > 30.0);
    // aabb_scale 4 about the origin, 0.33 units of the cube a file unit.
    assert!((scene.bounds.unwrap().max - DVec3::splat(2.0 / 0.33)).length() < 1e-12);
    assert_eq!(scene.held_out_names()[0], "images/0001.jpg");
}

#[test]
fn fox135_is_a_nerfstudio_scene_with_points() {
    let Some(path) = data("benchmarks/fox135") else { return };
    let scene = load(&path, &with(Holdout::Every(8))).unwrap();
    assert_eq!(scene.dialect, Dialect::Nerfstudio);
    assert_eq!(counts(&scene), [43, 0, 7, 0]);
    assert_eq!(scene.points.len(), 11_114);
    let share = share_in_view(&scene);
    assert!(share > 0.3, "only {share} of the points are in view: wrong axes?");
    // By itself, nerfstudio trains on nine of ten.
    assert_eq!(counts(&load(&path, &LoadOptions::default()).unwrap()), [45, 0, 5, 0]);
    assert_eq!(counts(&load(&path, &with(Holdout::None)).unwrap()), [50, 0, 0, 0]);
}

#[test]
fn plaza_has_a_camera_a_frame_and_named_splits() {
    let Some(path) = data("blender_rendered/plaza_photos") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Nerfstudio);
    assert_eq!(counts(&scene), [40, 0, 10, 0]);
    assert!(scene.frames.iter().any(|f| f.camera.width == 138) && scene.frames.iter().any(|f| f.camera.width == 184));
    // Passers-by are marked in training photos, and never as an ignore mask.
    let shares: Vec<f64> = scene
        .frames
        .iter()
        .filter_map(|f| Some(f.read_transient().unwrap()?.count() as f64 / f64::from(f.camera.width * f.camera.height)))
        .collect();
    let mean = shares.iter().sum::<f64>() / 40.0;
    assert!(shares.len() == 40 && (mean - 0.122).abs() < 0.001, "{mean} of {} pictures", shares.len());
    assert!(
        scene.frames.iter().all(|f| f.mask.is_none() && (f.truth.transient.is_some() == (f.split == Split::Train)))
    );
    let widths: std::collections::HashSet<u64> = scene.frames.iter().map(|f| f.camera.fx.to_bits()).collect();
    assert!(widths.len() > 40, "{} focal lengths", widths.len());
}
