//! Small captures for tests: cameras on a ring around a floor of points.

use engine::data::Dataset;
use field_core::rng::Rng;
use glam::{DMat3, DVec3};
use render_core::camera::Camera;
use render_core::pose::Pose;
use scene_io::{
    Dialect, Frame, Image, ImageSource, ImageStore, LayoutHint, Point, Scene, Split, StoreOptions, TrackPoint,
};
use std::sync::Arc;

/// Radius of the ring; cameras look at the origin from there, a third as high.
pub(crate) const RING: f64 = 3.0;
const VIEWS: usize = 12;
const POINTS: u64 = 600;
pub(crate) const SIDE: u32 = 24;

/// Points of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Points {
    None,
    /// In the scene, and nothing says which photo shows them.
    WithoutTracks,
    WithTracks,
}

/// A camera of the ring.
pub(crate) fn camera(k: usize) -> Camera {
    let angle = k as f64 / VIEWS as f64 * std::f64::consts::TAU;
    let c = DVec3::new(RING * angle.cos(), RING * angle.sin(), RING / 3.0);
    let z = -c.normalize();
    let x = z.cross(DVec3::Z).normalize();
    let pose = Pose { r: DMat3::from_cols(x, z.cross(x), z), c };
    Camera::pinhole(SIDE, SIDE, 24.0, 24.0, 12.0, 12.0, pose)
}

/// Photos of a colour for each pixel, `channels` 3 or 4.
pub(crate) fn frames(channels: u8, colour: impl Fn(usize, u32, u32) -> [u8; 4]) -> Vec<Frame> {
    (0..VIEWS)
        .map(|k| {
            let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
            let data = pixels.flat_map(|(x, y)| colour(k, x, y)[..usize::from(channels)].to_vec()).collect();
            let image = match channels {
                4 => Image::rgba(SIDE, SIDE, data),
                _ => Image::rgb(SIDE, SIDE, data),
            };
            Frame::new(format!("{k:02}.png"), ImageSource::Memory(Arc::new(image.unwrap())), camera(k))
        })
        .collect()
}

/// A scene of some frames, all of them trained on.
pub(crate) fn scene(frames: Vec<Frame>, points: Vec<Point>) -> (Scene, Dataset) {
    let scene = Scene {
        name: "made".into(),
        root: Default::default(),
        dialect: Dialect::Colmap,
        frames,
        points,
        layout: LayoutHint::Unknown,
        bounds: None,
        notes: Vec::new(),
    };
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    (scene, data)
}

/// The capture as a video: a time for each photo, in their order.
pub(crate) fn film(points: Points) -> (Scene, Dataset) {
    let (mut of, _) = capture(points);
    of.time_by_order();
    scene(of.frames, of.points)
}

/// The capture: noise on a floor of two units' side.
pub(crate) fn capture(points: Points) -> (Scene, Dataset) {
    let rng = Rng::new(3, 1);
    let mut frames = frames(3, |k, x, y| {
        let at = (k as u64 * 1000 + u64::from(y)) * 1000 + u64::from(x);
        rng.uniform4_at(at).map(|u| (255.0 * u) as u8)
    });
    if points == Points::None {
        return scene(frames, Vec::new());
    }
    let places: Vec<Point> = (0..POINTS)
        .map(|i| {
            let [x, y, ..] = rng.substream(7).uniform4_at(i).map(|u| 2.0 * f64::from(u) - 1.0);
            Point { xyz: DVec3::new(x, y, 0.0), rgb: [128; 3] }
        })
        .collect();
    if points == Points::WithTracks {
        for frame in &mut frames {
            let camera = frame.camera.prepare();
            let seen = (0_u32..).zip(&places).filter_map(|(point, at)| {
                let p = camera.project(at.xyz)?;
                let inside = p.min_element() >= 0.0 && p.max_element() < f64::from(SIDE);
                inside.then_some(TrackPoint { pixel: [p.x as f32, p.y as f32], length: VIEWS as u32, point })
            });
            frame.tracks = seen.collect();
        }
    }
    scene(frames, places)
}
