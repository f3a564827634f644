//! PSNR, SSIM, MS-SSIM and their masked forms: against plain loops, and the properties every such metric has.

use losses::metrics::{
    Border, Clamp, Image, MS_SSIM_MIN_SIDE, MaskedSsim, MetricError, SsimVariant, Window, masked_mse, masked_psnr,
    masked_ssim, ms_ssim, mse, psnr, psnr_of_mse, quantise, ssim,
};
use proptest::{collection::vec, prelude::*};

const C1: f64 = 1e-4;
const C2: f64 = 9e-4;

fn variants() -> impl Iterator<Item = SsimVariant> {
    [Window::Eleven, Window::Three].into_iter().flat_map(|window| {
        [Border::Valid, Border::Reflect, Border::Zero].into_iter().flat_map(move |border| {
            [Clamp::No, Clamp::Yes]
                .into_iter()
                .map(move |clamp| SsimVariant::REFERENCE.with_window(window).with_border(border).with_clamp(clamp))
        })
    })
}

/// The definitions: a two-dimensional window, moments about the mean, no running sums.
mod naive {
    use super::*;

    pub(crate) fn window(side: usize) -> Vec<f64> {
        let r = (side / 2) as f64;
        let g = |i: usize| (-((i as f64 - r).powi(2)) / (2.0 * 1.5 * 1.5)).exp();
        let raw: Vec<f64> = (0..side * side).map(|i| g(i % side) * g(i / side)).collect();
        let total: f64 = raw.iter().sum();
        raw.iter().map(|x| x / total).collect()
    }

    /// From weights, values of one image and values of the other.
    pub(crate) fn similarity(g: &[f64], a: &[f64], b: &[f64]) -> f64 {
        let mean = |f: &dyn Fn(usize) -> f64| (0..g.len()).map(|i| g[i] * f(i)).sum::<f64>();
        let (mu_a, mu_b) = (mean(&|i| a[i]), mean(&|i| b[i]));
        let (var_a, var_b) = (mean(&|i| (a[i] - mu_a).powi(2)), mean(&|i| (b[i] - mu_b).powi(2)));
        let cov = mean(&|i| (a[i] - mu_a) * (b[i] - mu_b));
        (2.0 * mu_a * mu_b + C1) * (2.0 * cov + C2) / ((mu_a * mu_a + mu_b * mu_b + C1) * (var_a + var_b + C2))
    }

    pub(crate) fn ssim(a: &[f32], b: &[f32], [w, h, c]: [usize; 3], variant: SsimVariant) -> f64 {
        let side = variant.window.side();
        let (g, r) = (window(side), (side / 2) as isize);
        let fold = |i: isize, n: usize| match (usize::try_from(i), variant.border) {
            (Ok(i), _) if i < n => Some(i),
            (_, Border::Reflect) if i < 0 => Some(-i as usize),
            (Ok(i), Border::Reflect) => Some(2 * n - 2 - i),
            _ => None,
        };
        let inset = if variant.border == Border::Valid { r } else { 0 };
        let (mut total, mut count) = (0.0, 0);
        for channel in 0..c {
            for y in inset..h as isize - inset {
                for x in inset..w as isize - inset {
                    let see = |image: &[f32]| -> Vec<f64> {
                        let offset = |i: usize| ((i / side) as isize - r, (i % side) as isize - r);
                        let at = |(dy, dx)| match (fold(y + dy, h), fold(x + dx, w)) {
                            (Some(y), Some(x)) => f64::from(image[(y * w + x) * c + channel]),
                            _ => 0.0,
                        };
                        (0..side * side).map(|i| at(offset(i))).collect()
                    };
                    let value = similarity(&g, &see(a), &see(b));
                    total += if variant.clamp == Clamp::Yes { value.clamp(0.0, 1.0) } else { value };
                    count += 1;
                }
            }
        }
        total / f64::from(count)
    }

