//! Photos from which masks cut out an object: alpha, layout, empty space, scores; and what their points tell without masks.

use crate::common::{Sky, Watch, request};
use engine::data::Dataset;
use engine::eval::{Measures, Protocol, Terms, evaluate};
use engine::options::{DataOptions, Request, RunOptions};
use engine::output::Disk;
use engine::progress::Reached;
use engine::run::{DefaultSystem, MaskMeaning, Parts, Run, mask_meaning};
use engine::system::{Appearance, LayerRequest, Query};
use engine::train::{Schedule, Stop};
use glam::{DVec2, DVec3};
use image::{GrayImage, Luma};
use render_core::camera::{Camera, Pose};
use scene_io::{
    Dialect, Frame, Image, ImageSource, ImageStore, LayoutHint, LoadOptions, MaskPolarity, Point, Scene, Split,
    StoreOptions, TrackPoint, refuse_blank_masks,
};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use systems::layout::layout;
use systems::registry::build;
use systems::space::SpaceKind;
use testkit::golden::data_or_skip;

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
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: Default::default() };
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
        halt: engine::halt::Halt::NEVER,
    };
    let terms = Terms { query: &query, protocol: &protocol, measures: Measures::Psnr, seed: 0 };
    // One mask in so many is wrong about the lower half: it is there all the same.
    let mut opaque = 1.0_f32;
    let scores = evaluate(&*system, &split(&scene, Split::Test), &terms, Reached { step: 120, seconds: 0.0 }, |seen| {
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
        let run =
            RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.into_iter().collect() };
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

/// The masks of `ball`, in which a square of noise per photo is white instead of the ball.
fn scattered(folder: &Path) -> Scene {
    let scene = ball(folder, false);
    for (i, frame) in (0_u32..).zip(&scene.frames) {
        let (left, top) = (i * 7 % 16, i * 11 % 16);
        let white = |x: u32, y: u32| (left..left + 7).contains(&x) && (top..top + 7).contains(&y);
        let mask = GrayImage::from_fn(SIDE, SIDE, |x, y| Luma([if white(x, y) { 255 } else { 0 }]));
        mask.save(frame.mask.as_ref().unwrap()).unwrap();
    }
    scene
}

#[test]
fn masks_that_show_one_thing_at_one_place_are_of_an_object() {
    let folder = tempfile::tempdir().unwrap();
    let meaning = |scene: &Scene| {
        let left = refuse_blank_masks(&scene.frames).unwrap().unwrap();
        mask_meaning(scene, Some(left), None).unwrap()
    };
    let MaskMeaning::Object(line) = meaning(&ball(folder.path(), false)) else { panic!("a ball is an object") };
    assert!(line.contains("OBJECT") && line.contains("--mask-white used"), "{line}");
    assert_eq!(meaning(&ball(folder.path(), true)), MaskMeaning::AsRead, "it was said already");
    let MaskMeaning::Sparse(line) = meaning(&scattered(folder.path())) else { panic!("squares anywhere are none") };
    assert!(line.contains("--masks off") && line.contains("--mask-white object"), "{line}");
    let mut few = ball(folder.path(), false);
    few.frames.truncate(4);
    assert!(matches!(meaning(&few), MaskMeaning::Sparse(_)), "three photos say too little");
    let mut whole = ball(folder.path(), false);
    whole.frames.iter_mut().for_each(|frame| frame.mask = None);
    assert_eq!(mask_meaning(&whole, Some(1.0), None).unwrap(), MaskMeaning::AsRead);
}

#[test]
fn what_masks_were_taken_for_is_written_down_and_said_once() {
    let photos = tempfile::tempdir().unwrap();
    let asked = |white: Option<&str>| Request {
        data: DataOptions { mask_white: white.map(str::to_string), ..DataOptions::default() },
        ..request()
    };
    let load = |_: &str, data: &DataOptions| Ok(ball(photos.path(), data.mask_white.as_deref() == Some("object")));
    let build = |name: &str, scene: &Scene, data: &Dataset, options: &RunOptions| {
        assert_eq!(data.is_cut_out(), scene.frames[0].mask_polarity == MaskPolarity::WhiteIsObject);
        Sky::build(name, scene, data, options)
    };
    let parts = Parts { load: &load, build: &build, storage: &Disk, default_system: DefaultSystem::Named("sky") };
    for (white, taken, warnings) in [(None, Some("object"), 1), (Some("used"), Some("used"), 0)] {
        let folder = tempfile::tempdir().unwrap();
        let mut watch = Watch::default();
        let mut run = Run::create(folder.path(), &asked(white), parts, &mut watch).unwrap();
        assert_eq!(run.config.data.mask_white.as_deref(), taken);
        assert_eq!(run.train.is_cut_out(), taken == Some("object"));
        assert_eq!(
            watch.warnings.iter().filter(|line| line.contains("masks")).count(),
            warnings,
            "{:?}",
            watch.warnings
        );
        run.train(&Schedule::new(Stop::Steps(2)), None, &mut watch, &AtomicBool::new(false)).unwrap();
        // A resumed run reads the same photos and says nothing more.
        let mut watch = Watch::default();
        let again = Run::open(folder.path(), &asked(None), parts, &mut watch).unwrap();
        assert_eq!(again.train.is_cut_out(), taken == Some("object"));
        assert!(watch.warnings.is_empty(), "{:?}", watch.warnings);
    }
}

#[test]
fn the_statues_masks_are_of_an_object() {
    let Some(path) = data_or_skip(env!("CARGO_MANIFEST_DIR"), STATUE, "the_statues_masks_are_of_an_object") else {
        return;
    };
    let scene = scene_io::load(&path, &LoadOptions::default()).unwrap();
    let left = refuse_blank_masks(&scene.frames).unwrap().unwrap();
    assert!(matches!(mask_meaning(&scene, Some(left), None).unwrap(), MaskMeaning::Object(_)));
}

const STATUE: &str = "nerd_in_the_wild/statue_of_liberty_40";
