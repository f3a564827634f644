//! Every published dataset we have, in its own layout. Skipped, and said so, where the data is not there.

use glam::{DVec2, DVec3};
use render_core::camera::{Camera, Lens, Pose};
use scene_io::colmap::Model;
use scene_io::{
    Depth, Dialect, Frame, Holdout, ImageSource, ImageStore, LayoutHint, LoadOptions, MaskPolarity, Masks,
    PerturbationKind, Scene, Split, StoreOptions, TrainPhotos, check, load, load_cameras, perturb, refuse_blank_masks,
    write_flo,
};
use std::path::PathBuf;

/// A dataset's folder, or `None` with a line on why the test is skipped.
fn data(relative: &str) -> Option<PathBuf> {
    testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), relative, "real_data")
}

fn counts(scene: &Scene) -> [usize; 4] {
    Split::ALL.map(|split| scene.count(split))
}

fn with(holdout: Holdout) -> LoadOptions {
    LoadOptions::default().with_holdout(holdout)
}

fn has_note(scene: &Scene, part: &str) {
    assert!(scene.notes.iter().any(|n| n.contains(part)), "no note holds `{part}`: {:#?}", scene.notes);
}

/// Share of the scene's points that every camera projects into its image, and their mean over cameras.
fn share_in_view(scene: &Scene) -> f64 {
    let mut inside = 0;
    for frame in &scene.frames {
        let camera = frame.camera.prepare();
        for point in &scene.points {
            let pixel = camera.project(point.xyz);
            let (w, h) = (f64::from(frame.camera.width), f64::from(frame.camera.height));
            inside += usize::from(pixel.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h));
        }
    }
    inside as f64 / (scene.frames.len() * scene.points.len()) as f64
}

/// Every point a photo sees projects to where it sees it; lengths count the photos that see it.
fn tracks_hit_their_points(scene: &Scene, median_at_most: f64) {
    let mut seen = vec![0; scene.points.len()];
    let mut off = Vec::new();
    for frame in &scene.frames {
        let camera = frame.camera.prepare();
        let mut points: Vec<u32> = frame.tracks.iter().map(|t| t.point).collect();
        points.sort_unstable();
        points.dedup();
        points.iter().for_each(|p| seen[*p as usize] += 1);
        for track in &frame.tracks {
            let at = camera.project(scene.points[track.point as usize].xyz).unwrap();
            off.push((at - glam::DVec2::from(track.pixel.map(f64::from))).length());
        }
    }
    assert!(off.len() > 3 * scene.frames.len());
    off.sort_by(f64::total_cmp);
    let median = off[off.len() / 2];
    assert!(median < median_at_most, "half of the features are more than {median} px off");
    let tracks = scene.frames.iter().flat_map(|f| &f.tracks);
    for track in tracks {
        assert_eq!(track.length, seen[track.point as usize]);
        assert!(track.length >= 2);
    }
}

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

#[test]
fn fern_is_an_llff_scene() {
    let Some(path) = data("nerf_llff_data/fern") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Llff);
    assert_eq!(counts(&scene), [17, 0, 3, 0]);
    assert_eq!(scene.held_out_names(), ["image000.png", "image008.png", "image016.png"]);
    assert_eq!(scene.layout, LayoutHint::ForwardFacing);
    let camera = &scene.frames[0].camera;
    assert_eq!((camera.width, camera.height), (504, 378));
    assert!((camera.fx - 3_260.526_333 / 8.0).abs() < 1e-3 && camera.cx == 252.0 && camera.cy == 189.0);
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!(near > 1.0 && far > near);
    // The start points of the incomplete COLMAP model lie in the same world.
    assert!(scene.points.len() > 5000);
    let share = share_in_view(&scene);
    assert!(share > 0.6, "only {share} of the points are in view: wrong axes?");
    has_note(&scene, "start points from");
}

