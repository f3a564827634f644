//! The tone of a cloud against its definition in `f64`, and what it must do.

use super::*;
use crate::views::{ColourAppearance, ColourBars, DrawnCloud, Learns, PlaceCodes, VisibleCloud};
use engine::system::{Appearance, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use splat_core::{Gaussians, ProjectedGaussian};
use std::sync::Arc;
use testkit::gradient::central_difference;
use testkit::reference::network::{Bias, Network};

const N: usize = 6;
const DIMS: usize = 3;
const WIDTH: usize = 5;
const SCALE: f32 = 0.7;
const PHOTOS: usize = 4;
const HORIZON: u64 = 200;

const SETTINGS: ToneSettings = ToneSettings {
    appearance_dims: DIMS,
    tone_width: WIDTH,
    tone_scale: SCALE,
    code_lr: 0.05,
    place_code_lr: 0.01,
    tone_lr: 0.01,
};

fn tone() -> Tone {
    let mut tone = Tone::new(SETTINGS, PHOTOS, HORIZON, 3).unwrap();
    let mut params = vec![0.0; tone.parameters().len()];
    Rng::new(8, 1).fill_uniform(0, &mut params);
    params.iter_mut().for_each(|p| *p = 1.4 * (*p - 0.45));
    tone.set_parameters(params);
    tone
}

fn cloud() -> Gaussians {
    let mut cloud = Gaussians::new(N, 1).unwrap();
    for (k, (_, values)) in (0..).zip(cloud.fields_mut()) {
        Rng::new(2, k).fill_uniform(0, values);
        values.iter_mut().for_each(|x| *x -= 0.5);
    }
    cloud
}

fn seen<'a>(gaussians: &'a Gaussians, extra: &'a [f32], visible: &'a [ProjectedGaussian]) -> VisibleCloud<'a> {
    let cloud = DrawnCloud { index: 0, gaussians, extra, composited: 0, degree: 1 };
    VisibleCloud { cloud, gaussians: visible, eye: None }
}

/// All but the second Gaussian, from the last to the first.
fn visible() -> Vec<ProjectedGaussian> {
    let index = (0..N as u32).rev().filter(|i| *i != 1);
    index.map(|index| ProjectedGaussian { index, ..ProjectedGaussian::default() }).collect()
}

fn colours(stream: u64) -> Vec<[f32; 3]> {
    let rng = Rng::new(11, stream);
    (0..N as u64 - 1).map(|i| rng.uniform4_at(i)).map(|u| [u[0], u[1], u[2]]).collect()
}

/// Everything that a toned colour depends on, in `f64`.
#[derive(Clone)]
struct Twin {
    network: Vec<f64>,
    code: Vec<f64>,
    /// `[3][n]`, `[ROWS][n]`.
    base: Vec<f64>,
    places: Vec<f64>,
    rgb: Vec<f64>,
}

impl Twin {
    fn toned(&self) -> Vec<f64> {
        const OWN: usize = 3 + PlaceCodes::ROWS;
        let network = Network { widths: &[OWN + DIMS, WIDTH, WIDTH, 6], skips: &[], bias: Bias::Each };
        // One first layer, of what belongs to a Gaussian and of the code.
        let (own, of_code) = self.network.split_at(self.network.len() - WIDTH * DIMS);
        let rows = own.chunks_exact(OWN).zip(of_code.chunks_exact(DIMS));
        let mut params: Vec<f64> = rows.flat_map(|(own, code)| [own, code].concat()).collect();
        params.extend(&own[WIDTH * OWN..]);
        assert_eq!(params.len(), network.param_count());
        let mut out = Vec::new();
        for (k, gaussian) in visible().iter().enumerate() {
            let i = gaussian.index as usize;
            let mut x: Vec<f64> = (0..3).map(|c| self.base[c * N + i]).collect();
            x.extend((0..PlaceCodes::ROWS).map(|row| self.places[row * N + i]));
            x.extend(&self.code);
            let y = network.forward(&params, &x);
            let scale = f64::from(SCALE);
            out.extend((0..3).map(|c| (1.0 + scale * y[3 + c]) * self.rgb[3 * k + c] + scale * y[c]));
        }
        out
    }

