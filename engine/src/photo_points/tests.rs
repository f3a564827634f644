//! Points of scenes that are known exactly, and of photos that show none.

use super::{Found, Options, along_ray, nearest_to_rays, photo_points};
use crate::data::Dataset;
use glam::DVec3;
use proptest::prelude::*;
use render_core::camera::{Camera, Lens, Pose};
use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop};
use scene_io::{Frame, Image, ImageSource, ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

fn dataset(scene: &Scene, longest_side: Option<u32>) -> Dataset {
    let options = StoreOptions::default().with_longest_side(longest_side);
    let store = Arc::new(ImageStore::new(&scene.frames, options).unwrap());
    Dataset::new(scene, store, scene.split(Split::Train).collect()).unwrap()
}

fn found(scene: &Scene) -> Found {
    photo_points(&dataset(scene, None), &Options::default()).unwrap()
}

fn small() -> (TabletopOptions, Scene) {
    let options =
        TabletopOptions { width: 192, height: 192, train: 30, test: 1, rays: 3, ..TabletopOptions::default() };
    let scene = tabletop(&options);
    (options, scene)
}

/// How far a point is off the surface that a camera sees in its direction, as a part of its distance.
fn error(scene: &Tabletop, camera: &Camera, x: DVec3) -> f64 {
    let o = camera.pose.c;
    let far = o.distance(x);
    let ray = render_core::ray::Ray { o, d: (x - o) / far };
    scene.trace(&ray).map_or(f64::INFINITY, |hit| (hit.t - far).abs() / far)
}

/// Off the painted plane by more than 4 % of the cameras' distance.
fn off_plane(found: &Found) -> usize {
    found.points.iter().filter(|p| p.xyz.z.abs() > 0.16).count()
}

/// A scene of textured photos of the plane `z = 0`, painted by a formula.
fn painted(cameras: &[Camera], paint: impl Fn(f64, f64) -> [u8; 3]) -> Scene {
    let scene =
        tabletop(&TabletopOptions { width: 8, height: 8, train: 1, test: 0, rays: 1, ..TabletopOptions::default() });
    let picture = |camera: &Camera| {
        let lens = camera.prepare();
        let pixel = |x: u32, y: u32| {
            let mut sum = [0.0; 3];
            for (u, v) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                let Some(ray) = lens.ray((f64::from(x) + u, f64::from(y) + v).into()) else { continue };
                let at = ray.at(-ray.o.z / ray.d.z);
                let c = paint(at.x, at.y);
                (0..3).for_each(|a| sum[a] += 0.25 * f64::from(c[a]));
            }
            sum.map(|v: f64| v.round() as u8)
        };
        let data =
            (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y))).flat_map(|(x, y)| pixel(x, y));
        Image::rgb(camera.width, camera.height, data.collect()).unwrap()
    };
    let frame = |(i, camera): (usize, &Camera)| {
        Frame::new(format!("{i}.png"), ImageSource::Memory(Arc::new(picture(camera))), *camera)
    };
    Scene { frames: cameras.iter().enumerate().map(frame).collect(), points: Vec::new(), ..scene }
}

/// Patches of many sizes, none like another.
fn blots(x: f64, y: f64) -> [u8; 3] {
    let (x, y) = (3.0 * x, 3.0 * y);
    let v = (3.1 * x + 1.7 * (2.3 * y).sin()).sin() + (4.7 * y + 1.3 * (3.9 * x).cos()).sin() + (9.1 * x * y).sin();
    let v = 128.0 + 40.0 * v;
    [v as u8, (0.8 * v) as u8, (255.0 - v) as u8]
}

/// Cameras on an arc that look at the origin, each rolled by `roll` more than the one before.
fn arc(count: usize, lens: Lens, roll: f64) -> Vec<Camera> {
    let camera = |k: usize| {
        let angle = -0.4 + 0.8 * k as f64 / (count.max(2) - 1) as f64;
        let eye = DVec3::new(4.0 * angle.sin(), 0.4 * (k % 2) as f64, 4.0 * angle.cos());
        let turn = roll * k as f64;
        let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::new(turn.sin(), turn.cos(), 0.0)).unwrap();
        Camera { lens, ..Camera::pinhole(160, 120, 150.0, 150.0, 80.0, 60.0, pose) }
    };
    (0..count).map(camera).collect()
}

