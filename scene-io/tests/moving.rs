//! Moving scenes: what each dialect gives, and what odd ones are promised: one line each.

mod common;

use common::{Dataset, npy, poses_bounds, still_poses};
use glam::DVec3;
use proptest::prelude::*;
use scene_io::{
    Depth, DepthMeaning, DepthSource, Dialect, ErrorKind, FrameIds, Holdout, ImageStore, LayoutHint, LoadOptions,
    MaskPolarity, Masks, Scene, Severity, Split, StoreOptions, check, export, load, load_cameras,
};

fn plain(dataset: &Dataset) -> Scene {
    load(dataset.path(), &LoadOptions::default()).unwrap()
}

fn times(scene: &Scene) -> Vec<f64> {
    scene.frames.iter().map(|f| f.time.unwrap()).collect()
}

/// One line, holding all parts.
#[track_caller]
fn refused(dataset: &Dataset, parts: &[&str]) {
    refused_with(dataset, &LoadOptions::default(), parts);
}

#[track_caller]
fn refused_with(dataset: &Dataset, options: &LoadOptions, parts: &[&str]) {
    let text = load(dataset.path(), options).expect_err("the dataset is spoiled").to_string();
    assert!(!text.contains('\n'), "more than one line: {text}");
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

#[track_caller]
fn notes(scene: &Scene, parts: &[&str]) {
    for part in parts {
        let found: Vec<_> = scene.notes.iter().filter(|n| n.contains(part)).collect();
        assert_eq!(found.len(), 1, "`{part}` is in {found:?} of {:#?}", scene.notes);
        assert!(!found[0].contains('\n'));
    }
}

#[track_caller]
fn warns(dataset: &Dataset, part: &str) {
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let found =
        report.problems.iter().filter(|p| p.severity == Severity::Warning && p.to_string().contains(part)).count();
    assert_eq!(found, 1, "`{part}` in\n{report}");
    assert!(report.can_train(), "{report}");
}

// --- Times ---

#[test]
fn times_in_range_are_kept_and_frame_numbers_mapped() {
    let scene = plain(&Dataset::d_nerf(&["0.0", "0.5", "1.0"], &["0.25"]));
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.25]);
    assert!(!scene.notes.iter().any(|n| n.contains("time")), "{:?}", scene.notes);
    // Frame numbers, unsorted, test frames beyond training: one map for all.
    let scene = plain(&Dataset::d_nerf(&["8", "3", "4"], &["0", "10"]));
    assert_eq!(times(&scene), [0.8, 0.3, 0.4, 0.0, 1.0]);
    notes(
        &scene,
        &["times 0 to 10 were mapped to 0 to 1", "2 of 2 test frames lie before the first or after the last"],
    );
    let scene = plain(&Dataset::d_nerf(&["-1.5", "0.5"], &["-0.5"]));
    assert_eq!(times(&scene), [0.0, 1.0, 0.5]);
    // The difference of the largest numbers is none.
    let scene = plain(&Dataset::d_nerf(&["-1.7e308", "1.7e308"], &["0"]));
    assert_eq!(times(&scene), [0.0, 1.0, 0.5]);
}

#[test]
fn times_that_do_not_start_at_0_are_shifted() {
    let scene = plain(&Dataset::d_nerf(&["0.25", "0.75"], &["0.5"]));
    assert_eq!(times(&scene), [0.0, 0.5, 0.25]);
    notes(&scene, &["no frame has time 0: times 0.25 to 0.75 were shifted"]);
    // D-NeRF's loader wants the first frame listed at 0; here it may be any.
    let scene = plain(&Dataset::d_nerf(&["0.5", "0.0", "1.0"], &["0.5"]));
    assert_eq!(times(&scene), [0.5, 0.0, 1.0, 0.5]);
    notes(&scene, &["the first training frame has time 0.5, which D-NeRF's own loader refuses"]);
}

