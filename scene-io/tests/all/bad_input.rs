//! Spoiled datasets: each gives one clear line that names the file, the place, the value and what to do.

use crate::common::{Dataset, colmap_binary, gradient, ngp_frame, ngp_json, poses_bounds};
use scene_io::{
    Depth, DepthPlace, ErrorKind, Holdout, ImageStore, LoadOptions, MaskPolarity, MissingImages, SceneError, Severity,
    Split, StoreOptions, check, load,
};

fn refused(dataset: &Dataset, options: &LoadOptions) -> SceneError {
    load(dataset.path(), options).expect_err("the dataset is spoiled")
}

/// The message is one line and holds all parts.
#[track_caller]
fn says(error: &SceneError, parts: &[&str]) {
    let text = error.to_string();
    assert!(!text.contains('\n'), "more than one line: {text}");
    for part in parts {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
}

#[track_caller]
fn ngp_says(edit: (&str, &str), parts: &[&str]) {
    let dataset = Dataset::ngp(3);
    dataset.edit("transforms.json", edit.0, edit.1);
    let error = refused(&dataset, &LoadOptions::default());
    says(&error, &["transforms.json"]);
    says(&error, parts);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Headers);
    assert!(!report.can_train() && report.to_string().ends_with("cannot be trained"));
}

