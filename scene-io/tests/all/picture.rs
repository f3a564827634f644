//! A photo as numbers.

use glam::DVec3;
use render_core::camera::{Camera, Pose};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Frame, Image, ImageSource, Scene};
use std::sync::Arc;

fn scene(image: Image) -> Scene {
    let pose = Pose { c: DVec3::ZERO, ..Pose::IDENTITY };
    let camera = Camera::pinhole(image.width, image.height, 4.0, 4.0, 1.0, 0.5, pose);
    let frames = vec![Frame::new("a", ImageSource::Memory(Arc::new(image)), camera)];
    Scene { frames, ..tabletop(&TabletopOptions { train: 0, test: 0, ..TabletopOptions::default() }) }
}

#[test]
fn a_picture_holds_the_values_of_its_image() {
    let picture = scene(Image::rgb(2, 1, vec![0, 51, 255, 255, 0, 102]).unwrap()).picture(0).unwrap();
    assert_eq!((picture.width, picture.height), (2, 1));
    assert_eq!(picture.rgb, [[0.0, 0.2, 1.0], [1.0, 0.0, 0.4]]);
    assert_eq!((&picture.alpha, &picture.used), (&None, &None));
    assert_eq!(picture.over([0.5; 3]), picture.rgb, "opaque");
}

#[test]
fn alpha_and_mask_come_with_it() {
    let mut image = Image::rgba(2, 1, vec![255, 0, 0, 255, 0, 255, 0, 0]).unwrap();
    image.mask = Some(vec![255, 0]);
    let picture = scene(image).picture(0).unwrap();
    assert_eq!(picture.alpha, Some(vec![1.0, 0.0]));
    assert_eq!(picture.used, Some(vec![true, false]));
    assert_eq!(picture.over([0.25, 0.5, 1.0]), [[1.0, 0.0, 0.0], [0.25, 0.5, 1.0]]);
}

#[test]
fn a_picture_of_another_size_than_its_camera_is_refused() {
    let mut scene = scene(Image::rgb(2, 1, vec![0; 6]).unwrap());
    scene.frames[0].camera.width = 3;
    assert!(scene.picture(0).is_err());
}
