//! Camera paths that stay where the photos were: a ball on a floor before a wall, drawn exactly.

use crate::common::train_split;
use engine::RunError;
use engine::camera_path::{BOUND, Film, PathKind, Sight, cameras, film};
use engine::data::Dataset;
use engine::render::{Rendered, plain_query};
use engine::system::Layers;
use engine::time_path::TimePath;
use glam::{DVec2, DVec3};
use render_core::camera::Camera;
use render_core::path::order::pose_distance;
use render_core::pose::Pose;
use scene_io::{Dialect, Frame, Image, ImageSource, LayoutHint, Scene, Split};
use std::cell::Cell;
use std::sync::Arc;

const WIDTH: u32 = 32;
const HEIGHT: u32 = 24;

fn camera(eye: DVec3, target: DVec3) -> Camera {
    let pose = Pose::look_at(eye, target, DVec3::Z).unwrap();
    Camera::pinhole(WIDTH, HEIGHT, 30.0, 30.0, 16.0, 12.0, pose)
}

/// Distance along a ray: a ball of radius 1 at the origin, a floor at -1, a wall around at 12; infinite above the wall's edge.
fn distance(o: DVec3, d: DVec3) -> f64 {
    let ball = {
        let (b, c) = (o.dot(d), o.length_squared() - 1.0);
        let root = b * b - c;
        if root > 0.0 && -b - root.sqrt() > 0.0 { -b - root.sqrt() } else { f64::INFINITY }
    };
    let floor = if d.z < 0.0 { (-1.0 - o.z) / d.z } else { f64::INFINITY };
    let (a, b, c) = (d.x * d.x + d.y * d.y, o.x * d.x + o.y * d.y, o.x * o.x + o.y * o.y - 144.0);
    let wall = (-b + (b * b - a * c).max(0.0).sqrt()) / a;
    let wall = if (o + d * wall).z < 6.0 { wall } else { f64::INFINITY };
    ball.min(floor).min(wall)
}

fn draw(camera: &Camera, _: f64) -> Result<Rendered, RunError> {
    let pixels = (camera.width * camera.height) as usize;
    let mut layers = Layers::nothing(pixels, &plain_query([0.0; 3], 0.0));
    for i in 0..pixels {
        let (x, y) = (i as u32 % camera.width, i as u32 / camera.width);
        let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
        let t = distance(ray.o, ray.d) as f32;
        layers.opacity[i] = if t.is_finite() { 1.0 } else { 0.0 };
        (layers.depth[i], layers.median_depth[i]) = (t, t);
    }
    Ok(Rendered { width: camera.width, height: camera.height, layers })
}

fn scene(views: impl IntoIterator<Item = Camera>) -> (Scene, Dataset) {
    let frame = |(i, camera): (usize, Camera)| {
        let image = Image::rgb(WIDTH, HEIGHT, vec![90; (3 * WIDTH * HEIGHT) as usize]).unwrap();
        let mut frame = Frame::new(format!("photos/IMG_{i}.png"), ImageSource::Memory(Arc::new(image)), camera);
        frame.split = Split::Train;
        frame
    };
    let scene = Scene {
        name: "ball".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: views.into_iter().enumerate().map(frame).collect(),
        points: Vec::new(),
        layout: LayoutHint::Unknown,
        bounds: None,
        notes: Vec::new(),
    };
    let data = train_split(&scene, 1 << 20);
    (scene, data)
}

/// A camera at an azimuth in degrees, 4 away and above the floor; its aim jitters as a hand does.
fn at(degrees: f64, i: usize) -> Camera {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let jitter = |k: usize| 0.2 * ((i * 7 + k) as f64 * 0.618).fract() - 0.1;
    let eye = DVec3::new(4.0 * cos, 4.0 * sin, 2.0 + jitter(2));
    camera(eye, DVec3::new(jitter(0), jitter(1), 0.0))
}

/// 25 photos on an arc of 120 degrees.
fn arc() -> Vec<Camera> {
    (0..25).map(|i| at(30.0 + 5.0 * i as f64, i)).collect()
}