    /// The corrected masked form: one two-dimensional window of kept weights.
    pub(crate) fn masked_ssim(a: &[f32], b: &[f32], m: &[f32], [w, h, c]: [usize; 3]) -> f64 {
        let g = window(11);
        let (mut total, mut count) = (0.0, 0);
        for channel in 0..c {
            for y in 0..=h - 11 {
                for x in 0..=w - 11 {
                    let at = |i: usize| (y + i / 11) * w + x + i % 11;
                    let kept: Vec<f64> = (0..121).map(|i| g[i] * f64::from(m[at(i)])).collect();
                    let mass: f64 = kept.iter().sum();
                    if mass > 0.0 {
                        let kept: Vec<f64> = kept.iter().map(|k| k / mass).collect();
                        let see = |x: &[f32]| (0..121).map(|i| f64::from(x[at(i) * c + channel])).collect::<Vec<_>>();
                        total += similarity(&kept, &see(a), &see(b));
                        count += 1;
                    }
                }
            }
        }
        total / f64::from(count)
    }
}

/// Two images of one shape, a mask, and the shape `[w, h, c]`: noise, flat areas, values nearly equal.
fn any_pair() -> impl Strategy<Value = (Vec<f32>, Vec<f32>, Vec<f32>, [usize; 3])> {
    (11_usize..18, 11_usize..16, prop_oneof![Just(1_usize), Just(3)]).prop_flat_map(|(w, h, c)| {
        let n = w * h * c;
        let image = prop_oneof![
            vec(0.0_f32..=1.0, n),
            (0.0_f32..=1.0, vec(-1e-3_f32..1e-3, n)).prop_map(|(v, x)| x.iter().map(|x| v + x).collect()),
            (0.0_f32..=1.0).prop_map(move |v| vec![v; n]),
        ];
        let other = (image.clone(), 0.0_f32..=1.0);
        let mask = vec(prop_oneof![Just(0.0_f32), Just(1.0), 0.0_f32..=1.0], w * h);
        (image, other, mask).prop_map(move |(a, (noise, share), mut m)| {
            let b = a.iter().zip(&noise).map(|(a, x)| a + share * (x - a)).collect();
            m[0] = 1.0; // keeps something
            (a, b, m, [w, h, c])
        })
    })
}

fn image(data: &[f32], [w, h, c]: [usize; 3]) -> Image<'_> {
    Image::from_f32(w, h, c, data).unwrap()
}

/// By how much two orders of the same sums may change SSIM beside rounding itself: covariances are held to `sqrt(var_a var_b)`, and
/// where an image is flat its variance is rounding `d`, whose root is more than rounding: `sqrt(var_a (var_b + d)) - sqrt(var_a var_b)`.
fn flat_rounding(a: &[f32], b: &[f32], channels: usize) -> f64 {
    const D: f64 = 2e-15;
    let variance = |x: &[f32], c: usize| {
        let plane: Vec<f64> = x.iter().skip(c).step_by(channels).map(|x| f64::from(*x)).collect();
        let mean = plane.iter().sum::<f64>() / plane.len() as f64;
        plane.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / plane.len() as f64
    };
    let of_channel = |c: usize| {
        let (x, y) = (variance(a, c), variance(b, c));
        let (most, least) = (x.max(y), x.min(y));
        ((most * (least + D)).sqrt() - (most * least).sqrt()) * 2.0 / 9e-4
    };
    (0..channels).map(of_channel).fold(0.0, f64::max)
}