#[test]
fn the_unspoiled_scene_loads() {
    let scene = load(Dataset::ngp(3).path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert_eq!(scene.frames[1].name, "images/001.png");
    assert_eq!(scene.held_out_names(), ["images/000.png"]);
}

#[test]
fn nan_poses_are_named_to_the_entry() {
    for token in ["NaN", "Infinity", "-Infinity", "nan"] {
        ngp_says(
            ("1.5]", &format!("{token}]")),
            &[
                "frame `images/001.png`",
                &format!("`frames[1].transform_matrix[0][3]` = {token}"),
                "not a finite number",
            ],
        );
    }
}

#[test]
fn impossible_rotations_are_refused() {
    let row = "[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]";
    ngp_says((row, "[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]"), &["images/000.png", "singular", "remove the frame"]);
    ngp_says((row, "[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]"), &["left-handed", "determinant -1"]);
    ngp_says((row, "[0.0, 1.0, 0.3, 0.0], [0.0, 0.0, 1.0, 0.0]"), &["not a rotation"]);
    ngp_says(("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 0.1, 1.0]"), &["last row"]);
    ngp_says(("[0.0, 0.0, 0.0, 1.0]", "[0.0, 0.0, 1.0]"), &["`frames[0].transform_matrix`", "not a 4x4"]);
}

#[test]
fn impossible_intrinsics_are_refused() {
    ngp_says(("\"fl_x\": 10.0", "\"fl_x\": 0"), &["`fl_x` = 0", "focal length must be above 0"]);
    ngp_says(("\"fl_x\": 10.0", "\"fl_x\": \"wide\""), &["`fl_x` = \"wide\"", "not a number"]);
    ngp_says(("\"fl_x\": 10.0", "\"fl_x\": NaN"), &["`fl_x`", "not a finite number"]);
    ngp_says(("\"fl_x\": 10.0, \"fl_y\": 11.0", "\"f\": 10.0"), &["neither `fl_x` nor `camera_angle_x`"]);
    ngp_says(("\"fl_x\": 10.0, \"fl_y\": 11.0", "\"camera_angle_x\": 45"), &["`camera_angle_x` = 45", "radians"]);
    ngp_says(("\"w\": 8", "\"w\": 0"), &["`w` = 0", "image size"]);
    ngp_says(
        ("\"w\": 8,", "\"camera_model\": \"PANORAMA\", \"w\": 8,"),
        &["`camera_model` = \"PANORAMA\"", "unknown", "OPENCV"],
    );
    ngp_says(("\"w\": 8,", "\"latlong\": true, \"w\": 8,"), &["`latlong`", "not supported"]);
}

#[test]
fn paths_stay_inside_and_names_are_unique() {
    ngp_says(
        ("./images/001.png", "../images/001.png"),
        &["`frames[1].file_path`", "leads out of the dataset's folder"],
    );
    ngp_says(("./images/001.png", "images/000.png"), &["frame `images/000.png`", "listed twice", "`frames[0]`"]);
}

#[test]
fn broken_json_names_line_and_column() {
    let dataset = Dataset::ngp(2);
    dataset.write("transforms.json", "{\n  \"frames\": [,]\n}");
    says(&refused(&dataset, &LoadOptions::default()), &["transforms.json:2:14", "not valid JSON"]);
    let whole = ngp_json(2, "");
    dataset.write("transforms.json", &whole[..whole.len() / 2]);
    says(&refused(&dataset, &LoadOptions::default()), &["cut off"]);
    dataset.write("transforms.json", "");
    says(&refused(&dataset, &LoadOptions::default()), &["the file is empty"]);
    dataset.write("transforms.json", "[1, 2]");
    says(&refused(&dataset, &LoadOptions::default()), &["no JSON object"]);
    dataset.write("transforms.json", b"{\"a\": \"\xff\"}");
    says(&refused(&dataset, &LoadOptions::default()), &["byte 7", "not UTF-8"]);
    // A byte-order mark and Windows line ends are fine.
    dataset.write("transforms.json", format!("\u{feff}{}", whole.replace('\n', "\r\n")));
    assert_eq!(load(dataset.path(), &LoadOptions::default()).unwrap().frames.len(), 2);
}

#[test]
fn missing_images_are_skipped_or_refused() {
    let dataset = Dataset::ngp(4);
    std::fs::remove_file(dataset.path().join("images/002.png")).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert!(scene.notes.iter().any(|n| n == "1 of 4 listed images are not there and were skipped: images/002.png"));
    let strict = LoadOptions::default().with_missing_images(MissingImages::Refuse);
    says(&refused(&dataset, &strict), &["frame `images/002.png`", "the image is not there", "add the file"]);
    // Nerfstudio refuses by itself.
    dataset.edit("transforms.json", "\"aabb_scale\": 1", "\"camera_model\": \"OPENCV\"");
    says(&refused(&dataset, &LoadOptions::default()), &["images/002.png", "the image is not there"]);
    // None left is an empty split.
    let none = Dataset::ngp(2);
    std::fs::remove_dir_all(none.path().join("images")).unwrap();
    let error = refused(&none, &LoadOptions::default());
    assert_eq!(error.kind(), ErrorKind::Split);
    says(&error, &["no frames are left to train on (0 frames: 0 train, 0 test)"]);
}

#[test]
fn unreadable_images_name_the_file() {
    let dataset = Dataset::ngp(3);
    dataset.write("images/001.png", "");
    let error = refused(&dataset, &LoadOptions::default());
    assert_eq!(error.kind(), ErrorKind::Image);
    says(&error, &["images/001.png", "frame `images/001.png`", "0 bytes", "copy the file again"]);
    dataset.write("images/001.png", "this is not an image");
    says(&refused(&dataset, &LoadOptions::default()), &["images/001.png"]);
}

#[test]
fn truncated_images_are_noticed_when_decoded() {
    for extension in ["png", "jpg"] {
        let dataset = Dataset::ngp(3);
        let name = format!("images/001.{extension}");
        std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
        let file = dataset.image(&name, 8, 6);
        let bytes = std::fs::read(&file).unwrap();
        dataset.write(&name, &bytes[..bytes.len() - 20]);
        let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
        let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
        assert!(store.get(0).is_ok());
        let error = store.get(1).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Image);
        says(&error, &[&name, "cut off", "frame `images/001.png`", "copy the file again"]);
        let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
        assert!(!report.can_train(), "{report}");
        assert_eq!(report.problems.iter().filter(|p| p.severity == Severity::Error).count(), 1);
    }
}