#[test]
fn statue_reads_the_same_as_colmap_and_llff() {
    let Some(path) = data("nerd_in_the_wild/statue_of_liberty_40") else { return };
    let colmap = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(colmap.dialect, Dialect::Colmap);
    assert_eq!(counts(&colmap), [35, 0, 5, 0]);
    has_note(&colmap, "`--format llff` reads that instead");
    has_note(&colmap, "40 of 40 frames have an ignore mask");
    refuse_blank_masks(&colmap.frames).unwrap();
    let inverted = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsIgnored);
    refuse_blank_masks(&load(&path, &inverted).unwrap().frames).unwrap();
    tracks_hit_their_points(&colmap, 3.0);
    let llff = load(&path, &LoadOptions::default().with_dialect(Dialect::Llff)).unwrap();
    assert_eq!(llff.dialect, Dialect::Llff);
    assert_eq!(counts(&llff), [35, 0, 5, 0]);
    for (a, b) in colmap.frames.iter().zip(&llff.frames) {
        assert_eq!(a.name, b.name);
        assert!((a.camera.pose.c - b.camera.pose.c).length() < 1e-10, "{}", a.name);
        let turned = a.camera.pose.r.transpose() * b.camera.pose.r - glam::DMat3::IDENTITY;
        assert!(turned.to_cols_array().iter().all(|x| x.abs() < 1e-10), "{}", a.name);
        // LLFF's own bounds are percentiles of the same points; how they round is theirs.
        let ([near, far], [llff_near, llff_far]) = (a.z_bounds.unwrap(), b.z_bounds.unwrap());
        assert!((near / llff_near - 1.0).abs() < 0.2, "{}: near {near} against {llff_near}", a.name);
        assert!((far / llff_far - 1.0).abs() < 0.2, "{}: far {far} against {llff_far}", a.name);
    }
    assert!(share_in_view(&colmap) > 0.5);

    let store = ImageStore::new(&colmap.frames, StoreOptions::default().with_longest_side(120)).unwrap();
    let image = store.get(0).unwrap();
    let used = image.mask.as_ref().unwrap().iter().filter(|v| **v == 255).count();
    let share = used as f64 / (image.width * image.height) as f64;
    assert!((0.02..0.9).contains(&share), "{share} of the pixels are used");
    let off = load(&path, &LoadOptions::default().with_masks(Masks::Off)).unwrap();
    assert!(off.frames.iter().all(|f| f.mask.is_none()));
    assert_ne!(off.fingerprint(), colmap.fingerprint());
    assert_eq!(colmap.fingerprint(), load(&path, &LoadOptions::default()).unwrap().fingerprint());
}

#[test]
fn sacre_coeur_has_a_camera_a_photograph() {
    let Some(path) = data("phototourism/sacre_coeur_10") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Colmap);
    assert_eq!(counts(&scene), [8, 0, 2, 0]);
    assert_eq!(scene.points.len(), 1516);
    let share = share_in_view(&scene);
    assert!(share > 0.4, "only {share} of the points are in view");
    tracks_hit_their_points(&scene, 1.0);
    let report = check(&path, &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train(), "{report}");
    assert!(report.sizes.len() > 1 && report.problems.is_empty(), "{report}");
}

