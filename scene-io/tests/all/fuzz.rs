//! Files cut off or with bytes changed: an error or a scene, never a panic, and cut files are never taken for whole.

use crate::common::{Dataset, colmap_binary, ngp_json, npy, poses_bounds};
use proptest::prelude::*;
use scene_io::colmap::Model;
use scene_io::{Depth, ImageStore, LoadOptions, StoreOptions, check, load, load_cameras};

/// Bytes cut at a place, and some of them changed.
fn spoil(bytes: &[u8], cut: prop::sample::Index, changes: &[(prop::sample::Index, u8)]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for (at, value) in changes {
        let at = at.index(bytes.len());
        bytes[at] = *value;
    }
    bytes.truncate(cut.index(bytes.len() + 1));
    bytes
}

fn any_changes() -> impl Strategy<Value = Vec<(prop::sample::Index, u8)>> {
    let byte = prop_oneof![any::<u8>(), Just(0), Just(0xff)];
    prop::collection::vec((any::<prop::sample::Index>(), byte), 0..4)
}

proptest! {
    #![proptest_config(testkit::property::cases(128))]

    #[test]
    fn colmap_models_never_panic(file in 0_usize..3, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::new();
        let mut files = colmap_binary(&["a.png", "b.png"]);
        let whole = files[file].len();
        files[file] = spoil(&files[file], cut, &changes);
        for (name, bytes) in ["cameras.bin", "images.bin", "points3D.bin"].iter().zip(&files) {
            dataset.write(name, bytes);
        }
        let result = Model::read(dataset.path());
        if changes.is_empty() {
            prop_assert_eq!(result.is_ok(), files[file].len() == whole);
        }
    }

    #[test]
    fn text_models_never_panic(file in 0_usize..3, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::new();
        let mut files = [
            "# c\n1 OPENCV 8 6 10 10 4 3 0.1 0 0 0\n2 FOV 8 6 10 10 4 3 0.5\n",
            "1 1 0 0 0 0 0 0 1 a.png\n1 2 -1 3 4 9\n2 0.9 0.1 0 0 1 0 0 2 b.png\n\n",
            "9 0 0 3 1 2 3 0.1 5 1\n10 1 0 3 1 2 3 0.1 5 1\n",
        ].map(|text| text.as_bytes().to_vec());
        files[file] = spoil(&files[file], cut, &changes);
        for (name, bytes) in ["cameras.txt", "images.txt", "points3D.txt"].iter().zip(&files) {
            dataset.write(name, bytes);
        }
        let _ = Model::read(dataset.path());
    }

    #[test]
    fn pose_files_never_panic(cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::new();
        for name in ["images/a.png", "images/b.png"] {
            dataset.image(name, 16, 12);
        }
        let whole = poses_bounds(2);
        let bytes = spoil(&whole, cut, &changes);
        dataset.write("poses_bounds.npy", &bytes);
        let result = load(dataset.path(), &LoadOptions::default());
        if changes.is_empty() {
            prop_assert_eq!(result.is_ok(), bytes.len() == whole.len());
        }
    }

    #[test]
    fn transforms_never_panic(cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::ngp(2);
        let whole = ngp_json(2, r#""k1": 0.1, "offset": [0.5, 0.5, 0.5], "scale": 0.3,"#);
        let bytes = spoil(whole.as_bytes(), cut, &changes);
        dataset.write("transforms.json", &bytes);
        let result = load(dataset.path(), &LoadOptions::default());
        if changes.is_empty() {
            prop_assert_eq!(result.is_ok(), bytes.len() == whole.len());
        }
    }

    #[test]
    fn images_never_panic(format in 0_usize..4, cut: prop::sample::Index, changes in any_changes()) {
        let name = ["images/000.png", "images/000.jpg", "images/000.exr", "images/000.gif"][format];
        let dataset = Dataset::ngp(2);
        std::fs::remove_file(dataset.path().join("images/000.png")).unwrap();
        let file = dataset.file(name);
        match format {
            2 => image::Rgb32FImage::from_pixel(8, 6, image::Rgb([0.1, 0.2, 0.3])).save(&file).unwrap(),
            _ => drop(dataset.image(name, 8, 6)),
        }
        let whole = std::fs::read(&file).unwrap();
        let bytes = spoil(&whole, cut, &changes);
        std::fs::write(&file, &bytes).unwrap();
        let pixels = load(dataset.path(), &LoadOptions::default())
            .and_then(|scene| ImageStore::new(&scene.frames, StoreOptions::default())?.get(0));
        // Decoders may do without the last chunk of a PNG or GIF; a cut JPEG is always noticed.
        if changes.is_empty() && (format == 1 || bytes.len() == whole.len()) {
            prop_assert_eq!(pixels.is_ok(), bytes.len() == whole.len());
        }
    }

    #[test]
    fn files_beside_photos_never_panic(kind in 0_usize..4, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::ngp(1);
        let grey = |name: &str| {
            let file = dataset.file(name);
            image::ImageBuffer::from_pixel(8, 6, image::Luma([300_u16])).save(&file).unwrap();
            file
        };
        let file = match kind {
            0 => grey("images/000.segs.png"),
            1 => grey("images/000.segs/a.png"),
            2 => {
                grey("images/000.points/a.png");
                dataset.write("images/000.points/scores.txt", "0.91 0.95\n")
            }
            _ => {
                let text = "{'descr': '<f2', 'fortran_order': False, 'shape': (2, 1, 2), }";
                let mut bytes = b"\x93NUMPY\x01\0".to_vec();
                bytes.extend((text.len() as u16).to_le_bytes());
                bytes.extend(text.as_bytes());
                bytes.extend([0, 60, 0, 0, 0, 60, 0, 192]);
                dataset.write("images/000.features.npy", bytes)
            }
        };
        let read = || {
            let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
            let frame = &scene.frames[0];
            let segments = frame.read_segments().map(|s| s.is_some());
            let prompted = frame.read_prompted().map(|s| s.is_some());
            [segments, prompted, frame.read_features().map(|f| f.is_some())]
        };
        prop_assert!(read().into_iter().any(|r| r.unwrap()));
        let whole = std::fs::read(&file).unwrap();
        let bytes = spoil(&whole, cut, &changes);
        std::fs::write(&file, &bytes).unwrap();
        let refused = read().iter().any(Result::is_err);
        // Features are never taken for whole when cut; one score may lose a digit, and pictures their last chunk.
        if changes.is_empty() && kind == 3 {
            prop_assert_eq!(refused, bytes.len() < whole.len());
        }
    }

    #[test]
    fn motion_beside_photos_never_panics(kind in 0_usize..3, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::ngp(1);
        let file = match kind {
            0 => {
                let head = b"PIEH\x08\0\0\0\x06\0\0\0".to_vec();
                dataset.write("flow/000_fwd.flo", [head, [0_u8, 0, 160, 63].repeat(96)].concat())
            }
            1 => dataset.write("flow/000_bwd.npy", npy(&[6, 8, 2], &[1.25; 96])),
            _ => dataset.write("disp/000.npy", npy(&[6, 8], &[0.5; 48])),
        };
        let read = || {
            let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
            let frame = &scene.frames[0];
            let flow = frame.read_flow_prior().map(|f| f.forward.is_some() || f.backward.is_some());
            [flow, frame.read_disparity().map(|d| d.is_some())]
        };
        prop_assert!(read().into_iter().any(|r| r.unwrap()));
        let whole = std::fs::read(&file).unwrap();
        let bytes = spoil(&whole, cut, &changes);
        std::fs::write(&file, &bytes).unwrap();
        let refused = read().iter().any(Result::is_err);
        // None of them is taken for whole when cut.
        if changes.is_empty() {
            prop_assert_eq!(refused, bytes.len() < whole.len());
        }
    }

    #[test]
    fn moving_scenes_never_panic(dialect in 0_usize..4, file in 0_usize..8, cut: prop::sample::Index, changes in any_changes()) {
        let (dataset, files): (Dataset, &[&str]) = match dialect {
            0 => (Dataset::nr_nerf(3), &["precomputed.json"]),
            1 => (Dataset::endonerf(3), &[
                "poses_bounds.npy", "masks/frame-000001.mask.png", "depth/frame-000001.depth.png",
                "gt_masks/frame-000001.mask.png",
            ]),
            2 => (Dataset::nerfies(), &[
                "dataset.json", "metadata.json", "scene.json", "extra.json", "camera/0_00002.json", "points.npy",
                "splits/train.json", "depth/2x/0_00000.npy",
            ]),
            _ => (Dataset::d_nerf(&["0", "3", ""], &["1"]), &["transforms_train.json", "transforms_test.json"]),
        };
        let name = files[file % files.len()];
        let path = dataset.path().join(name);
        let whole = std::fs::read(&path).unwrap();
        let bytes = spoil(&whole, cut, &changes);
        std::fs::write(&path, &bytes).unwrap();
        let options = LoadOptions::default();
        let loaded = load(dataset.path(), &options);
        let _ = load_cameras(dataset.path(), &options);
        let report = check(dataset.path(), &options, Depth::Pixels);
        // A cut list is never taken for a whole one (pictures may do without their last chunk, `extra.json` is an extra).
        if changes.is_empty() && !name.ends_with("png") && name != "extra.json" {
            prop_assert_eq!(loaded.is_ok(), bytes.len() == whole.len(), "{} of {}", bytes.len(), whole.len());
        }
        for frame in report.scene.iter().flat_map(|s| &s.frames) {
            prop_assert!(frame.time.is_none_or(|t| (0.0..=1.0).contains(&t)), "time {:?}", frame.time);
        }
    }

    #[test]
    fn depth_files_never_panic(format in 0_usize..3, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::endonerf(2);
        dataset.remove("depth");
        let name = ["depth/1.npy", "depth/1.png", "depth/1.exr"][format];
        let file = dataset.file(name);
        dataset.write("depth/0.npy", npy(&[12, 16], &[2.0; 192]));
        match format {
            0 => drop(dataset.write(name, npy(&[12, 16], &[1.0; 192]))),
            1 => image::ImageBuffer::from_pixel(16, 12, image::Luma([500_u16])).save(&file).unwrap(),
            _ => image::Rgb32FImage::from_pixel(16, 12, image::Rgb([0.1, 0.2, 0.3])).save(&file).unwrap(),
        }
        let whole = std::fs::read(&file).unwrap();
        let bytes = spoil(&whole, cut, &changes);
        std::fs::write(&file, &bytes).unwrap();
        let map = load(dataset.path(), &LoadOptions::default()).and_then(|scene| scene.frames[1].read_depth());
        if changes.is_empty() && format != 1 {
            prop_assert_eq!(map.is_ok(), bytes.len() == whole.len());
        }
        if let Ok(Some(map)) = map {
            prop_assert!(map.z.iter().all(|z| z.is_finite() && *z >= 0.0));
        }
    }

    #[test]
    fn split_lists_never_panic(table: bool, cut: prop::sample::Index, changes in any_changes()) {
        let dataset = Dataset::new();
        for name in ["a.png", "b.png", "c.png"] {
            dataset.image(&format!("images/{name}"), 8, 6);
        }
        for (name, bytes) in ["cameras", "images", "points3D"].iter().zip(colmap_binary(&["a.png", "b.png", "c.png"])) {
            dataset.write(&format!("sparse/{name}.bin"), bytes);
        }
        let (name, text) = match table {
            true => ("t.tsv", "filename\tid\tsplit\na.png\t1\ttrain\nb.png\t2\ttest\nc.png\t\ttest\n"),
            false => ("split.json", r#"{"clutter": [0, 1], "extra": [2]}"#),
        };
        dataset.write(name, text);
        prop_assert_eq!(load(dataset.path(), &LoadOptions::default()).unwrap().held_out_names().len(), 1);
        dataset.write(name, spoil(text.as_bytes(), cut, &changes));
        let _ = load(dataset.path(), &LoadOptions::default());
    }
}