#[test]
fn wrong_sizes_are_refused_and_uniform_scales_followed() {
    let dataset = Dataset::ngp(3);
    dataset.image("images/001.png", 8, 8);
    says(&refused(&dataset, &LoadOptions::default()), &["the image is 8x8 and its camera says 8x6"]);
    dataset.image("images/001.png", 16, 12);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let camera = scene.frames[1].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.cy), (16, 12, 20.0, 6.0));
    assert!(scene.notes.iter().any(|n| n.contains("cameras scaled to the images (8x6 listed, 16x12 found)")));
}

#[test]
fn splits_that_leave_nothing_are_refused() {
    let dataset = Dataset::ngp(1);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames[0].split, Split::Train);
    assert!(scene.notes.iter().any(|n| n.contains("single image")));
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train() && report.problems.iter().any(|p| p.what.contains("no parallax")), "{report}");
    let every = LoadOptions::default().with_holdout(Holdout::Every(8));
    says(&refused(&dataset, &every), &["no frames are left to train on (1 frames: 0 train, 1 test)"]);

    let blender = Dataset::new();
    blender.image("train/r_0.png", 4, 4);
    let file = |frames: &str| format!(r#"{{"camera_angle_x": 0.7, "frames": [{frames}]}}"#);
    let frame = ngp_frame(0).replace("./images/000.png", "./train/r_0");
    blender.write("transforms_train.json", file(&frame));
    blender.write("transforms_test.json", file(""));
    says(&refused(&blender, &LoadOptions::default()), &["transforms_test.json", "`frames`", "lists no test frames"]);
    blender.write("transforms_train.json", file(""));
    says(&refused(&blender, &LoadOptions::default()), &["transforms_train.json", "lists no train frames"]);
}

#[test]
fn cameras_in_one_place_are_flagged() {
    let dataset = Dataset::ngp(4);
    for i in 1..4 {
        dataset.edit("transforms.json", &format!(", {i}.5]"), ", 0.5]");
    }
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    assert!(report.problems.iter().any(|p| p.what.contains("same place: no parallax")), "{report}");
    assert!(report.can_train());
}

#[test]
fn check_lists_every_problem_at_once() {
    let dataset = Dataset::ngp(5);
    dataset.edit("transforms.json", "1.5]", "NaN]");
    dataset.write("images/002.png", "");
    dataset.image("images/003.png", 5, 5);
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    let frames: Vec<_> = report.problems.iter().filter_map(|p| p.frame.as_deref()).collect();
    assert_eq!(frames, ["images/001.png", "images/002.png", "images/003.png"]);
    says(&refused(&dataset, &LoadOptions::default()), &["images/001.png", "and 2 more problems"]);
}

#[test]
fn sixteen_bit_grey_and_palette_images_become_rgb() {
    let dataset = Dataset::ngp(5);
    image::ImageBuffer::from_fn(8, 6, |x, _| image::Rgb([(x * 8000 + 100) as u16, 65535, 0]))
        .save(dataset.path().join("images/000.png"))
        .unwrap();
    image::GrayImage::from_fn(8, 6, |x, y| image::Luma([(x * 10 + y) as u8]))
        .save(dataset.path().join("images/001.png"))
        .unwrap();
    image::ImageBuffer::from_fn(8, 6, |x, _| image::LumaA([(x * 30) as u8, 128_u8]))
        .save(dataset.path().join("images/002.png"))
        .unwrap();
    image::ImageBuffer::from_pixel(8, 6, image::Luma([32768_u16])).save(dataset.path().join("images/003.png")).unwrap();
    write_palette(&dataset.path().join("images/004.png"));
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    let images: Vec<_> = (0..5).map(|i| store.get(i).unwrap()).collect();
    assert_eq!(images.iter().map(|i| i.channels).collect::<Vec<_>>(), [3, 3, 4, 3, 3]);
    // 8 bits are 16 bits / 257, rounded: (3 * 8000 + 100) / 257 = 93.77.
    assert_eq!(images[0].pixel(3, 2), [94, 255, 0]);
    assert_eq!(images[1].pixel(3, 2), [32, 32, 32]);
    assert_eq!(images[2].pixel(3, 2), [90, 90, 90, 128]);
    assert_eq!(images[3].pixel(3, 2), [128, 128, 128]);
    assert_eq!(images[4].pixel(3, 2), [200, 100, 50]);
    assert_eq!(images[4].pixel(4, 2), [1, 2, 3]);
    let bytes: u64 = images.iter().map(|i| i.bytes()).sum();
    assert_eq!(store.estimate_bytes(), bytes);
}