#[test]
fn duplicate_and_unsorted_times_are_views_of_one_moment() {
    let scene = plain(&Dataset::d_nerf(&["0.5", "0.0", "0.5", "1.0", "0.0"], &["0.5"]));
    assert_eq!(times(&scene), [0.5, 0.0, 0.5, 1.0, 0.0, 0.5]);
    let dataset = Dataset::d_nerf(&["0.5", "0.0", "0.5", "1.0", "0.0"], &["0.5"]);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.to_string().contains("times: 6 frames, 3 distinct, 0 to 1"), "{report}");
}

#[test]
fn one_frame_and_equal_times_cannot_move() {
    let dataset = Dataset::d_nerf(&["0.0"], &[]);
    dataset.remove("transforms_test.json");
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0]);
    notes(&scene, &["there is a single moment: nothing can move"]);
    let scene = plain(&Dataset::d_nerf(&["7", "7"], &["7"]));
    assert_eq!(times(&scene), [0.0; 3]);
    notes(&scene, &["all 3 frames have the same time: nothing can move"]);
}

#[test]
fn missing_times_are_the_place_in_the_list() {
    let dataset = Dataset::d_nerf(&["0.0", "", "1.0"], &["0.25"]);
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.25]);
    notes(&scene, &["warning: ", "1 of 3 frames have no time: train/r_1; their place in the list is taken for it"]);
    warns(&dataset, "1 of 3 frames have no time");
    let scene = plain(&Dataset::d_nerf(&["0.0", "0.5", "1.0"], &["", ""]));
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.0, 1.0]);
    notes(&scene, &["transforms_test.json have no time: their order is taken for it, 0 to 1"]);
    // In no frame: a scene that stands still, until the caller says otherwise.
    let mut scene = plain(&Dataset::d_nerf(&["", "", ""], &["", ""]));
    assert!(scene.frames.iter().all(|f| f.time.is_none()));
    assert!(scene.time_by_order());
    assert_eq!(times(&scene), [0.0, 0.25, 0.5, 0.75, 1.0]);
    notes(&scene, &["the order of the 5 frames is taken for it"]);
    assert!(!scene.time_by_order());
}

#[test]
fn times_that_are_no_numbers_name_frame_and_field() {
    for (time, what) in [("NaN", "not a finite number"), ("Infinity", "not a finite number"), ("\"late\"", "no number")]
    {
        let dataset = Dataset::d_nerf(&["0.0", time], &["0.5"]);
        refused(&dataset, &["transforms_train.json", "frame `train/r_1`", "`frames[1].time`", what]);
    }
}

#[test]
fn exported_cameras_keep_their_times() {
    let dataset = Dataset::d_nerf(&["3", "7", "11"], &["5"]);
    let scene = plain(&dataset);
    let file = dataset.path().join("transforms.json");
    export::write_transforms(&file, &scene.frames).unwrap();
    let again = load(&file, &LoadOptions { holdout: Some(Holdout::None), ..LoadOptions::default() }).unwrap();
    for frame in &again.frames {
        let same = scene.frames.iter().find(|f| format!("{}.png", f.name) == frame.name).unwrap();
        assert_eq!((frame.time, frame.camera.pose.c), (same.time, same.camera.pose.c), "{}", frame.name);
    }
}

