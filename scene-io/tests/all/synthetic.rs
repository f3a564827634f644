//! Drawn scenes written to files and read back: by the loader where there is one, by plain readers where not.

use scene_io::synthetic::{
    Mouth, MouthOptions, OrbitMotion, OrbitOptions, Sight, TissueDepth, TissueOptions, TissueTool, mouth, mouth_views,
    orbit, orbit_views, tissue_truth, write_mouth, write_orbit, write_tissue,
};
use scene_io::{Depth, Image, ImageSource, ImageStore, LoadOptions, Scene, Split, StoreOptions, check, load};
use std::path::Path;

fn array(path: &Path) -> (Vec<u64>, Vec<f64>) {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let file = npyz::NpyFile::new(&bytes[..]).unwrap();
    let shape = file.shape().to_vec();
    let data = match file.dtype().descr().as_str() {
        "'<f4'" => file.into_vec::<f32>().unwrap().into_iter().map(f64::from).collect(),
        _ => file.into_vec::<f64>().unwrap(),
    };
    (shape, data)
}

fn grey(path: &Path) -> (u32, u32, Vec<u8>) {
    let picture = image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).into_luma8();
    (picture.width(), picture.height(), picture.into_raw())
}

#[test]
fn orbit_comes_back_from_its_files_as_it_was_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let options = OrbitOptions { width: 34, height: 26, train: 4, val: 2, test: 3, rays: 2, ..OrbitOptions::default() };
    write_orbit(&options, folder.path()).unwrap();
    comes_back(&orbit(&options), folder.path(), &[Split::Test]);
}

#[test]
fn mouth_comes_back_from_its_files_as_it_was_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let options = MouthOptions { width: 34, height: 26, train: 4, val: 2, test: 3, rays: 2, ..MouthOptions::default() };
    write_mouth(&options, folder.path()).unwrap();
    comes_back(&mouth(&options), folder.path(), &[Split::Val, Split::Test]);
}

/// Compare a scene of 34 x 26 pixels with what its files hold; frames of the splits `followed` have exact flow.
fn comes_back(drawn: &Scene, folder: &Path, followed: &[Split]) {
    let read = load(folder, &LoadOptions::default()).unwrap();
    assert_eq!(read.frames.len(), drawn.frames.len());
    assert_eq!(read.layout, drawn.layout);
    let pixels = ImageStore::new(&read.frames, StoreOptions::default()).unwrap();
    for (i, (a, b)) in read.frames.iter().zip(&drawn.frames).enumerate() {
        assert_eq!((a.split, a.name.trim_end_matches(".png")), (b.split, b.name.as_str()));
        assert!((a.time.unwrap() - b.time.unwrap()).abs() < 1e-12);
        assert!((a.camera.pose.c - b.camera.pose.c).length() < 1e-9);
        for (x, y) in a.camera.pose.r.to_cols_array().iter().zip(b.camera.pose.r.to_cols_array()) {
            assert!((x - y).abs() < 1e-9);
        }
        assert!((a.camera.fx - b.camera.fx).abs() < 1e-9 && (a.camera.fy - b.camera.fy).abs() < 1e-9);
        assert_eq!((a.camera.width, a.camera.cx, a.camera.cy), (34, 17.0, 13.0));
        let ImageSource::Memory(image) = &b.image else { panic!("drawn in memory") };
        assert_eq!(*pixels.get(i).unwrap(), Image::clone(image));
        assert_eq!(a.read_moving().unwrap().unwrap(), b.read_moving().unwrap().unwrap());
        assert_eq!(a.read_depth().unwrap(), b.read_depth().unwrap());
        assert_eq!(a.depth.is_some(), a.split != Split::Train);
        assert_eq!(a.read_flow().unwrap(), b.read_flow().unwrap());
        assert_eq!(a.truth.flow.is_some(), followed.contains(&a.split));
    }
    let report = check(folder, &LoadOptions::default(), Depth::Pixels);
    assert!(report.can_train(), "{report}");
}

#[test]
fn the_truth_beside_mouth_is_that_of_its_times() {
    let folder = tempfile::tempdir().unwrap();
    let options = MouthOptions { width: 20, height: 18, train: 4, val: 0, test: 0, rays: 1, ..MouthOptions::default() };
    write_mouth(&options, folder.path()).unwrap();
    let (drawn, views) = (Mouth::new(options.seed), mouth_views(&options));
    let start = drawn.at(0.0);
    for (i, view) in views.iter().enumerate() {
        let file = |what: &str| folder.path().join(format!("truth/{what}/{i:03}.npy"));
        let now = drawn.at(view.time);
        let exact = now.truth(&view.camera);
        let (shape, normals) = array(&file("normal"));
        assert_eq!(shape, [18, 20, 3]);
        for (read, exact) in normals.chunks(3).zip(&exact.normal) {
            assert!(read.iter().zip(exact.to_array()).all(|(a, b)| (a - b).abs() < 1e-6), "{read:?} for {exact}");
        }
        let (_, home) = array(&file("to_start"));
        let flow = now.flow_to(&view.camera, &start, &view.camera);
        for (read, exact) in home.chunks(3).zip(&flow.moved) {
            assert!(read.iter().zip(exact.to_array()).all(|(a, b)| (a - b).abs() < 1e-6), "{read:?} for {exact}");
        }
        // Closed at both ends.
        let moves = home.iter().any(|m| m.abs() > 1e-9);
        assert_eq!(moves, i != 0 && i != 3, "picture {i}");
    }
    let readme = std::fs::read_to_string(folder.path().join("truth/README.md")).unwrap();
    assert!(readme.contains("\"scene\": \"mouth\""), "{readme}");
}