fn permuted(x: &[f32], [w, h, c]: [usize; 3], from: impl Fn(usize, usize, usize) -> (usize, usize, usize)) -> Vec<f32> {
    let index = |(x, y, k): (usize, usize, usize)| (y * w + x) * c + k;
    (0..x.len()).map(|i| x[index(from(i / c % w, i / (w * c) % h, i % c))]).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    #[test]
    fn ssim_matches_naive((a, b, _, shape) in any_pair()) {
        for variant in variants() {
            let got = ssim(&image(&a, shape), &image(&b, shape), variant).unwrap();
            let want = naive::ssim(&a, &b, shape, variant);
            prop_assert!((got - want).abs() <= 1e-10, "{variant}: {got}, {want}");
        }
    }

    #[test]
    fn corrected_masked_ssim_matches_naive((a, b, m, shape) in any_pair()) {
        let got = masked_ssim(&image(&a, shape), &image(&b, shape), &m, MaskedSsim::Corrected).unwrap();
        let want = naive::masked_ssim(&a, &b, &m, shape);
        // Light weights amplify rounding of E[x^2] - mu^2 by their smallness, not more.
        prop_assert!((got - want).abs() <= 1e-9, "{got}, {want}");
    }

    #[test]
    fn a_full_mask_changes_nothing((a, b, _, shape) in any_pair()) {
        let rounding = 1e-12 + flat_rounding(&a, &b, shape[2]);
        let (a, b, full) = (image(&a, shape), image(&b, shape), vec![1.0; shape[0] * shape[1]]);
        let want = ssim(&a, &b, SsimVariant::REFERENCE).unwrap();
        for variant in [MaskedSsim::DyCheck, MaskedSsim::Corrected] {
            prop_assert!((masked_ssim(&a, &b, &full, variant).unwrap() - want).abs() <= rounding);
        }
        prop_assert!((masked_mse(&a, &b, &full).unwrap() - mse(&a, &b).unwrap()).abs() <= 1e-15);
    }

    #[test]
    fn pixels_outside_the_mask_do_not_matter((a, b, m, shape) in any_pair(), poison in 0.0_f32..=1.0) {
        let poisoned: Vec<f32> =
            b.iter().enumerate().map(|(i, &v)| if m[i / shape[2]] == 0.0 { poison } else { v }).collect();
        let (a, b, p) = (image(&a, shape), image(&b, shape), image(&poisoned, shape));
        prop_assert_eq!(masked_mse(&a, &b, &m).unwrap(), masked_mse(&a, &p, &m).unwrap());
        for variant in [MaskedSsim::DyCheck, MaskedSsim::Corrected] {
            prop_assert_eq!(masked_ssim(&a, &b, &m, variant).unwrap(), masked_ssim(&a, &p, &m, variant).unwrap());
        }
    }

    #[test]
    fn metrics_are_symmetric_and_bounded((a, b, m, shape) in any_pair()) {
        let (a, b) = (image(&a, shape), image(&b, shape));
        prop_assert_eq!(psnr(&a, &b).unwrap(), psnr(&b, &a).unwrap());
        prop_assert_eq!(masked_mse(&a, &b, &m).unwrap(), masked_mse(&b, &a, &m).unwrap());
        for variant in variants() {
            let s = ssim(&a, &b, variant).unwrap();
            prop_assert_eq!(s, ssim(&b, &a, variant).unwrap());
            prop_assert!((-1.0..=1.0).contains(&s), "{variant}: {s}");
            prop_assert!(variant.clamp == Clamp::No || s >= 0.0);
        }
    }

    #[test]
    fn equal_images_are_perfect((a, _, m, shape) in any_pair()) {
        let a = image(&a, shape);
        prop_assert_eq!(psnr(&a, &a).unwrap(), f64::INFINITY);
        prop_assert_eq!(masked_psnr(&a, &a, &m).unwrap(), f64::INFINITY);
        for variant in variants() {
            prop_assert_eq!(ssim(&a, &a, variant).unwrap(), 1.0, "{}", variant);
        }
        prop_assert_eq!(masked_ssim(&a, &a, &m, MaskedSsim::DyCheck).unwrap(), 1.0);
        prop_assert_eq!(masked_ssim(&a, &a, &m, MaskedSsim::Corrected).unwrap(), 1.0);
    }

    #[test]
    fn flips_and_channel_order_do_not_matter((a, b, _, shape) in any_pair()) {
        let [w, h, c] = shape;
        let mirrored = |x: &[f32]| permuted(x, shape, |x, y, k| (w - 1 - x, y, k));
        let upside_down = |x: &[f32]| permuted(x, shape, |x, y, k| (x, h - 1 - y, k));
        let rolled = |x: &[f32]| permuted(x, shape, |x, y, k| (x, y, (k + 1) % c));
        let (ia, ib) = (image(&a, shape), image(&b, shape));
        for f in [&mirrored as &dyn Fn(&[f32]) -> Vec<f32>, &upside_down, &rolled] {
            let (fa, fb) = (f(&a), f(&b));
            let (fa, fb) = (image(&fa, shape), image(&fb, shape));
            let (s, t) = (mse(&ia, &ib).unwrap(), mse(&fa, &fb).unwrap());
            // A sum of so many numbers, each addition rounded by half an eps of it.
            prop_assert!((s - t).abs() <= 1e-15_f64.max(0.5 * f64::EPSILON * a.len() as f64 * s), "{s}, {t}");
            for variant in variants() {
                let (s, t) = (ssim(&ia, &ib, variant).unwrap(), ssim(&fa, &fb, variant).unwrap());
                prop_assert!((s - t).abs() <= 1e-11 + flat_rounding(&a, &b, c), "{variant}: {s}, {t}");
            }
        }
    }

    #[test]
    fn constant_images_have_the_known_ssim(a in 0.0_f32..=1.0, b in 0.0_f32..=1.0) {
        let (va, vb) = (f64::from(a), f64::from(b));
        let want = (2.0 * va * vb + C1) / (va * va + vb * vb + C1);
        let (ia, ib) = (vec![a; 13 * 12], vec![b; 13 * 12]);
        for variant in variants().filter(|v| v.border != Border::Zero) {
            let got = ssim(&image(&ia, [13, 12, 1]), &image(&ib, [13, 12, 1]), variant).unwrap();
            // The variances are what rounding leaves, 1e-16 against C2.
            prop_assert!((got - want).abs() <= 1e-11, "{variant}: {got}, {want}");
        }
    }

    #[test]
    fn quantising_moves_a_value_by_half_a_level(x in vec(-0.5_f32..1.5, 0..50)) {
        for (x, q) in x.iter().zip(quantise(&x)) {
            prop_assert!((f64::from(q) / 255.0 - f64::from(x.clamp(0.0, 1.0))).abs() <= 0.5 / 255.0 + 1e-7);
        }
    }
}