#[test]
fn points_lie_on_the_surface_that_their_photos_show() {
    let (options, scene) = small();
    let found = found(&scene);
    let truth = Tabletop::new(options.seed);
    assert!(found.points.len() >= 150, "{} points", found.points.len());
    let data = dataset(&scene, None);
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); found.points.len()];
    for (view, tracks) in data.views().iter().zip(&found.tracks) {
        for seen in tracks {
            let x = found.points[seen.point as usize].xyz;
            let at = view.camera.project(x).unwrap();
            let off = (at - glam::DVec2::new(seen.pixel[0].into(), seen.pixel[1].into())).length();
            assert!(off < 1e-3, "a point is seen where it falls, {off}");
            errors[seen.point as usize].push(error(&truth, &view.camera, x));
        }
    }
    // A point beside an outline is behind it, or before what is behind it, in some photos: the middle one of its photos tells.
    let middle = |errors: &mut Vec<f64>| {
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    let mut errors: Vec<f64> = errors.iter_mut().map(middle).collect();
    errors.sort_by(f64::total_cmp);
    let share = |bound: f64| errors.iter().filter(|e| **e > bound).count() as f64 / errors.len() as f64;
    // A pixel is 0.6 % of the distance here.
    assert!(errors[errors.len() / 2] < 0.01, "median {}", errors[errors.len() / 2]);
    assert!(share(0.1) < 0.05, "{} of {} points off by 10 %", share(0.1), errors.len());
}

#[test]
fn lenses_and_rolled_cameras_make_no_difference() {
    let bent = Lens::opencv5([-0.15, 0.03, 0.001, -0.001, 0.0]);
    for (lens, roll) in
        [(Lens::PINHOLE, 0.0), (bent, 0.0), (Lens::PINHOLE, 0.9), (Lens::Fisheye { k: [0.02, 0.0, 0.0, 0.0] }, 0.4)]
    {
        let found = found(&painted(&arc(7, lens, roll), blots));
        assert!(found.points.len() >= 30, "{lens:?} {roll}: {} points", found.points.len());
        let off = off_plane(&found);
        assert!(20 * off <= found.points.len(), "{lens:?} {roll}: {off} of {} off the plane", found.points.len());
    }
}

#[test]
fn exposure_makes_no_difference() {
    let mut scene = painted(&arc(7, Lens::PINHOLE, 0.0), blots);
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        let ImageSource::Memory(image) = &mut frame.image else { unreachable!("drawn") };
        let darker = |v: u8| (f64::from(v) * (1.0 - 0.08 * k as f64)) as u8;
        Arc::make_mut(image).data.iter_mut().for_each(|v| *v = darker(*v));
    }
    let found = found(&scene);
    assert!(found.points.len() >= 30, "{} points", found.points.len());
    assert!(20 * off_plane(&found) <= found.points.len());
}

#[test]
fn the_same_bits_with_any_number_of_threads() {
    let (_, scene) = small();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| found(&scene))
    };
    let one = with(1);
    assert!(!one.points.is_empty());
    assert_eq!(one, with(2));
    assert_eq!(one, with(4));
}

#[test]
fn colours_and_tracks_belong_to_the_points() {
    let found = found(&painted(&arc(7, Lens::PINHOLE, 0.0), blots));
    for tracks in &found.tracks {
        assert!(tracks.windows(2).all(|w| w[0].point < w[1].point), "ascending, each once");
    }
    let seen = |k: usize| found.tracks.iter().flatten().filter(|s| s.point as usize == k).count();
    assert!((0..found.points.len()).all(|k| seen(k) >= 2));
    // Photos average over a pixel what is painted, and a point is a part of a pixel off.
    let differs = |point: &&scene_io::Point| {
        let paint = blots(point.xyz.x, point.xyz.y);
        (0..3).any(|c| point.rgb[c].abs_diff(paint[c]) > 40)
    };
    let off = found.points.iter().filter(differs).count();
    assert!(10 * off <= found.points.len(), "{off} of {} points have other colours", found.points.len());
}

#[test]
fn nothing_is_found_where_photos_show_nothing_in_common() {
    let textured = painted(&arc(7, Lens::PINHOLE, 0.0), blots);
    let none = |scene: &Scene, what: &str| {
        let found = found(scene);
        assert!(found.points.is_empty() && found.tracks.iter().all(Vec::is_empty), "{what}: {}", found.points.len());
    };
    let mut one = textured.clone();
    one.frames.truncate(1);
    none(&one, "one photo");
    let mut empty = textured.clone();
    empty.frames.clear();
    none(&empty, "no photo");
    let mut still = textured.clone();
    let first = still.frames[0].clone();
    still.frames.iter_mut().for_each(|f| (f.camera, f.image) = (first.camera, first.image.clone()));
    none(&still, "one pose");
    none(&painted(&arc(7, Lens::PINHOLE, 0.0), |_, _| [90, 120, 40]), "plain photos");
    for side in [1, 2, 7, 21, 23] {
        let cameras: Vec<Camera> =
            arc(4, Lens::PINHOLE, 0.0).iter().map(|c| c.resized(side, side.div_ceil(2))).collect();
        none(&painted(&cameras, blots), "tiny photos");
    }
    let mut masked = textured.clone();
    for frame in &mut masked.frames {
        let ImageSource::Memory(image) = &mut frame.image else { unreachable!("drawn") };
        Arc::make_mut(image).mask = Some(vec![0; 160 * 120]);
    }
    none(&masked, "masks everywhere");
}

