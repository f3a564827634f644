//! What an appearance from planes must do: tell places of a photo apart, keep, and come back.

use super::tests::{HORIZON, PHOTOS, SETTINGS};
use super::*;
use crate::cloud_reference::test_scene::{N, cloud, colours, seen, view, visible};
use crate::views::{ColourAppearance, ColourBars, Learns, PlaceCodes, SeenDepth, SeenPhoto};
use engine::system::{Appearance, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;

/// How bright each photo is on its left and on its right.
const SIDES: [[f32; 2]; PHOTOS] = [[0.5, 1.2], [1.2, 0.5], [0.6, 0.9], [1.0, 0.7]];
/// The cloud is about two units before the camera.
const DEPTH: SeenDepth<'_> = SeenDepth { size: [1, 1], z: &[2.0] };

/// A photo of noise, of other brightness on either side.
fn photo(sides: [f32; 2]) -> Vec<f32> {
    let mut noise = vec![0.0; 40 * 30];
    Rng::new(21, 0).fill_uniform(0, &mut noise);
    (0..3).flat_map(|_| noise.iter().enumerate().map(|(i, x)| sides[i % 40 / 20] * (0.3 + 0.4 * x))).collect()
}

/// What the colour of a Gaussian is multiplied with in a photo.
fn wanted(sides: [f32; 2], index: u32) -> f32 {
    sides[usize::from(cloud().mean[index as usize] > 0.0)]
}

/// Steps towards colours of each photo: those of the cloud times how bright the photo is there. Returns the mean square of each step's
/// errors, too.
fn trained(settings: TriplaneSettings, steps: u64) -> (Triplane, Vec<f32>) {
    let mut triplane = Triplane::new(settings, PHOTOS, HORIZON, 3).unwrap();
    let (cloud, visible, rgb, view) = (cloud(), visible(), colours(1), view());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let seen = seen(&cloud, &extra, &visible);
    let mut errors = Vec::new();
    for step in 0..steps {
        let of = step as usize % PHOTOS;
        let (appearance, sides, colour) = (Appearance::View(of), SIDES[of], photo(SIDES[of]));
        let depth = triplane.depth_side(step).map(|_| DEPTH);
        triplane.look_at(
            step,
            of,
            &SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth },
        );
        let mut toned = rgb.clone();
        triplane.forward(&appearance, seen, &mut toned);
        let mut bar: Vec<[f32; 3]> = Vec::new();
        for ((toned, rgb), gaussian) in toned.iter().zip(&rgb).zip(&visible) {
            let want = wanted(sides, gaussian.index);
            bar.push([0, 1, 2].map(|c| toned[c] - want * rgb[c]));
        }
        errors.push(bar.as_flattened().iter().map(|e| e * e).sum::<f32>() / bar.len() as f32);
        let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
        let bars = ColourBars { rgb: &mut bar, base: &mut base, extra: &mut extra_bar };
        triplane.backward(&appearance, seen, &rgb, bars);
        assert_eq!(triplane.step(Simd::best(), step), 0);
    }
    (triplane, errors)
}

const LEARNS: TriplaneSettings = TriplaneSettings { tone_width: 16, plane_channels: 4, ..SETTINGS };

#[test]
fn photos_of_another_brightness_on_either_side_are_read_where_gaussians_are() {
    let (triplane, _) = trained(LEARNS, 3 * HORIZON);
    let (cloud, visible, rgb, view) = (cloud(), visible(), colours(1), view());
    assert!((0..N).any(|i| cloud.mean[i] < 0.0) && (0..N).any(|i| cloud.mean[i] > 0.0));
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    // One that was not seen.
    let sides = [0.8, 1.1];
    let colour = photo(sides);
    let off = |appearance: &Appearance, sides: [f32; 2]| {
        let mut toned = rgb.clone();
        triplane.forward(appearance, seen(&cloud, &extra, &visible), &mut toned);
        let each = toned.iter().zip(&rgb).zip(&visible);
        each.flat_map(|((a, b), gaussian)| [0, 1, 2].map(|c| (a[c] - wanted(sides, gaussian.index) * b[c]).powi(2)))
            .sum::<f32>()
    };
    let code = |depth| {
        let photo = SeenPhoto { size: view.size, colour: &colour, weights: None, view: Some(&view), depth };
        Appearance::Code(triplane.encode(&photo).unwrap().into())
    };
    let of_all: f32 = (0..PHOTOS).map(|photo| off(&Appearance::View(photo), SIDES[photo])).sum();
    let of_others: f32 = (0..PHOTOS).map(|photo| off(&Appearance::View(photo), SIDES[(photo + 1) % PHOTOS])).sum();
    assert!(of_all < 0.1 * of_others, "{of_all} {of_others}");
    let (with, without) = (off(&code(Some(DEPTH)), sides), off(&code(None), sides));
    println!("a photo that was not seen: off by {with}, without depth by {without}");
}

#[test]
fn nothing_is_projected_back_before_its_time() {
    let (triplane, _) = trained(TriplaneSettings { plane_from: 1.0, ..LEARNS }, 9);
    let planes = triplane.code(&Appearance::View(1)).len() - 3 - 6;
    assert!(triplane.code(&Appearance::View(1))[..planes].iter().all(|x| *x == 0.0));
    // Planes that nothing went through have learnt nothing.
    let fresh = Triplane::new(TriplaneSettings { plane_from: 1.0, ..LEARNS }, PHOTOS, HORIZON, 3).unwrap();
    assert_eq!(triplane.encoder_parameters()[..100], fresh.encoder_parameters()[..100]);
    let (triplane, _) = trained(LEARNS, 9);
    assert!(triplane.code(&Appearance::View(1))[..planes].iter().any(|x| *x != 0.0));
}

#[test]
fn a_checkpoint_brings_back_networks_and_photos_with_their_depths() {
    let (mut triplane, _) = trained(LEARNS, 9);
    let state: TensorMap = triplane.state().into_iter().map(|t: Tensor<'_>| (t.name.clone(), t.into_owned())).collect();
    let (mut again, _) = trained(LEARNS, 2);
    again.load(&state).unwrap();
    assert_eq!(again.tone_parameters(), triplane.tone_parameters());
    for appearance in [Appearance::View(1), Appearance::Mean] {
        assert_eq!(again.code(&appearance), triplane.code(&appearance));
    }
    let other = Triplane::new(SETTINGS, PHOTOS, HORIZON, 3).unwrap().load(&state);
    assert!(other.unwrap_err().to_string().contains("triplane."));
    triplane.forget();
    assert_eq!(triplane.step(Simd::best(), 9), 0);
}

#[test]
fn the_mean_is_that_of_photos_as_a_whole_and_without_them_there_are_planes_alone() {
    let (triplane, _) = trained(LEARNS, 3);
    let mean = triplane.code(&Appearance::Mean);
    assert_eq!(triplane.code(&Appearance::View(3)), mean, "it was not seen");
    let first = mean.len() - 3;
    assert!(mean[..first].iter().all(|x| *x == 0.0));
    for (k, got) in mean.iter().enumerate().skip(first) {
        let want: f32 = (0..3).map(|photo| triplane.code(&Appearance::View(photo))[k] / 3.0).sum();
        assert!((got - want).abs() < 1e-5);
    }
    let (alone, errors) = trained(TriplaneSettings { photo_dims: 0, ..LEARNS }, HORIZON);
    assert!(alone.code(&Appearance::Mean).iter().all(|x| *x == 0.0));
    assert!(errors.iter().all(|e| e.is_finite()));
}
