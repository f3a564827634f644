//! Files of cameras to render along.

use crate::Try;
use crate::folder::Folder;
use crate::sound;
use engine::camera_path::{PathKind, cameras};
use engine::data::Dataset;
use glam::{DMat3, DVec3};
use render_core::camera::{Camera, Pose};
use scene_io::{Dialect, Frame, Image, ImageSource, ImageStore, LayoutHint, Scene, StoreOptions};
use std::sync::Arc;

/// Pictures a path may have before it is work and no longer a question.
const MOST: usize = 10_000;

/// The input is a file of cameras; its first byte says how many are asked for.
pub(crate) fn open() -> Try {
    let mut folder = Folder::new(vec![("path.json".into(), None)]);
    let (scene, data) = scene();
    Box::new(move |bytes| {
        let [how, content @ ..] = bytes else { return };
        folder.replace(b'0', content);
        let file = folder.path().join("path.json");
        let frames = [None, Some(1), Some(5)][usize::from(how.wrapping_sub(b'0') % 3)];
        match cameras(&PathKind::File(file), &scene, &data, frames) {
            Err(error) => sound::refused(&error.to_string(), "path.json"),
            Ok(path) => {
                assert!(!path.is_empty() && path.len() <= MOST, "{} cameras", path.len());
                path.iter().for_each(sound::camera);
            }
        }
    })
}

/// Two photos in memory.
pub(crate) fn scene() -> (Scene, Dataset) {
    let frames = (0..2).map(|i| {
        let image = Image::rgb(8, 6, vec![50 * i; 144]).expect("144 values");
        let pose = Pose { r: DMat3::from_rotation_y(0.1 * f64::from(i)), c: DVec3::new(f64::from(i), 0.0, -3.0) };
        let camera = Camera::pinhole(8, 6, 10.0, 10.0, 4.0, 3.0, pose);
        Frame::new(i.to_string(), ImageSource::Memory(Arc::new(image)), camera)
    });
    let scene = Scene {
        name: "two".into(),
        root: "two".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: Vec::new(),
        layout: LayoutHint::Object { near: 1.0, far: 5.0 },
        bounds: None,
        notes: Vec::new(),
    };
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).expect("pictures in memory");
    let data = Dataset::new(&scene, Arc::new(store), vec![0, 1]).expect("pictures in memory");
    (scene, data)
}