/// 8x6 with two colours, left and right.
fn write_palette(path: &std::path::Path) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), 8, 6);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::One);
    encoder.set_palette(vec![200, 100, 50, 1, 2, 3]);
    encoder.write_header().unwrap().write_image_data(&[0x0f; 6]).unwrap();
}

#[test]
fn hdr_images_name_the_pixel_that_is_not_finite() {
    let dataset = Dataset::ngp(2);
    std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
    let mut pixels = image::Rgb32FImage::from_pixel(8, 6, image::Rgb([0.5, 2.0, -1.0]));
    let file = dataset.path().join("images/001.exr");
    pixels.save(&file).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let get = || ImageStore::new(&scene.frames, StoreOptions::default()).unwrap().get(1);
    // sRGB(0.5) = 0.7354; beyond [0, 1] is clipped.
    assert_eq!(get().unwrap().pixel(0, 0), [188, 255, 0]);
    pixels.put_pixel(5, 3, image::Rgb([0.5, f32::NAN, 0.0]));
    pixels.save(&file).unwrap();
    says(&get().unwrap_err(), &["001.exr", "`G` = NaN", "pixel (column 5, row 3)", "ignore mask"]);
    // Under a mask it does not matter.
    let mut mask = image::GrayImage::from_pixel(8, 6, image::Luma([255]));
    mask.put_pixel(5, 3, image::Luma([0]));
    let mask_file = dataset.file("masks/001.png");
    mask.save(&mask_file).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let image = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap().get(1).unwrap();
    assert!(!image.is_used(5, 3) && image.is_used(4, 3));
}

#[test]
fn masks_are_matched_scaled_and_turned_round() {
    let dataset = Dataset::ngp(2);
    let mask = image::GrayImage::from_fn(8, 6, |x, _| image::Luma([if x < 4 { 140 } else { 100 }]));
    let file = dataset.file("masks/001.jpg");
    mask.save(&file).unwrap();
    let options = StoreOptions::default().with_longest_side(4);
    for (polarity, used) in [(MaskPolarity::WhiteIsUsed, [true, false]), (MaskPolarity::WhiteIsIgnored, [false, true])]
    {
        let load_options = LoadOptions::default().with_mask_polarity(polarity);
        let scene = load(dataset.path(), &load_options).unwrap();
        assert_eq!(scene.frames[0].mask, None);
        let store = ImageStore::new(&scene.frames, options).unwrap();
        assert_eq!(store.estimate_bytes(), 2 * 4 * 3 * 3 + 4 * 3);
        let image = store.get(1).unwrap();
        assert_eq!([image.is_used(0, 0), image.is_used(3, 0)], used);
    }
    // What cuts out an object is alpha, and colours around it stay out of its rim.
    let load_options = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsObject);
    let scene = load(dataset.path(), &load_options).unwrap();
    assert!(scene.notes.iter().any(|n| n.contains("1 of 2 frames have an object mask")));
    let store = ImageStore::new(&scene.frames, options).unwrap();
    assert_eq!(store.estimate_bytes(), 4 * 3 * 3 + 4 * 3 * 4);
    assert_eq!([store.is_cut_out(0), store.is_cut_out(1)], [false, true]);
    let image = store.get(1).unwrap();
    assert_eq!((image.channels, image.mask.as_ref(), image.bytes()), (4, None, 48));
    assert_eq!([0, 1, 2, 3].map(|x| image.pixel(x, 1)[3]), [255, 255, 0, 0]);
    let narrow = ImageStore::new(&scene.frames, options.with_longest_side(3)).unwrap();
    let image = narrow.get(1).unwrap();
    assert_eq!([0, 1, 2].map(|x| image.pixel(x, 0)[3]), [255, 128, 0]);

    image::GrayImage::new(3, 6).save(&file).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let error = ImageStore::new(&scene.frames, options).unwrap().get(1).unwrap_err();
    says(&error, &["masks/001.jpg", "the mask is 3x6 and its image 8x6"]);
}

