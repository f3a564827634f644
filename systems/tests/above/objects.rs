//! Photos from which masks cut out an object: alpha, layout, empty space, scores; and what their points tell without masks.

use glam::{DVec2, DVec3};
use image::{GrayImage, Luma};
use render_core::camera::{Camera, Pose};
use scene_io::{
    Dialect, Frame, Image, ImageSource, ImageStore, LayoutHint, MaskPolarity, Point, Scene, Split, StoreOptions,
    TrackPoint,
};
use std::path::Path;
use std::sync::Arc;
use systems::data::Dataset;
use systems::eval::{Measures, Protocol, Terms, evaluate};
use systems::layout::layout;
use systems::options::RunOptions;
use systems::plan::build;
use systems::space::SpaceKind;
use systems::system::{Appearance, LayerRequest, Query};

const CENTRE: DVec3 = DVec3::new(1.0, 2.0, 3.0);
const RADIUS: f64 = 0.5;
const SIDE: u32 = 24;

/// A red ball before noise that is another one in each photo; its masks are in `folder`, that of photo 3 shows nothing of
/// the ball's lower half. Points lie on the ball and far behind it.
fn ball(folder: &Path, cut_out: bool) -> Scene {
    let frames = (0..24_u32).map(|i| {
        let (angle, up) = (f64::from(i) * 2.4, f64::from(i) / 12.0 - 1.0);
        let eye = CENTRE + 4.0 * DVec3::new(angle.cos(), angle.sin(), up).normalize();
        let pose = Pose::look_at(eye, CENTRE, DVec3::Z).unwrap();
        let half = f64::from(SIDE) / 2.0;
        let camera = Camera::pinhole(SIDE, SIDE, 4.0 * half, 4.0 * half, half, half, pose);
        let mut data = Vec::new();
        let mut mask = GrayImage::new(SIDE, SIDE);
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
            let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap();
            let to = CENTRE - ray.o;
            let hit = (to - ray.d * to.dot(ray.d)).length() < RADIUS;
            let noise = (x * 37 + y * 91 + i * 53) as u8;
            data.extend(if hit { [200, 30, 30] } else { [noise, noise.wrapping_mul(7), 255 - noise] });
            mask.put_pixel(x, y, Luma([if hit && !(i == 3 && y > SIDE / 2) { 255 } else { 0 }]));
        }
        let path = folder.join(format!("{i}.png"));
        mask.save(&path).unwrap();
        let image = Image::rgb(SIDE, SIDE, data).unwrap();
        let mut frame = Frame::new(format!("{i:02}"), ImageSource::Memory(Arc::new(image)), camera);
        frame.split = if i % 8 == 2 { Split::Test } else { Split::Train };
        frame.mask = Some(path);
        frame.mask_polarity = if cut_out { MaskPolarity::WhiteIsObject } else { MaskPolarity::WhiteIsUsed };
        frame
    });
    let points = (0..200).map(|k| {
        let (a, z) = (f64::from(k) * 2.4, f64::from(k) / 100.0 - 0.995);
        let d = DVec3::new(a.cos() * (1.0 - z * z).sqrt(), a.sin() * (1.0 - z * z).sqrt(), z);
        Point { xyz: CENTRE + d * if k % 4 == 0 { 30.0 } else { 0.99 * RADIUS }, rgb: [0; 3] }
    });
    Scene {
        name: "ball".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: points.collect(),
        layout: LayoutHint::Unknown,
        bounds: None,
        notes: Vec::new(),
    }
}

fn split(scene: &Scene, split: Split) -> Dataset {
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(scene, store, scene.split(split).collect()).unwrap()
}

#[test]
fn the_cube_is_that_of_the_object() {
    let folder = tempfile::tempdir().unwrap();
    let scene = ball(folder.path(), true);
    let found = layout(&scene, &split(&scene, Split::Train));
    assert_eq!((found.kind, found.cascades), (SpaceKind::Box, 1));
    assert!(found.centre.distance(CENTRE) < 0.05, "{}", found.centre);
    assert!((0.5..0.65).contains(&found.radius), "{}", found.radius);
    assert!(found.why.contains("masks cut out an object"), "{}", found.why);
    // Where masks only ignore, nothing is known of what is around.
    let scene = ball(folder.path(), false);
    assert_eq!(layout(&scene, &split(&scene, Split::Train)).kind, SpaceKind::Contracted);
    // Without points to tell, neither.
    let scene = Scene { points: Vec::new(), ..ball(folder.path(), true) };
    assert_eq!(layout(&scene, &split(&scene, Split::Train)).kind, SpaceKind::Contracted);
}

