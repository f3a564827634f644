//! Appearance from a reference photo against its definition in `f64`.

use super::*;
use crate::cloud_reference::test_scene::{
    N, SCALE, Twin, WIDTH, bilinear, check_definition, cloud, colours, random_tones, seen, view, visible, wide,
};
use crate::cloud_reference::{CAMERA, Tap, Texels, camera_rows};
use crate::views::{ColourAppearance, ColourBars, PlaceCodes, SamplePlaces, VisibleCloud};
use engine::system::Appearance;
use field_core::rng::Rng;
use splat_core::Gaussians;
use std::sync::Arc;

pub(super) const PHOTOS: usize = 4;
pub(super) const HORIZON: u64 = 200;
const CHANNELS: usize = 2;
const SAMPLED: usize = 2;
const MAP: usize = 8;
const MAPS: usize = (1 + SAMPLED) * CHANNELS * MAP * MAP;

pub(super) const SETTINGS: MapSettings = MapSettings {
    encoder_side: 2 * MAP,
    sampled_maps: SAMPLED,
    map_channels: CHANNELS,
    tone_width: WIDTH,
    tone_scale: SCALE,
    tone_direction: false,
    sample_weight: 0.0,
    place_code_lr: 0.01,
    tone_lr: 0.01,
    encoder_lr: 3e-3,
};

fn maps(settings: MapSettings) -> FeatureMaps {
    let mut maps = FeatureMaps::new(settings, PHOTOS, HORIZON, 3).unwrap();
    random_tones(&mut maps);
    maps
}

pub(super) fn extra(cloud: &Gaussians) -> Vec<f32> {
    [PlaceCodes::of(cloud).rows(cloud), SamplePlaces::of(cloud, SAMPLED, 4).rows(cloud)].concat()
}

/// A code of random maps, and the camera of [`view`].
pub(super) fn code() -> Vec<f32> {
    let mut code = vec![0.0; MAPS];
    Rng::new(6, 0).fill_uniform(0, &mut code);
    code.extend(camera_rows(&view()));
    code
}

/// What Gaussian `i` reads, map by map.
fn features(twin: &Twin, i: usize) -> Vec<f64> {
    let (cloud, view) = (cloud(), view());
    let p = [0, 1, 2].map(|k| f64::from(cloud.mean[k * N + i]) + f64::from(view.t[k]));
    let uv = [0, 1].map(|k| f64::from(view.f[k]) * p[k] / p[2] + f64::from(view.c[k]));
    let is_inside = p[2] > 0.0 && uv[0] >= 0.0 && uv[0] <= 40.0 && uv[1] >= 0.0 && uv[1] <= 30.0;
    let read = |map: &[f64], at: [f64; 2]| bilinear(map, MAP, at.map(|x| x * MAP as f64));
    let mut out = Vec::new();
    for (plane, map) in twin.code[..MAPS].chunks_exact(MAP * MAP).enumerate() {
        out.push(match plane / CHANNELS {
            0 if is_inside => read(map, [uv[0] / 40.0, uv[1] / 30.0]),
            0 => 0.0,
            k => {
                let row = PlaceCodes::ROWS + 2 * (k - 1);
                read(map, [row, row + 1].map(|row| 0.5 * (twin.extra[row * N + i] + 1.0)))
            }
        });
    }
    out
}

#[test]
fn colours_and_their_gradients_are_those_of_the_definition() {
    let (extra, code) = (extra(&cloud()), code());
    let found = check_definition(&mut maps(SETTINGS), &extra, &code, features);
    let of_photo = |i: usize| features(&found.twin, i)[..CHANNELS].to_vec();
    assert!(of_photo(0).iter().all(|f| *f > 0.0), "the first is in the photo");
    assert_eq!([of_photo(N - 1), of_photo(N - 2)].concat(), [0.0; 2 * CHANNELS], "behind it, and beside it");
    let first = PlaceCodes::ROWS * N;
    for (name, error) in [
        ("codes", found.worst(&found.extra[..first], |twin| &mut twin.extra[..first])),
        ("coordinates", found.worst(&found.extra[first..], |twin| &mut twin.extra[first..])),
        ("maps", found.worst(&found.code[..MAPS], |twin| &mut twin.code[..MAPS])),
    ] {
        assert!(error < 1e-4, "{name}: {error}");
    }
    // The camera is not learnt.
    assert_eq!(found.code[MAPS..], [0.0; CAMERA]);
}

/// The same, and the direction from the camera.
fn features_and_direction(twin: &Twin, i: usize) -> Vec<f64> {
    let (cloud, view) = (cloud(), view());
    let d = [0, 1, 2].map(|k| f64::from(cloud.mean[k * N + i]) + f64::from(view.t[k]));
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    features(twin, i).into_iter().chain(d.map(|x| x / length)).collect()
}

#[test]
fn tones_that_know_the_direction_are_those_of_the_definition() {
    let settings = MapSettings { tone_direction: true, ..SETTINGS };
    let (gaussians, code, visible) = (cloud(), code(), visible());
    let extra = extra(&gaussians);
    let mut maps = maps(settings);
    let found = check_definition(&mut maps, &extra, &code, features_and_direction);
    let error = found.worst(&found.code[..MAPS], |twin| &mut twin.code[..MAPS]);
    assert!(error < 1e-4, "maps: {error}");
    // From elsewhere it has another tone, from nowhere one as well.
    let of_code = Appearance::Code(Arc::from(&code[..]));
    let shown = |eye: Option<[f32; 3]>| {
        let mut rgb = colours(1);
        maps.forward(&of_code, VisibleCloud { eye, ..seen(&gaussians, &extra, &visible) }, &mut rgb);
        rgb
    };
    assert!(shown(Some([3.0, 0.0, 0.0])) != shown(Some([0.0, 3.0, 0.0])));
    assert!(shown(None).as_flattened().iter().all(|x| x.is_finite()));
    // Where the camera is in a Gaussian it has no direction.
    let first = [0, 1, 2].map(|k| gaussians.mean[k * N]);
    assert!(shown(Some(first)).as_flattened().iter().all(|x| x.is_finite()));
}