#[test]
fn binary_and_text_models_agree() {
    let Some(path) = data("colmap_models/statue_of_liberty_bin_and_txt/sparse/0") else { return };
    let binary = Model::read(&path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["cameras.txt", "images.txt", "points3D.txt"] {
        std::fs::copy(path.join(name), folder.path().join(name)).unwrap();
    }
    let text = Model::read(folder.path()).unwrap();
    assert_eq!((binary.images.len(), binary.points.len()), (40, 1816));
    assert_eq!((text.images.len(), text.points.len()), (40, 1816));
    assert_eq!(binary.cameras.len(), text.cameras.len());
    for (id, a) in &binary.cameras {
        let b = &text.cameras[id];
        assert_eq!((a.width, a.height), (b.width, b.height));
        // The text of this version of COLMAP has six digits in cameras and poses, all of them in points.
        assert!((a.fx - b.fx).abs() < 1e-5 * a.fx && (a.cx - b.cx).abs() < 1e-3);
        let (Lens::Perspective { k: a, .. }, Lens::Perspective { k: b, .. }) = (a.lens, b.lens) else {
            panic!("SIMPLE_RADIAL is a perspective lens");
        };
        assert!(a[0] < -0.68 && (a[0] - b[0]).abs() < 1e-6);
    }
    for (a, b) in binary.images.iter().zip(&text.images) {
        assert_eq!((a.id, &a.name, a.camera_id, &a.point_ids), (b.id, &b.name, b.camera_id, &b.point_ids));
        assert!((a.pose.c - b.pose.c).length() < 1e-5 * a.pose.c.length().max(1.0));
    }
    for (id, a) in &binary.points {
        let b = text.points[id];
        assert!((a.xyz - b.xyz).length() < 1e-9 * a.xyz.length().max(1.0) && a.rgb == b.rgb);
    }
}

#[test]
fn colmap_cameras_are_scaled_to_larger_photographs() {
    let (Some(model), Some(images)) = (data("instant_ngp/fox_colmap"), data("instant_ngp/fox/images")) else { return };
    let options = LoadOptions::default().with_images(images);
    let scene = load(&model, &options).unwrap();
    assert_eq!(counts(&scene), [43, 0, 7, 0]);
    assert_eq!((scene.frames[0].camera.width, scene.frames[0].camera.height), (1080, 1920));
    has_note(&scene, "cameras scaled to the images (540x960 listed, 1080x1920 found)");
    has_note(&scene, "found under another extension than listed");
    let error = load(&model, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds no folder of images"), "{error}");

    // The reconstruction was made with the poses of the other file: the same cameras, at another size.
    let Some(fox135) = data("benchmarks/fox135") else { return };
    let other = load(&fox135, &LoadOptions::default()).unwrap();
    // The matrices of that file are orthonormal to 1.2e-6 only, and COLMAP made quaternions of them.
    for (a, b) in scene.frames.iter().zip(&other.frames) {
        assert!((a.camera.pose.c - b.camera.pose.c).length() < 1e-5, "{} {}", a.name, b.name);
        let off = a.camera.optical_axis().angle_between(b.camera.optical_axis());
        assert!(off < 1e-5, "{}: {off} rad", a.name);
        assert!((a.camera.fx / 8.0 - b.camera.fx).abs() < 1e-6 && (a.camera.cx / 8.0 - b.camera.cx).abs() < 1e-6);
    }
}

#[test]
fn nr_nerf_example_is_a_video_in_time_order() {
    let Some(path) = data("nr_nerf/example_sequence") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::NrNerf);
    assert_eq!(counts(&scene), [85, 0, 1, 0]);
    assert_eq!(scene.held_out_names(), ["image000021.png"]);
    assert!(scene.frames.iter().enumerate().all(|(i, f)| f.time == Some(i as f64 / 85.0)));
    let camera = &scene.frames[0].camera;
    assert_eq!((camera.width, camera.height, camera.cx), (512, 384, 256.0));
    assert!((camera.fx - 256.609_527).abs() < 1e-5);
    assert_eq!(scene.layout, LayoutHint::ForwardFacing);
    // The smallest near depth of a frame is 0.0024, the largest far one 1.0.
    assert!(scene.frames.iter().all(|f| f.z_bounds == scene.frames[0].z_bounds));
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!((0.03..0.1).contains(&near) && (0.7..0.95).contains(&far), "{near} {far}");
    // Recentred: on average the cameras look along -z with y up, in OpenGL's sense.
    let mean: DVec3 = scene.frames.iter().map(|f| f.camera.optical_axis()).sum();
    assert!(mean.normalize().dot(DVec3::NEG_Z) > 0.999, "{mean}");
    // Protocol nr-example: every 8th from the fifth.
    let protocol = load(&path, &with(Holdout::parse("every:8+4").unwrap())).unwrap();
    assert_eq!(counts(&protocol), [75, 0, 11, 0]);
    assert_eq!(protocol.held_out_names()[..2], ["image000005.png", "image000013.png"]);
    let report = check(&path, &LoadOptions::default(), Depth::Headers);
    assert!(report.can_train() && report.problems.is_empty(), "{report}");
}

/// Poses of `precomputed.json` are in OpenGL axes: what does not move in the video fits its epipolar lines in these axes and
/// in no others. Patches of one picture are looked for in one three frames later.
#[test]
fn nr_nerf_axes_fit_the_pictures() {
    let Some(path) = data("nr_nerf/example_sequence") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    let store = ImageStore::new(&scene.frames, StoreOptions::default().with_longest_side(256)).unwrap();
    // Had the columns been LLFF's (down, right, backwards), the axes would have been these.
    let as_llff = |camera: &Camera| {
        let r = camera.pose.r;
        Camera { pose: Pose { r: glam::DMat3::from_cols(-r.y_axis, r.x_axis, r.z_axis), ..camera.pose }, ..*camera }
    };
    let [mut off, mut wrong] = [Vec::new(), Vec::new()];
    for first in (0..80).step_by(8) {
        let (a, b) = (store.get(first).unwrap(), store.get(first + 3).unwrap());
        let (from, to) = (store.camera(first), store.camera(first + 3));
        for y in (24..168).step_by(12) {
            for x in (24..232).step_by(12) {
                let Some((u, v)) = matched(&a, &b, x, y) else { continue };
                let [here, there] = [(x, y), (u, v)].map(|(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
                off.extend(off_the_ray(from, to, here, there));
                wrong.extend(off_the_ray(&as_llff(from), &as_llff(to), here, there));
            }
        }
    }
    assert!(off.len() > 20, "only {} patches found again", off.len());
    let [off, wrong] = [off, wrong].map(|mut off| {
        off.sort_by(f64::total_cmp);
        off[off.len() / 2]
    });
    // Patches are found to whole pixels, and some belong to what moves: about a pixel is what can be asked.
    let what = format!("half of the patches are more than {off} px off their rays, {wrong} in other axes");
    assert!(off < 1.5 && wrong > 3.0 * off, "{what}");
}

/// How far `there` in one picture is from the ray of `here` in another, at whatever depth is best.
fn off_the_ray(from: &Camera, to: &Camera, here: DVec2, there: DVec2) -> Option<f64> {
    let ray = from.ray(here)?;
    let at = |k: i32| to.project(ray.o + ray.d * (0.05 * 1.02_f64.powi(k))).map(|p| p.distance(there));
    (0..200).filter_map(at).reduce(f64::min)
}

/// Where a patch of 9x9 pixels is found again, if it has texture, is found for sure and has moved.
fn matched(a: &scene_io::Image, b: &scene_io::Image, x: u32, y: u32) -> Option<(u32, u32)> {
    const HALF: i64 = 4;
    let patch = |image: &scene_io::Image, x: i64, y: i64| -> Vec<f64> {
        let at = |k: i64| image.pixel((x + k % 9 - HALF) as u32, (y + k / 9 - HALF) as u32)[1];
        let values: Vec<f64> = (0..81).map(|k| f64::from(at(k))).collect();
        let mean = values.iter().sum::<f64>() / 81.0;
        values.iter().map(|v| v - mean).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (x, y) = (i64::from(x), i64::from(y));
    let here = patch(a, x, y);
    let norm = dot(&here, &here);
    if norm < 81.0 * 400.0 {
        return None;
    }
    let mut best = (0.0, 0, 0);
    for v in -12..=12 {
        for u in -12..=12 {
            let there = patch(b, x + u, y + v);
            let likeness = dot(&here, &there) / (norm * dot(&there, &there)).sqrt().max(1e-9);
            if likeness > best.0 {
                best = (likeness, u, v);
            }
        }
    }
    let (likeness, u, v) = best;
    (likeness > 0.97 && u * u + v * v >= 4).then_some(((x + u) as u32, (y + v) as u32))
}

#[test]
fn dycheck_cameras_are_read_without_their_photos() {
    let Some(path) = data("dycheck_iphone/paper-windmill_cameras_only") else { return };
    let error = load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds no folder of images: looked for rgb/1x"), "{error}");
    assert!(error.contains("696 cameras (277 to train, 419 to test)") && !error.contains('\n'), "{error}");
    let report = check(&path, &LoadOptions::default(), Depth::Pixels);
    assert!(!report.can_train() && report.problems.len() == 1, "{report}");
    assert!(report.to_string().contains("times: 696 frames, 277 distinct, 0 to 1"), "{report}");

    let scene = load_cameras(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Nerfies);
    assert_eq!(counts(&scene), [277, 0, 419, 0]);
    let frame = &scene.frames[3];
    assert_eq!((frame.name.as_str(), frame.time), ("0_00003", Some(3.0 / 276.0)));
    let late = scene.frames.iter().find(|f| f.name == "2_00276").unwrap();
    assert_eq!((late.time, late.split, late.ids.unwrap().camera), (Some(1.0), Split::Test, 2));
    let camera = &scene.frames[0].camera;
    assert_eq!((camera.width, camera.height, camera.fx), (720, 960, 719.947_143_554_687_5));
    // The first camera looks along -z with y up.
    assert_eq!((camera.optical_axis(), camera.pose.r.y_axis), (DVec3::NEG_Z, DVec3::NEG_Y));
    // The point the authors say all look at, (0.07, -0.05, 0.15) in their frame, is in every picture.
    let lookat =
        DVec3::new(0.073_601, -0.053_279, 0.152_124) / 0.271_591_6 + DVec3::new(-0.200_620, 0.170_583, -1.171_748);
    let inside = |f: &&scene_io::Frame| {
        f.camera.project(lookat).is_some_and(|p| p.x > 0.0 && p.y > 0.0 && p.x < 720.0 && p.y < 960.0)
    };
    let seen = scene.frames[..277].iter().filter(inside).count();
    assert!(seen > 250, "{seen} of 277 pictures show what all look at: wrong axes?");
    let bounds = scene.bounds.unwrap();
    assert!(scene.frames[..277].iter().all(|f| {
        let c = f.camera.pose.c;
        (c - bounds.min).min_element() > -1e-3 && (bounds.max - c).min_element() > -1e-3
    }));
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!(near > 0.2 && near < 0.401 && (far - 1.886).abs() < 1e-3, "{near} {far}");
}

#[test]
fn endoscopes_poses_are_read_alone() {
    for (name, n) in [("pulling_soft_tissues_poses_only", 63), ("cutting_tissues_twice_poses_only", 156)] {
        let Some(path) = data(&format!("endonerf/{name}")) else { continue };
        let scene = load_cameras(&path, &LoadOptions::default()).unwrap();
        assert_eq!(scene.dialect, Dialect::EndoNerf);
        assert_eq!(counts(&scene), [n, 0, 0, 0]);
        assert!(scene.frames.iter().enumerate().all(|(i, f)| f.time == Some(i as f64 / (n - 1) as f64)));
        let camera = &scene.frames[n - 1].camera;
        assert_eq!((camera.width, camera.height, camera.cx, camera.cy), (640, 512, 320.0, 256.0));
        assert!((camera.fx - 569.468_200_41).abs() < 1e-6);
        assert_eq!((camera.pose.c, camera.optical_axis()), (DVec3::ZERO, DVec3::NEG_Z));
        let report = check(&path, &LoadOptions::default(), Depth::Pixels);
        assert!(!report.can_train() && report.problems.len() == 1, "{report}");
        let text = report.to_string();
        assert!(text.contains(&format!("there are {n} poses")) && text.contains("`masks` and `depth`"), "{text}");
        assert!(text.contains(&format!("times: {n} frames, {n} distinct, 0 to 1")), "{text}");
    }
}

#[test]
fn poses_without_images_say_what_is_missing() {
    let Some(path) = data("endonerf/pulling_soft_tissues_poses_only") else { return };
    let error = load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds no folder of images: there are 63 poses"), "{error}");
    let Some(path) = data("davis/lady-running") else { return };
    let error = load(&path, &LoadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds 65 photos and no cameras") && error.contains("`prepare`"), "{error}");
}

#[test]
fn all_images_of_the_small_scenes_decode() {
    for relative in ["benchmarks/fox135", "nerf_llff_data/fern", "blender_rendered/plaza_photos"] {
        let Some(path) = data(relative) else { continue };
        let report = check(&path, &LoadOptions::default(), Depth::Pixels);
        assert!(report.can_train() && report.problems.is_empty(), "{report}");
        let scene = report.scene.unwrap();
        assert!(scene.frames.iter().all(|f| matches!(f.image, ImageSource::File(_))));
        assert!(report.image_bytes > 0);
    }
}

#[test]
fn the_nerfies_capture_numbers_the_appearance_of_each_photo() {
    let Some(path) = data("nerfies_capture") else { return };
    let scene = load(&path, &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect, Dialect::Nerfies);
    assert_eq!(counts(&scene), [82, 0, 5, 0]);
    let appearances = |split| -> Vec<u32> {
        let frames = scene.frames.iter().filter(|frame| frame.split == split);
        frames.map(|frame| frame.ids.unwrap().appearance).collect()
    };
    let mut training = appearances(Split::Train);
    training.sort_unstable();
    assert_eq!(training, (0..82).collect::<Vec<u32>>());
    // Held-out photos have the numbers of training photos that were taken next to them.
    assert_eq!(appearances(Split::Test), [0, 19, 38, 57, 76]);
}

#[test]
fn flow_and_masks_of_a_real_video_are_read_and_written_again() {
    let Some(path) = data("davis/tennis") else { return };
    let folder = tempfile::tempdir().unwrap();
    for k in 1..=4 {
        let camera = Camera::pinhole(448, 256, 400.0, 400.0, 224.0, 128.0, Pose::IDENTITY);
        let photo = ImageSource::File(path.join(format!("rgb/{k:04}.jpg")));
        let mut frame = Frame::new(format!("{k:04}"), photo, camera);
        let file = path.join(format!("flow_sample/{k:04}.flo"));
        frame.priors.motion.forward = Some(file.clone());
        frame.priors.motion.mask = Some(path.join(format!("mask/{k:04}.png")));
        let flow = frame.read_flow_prior().unwrap().forward.unwrap();
        assert_eq!((flow.width, flow.height, flow.seen.count()), (448, 256, 448 * 256));
        if k == 1 {
            let first = [[0xa3, 0x04, 0x99, 0x3f], [0x6c, 0x87, 0xa6, 0xbd]].map(f32::from_le_bytes);
            assert_eq!(flow.vectors[0], first);
        }
        // All of it is valid, so the bytes are the same.
        let again = folder.path().join("again.flo");
        write_flo(&again, &flow).unwrap();
        assert!(std::fs::read(&again).unwrap() == std::fs::read(&file).unwrap(), "{}", file.display());
        let mask = frame.read_motion_mask().unwrap().unwrap();
        let share = mask.count() as f64 / (448.0 * 256.0);
        assert!(share > 0.03 && share < 0.04, "{share}");
        // The camera follows the player: what moves differs from the rest.
        let mean = |moves: bool| {
            let of = flow.vectors.iter().zip(mask.iter()).filter(|(_, m)| *m == moves);
            let across: Vec<f64> = of.map(|(vector, _)| f64::from(vector[0])).collect();
            across.iter().sum::<f64>() / across.len().max(1) as f64
        };
        assert!((mean(true) - mean(false)).abs() > 5.0, "{} {}", mean(true), mean(false));
    }
}
