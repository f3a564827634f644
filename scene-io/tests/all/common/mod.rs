//! Tiny datasets written for a test, to be spoiled by it.

use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder that goes away with the test.
pub(crate) struct Dataset {
    folder: TempDir,
}

impl Dataset {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder") }
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a parent")).expect("a folder");
        path
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.file(name);
        std::fs::write(&path, bytes).expect("a file");
        path
    }

    /// An RGB image with a gradient, PNG or JPEG by its name.
    pub(crate) fn image(&self, name: &str, width: u32, height: u32) -> PathBuf {
        let path = self.file(name);
        gradient(width, height).save(&path).expect("an image");
        path
    }

    /// An instant-ngp scene of `n` frames 8 pixels wide and 6 high, cameras along the x axis looking along -z.
    pub(crate) fn ngp(n: usize) -> Self {
        let dataset = Self::new();
        for i in 0..n {
            dataset.image(&format!("images/{i:03}.png"), 8, 6);
        }
        dataset.write("transforms.json", ngp_json(n, ""));
        dataset
    }

    /// Rewrites a text file.
    pub(crate) fn edit(&self, name: &str, from: &str, to: &str) {
        let path = self.path().join(name);
        let text = std::fs::read_to_string(&path).expect("a file");
        assert!(text.contains(from), "{name} holds no `{from}`:\n{text}");
        std::fs::write(path, text.replacen(from, to, 1)).expect("a file");
    }
}

pub(crate) fn gradient(width: u32, height: u32) -> image::RgbImage {
    image::RgbImage::from_fn(width, height, |x, y| image::Rgb([(x * 20) as u8, (y * 20) as u8, 7]))
}

pub(crate) fn ngp_frame(i: usize) -> String {
    format!(
        r#"{{"file_path": "./images/{i:03}.png", "transform_matrix":
            [[1.0, 0.0, 0.0, {i}.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]}}"#
    )
}

/// `more` goes to top level.
pub(crate) fn ngp_json(n: usize, more: &str) -> String {
    let frames: Vec<String> = (0..n).map(ngp_frame).collect();
    format!(
        r#"{{"fl_x": 10.0, "fl_y": 11.0, "cx": 4.0, "cy": 3.0, "w": 8, "h": 6, "aabb_scale": 1, {more}
        "frames": [{}]}}"#,
        frames.join(",\n")
    )
}

/// A COLMAP model: `cameras.bin`, `images.bin`, `points3D.bin`.
pub(crate) fn colmap_binary(names: &[&str]) -> [Vec<u8>; 3] {
    let mut cameras = 1_u64.to_le_bytes().to_vec();
    cameras.extend(7_u32.to_le_bytes());
    cameras.extend(2_i32.to_le_bytes());
    cameras.extend(8_u64.to_le_bytes());
    cameras.extend(6_u64.to_le_bytes());
    for v in [10.0_f64, 4.0, 3.0, 0.01] {
        cameras.extend(v.to_le_bytes());
    }
    let mut images = (names.len() as u64).to_le_bytes().to_vec();
    for (i, name) in names.iter().enumerate() {
        images.extend((i as u32 + 1).to_le_bytes());
        for v in [1.0_f64, 0.0, 0.0, 0.0, -(i as f64), 0.0, 0.0] {
            images.extend(v.to_le_bytes());
        }
        images.extend(7_u32.to_le_bytes());
        images.extend(name.as_bytes());
        images.push(0);
        images.extend(12_u64.to_le_bytes());
        for point in 0..12_u64 {
            images.extend(1.0_f64.to_le_bytes());
            images.extend(2.0_f64.to_le_bytes());
            images.extend(if point == 11 { u64::MAX } else { point }.to_le_bytes());
        }
    }
    let mut points = 11_u64.to_le_bytes().to_vec();
    for point in 0..11_u64 {
        points.extend(point.to_le_bytes());
        for v in [0.1 * point as f64, 0.0, 2.0 + point as f64] {
            points.extend(v.to_le_bytes());
        }
        points.extend([1, 2, 3]);
        points.extend(0.5_f64.to_le_bytes());
        points.extend(2_u64.to_le_bytes());
        points.extend([0; 16]);
    }
    [cameras, images, points]
}