#[test]
fn different_exposures_are_told() {
    let dataset = Dataset::d_nerf(&["0", "1", "2"], &["3"]);
    let file = dataset.path().join("transforms_train.json");
    let text = std::fs::read_to_string(&file).unwrap();
    std::fs::write(&file, text.replacen("{\"time\": 0,", "{\"exposures\": -3, \"time\": 0,", 1)).unwrap();
    assert!(!plain(&dataset).notes.iter().any(|n| n.contains("exposures")));
    dataset.edit("transforms_train.json", "{\"time\": 1,", "{\"exposures\": 1, \"time\": 1,");
    notes(&plain(&dataset), &["2 exposures (-3 to 1)"]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn time_is_between_0_and_1_in_the_order_written(
        written in prop::collection::vec(prop_oneof![-1e3..1e3_f64, 0.0..1.0_f64, (0..9_i32).prop_map(f64::from)], 2..7),
    ) {
        let texts: Vec<String> = written.iter().map(f64::to_string).collect();
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        let got = times(&plain(&Dataset::d_nerf(&texts[1..], &texts[..1])));
        // Test frames come last in the scene.
        let got: Vec<f64> = got.iter().cycle().skip(texts.len() - 1).take(texts.len()).copied().collect();
        prop_assert!(got.contains(&0.0) && got.iter().all(|t| (0.0..=1.0).contains(t)), "{got:?}");
        for i in 1..got.len() {
            // Rounding may make two of them one.
            prop_assert!((got[i] - got[0]) * (written[i] - written[0]) >= 0.0);
            prop_assert!(written[i] != written[0] || got[i] == got[0]);
        }
    }
}

// --- NR-NeRF ---

#[test]
fn nr_nerf_is_read_in_time_order() {
    let scene = plain(&Dataset::nr_nerf(5));
    assert_eq!(scene.dialect, Dialect::NrNerf);
    assert_eq!(times(&scene), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(scene.held_out_names(), ["image002.png"]);
    assert_eq!(scene.layout, LayoutHint::ForwardFacing);
    let camera = scene.frames[1].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.cx), (16, 12, 20.5, 8.0));
    assert_eq!((camera.pose.c, camera.optical_axis()), (DVec3::new(1.5, 0.0, 0.0), DVec3::NEG_Z));
    assert_eq!(scene.frames[0].z_bounds, Some([0.1, 6.0]));
    let held = |word: &str| {
        let options = LoadOptions { holdout: Some(Holdout::parse(word).unwrap()), ..LoadOptions::default() };
        load(Dataset::nr_nerf(9).path(), &options).unwrap().held_out_names()
    };
    assert_eq!(held("every:4+1"), ["image001.png", "image005.png"]);
    assert_eq!(held("every:8+4"), ["image004.png"]);
    let one = Dataset::nr_nerf(1);
    one.edit("precomputed.json", "\"i_test\": 2", "\"i_test\": []");
    assert_eq!(times(&plain(&one)), [0.0]);
}

