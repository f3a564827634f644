use super::*;
use crate::bit_mask::BitMask;
use crate::{Image, ImageStore, StoreOptions};
use proptest::prelude::*;

fn small(seed: u64) -> PlazaOptions {
    PlazaOptions { width: 48, height: 36, train: 5, test: 2, seed, rays: 1, ..PlazaOptions::default() }
}

fn image(frame: &Frame) -> &Image {
    match &frame.image {
        ImageSource::Memory(image) => image,
        ImageSource::File(path) => panic!("{} is a file", path.display()),
    }
}

/// The property that makes the scene a measure: every pixel of every photo is albedo times light, exposed and balanced.
#[test]
fn every_pixel_is_albedo_times_light_times_exposure_times_white_balance() {
    let options = small(1);
    let (scene, square) = (plaza(&options), Plaza::new(1));
    for (frame, photo) in scene.frames.iter().zip(plaza_photos(&options)) {
        let truth = square.truth(&photo);
        for (i, pixel) in image(frame).data.chunks_exact(3).enumerate() {
            let sky = truth.distance[i].is_infinite();
            let radiance = if sky { photo.light.sky } else { truth.albedo[i] * truth.light[i] };
            // Written out once more, independently of `develop`.
            for c in 0..3 {
                let x = (radiance[c] * photo.gain * photo.white_balance[c]).clamp(0.0, 1.0);
                let srgb = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
                assert_eq!(pixel[c], (srgb * 255.0 + 0.5) as u8, "pixel {i} of {}", frame.name);
            }
            let n = truth.normal[i];
            let facing = if truth.sunlit[i] { n.dot(photo.light.to_sun).max(0.0) } else { 0.0 };
            let light = photo.light.sky + photo.light.sun * facing;
            assert!(sky || (truth.light[i] - light).length() < 1e-12);
        }
    }
}

#[test]
fn white_in_a_truth_mask_is_a_passer_by_and_nothing_else_differs_from_the_empty_square_but_shadows() {
    let options = small(2);
    let (scene, square) = (plaza(&options), Plaza::new(2));
    let mut hidden = Vec::new();
    for (frame, photo) in scene.frames.iter().zip(plaza_photos(&options)) {
        let mask = frame.read_transient().unwrap();
        if photo.split == Split::Test {
            assert!(mask.is_none() && photo.passers_by.is_empty());
            continue;
        }
        let mask = mask.unwrap();
        assert_eq!(mask, square.truth(&photo).occluder);
        let empty = Photo { passers_by: Vec::new(), ..photo.clone() };
        let (clean, none) = square.render(&empty, 1);
        assert_eq!(none.count(), 0);
        let (with, without) = (square.truth(&photo), square.truth(&empty));
        let mut nearer = 0;
        for i in 0..48 * 36 {
            let (column, row) = (i as u32 % 48, i as u32 / 48);
            if mask.get(column, row) {
                nearer += u64::from(with.distance[i] < without.distance[i]);
            } else {
                // The same surface; at most the shadow of somebody falls on it.
                assert_eq!((with.distance[i], with.albedo[i]), (without.distance[i], without.albedo[i]));
                if with.sunlit[i] == without.sunlit[i] {
                    assert_eq!(image(frame).pixel(column, row), clean.pixel(column, row));
                } else {
                    assert!(without.sunlit[i]);
                }
            }
        }
        assert_eq!(nearer, mask.count());
        hidden.push(mask.count() as f64 / (48.0 * 36.0));
    }
    assert!(hidden.iter().all(|h| *h < 0.6), "{hidden:?}");
    assert!(hidden.iter().filter(|h| **h > 0.01).count() >= 4, "{hidden:?}");
}

#[test]
fn test_views_are_clean_under_neutral_light_and_clean_photos_are_like_them() {
    let options = small(0);
    let photos = plaza_photos(&options);
    for photo in photos.iter().filter(|p| p.split == Split::Test) {
        assert_eq!((photo.light, photo.gain, photo.white_balance), (Light::neutral(), 1.0, DVec3::ONE));
    }
    let lights: Vec<_> = photos[..5].iter().map(|p| (p.light, p.gain)).collect();
    for (i, a) in lights.iter().enumerate() {
        assert!(lights[..i].iter().all(|b| a.0 != b.0 && a.1 != b.1));
        assert!((a.0.to_sun.length() - 1.0).abs() < 1e-12 && a.0.to_sun.z > 0.4);
    }
    let clean = plaza(&PlazaOptions { photos: TrainPhotos::Clean, ..options });
    let clutter = plaza(&options);
    for (a, b) in clean.frames.iter().zip(&clutter.frames) {
        assert_eq!(a.camera, b.camera);
        assert_eq!(image(a) == image(b), a.split == Split::Test, "{}", a.name);
    }
    assert!(clean.frames[..5].iter().all(|f| f.read_transient().unwrap().unwrap().count() == 0));
}

