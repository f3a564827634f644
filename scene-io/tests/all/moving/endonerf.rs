//! EndoNeRF: poses, depth and tool masks of a stereo endoscope.

use super::*;

#[test]
fn endonerf_is_read_with_masks_depth_and_truth() {
    let dataset = Dataset::endonerf(5);
    let scene = plain(&dataset);
    assert_eq!(scene.dialect, Dialect::EndoNerf);
    assert_eq!(times(&scene), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!((scene.count(Split::Train), scene.count(Split::Test)), (5, 0));
    let frame = &scene.frames[1];
    assert_eq!((frame.camera.width, frame.camera.fx, frame.camera.cx), (16, 20.0, 8.0));
    // The identity means OpenGL axes: looking along -z with y up, columns as they are.
    assert_eq!((frame.camera.optical_axis(), frame.camera.pose.r.x_axis), (DVec3::NEG_Z, DVec3::X));
    assert_eq!(frame.mask_polarity, MaskPolarity::WhiteIsIgnored);
    let image = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap().get(1).unwrap();
    assert!(!image.is_used(1, 3) && image.is_used(2, 3));
    let depth = frame.read_depth().unwrap().unwrap();
    assert_eq!((depth.holes(), depth.range()), (2, Some([50.0, 65.0])));
    assert_eq!(frame.read_transient().unwrap().unwrap().count(), 12);
    notes(&scene, &["tools cover 10.0 % of the pixels; 1 of 5 masks show none", "no test frames"]);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.problems.is_empty(), "{report}");
    let text = report.to_string();
    for part in [
        "times: 5 frames, 5 distinct, 0 to 1",
        "depth: 5 maps, 50 to 65 world units, 1.0 % of the pixels not known",
        "truth: 5 masks of what does not belong",
        "masks: 90.0 % of the training photos' pixels are used",
        "5 masks",
    ] {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
}

#[test]
fn endonerf_is_told_from_llff_by_its_poses() {
    let dataset = Dataset::endonerf(3);
    dataset.write("poses_bounds.npy", poses_bounds(3));
    assert_eq!(plain(&dataset).dialect, Dialect::Llff);
    let options = LoadOptions::default().with_dialect(Dialect::EndoNerf);
    assert_eq!(load(dataset.path(), &options).unwrap().dialect, Dialect::EndoNerf);
    dataset.write("poses_bounds.npy", still_poses(3));
    let options = LoadOptions::default().with_dialect(Dialect::Llff);
    assert_eq!(load(dataset.path(), &options).unwrap().dialect, Dialect::Llff);
    // The README's spelling.
    dataset.remove("poses_bounds.npy");
    dataset.write("pose_bounds.npy", still_poses(3));
    let scene = plain(&dataset);
    assert_eq!(scene.dialect, Dialect::EndoNerf);
    notes(&scene, &["pose_bounds.npy is a misspelling of poses_bounds.npy"]);
    let file = dataset.path().join("pose_bounds.npy");
    assert_eq!(load(&file, &LoadOptions::default()).unwrap().dialect, Dialect::EndoNerf);
}

#[test]
fn endonerf_folders_must_match() {
    for (folder, file) in
        [("masks", "frame-000001.mask.png"), ("depth", "frame-000001.depth.png"), ("gt_masks", "frame-000001.mask.png")]
    {
        let dataset = Dataset::endonerf(4);
        dataset.grey(&format!("{folder}/{file}"), (12, 12), |x, _| x as u8);
        let kind = match folder {
            "masks" => "mask",
            "depth" => "depth map",
            _ => "true mask",
        };
        refused(
            &dataset,
            &[folder, "frame `frame-000001.color.png`", &format!("the {kind} is 12x12 and its image 16x12")],
        );
        dataset.remove(&format!("{folder}/{file}"));
        refused(&dataset, &[folder, "holds 3 files for 4 images", "remove the folder"]);
        dataset.remove(folder);
        plain(&dataset);
    }
    let dataset = Dataset::endonerf(4);
    dataset.remove("images/frame-000001.color.png");
    refused(&dataset, &["holds 4 poses", "holds 3 images"]);
    for name in ["images", "masks", "depth", "gt_masks"] {
        dataset.remove(name);
    }
    let parts = ["holds no folder of images", "4 poses", "`images`, `masks` and `depth`", "add the three folders"];
    refused(&dataset, &parts);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(!report.can_train() && report.problems.len() == 1, "{report}");
    let text = report.to_string();
    assert!(text.contains("times: 4 frames, 4 distinct, 0 to 1") && text.contains("4 of 16x12"), "{text}");
    assert_eq!(load_cameras(dataset.path(), &LoadOptions::default()).unwrap().frames.len(), 4);
}

#[test]
fn endonerf_without_masks_or_depth_says_so() {
    let dataset = Dataset::endonerf(3);
    dataset.remove("masks");
    dataset.remove("depth");
    notes(&plain(&dataset), &["no folder `masks`: nothing counts as a tool", "no folder `depth`"]);
    warns(&dataset, "all 3 training cameras stand at the same place");
    let dataset = Dataset::endonerf(3);
    let off = LoadOptions::default().with_masks(Masks::Off);
    assert!(load(dataset.path(), &off).unwrap().frames.iter().all(|f| f.mask.is_none()));
}

#[test]
fn tools_everywhere_are_left_out_and_everywhere_always_refused() {
    let dataset = Dataset::endonerf(4);
    // No tool anywhere is legal.
    for i in 0..4 {
        dataset.grey(&format!("masks/frame-{i:06}.mask.png"), (16, 12), |_, _| 0);
    }
    notes(&plain(&dataset), &["tools cover 0.0 % of the pixels; 4 of 4 masks show none"]);
    dataset.grey("masks/frame-000000.mask.png", (16, 12), |_, _| 255);
    let scene = plain(&dataset);
    assert_eq!(scene.frames[0].name, "frame-000001.color.png");
    assert_eq!(times(&scene), [1.0 / 3.0, 2.0 / 3.0, 1.0], "times stay those of the sequence");
    notes(&scene, &["1 frames show nothing but tools and are left out: frame-000000.color.png"]);
    warns(&dataset, "1 frames show nothing but tools");
    for i in 0..4 {
        dataset.grey(&format!("masks/frame-{i:06}.mask.png"), (16, 12), |_, _| 255);
    }
    refused(&dataset, &["masks", "all 4 frames are white all over", "turn the masks round"]);
}