#[test]
fn masked_pixels_have_no_points() {
    let mut scene = painted(&arc(7, Lens::PINHOLE, 0.0), blots);
    for frame in &mut scene.frames {
        let ImageSource::Memory(image) = &mut frame.image else { unreachable!("drawn") };
        // The left half of each photo.
        Arc::make_mut(image).mask = Some((0..160 * 120).map(|p| if p % 160 < 80 { 0 } else { 255 }).collect());
    }
    let found = found(&scene);
    assert!(found.points.len() >= 10, "{} points", found.points.len());
    assert!(found.tracks.iter().flatten().all(|s| s.pixel[0] >= 80.0));
}

fn any_point() -> impl Strategy<Value = DVec3> {
    [-10.0..10.0_f64, -10.0..10.0, -10.0..10.0].prop_map(DVec3::from_array)
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn rays_to_a_point_meet_there(x in any_point(), o in any_point(), p in any_point(), q in any_point(), at in any_point()) {
        let (x, o, p, q) = (x + 1e3 * at, o + 1e3 * at, p + 1e3 * at, q + 1e3 * at);
        let ray = |o: DVec3| (o, (x - o).normalize_or_zero());
        let ((o, d), (p, e), (q, f)) = (ray(o), ray(p), ray(q));
        let sine = d.cross(e).length();
        prop_assume!(sine > 1e-3);
        let t = along_ray(o, d, p, e);
        prop_assert!(t.is_some_and(|t| (o + d * t).distance(x) < 1e-9 / sine / sine * 1e3), "{t:?}");
        // Behind the first camera there is no point.
        prop_assert_eq!(along_ray(o, -d, p, e), None);
        let met = nearest_to_rays(&[(o, d, 1.0), (p, e, 2.0), (q, f, 0.5)]);
        prop_assert!(met.is_none_or(|m| m.distance(x) < 1e-9 / sine / sine * 1e3), "{met:?} for {x:?}");
        prop_assert!(sine < 0.1 || met.is_some());
    }

    #[test]
    fn the_nearest_point_has_the_least_sum(a in any_point(), b in any_point(), c in any_point(), d in any_point(), off in any_point()) {
        let rays = [(a, (b - a).normalize_or_zero(), 1.0), (c, (d - c).normalize_or_zero(), 1.0)];
        prop_assume!(rays[0].1.cross(rays[1].1).length() > 0.05);
        let sum = |x: DVec3| rays.iter().map(|(o, d, w)| w * (x - *o).cross(*d).length_squared()).sum::<f64>();
        let x = nearest_to_rays(&rays).unwrap();
        prop_assert!(sum(x) <= sum(x + 1e-2 * off) + 1e-9);
        // Two rays: half way between them.
        if let Some(t) = along_ray(rays[0].0, rays[0].1, rays[1].0, rays[1].1) {
            let on_first = a + rays[0].1 * t;
            prop_assert!((on_first.distance(x) - sum(x).sqrt() / 2.0_f64.sqrt()).abs() < 1e-6);
        }
    }

    #[test]
    fn parallel_rays_meet_nowhere(o in any_point(), p in any_point(), to in any_point()) {
        prop_assume!(to.length() > 1e-3);
        let d = to.normalize();
        prop_assert_eq!(along_ray(o, d, p, d), None);
        prop_assert_eq!(nearest_to_rays(&[(o, d, 1.0), (p, d, 1.0)]), None);
        prop_assert_eq!(nearest_to_rays(&[(o, d, 1.0)]), None);
    }
}

#[test]
fn no_rays_meet_nowhere() {
    assert_eq!(nearest_to_rays(&[]), None);
    let nan = DVec3::NAN;
    assert_eq!(along_ray(nan, nan, nan, nan), None);
    assert_eq!(nearest_to_rays(&[(nan, nan, 1.0), (nan, nan, 1.0)]), None);
}