#[test]
fn stores_keep_to_their_budget_and_do_not_depend_on_it() {
    let dataset = Dataset::ngp(6);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let store =
        |budget_bytes| ImageStore::new(&scene.frames, StoreOptions::default().with_budget_bytes(budget_bytes)).unwrap();
    let (all, two, none) = (store(u64::MAX), store(2 * 8 * 6 * 3), store(0));
    for i in [0, 1, 2, 1, 5, 0, 1, 4, 3, 0] {
        let want = all.get(i).unwrap();
        assert_eq!(two.get(i).unwrap(), want);
        assert_eq!(none.get(i).unwrap(), want);
    }
    // Kept images are the same allocation; dropped ones are not.
    assert!(std::sync::Arc::ptr_eq(&all.get(0).unwrap(), &all.get(0).unwrap()));
    assert!(std::sync::Arc::ptr_eq(&two.get(3).unwrap(), &two.get(3).unwrap()));
    let first = two.get(0).unwrap();
    for i in [1, 2] {
        two.get(i).unwrap();
    }
    assert!(!std::sync::Arc::ptr_eq(&first, &two.get(0).unwrap()));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| (0..60).for_each(|i| assert_eq!(two.get(i % 6).unwrap(), all.get(i % 6).unwrap())));
        }
    });
}