#[test]
fn the_truth_beside_orbit_is_that_of_its_times() {
    let folder = tempfile::tempdir().unwrap();
    let options = OrbitOptions {
        width: 20,
        height: 18,
        train: 3,
        test: 0,
        motion: OrbitMotion::Everything,
        ..OrbitOptions::default()
    };
    write_orbit(&options, folder.path()).unwrap();
    let stage = scene_io::synthetic::Orbit::new(options.seed, options.motion);
    let views = orbit_views(&options);
    for (i, pair) in views.windows(2).enumerate() {
        let file = |what: &str| folder.path().join(format!("truth/{what}/{i:03}.npy"));
        let (now, next) = (stage.at(pair[0].time), stage.at(pair[1].time));
        let flow = now.flow_to(&pair[0].camera, &next, &pair[1].camera);
        let (shape, way) = array(&file("flow"));
        assert_eq!(shape, [18, 20, 2]);
        for (read, exact) in way.chunks(2).zip(&flow.flow) {
            assert!((read[0] - exact.x).abs() < 1e-4 && (read[1] - exact.y).abs() < 1e-4);
        }
        let (w, h, valid) = grey(&folder.path().join(format!("truth/flow_valid/{i:03}.png")));
        assert_eq!((w, h), (20, 18));
        assert!(valid.iter().zip(&flow.sight).all(|(v, s)| (*v == 255) == (*s == Sight::Seen)));
        let exact = now.truth(&pair[0].camera);
        let (shape, depth) = array(&file("depth"));
        assert_eq!(shape, [18, 20]);
        assert!(depth.iter().zip(&exact.z).all(|(a, b)| (a - b).abs() < 1e-6));
        let (_, home) = array(&file("to_start"));
        assert_eq!(home.iter().all(|m| m.abs() < 1e-12), i == 0, "time 0 is where the first picture is");
    }
    assert!(!folder.path().join("truth/flow/002.npy").exists());
    let readme = std::fs::read_to_string(folder.path().join("truth/README.md")).unwrap();
    assert!(readme.contains("\"motion\": \"Everything\""), "{readme}");
}

#[test]
fn tissue_comes_back_from_its_files_as_it_was_drawn() {
    for depth in [TissueDepth::Npy, TissueDepth::Png] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let options = TissueOptions { width: 32, height: 24, frames: 4, seed: 2, ..TissueOptions::default() };
        write_tissue(&options, depth, folder.path()).unwrap();
        let (shape, poses) = array(&path("poses_bounds.npy"));
        assert_eq!(shape, [4, 17]);
        for (i, (truth, row)) in tissue_truth(&options).iter().zip(poses.chunks(17)).enumerate() {
            let focal = 569.468_200_41 / 640.0 * 32.0;
            let matrix = [1.0, 0.0, 0.0, 0.0, 24.0, 0.0, 1.0, 0.0, 0.0, 32.0, 0.0, 0.0, 1.0, 0.0, focal];
            assert!(row.iter().zip(matrix).all(|(a, b)| (a - b).abs() < 1e-12), "{row:?}");
            assert!(row[15] > 0.0 && row[15] < row[16]);
            for (place, picture) in [("images", &truth.picture), ("truth/images", &truth.without_tool)] {
                let read = image::open(path(&format!("{place}/{i:06}.png"))).unwrap().into_rgb8();
                assert_eq!((read.width(), read.height()), (32, 24));
                assert_eq!(read.into_raw(), picture.data);
            }
            for (place, mask) in
                [("masks", &truth.mask), ("gt_masks", &truth.tool), ("truth/recoverable", &truth.recoverable)]
            {
                let (w, h, read) = grey(&path(&format!("{place}/{i:06}.png")));
                assert_eq!((w, h), (32, 24));
                assert!(
                    read.iter()
                        .enumerate()
                        .all(|(k, v)| { *v == if mask.get(k as u32 % 32, k as u32 / 32) { 255 } else { 0 } })
                );
            }
            let exact = truth.stereo_depth.z.iter().map(|z| f64::from(*z));
            match depth {
                TissueDepth::Npy => {
                    let (shape, read) = array(&path(&format!("depth/{i:06}.npy")));
                    assert_eq!(shape, [24, 32]);
                    assert!(read.into_iter().eq(exact));
                }
                TissueDepth::Png => {
                    let read = image::open(path(&format!("depth/{i:06}.png"))).unwrap();
                    let image::DynamicImage::ImageLuma16(read) = read else { panic!("16 bits") };
                    assert!(read.into_raw().into_iter().zip(exact).all(|(a, b)| (f64::from(a) - b).abs() <= 0.5));
                }
            }
            let (_, tissue) = array(&path(&format!("truth/depth/{i:06}.npy")));
            assert!(tissue.into_iter().eq(truth.tissue_depth.z.iter().map(|z| f64::from(*z))));
        }
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, b"").unwrap();
    let options =
        TissueOptions { width: 4, height: 4, frames: 1, tool: TissueTool::Absent, ..TissueOptions::default() };
    let error = write_tissue(&options, TissueDepth::Npy, &file).unwrap_err();
    assert!(error.to_string().contains("file"), "{error}");
    let options = OrbitOptions { width: 4, height: 4, train: 1, test: 0, rays: 1, ..OrbitOptions::default() };
    assert!(write_orbit(&options, &file).is_err());
    let options = MouthOptions { width: 4, height: 4, train: 1, val: 0, test: 0, rays: 1, ..MouthOptions::default() };
    assert!(write_mouth(&options, &file).is_err());
}
