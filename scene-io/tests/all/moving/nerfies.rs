//! Nerfies, HyperNeRF, DyCheck: a folder of small files.

use super::*;

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
    // Alpha is not an opacity here, but says which pixels may be used.
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    let image = store.get(0).unwrap();
    assert_eq!((image.channels, image.is_used(3, 2), image.is_used(4, 2)), (3, true, false));
    assert_eq!(store.bytes(0), image.bytes());
    let half = ImageStore::new(&scene.frames, StoreOptions::default().with_longest_side(4)).unwrap();
    assert!(half.get(0).unwrap().is_used(1, 1) && !half.get(0).unwrap().is_used(2, 1));
    let depth = scene.frames[0].read_depth().unwrap().unwrap();
    assert_eq!((depth.width, depth.height, depth.holes(), depth.z[1]), (8, 6, 24, 1.51));
    assert!(scene.frames[3].depth.is_none());
    assert_eq!(scene.frames[3].read_covisible().unwrap().unwrap().count(), 12, "zeros and ones are black and white");
    assert!(scene.frames[0].truth.covisible.is_none());
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
    // Several photos of one time: a rig.
    let dataset = Dataset::nerfies();
    dataset.edit("metadata.json", "\"warp_id\": 1", "\"warp_id\": 2");
    let scene = plain(&dataset);
    assert_eq!(times(&scene), [0.0, 0.5, 1.0, 0.5, 0.75]);
    notes(&scene, &["says otherwise than metadata.json about 1 frames, first 1_00001"]);
    // Any number will do for an appearance; without one each time step has its own.
    dataset.edit("metadata.json", "\"appearance_id\": 3", "\"appearance_id\": 4294967295");
    dataset.edit("metadata.json", "\"appearance_id\": 4, ", "");
    let appearances: Vec<u32> = plain(&dataset).frames.iter().map(|frame| frame.ids.unwrap().appearance).collect();
    assert_eq!(appearances, [0, 2, 4, 1, u32::MAX]);
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
    spoiled(camera, "[0.01, 0.002, 0.0]", "[0.01]", &["`radial_distortion`", "not a list of 3 coefficients"]);
    spoiled(camera, "\"position\"", "\"place\"", &["`position`", "is missing"]);
    spoiled(
        "metadata.json",
        "\"0_00002\"",
        "\"0_00009\"",
        &["metadata.json", "frame `0_00002`", "the frame is not in it"],
    );
    spoiled("metadata.json", "\"warp_id\": 2", "\"warp_id\": -2", &["`0_00002.warp_id` = -2", "not a whole number"]);
    spoiled("metadata.json", "\"warp_id\": 2", "\"wrap_id\": 2", &["frame `0_00002`", "warp_id", "is missing"]);
    for number in ["-2", "2.5", "4294967296"] {
        let wrong = format!("\"appearance_id\": {number}");
        let said = format!("`0_00002.appearance_id` = {number}");
        let parts = ["frame `0_00002`", said.as_str(), "not a whole number from 0"];
        spoiled("metadata.json", "\"appearance_id\": 2", wrong.as_str(), &parts);
    }
    spoiled("splits/train.json", "0, 2, 4", "0, 2", &["train.json", "`time_ids`", "2 numbers for 3 frames"]);
    spoiled("splits/train.json", "\"0_00000\"", "\"../0_00000\"", &["is not the name of a frame"]);
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
    let width =
        |side| load(dataset.path(), &LoadOptions::default().with_longest_side(side)).unwrap().frames[0].camera.width;
    assert_eq!([width(None), width(Some(20)), width(Some(16)), width(Some(9)), width(Some(8))], [16, 16, 16, 16, 8]);
}