#[test]
fn colmap_problems_name_byte_or_line() {
    let dataset = Dataset::new();
    for name in ["images/a.png", "images/b.png"] {
        dataset.image(name, 8, 6);
    }
    let [cameras, images, points] = colmap_binary(&["b.png", "a.png"]);
    dataset.write("sparse/0/points3D.bin", &points);
    dataset.write("sparse/0/images.bin", &images);
    dataset.write("sparse/0/cameras.bin", &cameras);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["a.png", "b.png"]);
    assert_eq!(scene.frames[0].camera.pose.c, glam::DVec3::X);
    // 11 points at z 2 to 12: percentiles 0.1 and 99.9.
    let [near, far] = scene.frames[0].z_bounds.unwrap();
    assert!((near - 2.01).abs() < 1e-12 && (far - 11.99).abs() < 1e-12);

    let patched = |bytes: &[u8], at: usize, with: &[u8]| {
        let mut bytes = bytes.to_vec();
        bytes[at..at + with.len()].copy_from_slice(with);
        bytes
    };
    dataset.write("sparse/0/cameras.bin", patched(&cameras, 12, &11_i32.to_le_bytes()));
    says(
        &refused(&dataset, &LoadOptions::default()),
        &[
            "cameras.bin: byte 8",
            "`camera 7: model_id` = 11 (RAD_TAN_THIN_PRISM_FISHEYE)",
            "unknown camera model",
            "THIN_PRISM_FISHEYE",
        ],
    );
    dataset.write("sparse/0/cameras.bin", patched(&cameras, 32, &0_f64.to_le_bytes()));
    says(&refused(&dataset, &LoadOptions::default()), &["`camera 7: fx` = 0", "focal length must be above 0"]);
    dataset.write("sparse/0/cameras.bin", patched(&cameras, 0, &u64::MAX.to_le_bytes()));
    says(
        &refused(&dataset, &LoadOptions::default()),
        &["byte 0", "lists 18446744073709551615 cameras", "no more than 2"],
    );
    dataset.write("sparse/0/cameras.bin", &cameras);
    dataset.write("sparse/0/images.bin", patched(&images, 12, &f64::NAN.to_le_bytes()));
    says(
        &refused(&dataset, &LoadOptions::default()),
        &["images.bin: byte 8", "frame `b.png`", "`QW QX QY QZ`", "not finite"],
    );
    dataset.write("sparse/0/images.bin", patched(&images, 12, &0_f64.to_le_bytes()));
    says(&refused(&dataset, &LoadOptions::default()), &["frame `b.png`", "singular"]);
    dataset.write("sparse/0/images.bin", &images[..images.len() - 1]);
    says(&refused(&dataset, &LoadOptions::default()), &["images.bin: byte", "copy the model again"]);

    std::fs::remove_file(dataset.path().join("sparse/0/cameras.bin")).unwrap();
    dataset.write("sparse/0/images.bin", &images);
    dataset.write("sparse/0/cameras.txt", "# comment\r\n7 SIMPLE_RADIAL 8 6 -nan(ind) 4 3 0\r\n");
    says(&refused(&dataset, &LoadOptions::default()), &["cameras.txt:2", "`PARAMS` = -nan(ind)", "not a number"]);
    dataset.write("sparse/0/cameras.txt", "7 HOLOGRAM 8 6 10 4 3 0\n");
    says(
        &refused(&dataset, &LoadOptions::default()),
        &["cameras.txt:1", "`camera 7: MODEL` = HOLOGRAM", "unknown camera model"],
    );
    dataset.write("sparse/0/cameras.txt", "7 PINHOLE 8 6 10\n");
    says(&refused(&dataset, &LoadOptions::default()), &["PINHOLE with 1 parameters"]);
    dataset.write("sparse/0/cameras.txt", "1 PINHOLE 8 6 10 10 4 3\n");
    says(&refused(&dataset, &LoadOptions::default()), &["frame `a.png`", "its camera 7 is not in"]);
}

#[test]
fn text_models_keep_empty_lines_and_names_with_blanks() {
    let dataset = Dataset::new();
    dataset.image("images/a b.png", 8, 6);
    dataset.image("images/c.png", 8, 6);
    dataset.write("sparse/cameras.txt", "1 PINHOLE 8 6 10 10 4 3\n");
    dataset.write("sparse/images.txt", "# x\n2 1 0 0 0 0 0 0 1 a b.png\n\n5 1 0 0 0 -1 0 0 1 c.png\n1 2 -1 3 4 9\n");
    dataset.write("sparse/points3D.txt", "9 0 0 3 1 2 3 0.1 5 1\n");
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["a b.png", "c.png"]);
    assert_eq!(scene.points.len(), 1);
    for path in ["sparse", "sparse/images.txt"] {
        assert_eq!(load(&dataset.path().join(path), &LoadOptions::default()).unwrap().root, dataset.path());
    }
}

#[test]
fn the_model_with_most_images_is_taken() {
    let dataset = Dataset::new();
    for name in ["images/a.png", "images/b.png", "images/c.png"] {
        dataset.image(name, 8, 6);
    }
    for (folder, names) in [("0", &["a.png"][..]), ("1", &["a.png", "b.png", "c.png"]), ("2", &["a.png", "b.png"])] {
        let [cameras, images, points] = colmap_binary(names);
        dataset.write(&format!("sparse/{folder}/cameras.bin"), cameras);
        dataset.write(&format!("sparse/{folder}/images.bin"), images);
        dataset.write(&format!("sparse/{folder}/points3D.bin"), points);
    }
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.frames.len(), 3);
    assert!(scene.notes.iter().any(|n| n.contains("models with fewer images, not used")));
}