#[test]
fn an_offset_of_a_tenth_is_twenty_decibels() {
    // In 8 bit no offset is 0.1; 51 levels are exactly 0.2, which is 20 - 20 log10(2).
    let (a, b) = ([10_u8; 48], [61_u8; 48]);
    let got = psnr(&Image::from_u8(4, 4, 3, &a).unwrap(), &Image::from_u8(4, 4, 3, &b).unwrap()).unwrap();
    assert!((got - (20.0 - 20.0 * 2.0_f64.log10())).abs() < 1e-12, "{got}");
    let (a, b) = ([0.25_f32; 48], [0.35_f32; 48]);
    let got = psnr(&image(&a, [4, 4, 3]), &image(&b, [4, 4, 3])).unwrap();
    assert!((got - 20.0).abs() < 1e-5, "{got}: 0.35 - 0.25 in f32 is 0.1 to 1e-7");
    assert!((psnr_of_mse(0.01) - 20.0).abs() < 1e-14);
    assert_eq!(psnr_of_mse(0.0), f64::INFINITY);
    assert_eq!(psnr_of_mse(1.0), 0.0);
}

#[test]
fn an_inverted_checkerboard_is_negative() {
    let a: Vec<f32> = (0..20 * 20).map(|i| ((i % 20 + i / 20) % 2) as f32).collect();
    let b: Vec<f32> = a.iter().map(|x| 1.0 - x).collect();
    let s = ssim(&image(&a, [20, 20, 1]), &image(&b, [20, 20, 1]), SsimVariant::REFERENCE).unwrap();
    assert!((-1.0..-0.9).contains(&s), "{s}");
    let clamped = SsimVariant::REFERENCE.with_clamp(Clamp::Yes);
    assert_eq!(ssim(&image(&a, [20, 20, 1]), &image(&b, [20, 20, 1]), clamped).unwrap(), 0.0);
}

#[test]
fn ms_ssim_is_one_for_equal_images_and_never_nan() {
    let side = MS_SSIM_MIN_SIDE;
    let a: Vec<f32> = (0..side * side).map(|i| (i * 7919 % 251) as f32 / 250.0).collect();
    let inverted: Vec<f32> = a.iter().map(|x| 1.0 - x).collect();
    let shape = [side, side, 1];
    let (a, inverted) = (image(&a, shape), image(&inverted, shape));
    assert_eq!(ms_ssim(&a, &a).unwrap(), 1.0);
    // Every contrast term is negative: clamped to 0 before the fractional power.
    assert_eq!(ms_ssim(&a, &inverted).unwrap(), 0.0);
}