#[test]
fn maps_are_read_linearly_and_hold_beyond_their_border() {
    let code = code();
    let texels = Texels::new(&code[..MAPS], CHANNELS, MAP);
    let read = |map: usize, at: [f32; 2]| {
        let mut out = [0.0; CHANNELS];
        texels.sample(map, &Tap::at_coordinates(at, MAP), |c, x| out[c] = x);
        out
    };
    let planes: Vec<Vec<f64>> = code[..MAPS].chunks_exact(MAP * MAP).map(wide).collect();
    let rng = Rng::new(9, 9);
    for k in 0..200 {
        let [x, y, ..] = rng.uniform4_at(k).map(|u| 2.6 * u - 1.3);
        for map in 0..=SAMPLED {
            for (c, got) in read(map, [x, y]).into_iter().enumerate() {
                let pixel = |x: f32| 0.5 * (f64::from(x) + 1.0) * MAP as f64;
                let want = bilinear(&planes[map * CHANNELS + c], MAP, [x, y].map(pixel));
                assert!((f64::from(got) - want).abs() < 1e-5, "{map} {x} {y}: {got} {want}");
            }
        }
    }
    assert_eq!(read(1, [-7.0, f32::NEG_INFINITY]), read(1, [-1.0, -1.0]));
    assert_eq!(read(1, [7.0, f32::INFINITY]), read(1, [1.0, 1.0]));
    assert!(read(1, [f32::NAN, 0.3]).iter().all(|x| x.is_finite()));
    // A camera that is not known shows nothing; one that sees nothing but what is no number does so as well.
    assert_eq!(Tap::projected(&[0.0; CAMERA], [0.1; 3], MAP), None);
    assert_eq!(Tap::projected(&camera_rows(&view()), [f32::NAN; 3], MAP), None);
}

#[test]
fn places_beyond_the_borders_are_brought_back() {
    let mut maps = maps(MapSettings { sample_weight: 0.3, ..SETTINGS });
    let (cloud, visible, code) = (cloud(), visible(), code());
    let mut extra = extra(&cloud);
    let first = PlaceCodes::ROWS * N;
    (extra[first], extra[first + 1], extra[first + 2]) = (1.5, -1.2, 0.99);
    let (mut base, mut bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
    let mut zero = vec![[0.0; 3]; visible.len()];
    let bars = ColourBars { rgb: &mut zero, base: &mut base, extra: &mut bar };
    let appearance = Appearance::Code(Arc::from(&code[..]));
    maps.backward(&appearance, seen(&cloud, &extra, &visible), &colours(1), bars);
    let each = 0.3 / (2 * SAMPLED * N) as f32;
    assert_eq!(bar[first..first + 3], [each, -each, 0.0]);
    assert!(bar[..first].iter().all(|x| *x == 0.0));
}

#[test]
fn without_maps_of_their_own_places_gaussians_read_the_photo_alone() {
    let maps = FeatureMaps::new(MapSettings { sampled_maps: 0, ..SETTINGS }, 1, HORIZON, 3).unwrap();
    let (cloud, visible) = (cloud(), visible());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let mut toned = colours(1);
    maps.forward(&Appearance::Mean, seen(&cloud, &extra, &visible), &mut toned);
    assert!(toned.as_flattened().iter().all(|x| x.is_finite()));
}

#[test]
fn what_cannot_work_is_refused_by_its_name() {
    for (bad, name) in [
        (MapSettings { encoder_side: 0, ..SETTINGS }, "encoder_side"),
        (MapSettings { encoder_side: 40, ..SETTINGS }, "encoder_side"),
        (MapSettings { encoder_side: 528, ..SETTINGS }, "encoder_side"),
        (MapSettings { sampled_maps: 5, ..SETTINGS }, "sampled_maps"),
        (MapSettings { map_channels: 0, ..SETTINGS }, "map_channels"),
        (MapSettings { tone_width: 513, ..SETTINGS }, "tone_width"),
        (MapSettings { tone_scale: 0.0, ..SETTINGS }, "tone_scale"),
        (MapSettings { sample_weight: -1.0, ..SETTINGS }, "sample_weight"),
        (MapSettings { place_code_lr: f64::NAN, ..SETTINGS }, "place_code_lr"),
        (MapSettings { tone_lr: 0.0, ..SETTINGS }, "tone_lr"),
        (MapSettings { encoder_lr: 0.0, ..SETTINGS }, "encoder_lr"),
    ] {
        let error = FeatureMaps::new(bad, 2, 100, 0).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(name)), "{name}: {error:?}");
    }
}

#[test]
#[should_panic(expected = "as many numbers")]
fn a_code_of_another_system_is_refused() {
    let (maps, cloud) = (maps(SETTINGS), cloud());
    let code: Arc<[f32]> = Arc::from([1.0; 7]);
    maps.forward(&Appearance::Code(code), seen(&cloud, &extra(&cloud), &visible()), &mut colours(1));
}
