//! Files beside the photos: segments, features, truth masks, and what is refused.

use crate::common::{Dataset, colmap_binary};
use scene_io::{
    Depth, ImageStore, LoadOptions, MaskPolarity, Masks, Scene, Segments, Split, StoreOptions, check, load,
    refuse_blank_masks,
};

/// Grey values of an 8x6 picture, saved as 8-bit PNG.
fn grey(dataset: &Dataset, name: &str, value: impl Fn(u32, u32) -> u8) {
    let picture = image::GrayImage::from_fn(8, 6, |x, y| image::Luma([value(x, y)]));
    picture.save(dataset.file(name)).unwrap();
}

/// A PNG of one bit a pixel.
fn one_bit(dataset: &Dataset, name: &str, is_set: impl Fn(u32, u32) -> bool) {
    let mut encoder = png::Encoder::new(std::fs::File::create(dataset.file(name)).unwrap(), 8, 6);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let row = |y| (0..8).fold(0, |byte, x| byte << 1 | u8::from(is_set(x, y)));
    let bytes: Vec<u8> = (0..6).map(row).collect();
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

fn labels(dataset: &Dataset, name: &str, width: u32, height: u32, label: impl Fn(u32, u32) -> u16) {
    let picture = image::ImageBuffer::from_fn(width, height, |x, y| image::Luma([label(x, y)]));
    picture.save(dataset.file(name)).unwrap();
}

fn npy(dataset: &Dataset, name: &str, descr: &str, shape: &str, bytes: &[u8]) {
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    let mut file = b"\x93NUMPY\x01\0".to_vec();
    file.extend((text.len() as u16).to_le_bytes());
    file.extend(text.as_bytes());
    file.extend(bytes);
    dataset.write(name, file);
}

fn scene(dataset: &Dataset) -> Scene {
    load(dataset.path(), &LoadOptions::default()).unwrap()
}

fn problems(dataset: &Dataset) -> String {
    let report = check(dataset.path(), &LoadOptions::default(), Depth::Pixels);
    report.problems.iter().map(|p| format!("{p}\n")).collect()
}

#[test]
fn photos_without_files_have_no_priors() {
    let scene = scene(&Dataset::ngp(3));
    for frame in &scene.frames {
        assert!(frame.priors.is_empty() && frame.truth.transient.is_none() && frame.tracks.is_empty());
        assert_eq!(frame.read_segments().unwrap(), None);
        assert_eq!(frame.read_prompted().unwrap(), None);
        assert_eq!(frame.read_features().unwrap(), None);
        assert_eq!(frame.read_transient().unwrap(), None);
    }
}

#[test]
fn label_maps_keep_all_16_bits_and_come_before_stacks() {
    let dataset = Dataset::ngp(3);
    labels(&dataset, "images/001.segs.png", 8, 6, |x, y| if x < 4 { 0 } else { 65_535 - y as u16 });
    one_bit(&dataset, "images/001.segs/0.png", |_, _| true);
    grey(&dataset, "images/002.segs.png", |x, _| x as u8);
    let scene = scene(&dataset);
    assert!(scene.notes.iter().any(|n| n == "2 of 3 frames have segments"), "{:?}", scene.notes);
    let Some(Segments::Labels(map)) = scene.frames[1].read_segments().unwrap() else { panic!("no label map") };
    assert_eq!((map.width, map.height, map.labels[3], map.labels[4], map.labels[47]), (8, 6, 0, 65_535, 65_530));
    // Nearest: no label that was not there before.
    let small = map.resized(4, 3);
    assert_eq!((small.labels.len(), small.labels[0], small.labels[11]), (12, 0, 65_530));
    let Some(Segments::Labels(map)) = scene.frames[2].read_segments().unwrap() else { panic!("no label map") };
    assert_eq!(map.labels[..8], [0, 1, 2, 3, 4, 5, 6, 7]);
    assert_eq!(problems(&dataset), "");
}

#[test]
fn stacks_may_overlap_and_are_read_in_the_order_of_names() {
    let dataset = Dataset::ngp(2);
    one_bit(&dataset, "images/000.segs/b.png", |x, _| x >= 2);
    one_bit(&dataset, "images/000.segs/a.png", |x, y| x < 4 && y == 0);
    std::fs::create_dir(dataset.path().join("images/001.segs")).unwrap();
    let scene = scene(&dataset);
    let Some(Segments::Stack(stack)) = scene.frames[0].read_segments().unwrap() else { panic!("no stack") };
    assert_eq!(stack.iter().map(scene_io::BitMask::count).collect::<Vec<_>>(), [4, 36]);
    assert!(stack[0].get(3, 0) && stack[1].get(3, 0) && !stack[0].get(4, 0));
    assert_eq!(scene.frames[1].read_segments().unwrap(), Some(Segments::Stack(Vec::new())));
}

#[test]
fn prompted_segments_have_scores_where_a_list_gives_them() {
    let dataset = Dataset::ngp(2);
    for frame in ["000", "001"] {
        one_bit(&dataset, &format!("images/{frame}.points/0.png"), |x, y| x == 1 && y == 2);
        one_bit(&dataset, &format!("images/{frame}.points/1.png"), |_, _| false);
    }
    dataset.write("images/000.points/scores.txt", "# score stability\n0.95 0.97\n0.5\n");
    let scene = scene(&dataset);
    let scored = scene.frames[0].read_prompted().unwrap().unwrap();
    assert_eq!((scored[0].score, scored[0].stability, scored[1].score), (Some(0.95), Some(0.97), Some(0.5)));
    assert!(scored[0].mask.get(1, 2) && scored[0].mask.count() == 1 && scored[1].mask.count() == 0);
    let plain = scene.frames[1].read_prompted().unwrap().unwrap();
    assert!(plain.len() == 2 && plain.iter().all(|s| s.score.is_none() && s.stability.is_none()));

    for (list, said) in [
        (
            "0.9 0.9 0.9\n0.5\n",
            "scores.txt:1: frame `images/000.png`: `score` = 0.9 0.9 0.9: holds more than two numbers",
        ),
        ("0.9\nnan\n", "scores.txt:2: frame `images/000.png`: `score` = nan: is not a finite number"),
        ("0.9\n", "scores.txt: frame `images/000.png`: holds 1 scores for 2 pictures"),
    ] {
        dataset.write("images/000.points/scores.txt", list);
        let error = scene.frames[0].read_prompted().unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn features_are_read_in_both_precisions_and_must_be_finite() {
    let dataset = Dataset::ngp(3);
    let values: Vec<u8> = (0..24).flat_map(|i| (0.5 * i as f32).to_le_bytes()).collect();
    npy(&dataset, "images/000.features.npy", "<f4", "(4, 2, 3)", &values);
    // 1, -2 and 65504 as IEEE halves.
    let halves: Vec<u8> = [0x3c00_u16, 0xc000, 0x7bff].into_iter().flat_map(u16::to_le_bytes).collect();
    npy(&dataset, "images/001.features.npy", "<f2", "(3, 1, 1)", &halves);
    let frames = scene(&dataset).frames;
    let features = frames[0].read_features().unwrap().unwrap();
    assert_eq!((features.channels, features.height, features.width), (4, 2, 3));
    let mut vector = [0.0; 4];
    features.sample(0.5, 0.25, &mut vector);
    assert_eq!(vector, [0.5, 3.5, 6.5, 9.5]);
    assert_eq!(frames[1].read_features().unwrap().unwrap().data, [1.0, -2.0, 65504.0]);

    let mut broken = values.clone();
    broken[4 * 11..4 * 12].copy_from_slice(&f32::NAN.to_le_bytes());
    for (shape, bytes, said) in [
        ("(4, 2, 3)", &broken, "000.features.npy: frame `images/000.png`: `[1][1][2]` = NaN: is not finite"),
        ("(8, 3)", &values, "`shape` = [8, 3]: has not three dimensions"),
        ("(0, 2, 3)", &values, "`shape` = [0, 2, 3]: holds no features"),
        ("(40, 2, 3)", &values, "is cut off"),
    ] {
        npy(&dataset, "images/000.features.npy", "<f4", shape, bytes);
        assert!(problems(&dataset).contains(said), "{}", problems(&dataset));
        assert!(frames[0].read_features().unwrap_err().to_string().contains(said));
    }
}

#[test]
fn files_of_another_shape_are_refused_by_name_and_of_another_size_are_not() {
    let dataset = Dataset::ngp(3);
    labels(&dataset, "images/000.segs.png", 6, 8, |_, _| 1);
    one_bit(&dataset, "images/001.segs/0.png", |_, _| true);
    dataset.image("images/001.segs/1.png", 9, 9);
    labels(&dataset, "images/002.segs.png", 4, 3, |_, _| 1);
    let text = problems(&dataset);
    assert!(text.contains("000.segs.png: frame `images/000.png`: is 6x8 and its photo 8x6"), "{text}");
    assert!(text.contains("001.segs/1.png: frame `images/001.png`: is 9x9 and its photo 8x6"), "{text}");
    assert!(!text.contains("002.segs.png"), "{text}");
    // Colours are not labels.
    dataset.image("images/000.segs.png", 8, 6);
    assert!(problems(&dataset).contains("is not a label map but a picture of Rgb8"), "{}", problems(&dataset));
    dataset.write("images/000.segs.png", b"\x89PNG\r\n\x1a\nbroken");
    assert!(problems(&dataset).contains("the image is broken or cut off"), "{}", problems(&dataset));
}

#[test]
fn masks_beside_photos_ignore_black_and_come_before_the_mask_folder() {
    let dataset = Dataset::ngp(2);
    grey(&dataset, "images/000.mask.png", |x, _| if x < 3 { 127 } else { 128 });
    grey(&dataset, "masks/000.png", |_, _| 0);
    grey(&dataset, "masks/001.png", |x, _| if x == 0 { 255 } else { 0 });
    let scene = scene(&dataset);
    let used = |scene: &Scene, i: usize| {
        let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
        let image = store.get(i).unwrap();
        (0..8).map(|x| image.is_used(x, 0)).collect::<Vec<_>>()
    };
    assert_eq!(used(&scene, 0), [false, false, false, true, true, true, true, true]);
    assert_eq!(used(&scene, 1), [true, false, false, false, false, false, false, false]);
    let options = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsIgnored);
    assert_eq!(used(&load(dataset.path(), &options).unwrap(), 1)[..2], [false, true]);
    let off = LoadOptions::default().with_masks(Masks::Off);
    assert!(load(dataset.path(), &off).unwrap().frames.iter().all(|f| f.mask.is_none()));
}

#[test]
fn masks_that_ignore_more_than_half_of_the_photos_are_refused() {
    let dataset = Dataset::ngp(6);
    let blank = |n: usize| {
        for i in 0..6 {
            // One used pixel is enough.
            grey(&dataset, &format!("images/{i:03}.mask.png"), |x, y| if i > n && x + y == 0 { 255 } else { 0 });
        }
    };
    // Frame 0 is held out: it does not count.
    blank(2);
    let left = refuse_blank_masks(&scene(&dataset).frames).unwrap();
    assert!(left.is_some_and(|share| share > 0.0 && share < 1.0), "{left:?}");
    assert_eq!(problems(&dataset), "");
    blank(3);
    let error = refuse_blank_masks(&scene(&dataset).frames).unwrap_err().to_string();
    assert!(error.contains("001.mask.png: ignores every pixel, and so do the masks of 3 of 5 training"), "{error}");
    assert!(problems(&dataset).contains("3 of 5 training photos"));
    // The other way round nothing is ignored.
    let options = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsIgnored);
    refuse_blank_masks(&load(dataset.path(), &options).unwrap().frames).unwrap();
}

#[test]
fn truth_masks_never_reach_training_and_must_be_there() {
    let dataset = Dataset::ngp(3);
    grey(&dataset, "truth/a.png", |x, _| if x == 2 { 255 } else { 0 });
    let field = r#""file_path": "./images/001.png", "transient_mask_path": "truth/a.png""#;
    dataset.edit("transforms.json", r#""file_path": "./images/001.png""#, field);
    let scene = scene(&dataset);
    let truth = scene.frames[1].read_transient().unwrap().unwrap();
    assert!(truth.count() == 6 && truth.get(2, 5) && scene.frames[1].mask.is_none());
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    assert!(store.get(1).unwrap().mask.is_none());
    dataset.image("truth/a.png", 5, 5);
    assert!(problems(&dataset).contains("a.png: frame `images/001.png`: the truth mask is 5x5 and its photo 8x6"));
    dataset.edit("transforms.json", "truth/a.png", "truth/b.png");
    assert!(problems(&dataset).contains("the truth mask is not there"), "{}", problems(&dataset));
    dataset.edit("transforms.json", "truth/b.png", "../b.png");
    assert!(problems(&dataset).contains("leads out of the dataset's folder"), "{}", problems(&dataset));
}

#[test]
fn pictures_that_belong_to_photos_are_no_photos() {
    let dataset = Dataset::new();
    for name in ["a", "b", "c"] {
        dataset.image(&format!("images/{name}.png"), 16, 12);
    }
    labels(&dataset, "images/a.segs.png", 16, 12, |_, _| 1);
    labels(&dataset, "images/b.mask.png", 16, 12, |_, _| 65_535);
    dataset.write("poses_bounds.npy", crate::common::poses_bounds(3));
    let scene = scene(&dataset);
    let names: Vec<&str> = scene.frames.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(names, ["a.png", "b.png", "c.png"]);
    assert!(scene.frames[0].priors.segments.is_some() && scene.frames[1].mask.is_some());
}

#[test]
fn tracks_count_photos_and_scale_with_the_image() {
    let dataset = Dataset::new();
    let names = ["a.png", "b.png", "c.png"];
    for (i, name) in names.iter().enumerate() {
        // The last one is stored at twice the size its camera says.
        let scale = if i == 2 { 2 } else { 1 };
        dataset.image(&format!("images/{name}"), 8 * scale, 6 * scale);
    }
    for (name, bytes) in ["cameras", "images", "points3D"].iter().zip(colmap_binary(&names)) {
        dataset.write(&format!("sparse/0/{name}.bin"), bytes);
    }
    let scene = scene(&dataset);
    for (i, frame) in scene.frames.iter().enumerate() {
        assert_eq!(frame.tracks.len(), 11, "the twelfth feature has no point");
        for (k, track) in frame.tracks.iter().enumerate() {
            assert_eq!((track.length, track.point), (3, k as u32));
            assert_eq!(track.pixel, if i == 2 { [2.0, 4.0] } else { [1.0, 2.0] });
        }
    }
    // Without points nothing is triangulated.
    std::fs::remove_file(dataset.path().join("sparse/0/points3D.bin")).unwrap();
    let scene = self::scene(&dataset);
    assert!(scene.frames.iter().all(|f| f.tracks.is_empty()) && scene.count(Split::Train) > 0);
}
