//! Which reconstructed points training may use, and which of them a photo sees.
//!
//! All that is said about a scene by points (its box, near, free space, where Gaussians begin) reads [`Scene::points`] and
//! [`View::points`](crate::data::View::points), wherever they come from: the dataset, or the photos themselves.

use glam::DVec3;
use render_core::bounds::visible_depths;
use render_core::camera::Camera;
use scene_io::{Scene, Split};

/// Training photos that must show a point: fewer cannot place it.
const PHOTOS: u32 = 2;
/// Points that visibility is estimated from, at most, spread evenly over all.
const POINTS: usize = 40_000;
/// Points of a block of the picture, roughly; and how much deeper than the nearest of its block a visible point may be.
const BLOCK_POINTS: usize = 8;
const SLACK: f64 = 1.1;

/// The nearest points of a photo: this share of its points may be outliers, and at least this many in any case; a photo that shows
/// fewer than `NEAR_POINTS` has no nearest point.
const NEAR_STRAY: f64 = 0.02;
const NEAR_STRAYS: usize = 2;
const NEAR_POINTS: usize = 20;

/// Leave out points that fewer than two training photos show: held-out photos must not say where anything is. A held-out photo
/// keeps its tracks to points that stay, for measuring. Points without any track stay as they are: nothing says who saw them.
///
/// Called once for each scene that a run opens, before anything uses points.
pub fn keep_training_points(scene: &mut Scene) {
    if scene.frames.iter().all(|frame| frame.tracks.is_empty()) {
        return;
    }
    // Photos that show a point: those trained on, and the others.
    let [mut photos, mut others] = [(); 2].map(|()| vec![0_u32; scene.points.len()]);
    let mut last = vec![usize::MAX; scene.points.len()];
    for (f, frame) in scene.frames.iter().enumerate() {
        let count = if frame.split == Split::Train { &mut photos } else { &mut others };
        for track in &frame.tracks {
            let point = track.point as usize;
            if last.get(point).is_some_and(|&at| at != f) {
                (last[point], count[point]) = (f, count[point] + 1);
            }
        }
    }
    let mut kept = Vec::with_capacity(scene.points.len());
    let place: Vec<Option<u32>> = (scene.points.iter().zip(&photos))
        .map(|(point, &photos)| {
            (photos >= PHOTOS).then(|| {
                kept.push(*point);
                kept.len() as u32 - 1
            })
        })
        .collect();
    if kept.len() < scene.points.len() {
        let (left, all) = (scene.points.len() - kept.len(), scene.points.len());
        scene.notes.push(format!("points: {left} of {all} left out (fewer than {PHOTOS} training photos show them)"));
    }
    scene.points = kept;
    for frame in &mut scene.frames {
        frame.tracks.retain_mut(|track| match place.get(track.point as usize).copied().flatten() {
            Some(point) => {
                let others = others[track.point as usize];
                (track.length, track.point) = (track.length.saturating_sub(others), point);
                true
            }
            None => false,
        });
    }
}

/// Points that a camera sees, where no track says so: those in the picture that are hardly deeper than the nearest one in their
/// part of it. An estimate: what has no points hides nothing.
pub fn visible_points(camera: &Camera, points: &[DVec3]) -> Vec<DVec3> {
    let prepared = camera.prepare();
    let size = [f64::from(camera.width), f64::from(camera.height)];
    let step = points.len().div_ceil(POINTS).max(1);
    let seen: Vec<(DVec3, [f64; 2], f64)> = points
        .iter()
        .step_by(step)
        .filter_map(|&x| {
            let p = prepared.project(x)?;
            let inside = p.x >= 0.0 && p.y >= 0.0 && p.x < size[0] && p.y < size[1];
            let z = camera.pose.to_camera(x).z;
            (inside && z > 0.0).then_some((x, [p.x / size[0], p.y / size[1]], z))
        })
        .collect();
    let side = ((seen.len() / BLOCK_POINTS) as f64).sqrt().floor().clamp(1.0, 64.0);
    let block = |at: &[f64; 2]| (at[1] * side) as usize * side as usize + (at[0] * side) as usize;
    let mut nearest = vec![f64::INFINITY; (side * side) as usize];
    for (_, at, z) in &seen {
        let nearest = &mut nearest[block(at)];
        *nearest = nearest.min(*z);
    }
    seen.iter().filter(|(_, at, z)| *z <= SLACK * nearest[block(at)]).map(|(x, ..)| *x).collect()
}

