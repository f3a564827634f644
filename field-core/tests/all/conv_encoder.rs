//! The image encoder against its `f64` twin, and its properties.

use crate::conv_twin::{encode, encode_backward, layers};
use field_core::conv::{Encoder, EncoderConfig, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;
use testkit::gradient::{Tolerance, check_kinked, compare, cotangent};

/// Small enough for differences.
fn tiny() -> EncoderConfig {
    EncoderConfig::new(2, vec![3, 4, 4, 3, 2], 5)
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x.into()).collect()
}

struct Run {
    encoder: Encoder,
    params: Vec<f32>,
    work: Workspace,
}

impl Run {
    fn new(config: EncoderConfig) -> Self {
        let encoder = Encoder::new(config).unwrap();
        let mut params = vec![f32::NAN; encoder.param_count()];
        encoder.init(Rng::new(3, 7), &mut params);
        Self { encoder, params, work: Workspace::default() }
    }

    fn codes(&mut self, simd: Simd, images: &[f32], size: Size) -> (Vec<f32>, Vec<f32>) {
        let mut acts = vec![f32::NAN; self.encoder.activations_len(size).unwrap()];
        let mut codes = vec![f32::NAN; size.images * self.encoder.code()];
        self.encoder.forward(simd, &self.params, images, size, &mut acts, &mut codes, &mut self.work).unwrap();
        (codes, acts)
    }
}

#[test]
fn sizes_are_those_of_the_publication() {
    let published = Encoder::new(EncoderConfig::published()).unwrap();
    // Convolutions and the linear layer, with biases.
    let want = 64 * (3 * 49 + 1) + 128 * (64 * 16 + 1) + 256 * (128 * 16 + 1) + 2 * 256 * (256 * 16 + 1) + 48 * 257;
    assert_eq!((published.param_count(), published.min_side()), (want, 16));
    let small = Encoder::new(EncoderConfig::small()).unwrap();
    assert_eq!((small.param_count(), small.code(), small.min_side()), (61_424, 48, 16));
    let counted: usize = layers(&EncoderConfig::small()).iter().map(|l| l.params()).sum();
    assert_eq!(small.param_count(), counted);
}

#[test]
fn codes_and_gradients_match_the_twin_at_every_level() {
    for simd in Simd::available() {
        for (config, size) in [
            (tiny(), Size { images: 2, height: 17, width: 22 }),
            (tiny(), Size { images: 1, height: 16, width: 16 }),
            (EncoderConfig::new(3, vec![16, 20, 18], 4), Size { images: 1, height: 12, width: 31 }),
            (EncoderConfig::new(1, vec![2], 1), Size { images: 3, height: 4, width: 5 }),
        ] {
            let mut run = Run::new(config.clone());
            let images: Vec<f32> = cotangent(size.len(config.inputs), 1).iter().map(|&x| x as f32).collect();
            let (codes, acts) = run.codes(simd, &images, size);
            let (params, x) = (wide(&run.params), wide(&images));
            let want = encode(&config, &params, &x, size);
            compare("codes", &codes, &want.last().unwrap().1, Tolerance::new(1e-5, 1e-6)).unwrap();

            let codes_bar: Vec<f32> = cotangent(codes.len(), 2).iter().map(|&x| x as f32).collect();
            let (want_params, want_images) = encode_backward(&config, &params, &x, size, &wide(&codes_bar));
            let (mut params_bar, mut images_bar) = (vec![0.5; params.len()], vec![0.25; images.len()]);
            let Run { encoder, params, work } = &mut run;
            encoder
                .backward(simd, params, &images, size, &acts, &codes_bar, &mut params_bar, Some(&mut images_bar), work)
                .unwrap();
            let add = |x: &[f64], start: f64| x.iter().map(|x| x + start).collect::<Vec<f64>>();
            compare("params_bar", &params_bar, &add(&want_params, 0.5), Tolerance::new(2e-5, 1e-5)).unwrap();
            compare("images_bar", &images_bar, &add(&want_images, 0.25), Tolerance::new(2e-5, 1e-6)).unwrap();
            let mut alone = vec![0.5; params.len()];
            encoder.backward(simd, params, &images, size, &acts, &codes_bar, &mut alone, None, work).unwrap();
            assert_eq!(alone, params_bar);
        }
    }
}