#[test]
fn what_is_around_the_object_is_empty_and_scores_are_inside_too() {
    let folder = tempfile::tempdir().unwrap();
    let scene = ball(folder.path(), true);
    let data = split(&scene, Split::Train);
    let run = RunOptions { seed: 0, background: None, error_budget: None, set: Default::default() };
    let (mut system, plan) = build("ngp", &scene, &data, &run).unwrap();
    for step in 0..120 {
        system.step(&data, step).unwrap();
    }
    let protocol = Protocol::default();
    let query = Query {
        background: [1.0; 3],
        layers: LayerRequest::default(),
        error_budget: plan.error_budget,
        appearance: Appearance::Mean,
        time: 0.0,
    };
    let terms = Terms { query: &query, protocol: &protocol, measures: Measures::Psnr, seed: 0 };
    // One mask in so many is wrong about the lower half: it is there all the same.
    let mut opaque = 1.0_f32;
    let scores = evaluate(&*system, &split(&scene, Split::Test), &terms, (120, 0.0), |seen| {
        opaque = opaque.min(seen.rendered.layers.opacity[(SIDE / 2 * SIDE + SIDE / 2) as usize]);
        let corner = seen.rendered.layers.opacity[0];
        assert!(corner < 1e-3, "the corner is empty: {corner}");
        Ok(std::ops::ControlFlow::Continue(()))
    })
    .unwrap();
    let (whole, inside) = (scores.psnr.unwrap(), scores.psnr_object.unwrap());
    assert!(opaque > 0.9 && whole > 20.0 && inside > 20.0, "{opaque} {whole} {inside}");
    assert_ne!(whole, inside);
    assert!(scores.table().contains("inside the masks of the object: "));
}

/// The ball without masks; each photo knows the points that it shows.
fn tracked(folder: &Path) -> Scene {
    let mut scene = ball(folder, false);
    scene.points.retain(|p| p.xyz.distance(CENTRE) < 1.0);
    for frame in &mut scene.frames {
        frame.mask = None;
        let shown = |(_, p): &(usize, &Point)| (p.xyz - CENTRE).dot(frame.camera.pose.c - CENTRE) > 0.1;
        let track = |(i, p): (usize, &Point)| {
            let pixel = frame.camera.project(p.xyz).unwrap();
            TrackPoint { pixel: [pixel.x as f32, pixel.y as f32], length: 10, point: i as u32 }
        };
        frame.tracks = scene.points.iter().enumerate().filter(shown).map(track).collect();
    }
    scene
}

#[test]
fn far_from_its_cameras_the_place_is_where_the_points_are() {
    let folder = tempfile::tempdir().unwrap();
    let scene = tracked(folder.path());
    let found = layout(&scene, &split(&scene, Split::Train));
    assert_eq!(found.kind, SpaceKind::Contracted);
    assert!(found.centre.distance(CENTRE) < 0.05 && (0.5..0.65).contains(&found.radius), "{found:?}");
    // The cameras, four away, are within what is sampled.
    assert!((4.0..16.0).contains(&(found.radius * f64::from(1_u32 << (found.cascades - 1)))), "{found:?}");
}

#[test]
fn what_lies_before_the_points_of_photos_is_empty() {
    let folder = tempfile::tempdir().unwrap();
    let scene = tracked(folder.path());
    let data = split(&scene, Split::Train);
    assert!(data.views().iter().all(|view| view.points.len() > 20));
    let trained = |free: bool| {
        let set = [("free_space".to_string(), toml::Value::Boolean(free)), ("sky".into(), toml::Value::Boolean(free))];
        let run = RunOptions { seed: 0, background: None, error_budget: None, set: set.into_iter().collect() };
        let (mut system, plan) = build("ngp", &scene, &data, &run).unwrap();
        for step in 0..60 {
            system.step(&data, step).unwrap();
        }
        let line = plan.lines.iter().find(|line| line.starts_with("empty space: ")).unwrap();
        let empty: f64 = line["empty space: ".len()..].split(' ').next().unwrap().parse().unwrap();
        // Half way between each camera and the ball, and on the ball.
        let half_way: Vec<_> = data.views().iter().map(|v| v.camera.pose.c.lerp(CENTRE, 0.5).to_array()).collect();
        let on_it: Vec<_> = scene.points.iter().map(|p| p.xyz.to_array()).collect();
        let [mut fog, mut ball] = [vec![0.0; half_way.len()], vec![0.0; on_it.len()]];
        system.density(&half_way, 0.0, &mut fog);
        system.density(&on_it, 0.0, &mut ball);
        (empty, fog, ball.iter().filter(|sigma| **sigma > 0.0).count())
    };
    let ((plain, _, _), (empty, fog, ball)) = (trained(false), trained(true));
    assert!(empty > plain + 1.0, "{plain} % and {empty} %");
    assert!(fog.iter().all(|sigma| *sigma == 0.0), "{fog:?}");
    assert!(2 * ball > scene.points.len(), "the ball itself stays: {ball}");
}
