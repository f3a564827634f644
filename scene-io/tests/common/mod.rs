//! Tiny datasets written for a test, to be spoiled by it.

#![allow(dead_code, reason = "each test binary uses a part")]

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