#[test]
fn llff_problems_name_row_and_column() {
    let dataset = Dataset::new();
    for name in ["images_2/a.png", "images_2/b.png", "images_2/c.png"] {
        dataset.image(name, 8, 6);
    }
    let good = poses_bounds(3);
    dataset.write("poses_bounds.npy", &good);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    let camera = scene.frames[1].camera;
    assert_eq!((camera.width, camera.height, camera.fx, camera.cx), (8, 6, 10.0, 4.0));
    assert_eq!(camera.optical_axis(), glam::DVec3::NEG_Z);
    let start = good.len() - 3 * 17 * 8;
    let spoiled = |row: usize, column: usize, value: f64| {
        let mut bytes = good.clone();
        let at = start + (row * 17 + column) * 8;
        bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
        dataset.write("poses_bounds.npy", bytes);
        refused(&dataset, &LoadOptions::default())
    };
    says(&spoiled(1, 8, f64::NAN), &["poses_bounds.npy", "frame `b.png`", "`[1, 8]` = NaN", "not a finite number"]);
    says(&spoiled(2, 14, 0.0), &["`[2, 14]` = 0", "focal length must be above 0"]);
    says(&spoiled(0, 4, 11.5), &["`[0, 4]` = 11.5", "not an image size"]);
    says(&spoiled(0, 12, 0.0), &["singular"]);
    says(&spoiled(0, 16, f64::INFINITY), &["`[0, 16]` = inf", "not a finite depth"]);
    dataset.write("poses_bounds.npy", poses_bounds(4));
    says(&refused(&dataset, &LoadOptions::default()), &["holds 4 poses", "holds 3 images"]);
    // The smallest folder that has the wanted size; without a wish, the largest.
    dataset.write("poses_bounds.npy", &good);
    for name in ["images/a.png", "images/b.png", "images/c.png"] {
        dataset.image(name, 16, 12);
    }
    let width =
        |side| load(dataset.path(), &LoadOptions::default().with_longest_side(side)).unwrap().frames[0].camera.width;
    assert_eq!([width(None), width(Some(16)), width(Some(9)), width(Some(8)), width(Some(100))], [16, 16, 16, 8, 16]);
}

#[test]
fn nerfstudio_fields_are_read() {
    let dataset = Dataset::new();
    for i in 0..4 {
        dataset.image(&format!("images/{i:03}.png"), 8, 6);
    }
    gradient(8, 6).save(dataset.file("other/m.png")).unwrap();
    dataset.write("points.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n");
    let more = r#""camera_model": "OPENCV_FISHEYE", "k1": 0.1, "k4": -0.01, "applied_scale": 2.0, "ply_file_path": "points.ply",
        "applied_transform": [[1,0,0,0],[0,0,1,0],[0,-1,0,0]], "orientation_override": "up",
        "train_filenames": ["images/001.png", "images/002.png"], "test_filenames": ["./images/000.png"],"#;
    let json = ngp_json(4, more).replace("\"aabb_scale\": 1,", "").replacen(
        "\"file_path\": \"./images/001.png\",",
        "\"file_path\": \"./images/001.png\", \"fl_x\": 99, \"mask_path\": \"other/m.png\", \"depth_file_path\": \"d/1.png\",",
        1,
    );
    dataset.write("transforms.json", &json);
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert_eq!(scene.dialect.name(), "nerfstudio");
    let splits: Vec<_> = scene.frames.iter().map(|f| f.split).collect();
    assert_eq!(splits, [Split::Test, Split::Train, Split::Train, Split::Unused]);
    let frame = &scene.frames[1];
    assert_eq!((frame.camera.fx, frame.camera.fy), (99.0, 11.0));
    assert_eq!(frame.camera.lens, render_core::camera::Lens::Fisheye { k: [0.1, 0.0, 0.0, -0.01] });
    assert_eq!(frame.mask.as_deref(), Some(dataset.path().join("other/m.png").as_path()));
    let depth = frame.depth.as_ref().map(|depth| &depth.place);
    assert!(matches!(depth, Some(DepthPlace::File(path)) if *path == dataset.path().join("d/1.png")), "{depth:?}");
    assert_eq!(scene.points.len(), 1);
    dataset.edit("transforms.json", "[\"images/001.png\"", "[\"images/009.png\"");
    says(&refused(&dataset, &LoadOptions::default()), &["`train_filenames` = images/009.png", "names no frame"]);
}

