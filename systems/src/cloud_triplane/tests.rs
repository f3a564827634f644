//! Appearance from planes about a scene against its definition in `f64`.

use super::planes::PlaneBox;
use super::*;
use crate::cloud_reference::test_scene::{
    N, SCALE, Twin, WIDTH, bilinear, check_definition, cloud, colours, random_tones, seen, view, visible,
};
use crate::views::{ColourAppearance, ColourBars, PlaceCodes, SeenDepth, SeenPhoto};
use engine::system::Appearance;
use field_core::rng::Rng;
use splat_core::Gaussians;
use std::sync::Arc;

pub(super) const PHOTOS: usize = 4;
pub(super) const HORIZON: u64 = 200;
const CHANNELS: usize = 2;
const DIMS: usize = 3;
const PLANE: usize = 8;
const FEATURES: usize = 3 * CHANNELS * PLANE * PLANE;
const FIRST_OF_PHOTO: usize = FEATURES + PlaneBox::NUMBERS;

pub(super) const SETTINGS: TriplaneSettings = TriplaneSettings {
    encoder_side: 16,
    plane_side: 2 * PLANE,
    plane_channels: CHANNELS,
    plane_crop: 0.01,
    plane_from: 0.0,
    photo_dims: DIMS,
    tone_width: WIDTH,
    tone_scale: SCALE,
    place_code_lr: 0.01,
    tone_lr: 0.01,
    encoder_lr: 3e-3,
};

/// The box of [`code`]: some Gaussians are beyond it.
const BOX: PlaneBox = PlaneBox { low: [-0.4, -0.5, -0.45], high: [0.45, 0.4, 0.5] };

fn numbers(stream: u64, n: usize) -> Vec<f32> {
    let mut out = vec![0.0; n];
    Rng::new(8, stream).fill_uniform(0, &mut out);
    out
}

fn triplane(settings: TriplaneSettings) -> Triplane {
    let mut triplane = Triplane::new(settings, PHOTOS, HORIZON, 3).unwrap();
    random_tones(&mut triplane);
    // Features of planes begin as zeros.
    let params = triplane.encoder_parameters();
    let moved = params.iter().zip(numbers(5, params.len())).map(|(p, x)| p + 0.3 * (x - 0.5)).collect();
    triplane.set_encoder_parameters(moved);
    triplane
}

/// A code of random features, a box, and numbers of a photo.
fn code() -> Vec<f32> {
    [numbers(2, FEATURES), BOX.numbers().to_vec(), numbers(3, DIMS)].concat()
}

/// The sum of what Gaussian `i` reads in the planes xy, yz and zx, then the numbers of the photo.
fn features(twin: &Twin, i: usize) -> Vec<f64> {
    let cloud = cloud();
    let cell = |axis: usize| {
        let [low, high] = [BOX.low[axis], BOX.high[axis]].map(f64::from);
        (f64::from(cloud.mean[axis * N + i]) - low) / (high - low) * PLANE as f64
    };
    let plane = |k: usize, c: usize| &twin.code[(k * CHANNELS + c) * PLANE * PLANE..][..PLANE * PLANE];
    let axes = [[0, 1], [1, 2], [2, 0]];
    let of = |c: usize| (0..3).map(|k| bilinear(plane(k, c), PLANE, axes[k].map(cell))).sum();
    (0..CHANNELS).map(of).chain(twin.code[FIRST_OF_PHOTO..].iter().copied()).collect()
}

#[test]
fn colours_and_their_gradients_are_those_of_the_definition() {
    let cloud = cloud();
    let (extra, code) = (PlaceCodes::of(&cloud).rows(&cloud), code());
    let found = check_definition(&mut triplane(SETTINGS), &extra, &code, features);
    for (name, error) in [
        ("codes", found.worst(&found.extra, |twin| &mut twin.extra)),
        ("planes", found.worst(&found.code[..FEATURES], |twin| &mut twin.code[..FEATURES])),
        ("photo", found.worst(&found.code[FIRST_OF_PHOTO..], |twin| &mut twin.code[FIRST_OF_PHOTO..])),
    ] {
        assert!(error < 1e-4, "{name}: {error}");
    }
    // The box is not learnt.
    assert!(found.code[FEATURES..FIRST_OF_PHOTO].iter().all(|x| *x == 0.0));
}

