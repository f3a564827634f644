//! What an appearance from a reference photo must do: learn, keep, and come back.

use super::tests::{HORIZON, PHOTOS, SETTINGS, code, extra};
use super::*;
use crate::cloud_reference::CAMERA;
use crate::cloud_reference::test_scene::{cloud, colours, seen, view, visible};
use crate::views::{ColourAppearance, ColourBars, Learns, SeenPhoto};
use engine::system::{Appearance, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use splat_core::Gaussians;

/// Photos of one colour each, with noise: that of a photo times a tint.
fn photo(tint: [f32; 3]) -> Vec<f32> {
    let mut noise = vec![0.0; 40 * 30];
    Rng::new(21, 0).fill_uniform(0, &mut noise);
    tint.iter().flat_map(|t| noise.iter().map(move |x| t * (0.3 + 0.4 * x))).collect()
}

const TINTS: [[f32; 3]; PHOTOS] = [[1.0; 3], [0.6, 0.9, 1.2], [1.3, 1.0, 0.7], [0.8; 3]];

/// Steps towards colours of each photo: those of the cloud times its tint. Returns the mean square of each step's errors, too.
fn trained(steps: u64) -> (FeatureMaps, Vec<f32>) {
    let settings = MapSettings { tone_width: 16, map_channels: 4, ..SETTINGS };
    let mut maps = FeatureMaps::new(settings, PHOTOS, HORIZON, 3).unwrap();
    let (cloud, visible, rgb, view) = (cloud(), visible(), colours(1), view());
    let extra = extra(&cloud);
    let seen = seen(&cloud, &extra, &visible);
    let mut errors = Vec::new();
    for step in 0..steps {
        let of = step as usize % PHOTOS;
        let (appearance, tint, colour) = (Appearance::View(of), TINTS[of], photo(TINTS[of]));
        maps.look_at(
            step,
            of,
            &SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth: None },
        );
        let mut toned = rgb.clone();
        maps.forward(&appearance, seen, &mut toned);
        let away = |(toned, rgb): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| toned[c] - tint[c] * rgb[c]);
        let mut bar: Vec<[f32; 3]> = toned.iter().zip(&rgb).map(away).collect();
        errors.push(bar.as_flattened().iter().map(|e| e * e).sum::<f32>() / bar.len() as f32);
        let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
        let bars = ColourBars { rgb: &mut bar, base: &mut base, extra: &mut extra_bar };
        maps.backward(&appearance, seen, &rgb, bars);
        assert_eq!(maps.step(Simd::best(), step), 0);
    }
    (maps, errors)
}

#[test]
fn photos_of_other_tints_are_read_off_the_photos_and_so_is_one_that_was_not_seen() {
    let (maps, errors) = trained(2 * HORIZON);
    let of_all = |errors: &[f32]| errors.iter().sum::<f32>();
    let [first, last] = [&errors[..2 * PHOTOS], &errors[errors.len() - 2 * PHOTOS..]].map(of_all);
    assert!(last < 0.05 * first, "{first} {last}");
    // Another tint, between those that were seen.
    let (cloud, visible, rgb, view) = (cloud(), visible(), colours(1), view());
    let extra = extra(&cloud);
    let tint = [0.9, 0.95, 1.0];
    let colour = photo(tint);
    let seen_photo = SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth: None };
    let off = |appearance: &Appearance| {
        let mut toned = rgb.clone();
        maps.forward(appearance, seen(&cloud, &extra, &visible), &mut toned);
        let each = toned.as_flattened().iter().zip(rgb.as_flattened()).enumerate();
        each.map(|(k, (a, b))| (a - tint[k % 3] * b).powi(2)).sum::<f32>()
    };
    let own = Appearance::Code(maps.encode(&seen_photo).unwrap().into());
    let (own, other) = (off(&own), off(&Appearance::View(1)));
    assert!(own < 0.3 * other, "{own} {other}");
}

#[test]
fn tones_that_are_kept_are_those_of_a_step_and_what_changes_is_worked_out_anew() {
    let (mut maps, _) = trained(5);
    let (cloud, visible, rgb, view) = (cloud(), visible(), colours(1), view());
    let extra = extra(&cloud);
    let of = |maps: &FeatureMaps, cloud: &Gaussians, extra: &[f32]| {
        let mut toned = rgb.clone();
        maps.forward(&Appearance::View(1), seen(cloud, extra, &visible), &mut toned);
        toned
    };
    let kept = of(&maps, &cloud, &extra);
    assert_eq!(of(&maps, &cloud, &extra), kept, "the second time");
    // A step of all of the photo, with its camera.
    let colour = photo(TINTS[1]);
    let photo = SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth: None };
    let whole = maps.code(&Appearance::View(1));
    let step = (0..100).find(|step| {
        maps.look_at(*step, 1, &photo);
        maps.current_code().is_some_and(|code| code == whole)
    });
    assert!(step.is_some() && of(&maps, &cloud, &extra) == kept);
    assert!((0..100).any(|step| {
        maps.look_at(step, 1, &photo);
        maps.current_code().is_some_and(|code| code != whole)
    }));
    maps.forget();
    let mut moved = extra.clone();
    moved[0] += 0.5;
    let other = of(&maps, &cloud, &moved);
    assert!(other != kept);
    let mut redder = cloud.clone();
    redder.dc[2] += 0.5;
    assert!(of(&maps, &redder, &moved) != other);
    maps.set_tone_parameters(maps.tone_parameters().iter().map(|x| 1.5 * x).collect());
    assert!(of(&maps, &cloud, &extra) != kept);
}

#[test]
fn a_checkpoint_brings_back_networks_and_photos() {
    let (mut maps, _) = trained(9);
    let state: TensorMap = maps.state().into_iter().map(|t: Tensor<'_>| (t.name.clone(), t.into_owned())).collect();
    let (mut again, _) = trained(2);
    again.load(&state).unwrap();
    assert_eq!(again.tone_parameters(), maps.tone_parameters());
    for appearance in [Appearance::View(1), Appearance::Mean] {
        assert_eq!(again.code(&appearance), maps.code(&appearance));
    }
    let other = FeatureMaps::new(SETTINGS, PHOTOS, HORIZON, 3).unwrap().load(&state);
    assert!(other.unwrap_err().to_string().contains("maps."));
    maps.forget();
    assert_eq!(maps.step(Simd::best(), 9), 0);
}

#[test]
fn the_mean_is_that_of_the_photos_that_were_seen_and_it_has_no_camera() {
    let (maps, _) = trained(3);
    let codes: Vec<Vec<f32>> = (0..3).map(|photo| maps.code(&Appearance::View(photo))).collect();
    let mean = maps.code(&Appearance::Mean);
    assert_eq!(maps.code(&Appearance::View(3)), mean, "it was not seen");
    let maps_end = mean.len() - CAMERA;
    for k in 0..maps_end {
        assert!((mean[k] - codes.iter().map(|code| code[k] / 3.0).sum::<f32>()).abs() < 1e-5);
    }
    assert_eq!(mean[maps_end..], [0.0; CAMERA]);
    let none = FeatureMaps::new(SETTINGS, 0, HORIZON, 3).unwrap();
    assert!(none.code(&Appearance::Mean).iter().all(|x| *x == 0.0));
    let empty = Gaussians::new(0, 0).unwrap();
    none.forward(&Appearance::Mean, seen(&empty, &[], &[]), &mut []);
    let bar = none.code_bar(&code(), seen(&empty, &[], &[]), &[], &mut []);
    assert!(bar.len() == code().len() && bar.iter().all(|x| *x == 0.0));
}