/// `poses_bounds.npy` of cameras along the x axis, for images of 16x12.
pub(crate) fn poses_bounds(n: usize) -> Vec<u8> {
    let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({n}, 17), }}");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    for i in 0..n {
        // Columns down, right, backwards of an upright camera looking along -z; centre; height, width, focal length.
        let row = [[0.0, 1.0, 0.0, i as f64, 12.0], [-1.0, 0.0, 0.0, 0.0, 16.0], [0.0, 0.0, 1.0, 0.0, 20.0]];
        for v in row.as_flattened().iter().chain(&[1.0, 5.0]) {
            bytes.extend(v.to_le_bytes());
        }
    }
    bytes
}

/// An array of `f32` as `numpy.save` writes it.
pub(crate) fn npy(shape: &[usize], data: &[f32]) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    data.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

impl Dataset {
    /// An 8-bit grey picture.
    pub(crate) fn grey(&self, name: &str, (width, height): (u32, u32), value: impl Fn(u32, u32) -> u8) {
        image::GrayImage::from_fn(width, height, |x, y| image::Luma([value(x, y)]))
            .save(self.file(name))
            .expect("a mask");
    }

    pub(crate) fn remove(&self, name: &str) {
        let path = self.path().join(name);
        if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.expect("a file");
    }

    /// A D-NeRF scene: a training frame for each of `train`, a test frame for each of `test`, with these times (empty: none).
    pub(crate) fn d_nerf(train: &[&str], test: &[&str]) -> Self {
        let dataset = Self::new();
        for (split, times) in [("train", train), ("test", test)] {
            let frames: Vec<String> = times
                .iter()
                .enumerate()
                .map(|(i, time)| {
                    dataset.image(&format!("{split}/r_{i}.png"), 8, 8);
                    let frame = ngp_frame(i).replace(&format!("./images/{i:03}.png"), &format!("./{split}/r_{i}"));
                    if time.is_empty() { frame } else { frame.replacen('{', &format!("{{\"time\": {time}, "), 1) }
                })
                .collect();
            let text = format!(r#"{{"camera_angle_x": 0.7, "frames": [{}]}}"#, frames.join(",\n"));
            dataset.write(&format!("transforms_{split}.json"), text);
        }
        dataset
    }

    /// An NR-NeRF scene of `n` images of 16x12, the third held out.
    pub(crate) fn nr_nerf(n: usize) -> Self {
        let dataset = Self::new();
        let (mut poses, mut bounds) = (Vec::new(), Vec::new());
        for i in 0..n {
            dataset.image(&format!("images/image{i:03}.png"), 16, 12);
            poses.push(format!("[[1, 0, 0, {i}.5, 12.0], [0, 1, 0, 0, 16.0], [0, 0, 1, 0, 20.5]]"));
            bounds.push(format!("[0.{}, {}.0]", i + 1, i + 2));
        }
        let text = format!(
            r#"{{"poses": [{}], "bds": [{}], "render_poses": [], "i_test": 2}}"#,
            poses.join(",\n"),
            bounds.join(", ")
        );
        dataset.write("precomputed.json", text);
        dataset
    }

    /// EndoNeRF's form: `n` pictures of 16x12 with a tool of two columns in all but the first, depth 50 with two holes.
    pub(crate) fn endonerf(n: usize) -> Self {
        let dataset = Self::new();
        for i in 0..n {
            dataset.image(&format!("images/frame-{i:06}.color.png"), 16, 12);
            let tool = |x: u32, _| if i > 0 && x < 2 { 255 } else { 0 };
            dataset.grey(&format!("masks/frame-{i:06}.mask.png"), (16, 12), tool);
            dataset.grey(
                &format!("gt_masks/frame-{i:06}.mask.png"),
                (16, 12),
                |x, _| if i > 0 && x < 1 { 255 } else { 0 },
            );
            dataset.grey(&format!("depth/frame-{i:06}.depth.png"), (16, 12), |x, y| {
                if y == 0 && x < 2 { 0 } else { 50 + x as u8 }
            });
        }
        dataset.write("poses_bounds.npy", still_poses(n));
        dataset
    }

    /// A folder of DyCheck's form: camera 0 trains on moments 0, 2 and 4, camera 1 is tested at 1 and 3. Photos of 8x6, half
    /// as large as the cameras say.
    pub(crate) fn nerfies() -> Self {
        let dataset = Self::new();
        let frames = [("0_00000", 0, 0), ("0_00002", 2, 0), ("0_00004", 4, 0), ("1_00001", 1, 1), ("1_00003", 3, 1)];
        let quoted = |camera: usize| -> String {
            let names = frames.iter().filter(|f| f.2 == camera).map(|f| format!("{:?}", f.0));
            names.collect::<Vec<_>>().join(", ")
        };
        let (train, val) = (quoted(0), quoted(1));
        let lists = format!(r#""ids": [{train}, {val}], "train_ids": [{train}], "val_ids": [{val}]"#);
        dataset.write("dataset.json", format!(r#"{{"count": 5, "num_exemplars": 3, {lists}}}"#));
        let mut metadata = Vec::new();
        for (i, (id, time, camera)) in frames.into_iter().enumerate() {
            metadata.push(format!(r#""{id}": {{"appearance_id": {time}, "camera_id": {camera}, "warp_id": {time}}}"#));
            let text = format!(
                r#"{{"orientation": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "position": [{i}.5, 0, 0], "focal_length": 20.0,
                "pixel_aspect_ratio": 1.1, "principal_point": [8.2, 5.9], "skew": 0.0, "image_size": [16, 12],
                "radial_distortion": [0.01, 0.002, 0.0], "tangential_distortion": [0.001, -0.001]}}"#
            );
            dataset.write(&format!("camera/{id}.json"), text);
            let alpha = |x: u32| if x < 4 { 255 } else { 0 };
            let photo = image::RgbaImage::from_fn(8, 6, |x, y| image::Rgba([20 * x as u8, 20 * y as u8, 7, alpha(x)]));
            photo.save(dataset.file(&format!("rgb/2x/{id}.png"))).expect("a photo");
            if camera == 0 {
                let depth: Vec<f32> = (0..48).map(|k| if k % 8 < 4 { 1.5 + 0.01 * k as f32 } else { 0.0 }).collect();
                dataset.write(&format!("depth/2x/{id}.npy"), npy(&[6, 8, 1], &depth));
            } else {
                dataset.grey(&format!("covisible/2x/val/{id}.png"), (8, 6), |x, _| u8::from(x < 2));
            }
        }
        dataset.write("metadata.json", format!("{{{}}}", metadata.join(", ")));
        dataset.write("scene.json", r#"{"center": [1.0, 2.0, 3.0], "scale": 0.5, "near": 0.1, "far": 2.0}"#);
        dataset.write("extra.json", r#"{"bbox": [[-0.5, -0.25, -1.0], [0.5, 0.25, 1.0]], "factor": 2, "fps": 30.0}"#);
        let split = |names: &str, times: &str, cameras: &str| {
            format!(r#"{{"frame_names": [{names}], "time_ids": [{times}], "camera_ids": [{cameras}]}}"#)
        };
        dataset.write("splits/train.json", split(&train, "0, 2, 4", "0, 0, 0"));
        dataset.write("splits/val.json", split(&val, "1, 3", "1, 1"));
        dataset.write("points.npy", npy(&[2, 3], &[1.0, 2.0, 3.0, f32::NAN, 0.0, 0.0]));
        dataset
    }
}

/// EndoNeRF's `poses_bounds.npy` for images of 16x12: the identity in every row, near depth 0.
pub(crate) fn still_poses(n: usize) -> Vec<u8> {
    let whole = poses_bounds(n);
    let start = whole.len() - n * 17 * 8;
    let mut bytes = whole[..start].to_vec();
    for _ in 0..n {
        let row = [[1.0_f64, 0.0, 0.0, 0.0, 12.0], [0.0, 1.0, 0.0, 0.0, 16.0], [0.0, 0.0, 1.0, 0.0, 20.0]];
        for v in row.as_flattened().iter().chain(&[0.0, 90.0]) {
            bytes.extend(v.to_le_bytes());
        }
    }
    bytes
}