#[test]
fn fingerprints_follow_cameras_and_splits() {
    let dataset = Dataset::ngp(4);
    let fingerprint = |options: &LoadOptions| load(dataset.path(), options).unwrap().fingerprint();
    let first = fingerprint(&LoadOptions::default());
    assert_eq!(first.len(), 64);
    assert_eq!(first, fingerprint(&LoadOptions::default()));
    let other_split = LoadOptions::default().with_holdout(Holdout::Every(2));
    assert_ne!(first, fingerprint(&other_split));
    dataset.edit("transforms.json", "1.5]", "1.5000001]");
    assert_ne!(first, fingerprint(&LoadOptions::default()));
}

#[test]
fn holdout_words_are_parsed() {
    assert_eq!(Holdout::parse("every:8").unwrap(), Holdout::Every(8));
    assert_eq!(Holdout::parse("none").unwrap(), Holdout::None);
    let dataset = Dataset::new();
    let list = dataset.write("held.txt", "# views\r\ntest/r_0\r\n\r\n  test/r_24\n");
    let names = Holdout::parse(&format!("names:{}", list.display())).unwrap();
    assert_eq!(names, Holdout::Names(vec!["test/r_0".into(), "test/r_24".into()]));
    for (text, part) in
        [("every:0", "none"), ("every:x", "whole number"), ("all", "not a way"), ("names:", "not a way")]
    {
        says(&Holdout::parse(text).unwrap_err(), &["--holdout", text, part, "every:8"]);
    }
    says(&Holdout::parse("names:/nowhere/x").unwrap_err(), &["/nowhere/x", "check the path"]);
}

#[test]
fn numbers_that_no_camera_can_have_are_refused_with_field_and_value() {
    for (from, to, part) in [
        ("\"cx\": 4.0", "\"cx\": 1e308", "`frames[0]: cx` = 1e308"),
        ("\"cy\": 3.0", "\"cy\": -1e300", "`frames[0]: cy` = -1e300"),
        ("\"fl_x\": 10.0", "\"fl_x\": 1e-300", "`frames[0]: fx` = 1e-300"),
        ("\"fl_y\": 11.0", "\"k2\": 1e100, \"fl_y\": 11.0", "`frames[0]: k2` = 1e100"),
        ("1.5]", "1e200]", "`frames[1]: centre x` = 1e200"),
    ] {
        ngp_says((from, to), &[part, "no camera can have this", "expected"]);
    }
    ngp_says(("\"aabb_scale\": 1", "\"aabb_scale\": 1e300"), &["`aabb_scale` = 1e+300", "outside of any scene"]);
}

#[test]
fn line_ends_and_escapes_in_names_stay_on_one_line() {
    let dataset = Dataset::ngp(3);
    dataset.edit("transforms.json", "./images/001.png", "./images/a\\n\\u001b[2J\\u2028b.png");
    let options = LoadOptions::default().with_missing_images(MissingImages::Refuse);
    let text = refused(&dataset, &options).to_string();
    assert!(text.contains(r"frame `images/a\n\u{1b}[2J\u{2028}b.png`"), "{text}");
    // Skipped ones are named in a note.
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert!(scene.notes.iter().any(|note| note.contains(r"a\n\u{1b}[2J")), "{:?}", scene.notes);
    assert!(scene.notes.iter().all(|note| !note.contains(char::is_control)));
}