/// A photo of noise.
fn noise() -> Vec<f32> {
    numbers(4, 3 * 40 * 30)
}

#[test]
fn the_gradient_of_the_networks_of_photo_and_planes_is_that_of_differences() {
    let (view, colour, z) = (view(), noise(), [2.0; 12]);
    let depth = Some(SeenDepth { size: [4, 3], z: &z });
    let photo = SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth };
    let (cloud, visible) = (cloud(), visible());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let (rgb, weights) = (colours(1), colours(2));
    let mut triplane = triplane(SETTINGS);
    let whole = triplane.encode(&photo).unwrap();
    // A step that looks at all of the photo.
    let step = (0..100).find(|step| {
        triplane.look_at(*step, 1, &photo);
        triplane.current_code() == Some(&whole[..])
    });
    assert!(step.is_some() && whole[..FEATURES].iter().any(|x| *x != 0.0));
    let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
    let bars = ColourBars { rgb: &mut weights.clone(), base: &mut base, extra: &mut extra_bar };
    triplane.backward(&Appearance::View(1), seen(&cloud, &extra, &visible), &rgb, bars);
    let got = triplane.encoder_gradient();
    let params = triplane.encoder_parameters().to_vec();
    let mut at = |params: Vec<f32>| {
        triplane.set_encoder_parameters(params);
        let code = triplane.encode(&photo).unwrap();
        let mut toned = rgb.clone();
        triplane.forward(&Appearance::Code(code.into()), seen(&cloud, &extra, &visible), &mut toned);
        let each = toned.as_flattened().iter().zip(weights.as_flattened());
        each.map(|(x, w)| f64::from(*x) * f64::from(*w)).sum::<f64>()
    };
    // The steepest of the network of planes, whose parameters come first, and of that of the photo.
    let of_photo = 3 * 49 * 8 + 8 + 8 * 16 * 16 + 16 + 16 * 16 * 32 + 32 + 32 * 16 * 32 + 32 + 33 * DIMS + 15 * DIMS;
    for range in [0..params.len() - of_photo, params.len() - of_photo..params.len()] {
        let mut order: Vec<usize> = range.collect();
        order.sort_by(|a, b| got[*b].abs().total_cmp(&got[*a].abs()));
        assert!(got[order[0]].abs() > 1e-3, "{}", got[order[0]]);
        for &k in &order[..12] {
            let h = 2e-3;
            let mut moved = |by: f32| {
                let mut params = params.clone();
                params[k] += by;
                at(params)
            };
            let want = (moved(h) - moved(-h)) / f64::from(2.0 * h);
            let largest = f64::from(got[order[0]].abs());
            assert!((f64::from(got[k]) - want).abs() < 0.03 * largest, "parameter {k}: {} {want}", got[k]);
        }
    }
}

#[test]
fn photos_without_depth_camera_or_pixels_have_no_planes_and_say_what_they_are_as_a_whole() {
    let (view, colour, nothing) = (view(), noise(), [0.0; 12]);
    let triplane = triplane(SETTINGS);
    let [known, far] = [[2.0; 12], [f32::INFINITY; 12]];
    let of = |z: Option<&[f32; 12]>, view| {
        let depth = z.map(|z| SeenDepth { size: [4, 3], z });
        let photo = SeenPhoto { size: [40, 30], colour: &colour, weights: None, view, depth };
        triplane.encode(&photo).unwrap()
    };
    let with = of(Some(&known), Some(&view));
    let without = of(None, None);
    assert!(with[..FEATURES].iter().any(|x| *x != 0.0) && with[FIRST_OF_PHOTO..] == without[FIRST_OF_PHOTO..]);
    assert!(without[..FIRST_OF_PHOTO].iter().all(|x| *x == 0.0) && without[FIRST_OF_PHOTO..].iter().any(|x| *x != 0.0));
    for other in
        [of(Some(&known), None), of(Some(&nothing), Some(&view)), of(Some(&far), Some(&view)), of(None, Some(&view))]
    {
        assert_eq!(other, without);
    }
    // One pixel is a point: no box.
    let one = SeenDepth { size: [16, 16], z: &[&[2.0][..], &[0.0; 255]].concat() };
    let photo = SeenPhoto { size: [40, 30], colour: &colour, weights: None, view: Some(&view), depth: Some(one) };
    assert_eq!(triplane.encode(&photo).unwrap(), without);
    // Nothing of the photo counts: it is grey.
    let masked = SeenPhoto { weights: Some(&[0.0; 1200]), depth: None, ..photo };
    assert!(triplane.encode(&masked).unwrap().iter().all(|x| x.is_finite()));
    let empty = SeenPhoto { size: [0, 0], colour: &[], weights: None, view: None, depth: None };
    assert!(triplane.encode(&empty).is_none());
}