    fn value(&self, weights: &[[f32; 3]]) -> f64 {
        self.toned().iter().zip(weights.as_flattened()).map(|(x, w)| x * f64::from(*w)).sum()
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

/// Largest difference between gradients and differences of the twin, relative to the largest gradient.
fn worst(twin: &Twin, weights: &[[f32; 3]], got: &[f32], part: impl Fn(&mut Twin) -> &mut Vec<f64>) -> f64 {
    let want = central_difference(&part(&mut twin.clone()).clone(), |values| {
        let mut at = twin.clone();
        part(&mut at).copy_from_slice(values);
        at.value(weights)
    });
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(largest > 1e-3, "nothing depends on it");
    want.iter().zip(got).map(|(want, got)| (want - f64::from(*got)).abs() / largest).fold(0.0, f64::max)
}

#[test]
fn tones_and_their_gradients_are_those_of_the_definition() {
    let (mut tone, cloud, visible) = (tone(), cloud(), visible());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let seen = seen(&cloud, &extra, &visible);
    let appearance = Appearance::View(2);
    let (rgb, weights) = (colours(1), colours(2));
    let twin = Twin {
        network: wide(tone.parameters()),
        code: wide(&tone.code(&appearance)),
        base: wide(&cloud.dc),
        places: wide(&extra),
        rgb: wide(rgb.as_flattened()),
    };
    let mut toned = rgb.clone();
    tone.forward(&appearance, seen, &mut toned);
    for (got, want) in toned.as_flattened().iter().zip(twin.toned()) {
        assert!((f64::from(*got) - want).abs() < 1e-5, "{got} {want}");
    }

    let mut bar = weights.clone();
    let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
    let bars = ColourBars { rgb: &mut bar, base: &mut base, extra: &mut extra_bar };
    tone.backward(&appearance, seen, &rgb, bars);
    let mut base_bar = vec![0.0; 3 * N];
    for (gaussian, base) in visible.iter().zip(&base) {
        (0..3).for_each(|c| base_bar[c * N + gaussian.index as usize] = base[c]);
    }
    let (network_bar, code_bar) = tone.gradients();
    for (name, error) in [
        ("colours", worst(&twin, &weights, bar.as_flattened(), |twin| &mut twin.rgb)),
        ("base", worst(&twin, &weights, &base_bar, |twin| &mut twin.base)),
        ("places", worst(&twin, &weights, &extra_bar, |twin| &mut twin.places)),
        ("code", worst(&twin, &weights, &code_bar, |twin| &mut twin.code)),
        ("network", worst(&twin, &weights, &network_bar, |twin| &mut twin.network)),
    ] {
        assert!(error < 1e-4, "{name}: {error}");
    }
    // The code alone, as a fit asks for it.
    let alone = tone.code_bar(&tone.code(&appearance), seen, &rgb, &mut weights.clone());
    assert_eq!(alone, code_bar);
}

/// Steps towards colours of each photo: those of the cloud times a tint. Returns the mean square of each step's errors, too.
fn trained(tint: impl Fn(usize) -> [f32; 3], steps: u64) -> (Tone, Vec<f32>) {
    let mut tone = Tone::new(ToneSettings { tone_width: 16, ..SETTINGS }, PHOTOS, HORIZON, 3).unwrap();
    let (cloud, visible, rgb) = (cloud(), visible(), colours(1));
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let seen = seen(&cloud, &extra, &visible);
    let mut errors = Vec::new();
    for step in 0..steps {
        let photo = step as usize % PHOTOS;
        let (appearance, tint) = (Appearance::View(photo), tint(photo));
        let mut toned = rgb.clone();
        tone.forward(&appearance, seen, &mut toned);
        let away = |(toned, rgb): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|c| toned[c] - tint[c] * rgb[c]);
        let mut bar: Vec<[f32; 3]> = toned.iter().zip(&rgb).map(away).collect();
        errors.push(bar.as_flattened().iter().map(|e| e * e).sum::<f32>() / bar.len() as f32);
        let (mut base, mut extra_bar) = (vec![[0.0; 3]; visible.len()], vec![0.0; extra.len()]);
        let bars = ColourBars { rgb: &mut bar, base: &mut base, extra: &mut extra_bar };
        tone.backward(&appearance, seen, &rgb, bars);
        assert_eq!(tone.step(Simd::best(), step), 0);
    }
    (tone, errors)
}

#[test]
fn photos_of_other_tints_are_learnt_each_in_its_code() {
    let tints = |photo: usize| [[1.0; 3], [0.6, 0.9, 1.2], [1.3, 1.0, 0.7], [0.8; 3]][photo];
    let (tone, errors) = trained(tints, 2 * HORIZON);
    let of_all = |errors: &[f32]| errors.iter().sum::<f32>();
    let [first, last] = [&errors[..PHOTOS], &errors[errors.len() - PHOTOS..]].map(of_all);
    assert!(last < 0.05 * first, "{first} {last}");
    let codes: Vec<Vec<f32>> = (0..PHOTOS).map(|photo| tone.code(&Appearance::View(photo))).collect();
    assert!(codes[0].iter().zip(&codes[1]).any(|(a, b)| (a - b).abs() > 0.05), "{codes:?}");
}

#[test]
fn a_checkpoint_brings_back_codes_and_network() {
    let (mut tone, _) = trained(|photo| [0.5 + 0.2 * photo as f32; 3], 9);
    let state: TensorMap = tone.state().into_iter().map(|t: Tensor<'_>| (t.name.clone(), t.into_owned())).collect();
    let (mut again, _) = trained(|_| [1.0; 3], 2);
    again.load(&state).unwrap();
    assert_eq!(again.parameters(), tone.parameters());
    assert_eq!(again.code(&Appearance::View(1)), tone.code(&Appearance::View(1)));
    let other = Tone::new(SETTINGS, PHOTOS, HORIZON, 3).unwrap().load(&state);
    assert!(other.unwrap_err().to_string().contains("tone.network"));
    tone.forget();
    assert_eq!(tone.step(Simd::best(), 9), 0);
}

#[test]
fn given_codes_and_their_mean_are_appearances_and_nothing_visible_is_nothing() {
    let tone = tone();
    let codes: Vec<Vec<f32>> = (0..PHOTOS).map(|photo| tone.code(&Appearance::View(photo))).collect();
    let mean = tone.code(&Appearance::Mean);
    for k in 0..DIMS {
        let want = codes.iter().map(|code| code[k]).sum::<f32>() / PHOTOS as f32;
        assert!((mean[k] - want).abs() < 1e-6);
    }
    let given: Arc<[f32]> = Arc::from([1.0, 2.0, 3.0]);
    assert_eq!(tone.code(&Appearance::Code(given.clone())), [1.0, 2.0, 3.0]);
    let empty = Gaussians::new(0, 0).unwrap();
    tone.forward(&Appearance::Code(given.clone()), seen(&empty, &[], &[]), &mut []);
    let bar = tone.code_bar(&given, seen(&empty, &[], &[]), &[], &mut []);
    assert_eq!(bar, [0.0; DIMS]);
}

#[test]
fn what_cannot_work_is_refused_by_its_name() {
    for (bad, name) in [
        (ToneSettings { appearance_dims: 0, ..SETTINGS }, "appearance_dims"),
        (ToneSettings { tone_width: 513, ..SETTINGS }, "tone_width"),
        (ToneSettings { tone_scale: 0.0, ..SETTINGS }, "tone_scale"),
        (ToneSettings { code_lr: f64::NAN, ..SETTINGS }, "code_lr"),
        (ToneSettings { place_code_lr: -1.0, ..SETTINGS }, "place_code_lr"),
        (ToneSettings { tone_lr: 0.0, ..SETTINGS }, "tone_lr"),
    ] {
        let error = Tone::new(bad, 2, 100, 0).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(name)), "{name}: {error:?}");
    }
}

#[test]
#[should_panic(expected = "as many numbers")]
fn a_code_of_another_system_is_refused() {
    let (tone, cloud) = (tone(), cloud());
    let extra = PlaceCodes::of(&cloud).rows(&cloud);
    let code: Arc<[f32]> = Arc::from([1.0; DIMS + 1]);
    tone.forward(&Appearance::Code(code), seen(&cloud, &extra, &visible()), &mut colours(1));
}