#[test]
fn stray_depths_of_nr_nerf_are_left_out() {
    let dataset = Dataset::nr_nerf(9);
    let file = dataset.path().join("precomputed.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let start = text.find("\"bds\"").unwrap();
    let ranges: Vec<String> =
        (0..40).map(|i| format!("[{}, {}]", if i == 7 { 1e-4 } else { 0.5 }, if i == 9 { 1e6 } else { 2.0 })).collect();
    let poses = vec!["[[1, 0, 0, 0.5, 12.0], [0, 1, 0, 0, 16.0], [0, 0, 1, 0, 20.5]]"; 40].join(", ");
    assert!(start > 0);
    std::fs::write(&file, format!(r#"{{"poses": [{poses}], "bds": [{}]}}"#, ranges.join(", "))).unwrap();
    for i in 9..40 {
        dataset.image(&format!("images/image{i:03}.png"), 16, 12);
    }
    let scene = plain(&dataset);
    assert!(scene.frames.iter().all(|f| f.z_bounds == Some([0.5, 2.0])), "{:?}", scene.frames[0].z_bounds);
    notes(&scene, &["0.500 to 2.000 is taken for all"]);
}

#[test]
fn nr_nerf_problems_name_the_entry() {
    let spoiled = |from: &str, to: &str, parts: &[&str]| {
        let dataset = Dataset::nr_nerf(4);
        dataset.edit("precomputed.json", from, to);
        refused(&dataset, &["precomputed.json"]);
        refused(&dataset, parts);
    };
    spoiled("1.5, 12.0", "NaN, 12.0", &["`poses[1][0][3]` = NaN", "not a finite number"]);
    spoiled("1.5, 12.0]", "1.5]", &["`poses[1]`", "no list of 3x5 numbers"]);
    spoiled("[1, 0, 0, 1.5", "[0, 0, 0, 1.5", &["frame `image001.png`", "`poses[1]`", "singular"]);
    spoiled("2.5, 12.0", "2.5, 0.5", &["`poses[2][0][4]` = 0.5", "no image size"]);
    spoiled("[0.1, 2.0], ", "", &["`bds`", "3 depth ranges for 4 poses"]);
    spoiled("[0.1, 2.0]", "[0.1, Infinity]", &["`bds[0][1]` = Infinity", "not a finite number"]);
    spoiled("\"i_test\": 2", "\"i_test\": 4", &["`i_test` = 4", "only 4 frames"]);
    spoiled("\"i_test\": 2", "\"i_test\": -1", &["`i_test` = -1", "no whole number"]);
    spoiled("\"poses\"", "\"pauses\"", &["`poses`", "is missing"]);
    let dataset = Dataset::nr_nerf(4);
    dataset.remove("images/image003.png");
    refused(&dataset, &["holds 4 poses", "holds 3 images"]);
    dataset.remove("images");
    refused(&dataset, &["holds no folder of images"]);
    let scene = load_cameras(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!((scene.frames.len(), scene.frames[3].time), (4, Some(1.0)));
}

// --- EndoNeRF ---

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
    let options = LoadOptions { dialect: Some(Dialect::EndoNerf), ..LoadOptions::default() };
    assert_eq!(load(dataset.path(), &options).unwrap().dialect, Dialect::EndoNerf);
    dataset.write("poses_bounds.npy", still_poses(3));
    let options = LoadOptions { dialect: Some(Dialect::Llff), ..LoadOptions::default() };
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
    let off = LoadOptions { masks: Masks::Off, ..LoadOptions::default() };
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

// --- Nerfies, HyperNeRF, DyCheck ---

#[test]
fn nerfies_folders_are_read_whole() {
    let dataset = Dataset::nerfies();
    let scene = plain(&dataset);
    assert_eq!(scene.dialect, Dialect::Nerfies);
    let names: Vec<&str> = scene.frames.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["0_00000", "0_00002", "0_00004", "1_00001", "1_00003"]);
    assert_eq!((scene.count(Split::Train), scene.count(Split::Test)), (3, 2));
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.25, 0.75]);
    assert_eq!(scene.frames[4].ids, Some(FrameIds { time: 3, appearance: 3, camera: 1 }));
    let camera = scene.frames[1].camera;
    assert_eq!((camera.width, camera.height, camera.fx), (8, 6, 10.0));
    assert!((camera.fy - 11.0).abs() < 1e-12 && (camera.cx - 4.1).abs() < 1e-12 && (camera.cy - 2.95).abs() < 1e-12);
    let lens = render_core::camera::Lens::Perspective { k: [0.01, 0.002, 0.0, 0.0, 0.0, 0.0], p: [0.001, -0.001] };
    assert_eq!(camera.lens, lens);
    // Rows of the orientation: right, down, forward.
    assert_eq!((camera.pose.r.x_axis, camera.pose.r.y_axis), (DVec3::X, DVec3::NEG_Y));
    assert_eq!((camera.optical_axis(), camera.pose.c), (DVec3::NEG_Z, DVec3::new(1.5, 0.0, 0.0)));
    // World units: the authors' are half of them, about (1, 2, 3).
    let bounds = scene.bounds.unwrap();
    assert_eq!((bounds.min, bounds.max), (DVec3::new(0.0, 1.5, 1.0), DVec3::new(2.0, 2.5, 5.0)));
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!(near < 0.2 && near > 0.17 && far == 4.0, "{near} {far}");
    assert_eq!(scene.points.len(), 1);
    assert_eq!(scene.points[0].xyz, DVec3::new(1.0, 2.0, 3.0));
    notes(
        &scene,
        &["1 points of the background", "1 points are not finite", "taken to be in metres", "splits/train.json"],
    );
    // Alpha is no opacity here, but says which pixels may be used.
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    let image = store.get(0).unwrap();
    assert_eq!((image.channels, image.is_used(3, 2), image.is_used(4, 2)), (3, true, false));
    assert_eq!(store.bytes(0), image.bytes());
    let half = ImageStore::new(&scene.frames, StoreOptions { longest_side: Some(4), ..Default::default() }).unwrap();
    assert!(half.get(0).unwrap().is_used(1, 1) && !half.get(0).unwrap().is_used(2, 1));
    let depth = scene.frames[0].read_depth().unwrap().unwrap();
    assert_eq!((depth.width, depth.height, depth.holes(), depth.z[1]), (8, 6, 24, 1.51));
    assert!(scene.frames[3].depth.is_none());
    assert_eq!(scene.frames[3].read_covisible().unwrap().unwrap().count(), 12, "zeros and ones are black and white");
    assert!(scene.frames[0].covisible.is_none());
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train(), "{report}");
    let text = report.to_string();
    for part in ["times: 5 frames, 5 distinct, 0 to 1", "depth: 3 maps, 1.5 to", "2 masks of what training frames show"]
    {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
}