fn filmed(kind: Option<&PathKind>, (scene, data): &(Scene, Dataset), frames: usize) -> Film {
    let sight = Sight::new(data, &draw).unwrap();
    film(kind, scene, data, Some(frames), TimePath::START, &sight).unwrap()
}

fn azimuth(camera: &Camera) -> f64 {
    camera.pose.c.y.atan2(camera.pose.c.x).to_degrees()
}

#[test]
fn the_path_through_the_photos_shows_what_they_show_at_constant_speed() {
    let scene = scene(arc());
    let film = filmed(None, &scene, 60);
    assert_eq!((film.path, film.cameras.len(), film.seen.len()), (PathKind::Photos, 60, 60));
    assert!(film.line.contains("in order of names"), "{}", film.line);
    assert!(film.seen.iter().all(|s| *s >= BOUND), "{:?}", film.seen);
    let steps: Vec<f64> = film.cameras.windows(2).map(|w| pose_distance(&w[0].pose, &w[1].pose, 4.0)).collect();
    let mean = steps.iter().sum::<f64>() / 59.0;
    assert!(steps.iter().all(|s| (s / mean - 1.0).abs() < 0.15), "{steps:?}");
    let [first, last] = [azimuth(&film.cameras[0]), azimuth(&film.cameras[59])];
    assert!(first < 50.0 && last > 130.0, "most of the way: {first} to {last}");
    for camera in &film.cameras {
        assert_eq!((camera.width, camera.height, camera.fx), (WIDTH, HEIGHT, 30.0));
        assert!(camera.pose.r.y_axis.z < -0.5 && camera.pose.r.x_axis.z.abs() < 0.1, "upright and level");
    }
}

#[test]
fn photos_in_no_order_are_visited_by_a_short_way() {
    let photos = arc();
    let mut shuffled: Vec<Camera> = (0..25).map(|i| photos[i * 7 % 25]).collect();
    shuffled.push(camera(DVec3::new(0.0, 11.0, 5.0), DVec3::new(0.0, 0.0, 20.0))); // looks at nothing the others see
    let film = filmed(None, &scene(shuffled), 40);
    assert!(film.line.contains("by the shortest way"), "{}", film.line);
    assert!(film.seen.iter().all(|s| *s >= BOUND), "{:?}", film.seen);
    let azimuths: Vec<f64> = film.cameras.iter().map(azimuth).collect();
    let way = azimuths.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>();
    let [low, high] = [f64::min, f64::max].map(|f| azimuths.iter().copied().reduce(f).unwrap());
    assert!(high - low > 70.0 && way < 1.1 * (high - low), "{low} {high} {way}");
}

#[test]
fn an_orbit_keeps_to_the_arc_of_the_photos() {
    let scene = scene(arc());
    let film = filmed(Some(&PathKind::Orbit), &scene, 60);
    assert!(film.seen.iter().all(|s| *s >= BOUND), "{:?}", film.seen);
    let azimuths: Vec<f64> = film.cameras.iter().map(azimuth).collect();
    let [low, high] = [f64::min, f64::max].map(|f| azimuths.iter().copied().reduce(f).unwrap());
    assert!(low > 28.0 && high < 152.0 && high - low > 70.0, "{low} to {high}");
    for camera in &film.cameras {
        assert!((camera.pose.c.truncate().length() - 4.0).abs() < 0.3 && (camera.pose.c.z - 2.0).abs() < 0.3);
        let aim = (-camera.pose.c).angle_between(camera.pose.r.z_axis).to_degrees();
        assert!(aim < 3.0, "{aim}");
    }
    // The whole circle, as a file of cameras, leaves what they saw: and that is said, not mended.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("circle.json");
    let rows = |c: &Camera| {
        let rows = c.pose.to_matrix(render_core::pose::Axes::Gl).map(|row| format!("{row:?}")).join(",");
        format!("{{\"transform_matrix\": [{rows}]}}")
    };
    let frames: Vec<String> = (0..12).map(|i| rows(&at(30.0 * f64::from(i), 0))).collect();
    std::fs::write(&file, format!("{{\"frames\": [{}]}}", frames.join(","))).unwrap();
    let film = filmed(Some(&PathKind::File(file)), &scene, 12);
    assert!(film.seen[3] >= BOUND && film.seen[9] < 0.6, "{:?}", film.seen);
    let line = engine::camera_path::coverage_line(&film.seen, None);
    assert!(line.contains(" of 12 frames") && line.contains("9"), "{line}");
}

