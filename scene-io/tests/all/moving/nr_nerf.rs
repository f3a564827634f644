//! NR-NeRF: `precomputed.json` beside the images of a video.

use super::*;

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
        let options = LoadOptions::default().with_holdout(Holdout::parse(word).unwrap());
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
    spoiled("1.5, 12.0]", "1.5]", &["`poses[1]`", "not a list of 3x5 numbers"]);
    spoiled("[1, 0, 0, 1.5", "[0, 0, 0, 1.5", &["frame `image001.png`", "`poses[1]`", "singular"]);
    spoiled("2.5, 12.0", "2.5, 0.5", &["`poses[2][0][4]` = 0.5", "not an image size"]);
    spoiled("[0.1, 2.0], ", "", &["`bds`", "3 depth ranges for 4 poses"]);
    spoiled("[0.1, 2.0]", "[0.1, Infinity]", &["`bds[0][1]` = Infinity", "not a finite number"]);
    spoiled("\"i_test\": 2", "\"i_test\": 4", &["`i_test` = 4", "only 4 frames"]);
    spoiled("\"i_test\": 2", "\"i_test\": -1", &["`i_test` = -1", "not a whole number"]);
    spoiled("\"poses\"", "\"pauses\"", &["`poses`", "is missing"]);
    let dataset = Dataset::nr_nerf(4);
    dataset.remove("images/image003.png");
    refused(&dataset, &["holds 4 poses", "holds 3 images"]);
    dataset.remove("images");
    refused(&dataset, &["holds no folder of images"]);
    let scene = load_cameras(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!((scene.frames.len(), scene.frames[3].time), (4, Some(1.0)));
}