#[test]
fn nerfies_splits_follow_the_lists() {
    let dataset = Dataset::nerfies();
    dataset.remove("splits");
    let scene = plain(&dataset);
    assert_eq!(scene.held_out_names(), ["1_00001", "1_00003"]);
    dataset.edit("dataset.json", "\"val_ids\": [\"1_00001\", \"1_00003\"]", "\"val_ids\": []");
    let scene = plain(&dataset);
    let splits: Vec<Split> = scene.frames.iter().map(|f| f.split).collect();
    assert_eq!(splits, [Split::Train, Split::Unused, Split::Test, Split::Unused, Split::Train]);
    notes(&scene, &["val_ids is empty: of four frames the first is trained on, the third tested on"]);
    // A frame in both lists is trained on, and its score means nothing.
    let dataset = Dataset::nerfies();
    dataset.remove("splits");
    dataset.edit("dataset.json", "\"val_ids\": [", "\"val_ids\": [\"0_00000\", ");
    assert_eq!(plain(&dataset).frames[0].split, Split::Train);
    warns(&dataset, "is for training and for testing at once");
    // Several times of one moment: a rig.
    let dataset = Dataset::nerfies();
    dataset.edit("metadata.json", "\"warp_id\": 1", "\"warp_id\": 2");
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.5, 0.75]);
    notes(&scene, &["says otherwise than metadata.json about 1 frames, first 1_00001"]);
    // `time_id` comes before `warp_id`.
    dataset.edit("metadata.json", "\"warp_id\": 4", "\"warp_id\": 4, \"time_id\": 8");
    assert_eq!(times(&plain(&dataset))[2], 1.0);
    assert_eq!(times(&plain(&dataset))[1], 0.25);
}

#[test]
fn millimetres_are_noticed() {
    let dataset = Dataset::nerfies();
    for id in ["0_00000", "0_00002", "0_00004"] {
        dataset.write(&format!("depth/2x/{id}.npy"), npy(&[6, 8], &[1500.0; 48]));
    }
    let scene = plain(&dataset);
    assert_eq!(scene.frames[1].read_depth().unwrap().unwrap().z[7], 1.5);
    notes(&scene, &["taken to be in millimetres: their median is 1500"]);
}