#[test]
fn windows_larger_than_the_image_are_errors() {
    let data = vec![0.5; 200 * 200];
    let sized = |w: usize, h: usize| Image::from_f32(w, h, 1, &data[..w * h]).unwrap();
    for variant in variants() {
        let side = variant.window.side();
        assert!(ssim(&sized(side, side), &sized(side, side), variant).is_ok());
        for (w, h) in [(side - 1, 40), (40, side - 1), (0, 0)] {
            let error = ssim(&sized(w, h), &sized(w, h), variant).unwrap_err();
            assert!(matches!(error, MetricError::TooSmall { .. }), "{error}");
        }
    }
    let error = ms_ssim(&sized(160, 200), &sized(160, 200)).unwrap_err();
    assert_eq!(error.to_string(), "MS-SSIM needs images of at least 161 pixels a side, these are 160x200");
    assert!(ms_ssim(&sized(161, 161), &sized(161, 161)).is_ok());
    let mask = [1.0; 100];
    let error = masked_ssim(&sized(10, 10), &sized(10, 10), &mask, MaskedSsim::DyCheck).unwrap_err();
    assert!(matches!(error, MetricError::TooSmall { min_side: 11, .. }));
    assert!(matches!(mse(&sized(0, 4), &sized(0, 4)), Err(MetricError::TooSmall { .. })), "the mean of nothing");
}

#[test]
fn bad_images_and_masks_are_named() {
    let data = [0.5_f32; 12];
    assert_eq!(Image::from_f32(2, 2, 4, &data).unwrap_err(), MetricError::Shape { what: "image", want: 16, got: 12 });
    assert!(Image::from_u8(usize::MAX, 2, 3, &[0; 6]).is_err(), "the product overflows");
    let poisoned = [0.5, f32::NAN, 0.5, f32::INFINITY];
    assert_eq!(Image::from_f32(2, 2, 1, &poisoned).unwrap_err(), MetricError::NonFinite { index: 1 });
    let (a, b) = (Image::from_f32(2, 2, 3, &data).unwrap(), Image::from_f32(4, 1, 3, &data).unwrap());
    let error = psnr(&a, &b).unwrap_err();
    assert_eq!(error.to_string(), "images of different shapes: 2x2 with 3 channels and 4x1 with 3");
    assert_eq!(masked_psnr(&a, &a, &[1.0; 3]).unwrap_err(), MetricError::Shape { what: "mask", want: 4, got: 3 });
    assert_eq!(masked_mse(&a, &a, &[1.0, 2.0, 0.0, 0.0]), Err(MetricError::Mask { index: 1, value: 2.0 }));
    assert!(matches!(masked_mse(&a, &a, &[1.0, 0.0, f32::NAN, 0.0]), Err(MetricError::Mask { index: 2, .. })));
}

#[test]
fn an_empty_mask_has_no_psnr() {
    let (a, b) = (vec![0.2_f32; 144], vec![0.7_f32; 144]);
    let (a, b, none) = (image(&a, [12, 12, 1]), image(&b, [12, 12, 1]), vec![0.0; 144]);
    assert_eq!(masked_psnr(&a, &b, &none), Err(MetricError::EmptyMask));
    assert_eq!(masked_mse(&a, &b, &none), Ok(0.0));
    assert_eq!(masked_ssim(&a, &b, &none, MaskedSsim::Corrected), Err(MetricError::EmptyMask));
    assert_eq!(masked_ssim(&a, &b, &none, MaskedSsim::DyCheck), Ok(1.0));
}

#[test]
fn variants_print_their_name() {
    assert_eq!(SsimVariant::REFERENCE.to_string(), "SSIM (window 11, valid)");
    assert_eq!(SsimVariant::SMALL_WINDOW.to_string(), "SSIM (window 3, zero, clamped)");
    let names: std::collections::HashSet<String> = variants().map(|v| v.to_string()).collect();
    assert_eq!(names.len(), 12);
}

#[test]
fn values_far_outside_the_range_stay_finite() {
    let mut data = vec![0.5_f32; 144];
    (data[7], data[9], data[11]) = (f32::MAX, -f32::MAX, 1e-45);
    let (a, flat) = (image(&data, [12, 12, 1]), vec![0.5_f32; 144]);
    let b = image(&flat, [12, 12, 1]);
    assert!(psnr(&a, &b).unwrap().is_finite());
    for variant in variants() {
        let s = ssim(&a, &b, variant).unwrap();
        assert!((-1.0..=1.0).contains(&s), "{variant}: {s}");
    }
}