/// Depth along the axis of the nearest points in a camera's picture, but for strays: at least two, and one in fifty. `None`
/// where there are too few.
pub fn nearest_point(camera: &Camera, points: &[DVec3]) -> Option<f64> {
    let depths = visible_depths(camera, points);
    let strays = ((depths.len() as f64 * NEAR_STRAY).ceil() as usize).max(NEAR_STRAYS);
    (depths.len() >= NEAR_POINTS).then(|| depths[strays])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use render_core::pose::Pose;
    use scene_io::{Frame, Image, ImageSource, LayoutHint, Point, TrackPoint};
    use std::sync::Arc;

    fn camera() -> Camera {
        Camera::pinhole(40, 40, 40.0, 40.0, 20.0, 20.0, Pose { r: DMat3::IDENTITY, c: DVec3::ZERO })
    }

    fn scene() -> Scene {
        let frame = |split, points: &[u32]| {
            let image = ImageSource::Memory(Arc::new(Image::rgb(40, 40, vec![0; 4800]).unwrap()));
            let track = |&point| TrackPoint { pixel: [0.0; 2], length: 9, point };
            let tracks = points.iter().map(track).collect();
            let mut frame = Frame::new(format!("{points:?}"), image, camera());
            (frame.split, frame.tracks) = (split, tracks);
            frame
        };
        let frames = vec![
            frame(Split::Train, &[0, 1, 2, 2]),
            frame(Split::Train, &[0, 3]),
            frame(Split::Test, &[1, 2, 4, 3]),
            frame(Split::Train, &[3, 0]),
        ];
        let points = (0..5).map(|i| Point { xyz: DVec3::splat(f64::from(i)), rgb: [i as u8; 3] }).collect();
        Scene {
            name: "made".into(),
            root: Default::default(),
            dialect: scene_io::Dialect::Colmap,
            frames,
            points,
            layout: LayoutHint::Unknown,
            bounds: None,
            notes: Vec::new(),
        }
    }

    #[test]
    fn points_that_held_out_photos_alone_place_are_left_out() {
        let mut scene = scene();
        keep_training_points(&mut scene);
        assert_eq!(scene.points.iter().map(|p| p.rgb[0]).collect::<Vec<_>>(), [0, 3]);
        let tracks: Vec<Vec<u32>> = scene.frames.iter().map(|f| f.tracks.iter().map(|t| t.point).collect()).collect();
        assert_eq!(tracks, [vec![0], vec![0, 1], vec![1], vec![1, 0]]);
        assert_eq!(scene.frames[1].tracks.iter().map(|t| t.length).collect::<Vec<_>>(), [9, 8]);
        assert!(scene.notes[0].contains("3 of 5"), "{:?}", scene.notes);
        // Once more leaves the same points.
        let points = scene.points.clone();
        keep_training_points(&mut scene);
        assert_eq!((scene.points, scene.notes.len()), (points, 1));
    }

    #[test]
    fn points_without_tracks_stay() {
        let mut scene = scene();
        scene.frames.iter_mut().for_each(|f| f.tracks.clear());
        keep_training_points(&mut scene);
        assert_eq!((scene.points.len(), scene.notes.len()), (5, 0));
    }

    #[test]
    fn what_lies_behind_a_near_plane_of_points_is_not_seen() {
        let plane = |z: f64| {
            (0..400).map(move |i| DVec3::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5, 40.0) * (z / 40.0))
        };
        let points: Vec<DVec3> = plane(2.0).chain(plane(5.0)).chain([DVec3::new(0.0, 0.0, -1.0)]).collect();
        let seen = visible_points(&camera(), &points);
        assert_eq!(seen.len(), 400);
        assert!(seen.iter().all(|x| x.z < 3.0));
        assert!(visible_points(&camera(), &[]).is_empty());
    }
}