#[test]
fn nerfies_problems_name_file_and_frame() {
    let spoiled = |file: &str, from: &str, to: &str, parts: &[&str]| {
        let dataset = Dataset::nerfies();
        dataset.edit(file, from, to);
        refused(&dataset, parts);
    };
    let camera = "camera/0_00002.json";
    spoiled(camera, "[0, -1, 0]", "[0, 1, 0]", &["0_00002.json", "frame `0_00002`", "`orientation`", "left-handed"]);
    spoiled(camera, "[0, -1, 0]", "[0, NaN, 0]", &["frame `0_00002`", "`orientation[1][1]` = NaN"]);
    spoiled(camera, "\"focal_length\": 20.0", "\"focal_length\": 0", &["`focal_length` = 0", "above 0"]);
    spoiled(camera, "\"skew\": 0.0", "\"skew\": 1.0", &["`skew` = 1.0", "not supported", "undistort"]);
    spoiled(camera, "[16, 12]", "[16]", &["`image_size`", "two numbers"]);
    spoiled(camera, "[0.01, 0.002, 0.0]", "[0.01]", &["`radial_distortion`", "no list of 3 coefficients"]);
    spoiled(camera, "\"position\"", "\"place\"", &["`position`", "is missing"]);
    spoiled(
        "metadata.json",
        "\"0_00002\"",
        "\"0_00009\"",
        &["metadata.json", "frame `0_00002`", "the frame is not in it"],
    );
    spoiled("metadata.json", "\"warp_id\": 2", "\"warp_id\": -2", &["`0_00002.warp_id` = -2", "no whole number"]);
    spoiled("metadata.json", "\"warp_id\": 2", "\"wrap_id\": 2", &["frame `0_00002`", "warp_id", "is missing"]);
    spoiled("splits/train.json", "0, 2, 4", "0, 2", &["train.json", "`time_ids`", "2 numbers for 3 frames"]);
    spoiled("splits/train.json", "\"0_00000\"", "\"../0_00000\"", &["is no name of a frame"]);
    spoiled("scene.json", "\"scale\": 0.5", "\"scale\": 0", &["scene.json", "`scale` = 0", "above 0"]);
    spoiled("scene.json", "\"far\": 2.0", "\"far\": 0.0", &["`near` = 0.1 (far = 0)", "below far"]);
    let dataset = Dataset::nerfies();
    dataset.remove("rgb/2x/0_00002.png");
    refused(&dataset, &["frame `0_00002`", "the image is not there", "rgb/2x/0_00002.png"]);
    dataset.remove("rgb");
    refused(&dataset, &["holds no folder of images", "rgb/1x, rgb/2x", "5 cameras (3 to train, 2 to test)"]);
    assert_eq!(load_cameras(dataset.path(), &LoadOptions::default()).unwrap().frames[0].camera.width, 16);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(!report.can_train() && report.to_string().contains("times: 5 frames"), "{report}");
    dataset.remove("camera/0_00000.json");
    refused(&dataset, &["holds no folder of images"]);
    dataset.remove("metadata.json");
    refused(&dataset, &["metadata.json", "cannot read the file"]);
}

#[test]
fn the_smallest_photos_that_do_are_taken() {
    let dataset = Dataset::nerfies();
    for id in ["0_00000", "0_00002", "0_00004", "1_00001", "1_00003"] {
        dataset.image(&format!("rgb/1x/{id}.png"), 16, 12);
    }
    let width = |side| {
        load(dataset.path(), &LoadOptions { longest_side: side, ..LoadOptions::default() }).unwrap().frames[0]
            .camera
            .width
    };
    assert_eq!([width(None), width(Some(20)), width(Some(16)), width(Some(9)), width(Some(8))], [16, 16, 16, 16, 8]);
}

// --- Depth ---