#[test]
fn cameras_and_people_stand_free_and_shadows_fall() {
    for seed in 0..6 {
        let square = Plaza::new(seed);
        let options = PlazaOptions { train: 24, test: 6, ..small(seed) };
        let (mut sky, mut dark, mut all) = (0, 0, 0);
        for photo in plaza_photos(&options) {
            let eye = photo.camera.pose.c;
            assert!(!square.contains(eye) && photo.passers_by.iter().all(|p| !p.contains(eye)));
            assert!(photo.camera.pose.r.y_axis.z < 0.0, "upright");
            for person in &photo.passers_by {
                let place = person.place();
                assert!(place.length() > 0.9 && place.distance(eye.truncate()) > 1.0, "{place}");
            }
            let truth = square.truth(&photo);
            sky += truth.distance.iter().filter(|t| t.is_infinite()).count();
            dark += truth.sunlit.iter().filter(|lit| !**lit).count();
            all += truth.sunlit.len();
        }
        let share = |n: usize| n as f64 / all as f64;
        assert!(
            (0.02..0.6).contains(&share(sky)) && (0.1..0.8).contains(&share(dark)),
            "{} {}",
            share(sky),
            share(dark)
        );
    }
}

#[test]
fn points_lie_on_surfaces_and_photos_see_them_where_they_say() {
    let options = small(3);
    let (scene, photos) = (plaza(&options), plaza_photos(&options));
    assert!(scene.points.len() > 50, "{} points", scene.points.len());
    let mut seen = vec![0; scene.points.len()];
    let mut hidden = 0;
    for (frame, photo) in scene.frames.iter().zip(&photos) {
        assert!(photo.split == Split::Train || frame.tracks.is_empty());
        let mask = frame.read_transient().unwrap();
        for track in &frame.tracks {
            let at = frame.camera.project(scene.points[track.point as usize].xyz).unwrap();
            assert!((at - DVec2::from(track.pixel.map(f64::from))).length() < 1e-4);
            seen[track.point as usize] += 1;
            // At somebody's edge the pixel's centre may show them though the point beside it is free.
            let free = |mask: &BitMask| !mask.get(track.pixel[0] as u32, track.pixel[1] as u32);
            hidden += usize::from(!mask.as_ref().is_none_or(free));
        }
    }
    let all: usize = seen.iter().map(|n| *n as usize).sum();
    assert!(hidden * 50 < all, "{hidden} of {all} features lie on passers-by");
    for track in scene.frames.iter().flat_map(|f| &f.tracks) {
        assert_eq!(track.length, seen[track.point as usize]);
        assert!(track.length >= 2);
    }
}

#[test]
fn the_same_options_give_the_same_bytes_on_any_number_of_threads() {
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let scene = pool.install(|| plaza(&PlazaOptions { rays: 2, ..small(seed) }));
        scene.frames.iter().map(|f| image(f).data.clone()).collect::<Vec<_>>()
    };
    let one = run(1, 0);
    assert_eq!(one, run(3, 0));
    assert_ne!(one, run(1, 1));
}

#[test]
fn a_scene_has_what_was_asked_for() {
    let scene = plaza(&small(0));
    assert_eq!((scene.count(Split::Train), scene.count(Split::Test)), (5, 2));
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    assert_eq!(store.estimate_bytes(), 7 * 48 * 36 * 3);
    assert!(plaza(&PlazaOptions { train: 0, test: 0, ..small(0) }).frames.is_empty());
    assert_eq!(plaza(&PlazaOptions { train: 0, ..small(0) }).frames.len(), 2);
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn hits_are_on_surfaces_and_sunlit_ones_see_the_sun(x in 0.0..48.0_f64, y in 0.0..36.0_f64, i in 0_usize..7, seed in 0..3_u64) {
        let square = Plaza::new(seed);
        let photo = &plaza_photos(&small(seed))[i];
        let ray = photo.camera.ray(DVec2::new(x, y)).unwrap();
        if let Some(hit) = square.trace(&ray, photo) {
            let solid = |p: DVec3| square.contains(p) || photo.passers_by.iter().any(|q| q.contains(p));
            let point = ray.at(hit.t);
            prop_assert!(solid(point - hit.normal * 1e-6));
            prop_assert!((1..200).all(|k| !solid(ray.at((hit.t - 1e-6) * f64::from(k) / 200.0))));
            prop_assert!(hit.albedo.cmpge(DVec3::ZERO).all() && hit.albedo.cmple(DVec3::splat(0.9)).all());
            if hit.sunlit {
                prop_assert!((1..200).all(|k| !solid(point + hit.normal * 1e-6 + photo.light.to_sun * (0.05 * f64::from(k)))));
            }
        }
    }
}