#[test]
fn the_twin_gradient_matches_central_differences() {
    let config = tiny();
    let run = Run::new(config.clone());
    let size = Size { images: 1, height: 17, width: 16 };
    let (params, images) = (wide(&run.params), cotangent(size.len(2), 1));
    let split = params.len();
    let all = [params, images].concat();
    let forward = |all: &[f64], codes: &mut [f64]| {
        codes.copy_from_slice(&encode(&config, &all[..split], &all[split..], size).pop().unwrap().1);
    };
    let backward = |all: &[f64], bar: &[f64], all_bar: &mut [f64]| {
        let (params_bar, images_bar) = encode_backward(&config, &all[..split], &all[split..], size, bar);
        all_bar.iter_mut().zip(params_bar.iter().chain(&images_bar)).for_each(|(a, b)| *a += b);
    };
    check_kinked(&all, &cotangent(5, 2), forward, backward, Tolerance::new(1e-6, 1e-8), 0.02).unwrap();
}

#[test]
fn a_constant_image_has_a_finite_code() {
    let mut run = Run::new(EncoderConfig::small());
    let size = Size::one(24, 40);
    for value in [0.0, 1.0, -1.0, 1e-30, 1e20] {
        let (codes, _) = run.codes(Simd::best(), &vec![value; size.len(3)], size);
        assert!(codes.iter().all(|c| c.is_finite()), "{value}: {codes:?}");
        // Without biases nothing comes of nothing.
        assert!(value != 0.0 || codes.iter().all(|&c| c == 0.0));
    }
}

#[test]
fn shifting_a_periodic_image_changes_the_code_by_its_border_only() {
    let mut run = Run::new(EncoderConfig::small());
    // Period 48, shifted by 16: another image, of which the encoder sees the same away from the border.
    let image = |side: usize, shift: usize, frequency: usize| -> Vec<f32> {
        let value = |c: usize, y: usize, x: usize| {
            let phase =
                ((x + shift) * frequency % 48) as f32 / 48.0 + (y * frequency % 48) as f32 / 24.0 + c as f32 * 0.3;
            (phase * std::f32::consts::TAU).sin()
        };
        (0..3 * side * side).map(|i| value(i / (side * side), i / side % side, i % side)).collect()
    };
    let mut distance = |side: usize, shift: usize, frequency: usize| {
        let size = Size::one(side, side);
        let (a, _) = run.codes(Simd::best(), &image(side, 0, 1), size);
        let (b, _) = run.codes(Simd::best(), &image(side, shift, frequency), size);
        a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
    };
    // Sides that hold whole periods, so that only the border differs.
    let (small, large) = (distance(96, 16, 1), distance(384, 16, 1));
    // The border's share falls as one over the side.
    assert!(small > 0.0 && large < small / 3.0, "{small} {large}");
    let other = distance(384, 0, 5);
    assert!(large < 0.05 * other, "{large} against another pattern's {other}");
}

#[test]
fn images_of_a_batch_do_not_see_each_other() {
    let mut run = Run::new(EncoderConfig::small());
    let size = Size { images: 3, height: 20, width: 18 };
    let images: Vec<f32> = cotangent(size.len(3), 1).iter().map(|&x| x as f32).collect();
    let (all, _) = run.codes(Simd::best(), &images, size);
    for i in 0..3 {
        let one = size.len(3) / 3;
        let (alone, _) = run.codes(Simd::best(), &images[i * one..][..one], Size { images: 1, ..size });
        assert_eq!(all[i * 48..][..48], alone[..]);
    }
}

#[test]
fn empty_batches_and_refusals() {
    let mut run = Run::new(EncoderConfig::small());
    let none = Size { images: 0, height: 16, width: 16 };
    let (codes, acts) = run.codes(Simd::best(), &[], none);
    assert!(codes.is_empty() && acts.is_empty());
    let mut params_bar = vec![1.0; run.params.len()];
    let Run { encoder, params, work } = &mut run;
    encoder.backward(Simd::best(), params, &[], none, &[], &[], &mut params_bar, None, work).unwrap();
    assert!(params_bar.iter().all(|&x| x == 1.0));

    let message = |size| encoder.activations_len(size).unwrap_err().to_string();
    assert_eq!(message(Size::one(15, 80)), "`height` is 15, expected at least 2 pixels for each halving and 4");
    assert_eq!(message(Size::one(16, 3)), "`width` is 3, expected at least 2 pixels for each halving and 4");
    assert!(encoder.activations_len(Size::one(16, 16)).is_ok());
    let size = Size::one(16, 16);
    let mut acts = vec![0.0; encoder.activations_len(size).unwrap()];
    let mut codes = [0.0; 47];
    let e = encoder.forward(Simd::best(), params, &[0.0; 768], size, &mut acts, &mut codes, work).unwrap_err();
    assert_eq!(e.to_string(), "`codes` holds 47 values, expected 48");

    let config = |inputs, channels, code| Encoder::new(EncoderConfig::new(inputs, channels, code));
    assert!(config(0, vec![4], 1).is_err());
    assert!(config(3, vec![], 1).is_err());
    assert!(config(3, vec![4, 0], 1).is_err());
    assert!(config(3, vec![4], 0).is_err());
}