#[test]
fn depth_files_are_read_by_extension_in_the_dialects_unit() {
    let dataset = Dataset::ngp(4);
    for (i, name) in ["0.npy", "1.png", "2.exr", "3.npy"].into_iter().enumerate() {
        let image = format!("\"file_path\": \"./images/{i:03}.png\",");
        dataset.edit("transforms.json", &image, &format!("{image} \"depth_file_path\": \"depth/{name}\","));
    }
    dataset.edit("transforms.json", "\"aabb_scale\": 1", "\"camera_model\": \"OPENCV\"");
    dataset.write("depth/0.npy", npy(&[6, 8], &[2.5; 48]));
    image::ImageBuffer::from_pixel(8, 6, image::Luma([2500_u16])).save(dataset.file("depth/1.png")).unwrap();
    image::Rgb32FImage::from_pixel(8, 6, image::Rgb([2.5, 0.0, 0.0])).save(dataset.file("depth/2.exr")).unwrap();
    dataset.write("depth/3.npy", npy(&[3, 4], &[2.5; 12]));
    let scene = plain(&dataset);
    for frame in &scene.frames {
        let map = frame.read_depth().unwrap().unwrap();
        assert_eq!(map.range(), Some([2.5, 2.5]), "{}", frame.name);
        assert_eq!(map.resized(8, 6).holes(), 0);
    }
    warns(&dataset, "the depth is the same everywhere in images/000.png, images/001.png");
    dataset.edit("transforms.json", "\"fl_x\"", "\"applied_scale\": 2.0, \"depth_unit_scale_factor\": 0.01, \"fl_x\"");
    let scene = plain(&dataset);
    let depths: Vec<f32> = scene.frames.iter().map(|f| f.read_depth().unwrap().unwrap().z[0]).collect();
    assert_eq!(depths, [5.0, 50.0, 5.0, 5.0]);

    dataset.write("depth/0.npy", npy(&[8, 6], &[2.5; 48]));
    dataset.write("depth/1.png", "no png");
    dataset.write("depth/3.npy", npy(&[12], &[2.5; 12]));
    dataset.remove("depth/2.exr");
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let errors: Vec<String> =
        report.problems.iter().filter(|p| p.severity == Severity::Error).map(ToString::to_string).collect();
    assert_eq!(errors.len(), 4, "{report}");
    let whats =
        ["the depth map is 6x8 and its photo 8x6", "1.png", "cannot read the file", "`shape` = [12]: is no depth map"];
    for (i, (error, what)) in errors.iter().zip(whats).enumerate() {
        assert!(error.contains(what) && error.contains(&format!("frame `images/{i:03}.png`")), "{error}");
    }
}

#[test]
fn maps_full_of_holes_are_told() {
    let dataset = Dataset::endonerf(3);
    dataset.grey("depth/frame-000001.depth.png", (16, 12), |_, _| 0);
    warns(&dataset, "no depth is known anywhere in frame-000001.color.png");
    for i in [0, 2] {
        dataset.grey(&format!("depth/frame-{i:06}.depth.png"), (16, 12), |x, _| if x < 8 { 40 } else { 0 });
    }
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let depth = report.depth.unwrap();
    assert_eq!((depth.maps, depth.range), (3, Some([40.0, 40.0])));
    assert!((depth.holes - 2.0 / 3.0).abs() < 1e-12);
    assert!(report.to_string().contains("66.7 % of the pixels not known"), "{report}");
}

#[test]
fn distances_along_rays_become_depths() {
    let dataset = Dataset::nerfies();
    let scene = plain(&dataset);
    let mut frame = scene.frames[0].clone();
    frame.depth = Some(DepthSource {
        meaning: DepthMeaning::Distance,
        ..DepthSource::file(dataset.write("d.npy", npy(&[6, 8], &[2.0; 48])))
    });
    let map = frame.read_depth().unwrap().unwrap();
    for (i, z) in map.z.iter().enumerate() {
        let pixel = glam::DVec2::new((i % 8) as f64 + 0.5, (i / 8) as f64 + 0.5);
        let point = frame.camera.ray(pixel).map(|ray| ray.o + ray.d * 2.0).unwrap();
        assert!((f64::from(*z) - frame.camera.pose.to_camera(point).z).abs() < 1e-6);
    }
}

#[test]
fn other_dialects_are_named_where_nothing_is_found() {
    let dataset = Dataset::new();
    dataset.write("README", "");
    let error = load(dataset.path(), &LoadOptions::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Layout);
    refused(&dataset, &["precomputed.json (nr-nerf)", "dataset.json with camera/ (nerfies)", "(endonerf)"]);
    for name in ["nr-nerf", "nerfies", "endonerf"] {
        let dialect: Dialect = name.parse().unwrap();
        assert_eq!(dialect.name(), name);
        let options = LoadOptions { dialect: Some(dialect), ..LoadOptions::default() };
        refused_with(&dataset, &options, &[&format!("holds no {name} dataset")]);
    }
}