#[test]
fn photos_all_round_make_a_whole_circle() {
    let photos = |i: usize| at(((i * 13) % 36) as f64 * 10.0, i);
    let mut round = scene((0..36).map(photos));
    let orbit = filmed(Some(&PathKind::Orbit), &round, 36);
    assert!(orbit.seen.iter().all(|s| *s >= BOUND), "{:?}", orbit.seen);
    assert!(orbit.line.contains("once around"), "{}", orbit.line);
    // Without anything behind it that is the path, too.
    assert_eq!(filmed(None, &round, 4).path, PathKind::Photos);
    round.0.layout = LayoutHint::Object { near: 2.0, far: 7.0 };
    assert_eq!(filmed(None, &round, 4).path, PathKind::Orbit);
}

#[test]
fn a_wall_between_two_rooms_is_not_walked_through() {
    // Two groups of photos on both sides of the ball look at it from near; the way between them leads through it.
    let side = |x: f64| (0..6).map(move |i| camera(DVec3::new(2.2 * x, 0.3 * f64::from(i) - 0.75, 0.3), DVec3::X * x));
    let film = filmed(Some(&PathKind::Photos), &scene(side(1.0).chain(side(-1.0))), 30);
    assert!(film.seen.iter().all(|s| *s >= BOUND), "{:?}", film.seen);
    assert!(film.cameras.iter().all(|c| c.pose.c.length() > 1.5), "{:?}", film.line);
}

#[test]
fn few_photos_make_paths_too() {
    for n in 1..4 {
        let scene = scene((0..n).map(|i| at(80.0 + 4.0 * i as f64, i)));
        let film = filmed(None, &scene, 5);
        assert_eq!(film.cameras.len(), 5);
        assert!(film.cameras.iter().all(|c| c.pose.c.is_finite() && c.check().is_ok()), "{n}");
    }
    let (one, data) = scene([at(80.0, 0)]);
    let error = cameras(&PathKind::Orbit, &one, &data, None).unwrap_err().to_string();
    assert!(error.contains("`--path orbit`") && error.contains("`photos`"), "{error}");
    // All photos from one place.
    let film = filmed(None, &scene([at(80.0, 0); 9]), 5);
    assert!(film.cameras.iter().all(|c| c.pose.c.distance(at(80.0, 0).pose.c) < 1e-6));
}

#[test]
fn the_camera_of_a_frame_is_found_by_part_of_its_name_and_looked_at_once() {
    let scene = scene(arc());
    let drawn = Cell::new(0);
    let counting = |camera: &Camera, time: f64| {
        drawn.set(drawn.get() + 1);
        draw(camera, time)
    };
    let sight = Sight::new(&scene.1, &counting).unwrap();
    let photos = drawn.get();
    assert_eq!(photos, 25, "each photo once");
    let hold =
        |name: &str| film(Some(&PathKind::Hold(name.into())), &scene.0, &scene.1, Some(7), TimePath::START, &sight);
    let film = hold("G_17").unwrap();
    assert_eq!((film.cameras.len(), drawn.get() - photos), (7, 1));
    assert!(film.cameras[0] == scene.0.frames[17].camera && film.seen[6] > 0.95, "{:?}", film.seen);
    let error = hold("IMG_2").err().map(|e| e.to_string());
    assert_eq!(error, None, "a whole name without its extension");
    let error = hold("MG_2").unwrap_err().to_string();
    assert!(error.contains("`photos/IMG_2.png`") && error.contains("`photos/IMG_20.png`"), "{error}");
    let error = film_of_missing(&scene).to_string();
    assert!(error.contains("no such file") && error.contains("`orbit`") && error.contains("nowhere.json"), "{error}");
}

fn film_of_missing((scene, data): &(Scene, Dataset)) -> RunError {
    cameras(&PathKind::File("nowhere.json".into()), scene, data, None).unwrap_err()
}
