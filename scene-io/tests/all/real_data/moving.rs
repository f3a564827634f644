//! Scenes that move: NR-NeRF, DyCheck, EndoNeRF, Nerfies.

use super::{counts, data, with};
use glam::DVec3;
use scene_io::{Depth, Dialect, Holdout, LayoutHint, LoadOptions, Split, check, load, load_cameras};

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
