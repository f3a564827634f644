//! What holds of a scene that was read, and of every error.

use glam::DVec2;
use render_core::camera::Camera;
use scene_io::{BitMask, Frame, ImageSource, LayoutHint, Scene, SceneError, Segments};
use std::collections::HashSet;
use std::path::Path;

/// An error is one line, and names a file.
pub(crate) fn refused(line: &str, file: &str) {
    one_line(line);
    assert!(line.contains(file), "no word of {file}: {line}");
}

/// Text that stays on one line of a terminal.
pub(crate) fn one_line(line: &str) {
    assert!(!line.contains(char::is_control), "more than one line, or what a terminal obeys: {line:?}");
    assert!(line.len() < 20_000, "{} bytes are not a line", line.len());
}

/// A camera that systems can use: finite, within what cameras can have, and with finite rays.
pub(crate) fn camera(camera: &Camera) {
    assert_eq!(camera.check(), Ok(()), "{camera:?}");
    let rotation = camera.pose.r;
    let off = (rotation.transpose() * rotation - glam::DMat3::IDENTITY).to_cols_array();
    assert!(off.iter().all(|x| x.abs() < 1e-5) && rotation.determinant() > 0.0, "no rotation: {rotation}");
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let prepared = camera.prepare();
    for pixel in [DVec2::new(0.5 * w, 0.5 * h), DVec2::splat(0.5), DVec2::new(w - 0.5, h - 0.5)] {
        if let Some(ray) = prepared.ray(pixel) {
            assert!(ray.d.is_finite() && (ray.d.length() - 1.0).abs() < 1e-6, "ray {:?} of {camera:?}", ray.d);
            if let Some(back) = prepared.project(ray.at(1.0)) {
                assert!(back.is_finite(), "{back} of {camera:?}");
            }
        }
    }
}

/// A scene that was read: names, cameras, times, bounds, points, tracks, notes.
pub(crate) fn scene(scene: &Scene) {
    let mut names = HashSet::new();
    for frame in &scene.frames {
        assert!(names.insert(frame.name.as_str()), "two frames are called {:?}", frame.name);
        camera(&frame.camera);
        assert!(frame.time.is_none_or(|t| (0.0..=1.0).contains(&t)), "time {:?}", frame.time);
        assert!(frame.sharpness.is_none_or(f64::is_finite), "sharpness {:?}", frame.sharpness);
        if let Some([near, far]) = frame.z_bounds {
            assert!(near > 0.0 && near <= far && (near as f32) > 0.0 && (far as f32).is_finite(), "{near} to {far}");
        }
        for track in &frame.tracks {
            assert!((track.point as usize) < scene.points.len() && track.length > 0, "{track:?}");
            assert!(track.pixel.iter().all(|x| x.is_finite()), "{track:?}");
        }
    }
    for point in &scene.points {
        assert!(point.xyz.abs().max_element() <= 1e12, "{point:?}");
    }
    if let Some(bounds) = scene.bounds {
        assert!(bounds.min.is_finite() && bounds.max.is_finite() && bounds.min.cmple(bounds.max).all(), "{bounds:?}");
    }
    if let LayoutHint::Object { near, far } = scene.layout {
        assert!((near as f32) > 0.0 && far > near && (far as f32).is_finite(), "{near} to {far}");
    }
    scene.notes.iter().for_each(|note| one_line(note));
}

/// What belongs to a frame, each file read: whole, or refused by name.
pub(crate) fn belongings(frame: &Frame, root: &Path) {
    let root = root.display().to_string();
    let (width, height) = (frame.camera.width, frame.camera.height);
    let mask = |mask: &BitMask| assert_eq!(mask.iter().count(), mask.width() as usize * mask.height() as usize);
    if let Some(map) = read(frame.read_depth(), &root) {
        assert_eq!(map.z.len() as u64, u64::from(map.width) * u64::from(map.height));
        assert!(map.z.iter().all(|z| z.is_finite() && *z >= 0.0), "a depth is not finite or negative");
        assert!(map.holes() <= map.z.len() && map.range().is_none_or(|[low, high]| 0.0 < low && low <= high));
    }
    for truth in [frame.read_mask(), frame.read_transient(), frame.read_moving(), frame.read_covisible()] {
        if let Some(truth) = read(truth, &root) {
            mask(&truth);
        }
    }
    match read(frame.read_segments(), &root) {
        Some(Segments::Labels(map)) => {
            assert_eq!(map.labels.len() as u64, u64::from(map.width) * u64::from(map.height));
            assert_eq!(map.resized(3, 5).labels.len(), 15);
        }
        Some(Segments::Stack(masks)) => masks.iter().for_each(mask),
        None => {}
    }
    for segment in read(frame.read_prompted(), &root).into_iter().flatten() {
        mask(&segment.mask);
        assert!(segment.score.is_none_or(f32::is_finite) && segment.stability.is_none_or(f32::is_finite));
    }
    if let Some(features) = read(frame.read_features(), &root) {
        assert_eq!(features.data.len(), features.channels * features.width * features.height);
        let mut vector = vec![0.0; features.channels];
        features.sample(0.3, 1.0, &mut vector);
        assert!(features.data.iter().chain(&vector).all(|x| x.is_finite()), "a feature is not finite");
    }
    if let Some((flow, _)) = read(frame.read_flow(), &root) {
        assert_eq!(flow.vectors.len() as u64, u64::from(width) * u64::from(height));
        assert!(
            flow.vectors.iter().zip(flow.seen.iter()).all(|(way, seen)| !seen || way.iter().all(|x| x.is_finite()))
        );
        assert_eq!(flow.resized(3, 2).vectors.len(), 6);
    }
    motion(frame, &root);
}

/// What other programs say of motion: all finite, with masks of its size.
fn motion(frame: &Frame, root: &str) {
    let prior = read(frame.read_flow_prior().map(Some), root).unwrap_or_default();
    for flow in [prior.forward, prior.backward].into_iter().flatten() {
        assert_eq!(flow.vectors.len() as u64, u64::from(flow.width) * u64::from(flow.height));
        assert_eq!((flow.seen.width(), flow.seen.height()), (flow.width, flow.height));
        assert!(flow.vectors.iter().flatten().all(|x| x.abs() <= 1e9), "a vector is not finite or huge");
        assert_eq!(flow.resized(3, 2).vectors.len(), 6);
    }
    if let Some(disparity) = read(frame.read_disparity(), root) {
        assert_eq!(disparity.values.len() as u64, u64::from(disparity.width) * u64::from(disparity.height));
        assert!(disparity.values.iter().all(|x| x.is_finite()), "a disparity is not finite");
        assert_eq!(disparity.resized(3, 5).values.len(), 15);
    }
    if let Some(mask) = read(frame.read_motion_mask(), root) {
        assert_eq!(mask.resized(3, 5).iter().count(), 15);
    }
}

fn read<T>(result: Result<Option<T>, SceneError>, root: &str) -> Option<T> {
    result.unwrap_or_else(|error| {
        refused(&error.to_string(), root);
        None
    })
}

/// The file of a frame lies in the dataset.
pub(crate) fn inside(frame: &Frame, root: &Path) {
    if let ImageSource::File(path) = &frame.image {
        let inside = path.strip_prefix(root).is_ok_and(|rest| !rest.components().any(|c| c.as_os_str() == ".."));
        assert!(inside, "{} is not in {}", path.display(), root.display());
    }
}