#[test]
fn a_code_without_a_box_is_read_as_zeros_and_an_empty_cloud_has_no_colours() {
    let triplane = triplane(SETTINGS);
    let (cloud, visible) = (cloud(), visible());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let of = |code: Vec<f32>| {
        let mut toned = colours(1);
        triplane.forward(&Appearance::Code(code.into()), seen(&cloud, &extra, &visible), &mut toned);
        toned
    };
    let mut boxless = code();
    boxless[FEATURES..FIRST_OF_PHOTO].fill(0.0);
    let mut empty = boxless.clone();
    empty[..FEATURES].fill(0.0);
    assert_eq!(of(boxless), of(empty));
    let none = Gaussians::new(0, 0).unwrap();
    triplane.forward(&Appearance::Mean, seen(&none, &[], &[]), &mut []);
    let bar = triplane.code_bar(&code(), seen(&none, &[], &[]), &[], &mut []);
    assert!(bar.len() == code().len() && bar.iter().all(|x| *x == 0.0));
}

#[test]
fn depths_are_asked_for_from_a_share_of_the_schedule_on() {
    let of = |plane_from: f64| Triplane::new(TriplaneSettings { plane_from, ..SETTINGS }, 1, HORIZON, 3).unwrap();
    let late = of(0.1);
    assert_eq!([0, 19, 20, 1000].map(|step| late.depth_side(step)), [None, None, Some(16), Some(16)]);
    assert_eq!(of(0.0).depth_side(0), Some(16));
    assert_eq!([0, HORIZON, u64::MAX - 1].map(|step| of(1.0).depth_side(step)), [None; 3]);
}

#[test]
fn what_cannot_work_is_refused_by_its_name() {
    for (bad, name) in [
        (TriplaneSettings { encoder_side: 0, ..SETTINGS }, "encoder_side"),
        (TriplaneSettings { plane_side: 40, ..SETTINGS }, "plane_side"),
        (TriplaneSettings { plane_side: 528, ..SETTINGS }, "plane_side"),
        (TriplaneSettings { plane_channels: 0, ..SETTINGS }, "plane_channels"),
        (TriplaneSettings { plane_crop: 0.5, ..SETTINGS }, "plane_crop"),
        (TriplaneSettings { plane_from: f64::NAN, ..SETTINGS }, "plane_from"),
        (TriplaneSettings { photo_dims: 257, ..SETTINGS }, "photo_dims"),
        (TriplaneSettings { tone_width: 513, ..SETTINGS }, "tone_width"),
        (TriplaneSettings { tone_scale: 0.0, ..SETTINGS }, "tone_scale"),
        (TriplaneSettings { place_code_lr: f64::NAN, ..SETTINGS }, "place_code_lr"),
        (TriplaneSettings { tone_lr: 0.0, ..SETTINGS }, "tone_lr"),
        (TriplaneSettings { encoder_lr: 0.2, ..SETTINGS }, "encoder_lr"),
    ] {
        let error = Triplane::new(bad, 2, 100, 0).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(name)), "{name}: {error:?}");
    }
}

#[test]
#[should_panic(expected = "as many numbers")]
fn a_code_of_another_system_is_refused() {
    let (triplane, cloud) = (triplane(SETTINGS), cloud());
    let code: Arc<[f32]> = Arc::from([1.0; 7]);
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    triplane.forward(&Appearance::Code(code), seen(&cloud, &extra, &visible()), &mut colours(1));
}
