//! Broken datasets: `train` says in one line what is wrong and where, writes no result, and does not panic.

use crate::tools::{Answer, SMALL, dataset, error_line, nerf, text};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

fn train(scene: &Path, out: &Path) -> Answer {
    let mut words = vec!["train", text(scene), "--out", text(out), "--steps", "1", "--progress", "off"];
    words.extend(SMALL);
    nerf(&words)
}

fn edit(scene: &Path, change: impl FnOnce(&mut Value)) {
    let path = scene.join("transforms_train.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    change(&mut json);
    fs::write(&path, json.to_string()).unwrap();
}

/// The image file of the first training frame.
fn first_image(scene: &Path) -> std::path::PathBuf {
    let mut images: Vec<_> = fs::read_dir(scene.join("train")).unwrap().map(|e| e.unwrap().path()).collect();
    images.sort();
    images.swap_remove(0)
}

/// Break a fresh dataset, train on it: the exit code is 1 and the line holds all `parts`.
fn refused(what: &str, parts: &[&str], spoil: impl FnOnce(&Path)) {
    let (folder, scene) = dataset();
    spoil(&scene);
    let out = folder.path().join("run");
    let answer = train(&scene, &out);
    assert_eq!(answer.code, 1, "{what}: {}{}", answer.out, answer.err);
    let line = error_line(&answer);
    for part in parts {
        assert!(line.contains(part), "{what}: `{part}` is not in: {line}");
    }
    assert!(!out.join("checkpoint").exists(), "{what}");
    // `check` finds the same, and says so by its exit code.
    assert_eq!(nerf(&["check", text(&scene)]).code, 1, "{what}: check");
}

#[test]
fn broken_images_are_named() {
    refused("missing image", &["r_000"], |scene| fs::remove_file(first_image(scene)).unwrap());
    refused("zero bytes", &["r_000"], |scene| fs::write(first_image(scene), b"").unwrap());
    refused("truncated", &["r_000"], |scene| {
        let bytes = fs::read(first_image(scene)).unwrap();
        fs::write(first_image(scene), &bytes[..bytes.len() / 2]).unwrap();
    });
    refused("truncated JPEG", &["photo.jpg"], |scene| {
        let path = scene.join("train/photo.jpg");
        image::RgbImage::from_fn(24, 24, |x, y| image::Rgb([(x * y) as u8, 7, 9])).save(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        edit(scene, |json| json["frames"][0]["file_path"] = json!("./train/photo.jpg"));
    });
}

#[test]
fn impossible_cameras_are_named_with_their_field() {
    let matrix = |rows: [[f64; 4]; 4]| move |json: &mut Value| json["frames"][2]["transform_matrix"] = json!(rows);
    refused("singular rotation", &["transforms_train.json", "transform_matrix"], |scene| {
        edit(scene, matrix([[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]));
    });
    refused("mirrored", &["transforms_train.json", "transform_matrix"], |scene| {
        edit(scene, matrix([[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 4.0], [0.0, 0.0, 0.0, 1.0]]));
    });
    refused("NaN pose", &["transforms_train.json"], |scene| {
        let path = scene.join("transforms_train.json");
        edit(scene, |json| json["frames"][1]["transform_matrix"][0][3] = json!(123_456.25));
        let text = fs::read_to_string(&path).unwrap().replace("123456.25", "NaN");
        fs::write(&path, text).unwrap();
    });
    refused("focal length 0", &["transforms_train.json", "camera_angle_x"], |scene| {
        edit(scene, |json| json["camera_angle_x"] = json!(std::f64::consts::PI));
    });
}

#[test]
fn empty_splits_broken_json_and_empty_folders_are_refused() {
    refused("empty split", &["transforms_train.json"], |scene| edit(scene, |json| json["frames"] = json!([])));
    refused("broken JSON", &["transforms_train.json"], |scene| {
        fs::write(scene.join("transforms_train.json"), b"{\"frames\": [").unwrap();
    });
    refused("empty folder", &["scene"], |scene| {
        fs::remove_dir_all(scene).unwrap();
        fs::create_dir(scene).unwrap();
    });
    refused("no folder", &["scene"], |scene| fs::remove_dir_all(scene).unwrap());
}

#[test]
fn unknown_camera_models_are_listed_by_name() {
    refused("unknown model", &["transforms.json", "HOLOGRAPHIC"], |scene| {
        fs::rename(scene.join("transforms_train.json"), scene.join("transforms.json")).unwrap();
        fs::remove_file(scene.join("transforms_test.json")).unwrap();
        let path = scene.join("transforms.json");
        let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        json["camera_model"] = json!("HOLOGRAPHIC");
        json["fl_x"] = json!(30.0);
        fs::write(&path, json.to_string()).unwrap();
    });
}

#[test]
fn sixteen_bit_grey_and_palette_images_are_read() {
    let (folder, scene) = dataset();
    let mut images: Vec<_> = fs::read_dir(scene.join("train")).unwrap().map(|e| e.unwrap().path()).collect();
    images.sort();
    let rgba = |path: &Path| image::open(path).unwrap();
    let deep = rgba(&images[0]).into_rgba16();
    deep.save(&images[0]).unwrap();
    let grey = rgba(&images[1]).into_luma_alpha8();
    grey.save(&images[1]).unwrap();
    let plain = rgba(&images[2]).into_luma8();
    plain.save(&images[2]).unwrap();
    fs::write(&images[3], palette_png()).unwrap();
    let answer = train(&scene, &folder.path().join("run"));
    assert_eq!(answer.code, 0, "{}", answer.err);
}

/// A 24 x 24 PNG with two palette colours.
fn palette_png() -> Vec<u8> {
    fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
        let mut body = kind.to_vec();
        body.extend(data);
        let crc = body.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
        });
        [(data.len() as u32).to_be_bytes().as_slice(), &body, &(!crc).to_be_bytes()].concat()
    }
    // One byte a pixel behind a filter byte a row, in one stored (not compressed) deflate block.
    let rows: Vec<u8> = (0..24_u8).flat_map(|y| std::iter::once(0).chain((0..24).map(move |x| (x + y) % 2))).collect();
    let (a, b) =
        rows.iter().fold((1_u32, 0_u32), |(a, b), &x| ((a + u32::from(x)) % 65_521, (a + b + u32::from(x)) % 65_521));
    let length = rows.len() as u16;
    let adler = (b << 16 | a).to_be_bytes();
    let zlib = [&[0x78, 0x01, 1][..], &length.to_le_bytes(), &(!length).to_le_bytes(), &rows, &adler].concat();
    let header = [&24_u32.to_be_bytes()[..], &24_u32.to_be_bytes(), &[8, 3, 0, 0, 0]].concat();
    [
        b"\x89PNG\r\n\x1a\n".to_vec(),
        chunk(b"IHDR", &header),
        chunk(b"PLTE", &[200, 30, 30, 30, 30, 200]),
        chunk(b"IDAT", &zlib),
        chunk(b"IEND", &[]),
    ]
    .concat()
}

#[test]
fn a_single_image_trains_or_is_refused_but_never_panics() {
    let (folder, scene) = dataset();
    edit(&scene, |json| {
        json["frames"].as_array_mut().unwrap().truncate(1);
    });
    let answer = train(&scene, &folder.path().join("run"));
    match answer.code {
        0 => assert!(folder.path().join("run/eval.json").exists()),
        code => {
            assert_eq!(code, 1);
            error_line(&answer);
        }
    }
}
