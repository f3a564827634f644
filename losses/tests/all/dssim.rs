//! D-SSIM against its definition: 121 taps at every pixel, in `f64`.

use float_core::Simd;
use losses::LossError;
use losses::dssim::{Dssim, L1Dssim, Pair, Target};
use losses::metrics::{Image, SsimVariant, ssim};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, compare, cotangent};

const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
const REACH: isize = 5;

/// A picture's size: `[channels, height, width]`.
type Size = [usize; 3];

fn pair<'a>(size: Size, x: &'a [f32], y: &'a [f32], weights: Option<&'a [f32]>) -> Pair<'a> {
    let [channels, height, width] = size;
    Pair { channels, height, width, x, target: Target::Planes(y), weights }
}

/// The window at two offsets; the sum over all 121 is 1.
fn window(dy: isize, dx: isize) -> f64 {
    let raw = |d: isize| (-(d * d) as f64 / 4.5).exp();
    let total: f64 = (-REACH..=REACH).map(raw).sum();
    raw(dy) * raw(dx) / (total * total)
}

/// Pixels of the window around one pixel, with their weights; those outside the picture are black.
fn around([_, height, width]: Size, pixel: usize) -> impl Iterator<Item = (usize, f64)> {
    let (row, column) = ((pixel / width) as isize, (pixel % width) as isize);
    let offsets = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dy, dx)));
    offsets.filter_map(move |(dy, dx)| {
        let (r, c) = (row + dy, column + dx);
        let inside = (0..height as isize).contains(&r) && (0..width as isize).contains(&c);
        inside.then(|| ((r * width as isize + c) as usize, window(dy, dx)))
    })
}

/// Moments `[mu_x, mu_y, e_xx, e_yy, e_xy]` around one pixel of a plane.
fn moments(size: Size, x: &[f64], y: &[f64], pixel: usize) -> [f64; 5] {
    around(size, pixel).fold([0.0; 5], |m, (i, w)| {
        let products = [x[i], y[i], x[i] * x[i], y[i] * y[i], x[i] * y[i]];
        std::array::from_fn(|k| m[k] + w * products[k])
    })
}

/// A picture that is black where a pixel is left out, as beyond its edge.
fn black_where_left_out(x: &[f64], g: &[f64]) -> Vec<f64> {
    x.iter().enumerate().map(|(i, x)| if g[i % g.len()] == 0.0 { 0.0 } else { *x }).collect()
}

/// The loss `(1 - lambda) mean g |x - y| + lambda mean g (1 - s)` by the usual formula.
fn twin(size: Size, x: &[f64], y: &[f64], g: &[f64], lambda: f64) -> f64 {
    let plane = size[1] * size[2];
    let (x, y) = (&black_where_left_out(x, g)[..], &black_where_left_out(y, g)[..]);
    let mut loss = 0.0;
    for i in 0..x.len() {
        let (start, pixel) = (i / plane * plane, i % plane);
        let [mx, my, xx, yy, xy] = moments(size, &x[start..], &y[start..], pixel);
        let (a1, a2) = (2.0 * mx * my + C1, 2.0 * (xy - mx * my) + C2);
        let (b1, b2) = (mx * mx + my * my + C1, xx - mx * mx + yy - my * my + C2);
        loss += g[pixel] * ((1.0 - lambda) * (x[i] - y[i]).abs() + lambda * (1.0 - a1 * a2 / (b1 * b2)));
    }
    loss / x.len() as f64
}

/// Its gradient: every pixel of the map hands its share to the pixels of its window.
fn twin_backward(size: Size, x: &[f64], y: &[f64], g: &[f64], lambda: f64, bar: f64, x_bar: &mut [f64]) {
    let plane = size[1] * size[2];
    let bar = bar / x.len() as f64;
    let (x, y) = (&black_where_left_out(x, g)[..], &black_where_left_out(y, g)[..]);
    for i in 0..x.len() {
        let (start, pixel) = (i / plane * plane, i % plane);
        let [mx, my, xx, yy, xy] = moments(size, &x[start..], &y[start..], pixel);
        let (a1, a2) = (2.0 * mx * my + C1, 2.0 * (xy - mx * my) + C2);
        let (b1, b2) = (mx * mx + my * my + C1, xx - mx * mx + yy - my * my + C2);
        let s = a1 * a2 / (b1 * b2);
        let of_mu = 2.0 * my * (a2 - a1) / (b1 * b2) - 2.0 * mx * s * (1.0 / b1 - 1.0 / b2);
        let (of_xx, of_xy) = (-s / b2, 2.0 * a1 / (b1 * b2));
        for (j, w) in around(size, pixel) {
            let (pixel_of_window, j) = (j, start + j);
            if g[pixel_of_window] == 0.0 {
                continue;
            }
            x_bar[j] -= lambda * bar * g[pixel] * w * (of_mu + 2.0 * x[j] * of_xx + y[j] * of_xy);
        }
        let sign = if x[i] == y[i] { 0.0 } else { (x[i] - y[i]).signum() };
        x_bar[i] += (1.0 - lambda) * bar * g[pixel] * sign;
    }
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

/// A smooth picture with some texture, and one beside it.
fn pictures(size: Size, contrast: f32, apart: f32) -> [Vec<f32>; 2] {
    let len = size.iter().product();
    let noise = |seed: u64| cotangent(len, seed).into_iter().map(|x| x as f32 / 4.0);
    let smooth = |i: usize| 0.5 + 0.3 * ((i % size[2]) as f32 / 7.0).sin();
    let y: Vec<f32> = noise(1).enumerate().map(|(i, e)| smooth(i) + contrast * e).collect();
    let x = y.iter().zip(noise(2)).map(|(y, e)| y + apart * e).collect();
    [x, y]
}

/// Everything of one case at one level.
fn full(simd: Simd, pair: &Pair<'_>, lambda: f32) -> (L1Dssim, Vec<f32>) {
    let mut x_bar = vec![0.0; pair.x.len()];
    let loss = Dssim::new(simd).l1_dssim_backward(pair, lambda, 1.0, &mut x_bar).unwrap();
    (loss, x_bar)
}

#[test]
fn l1_dssim_and_its_gradient_match_the_definition() {
    for (size, lambda) in [([2, 12, 13], 1.0), ([1, 6, 34], 0.2), ([3, 3, 2], 0.6), ([1, 1, 1], 0.2), ([1, 17, 1], 1.0)]
    {
        let [x, y] = pictures(size, 0.2, 0.4);
        let plane = size[1] * size[2];
        let weights: Vec<f32> = (0..plane).map(|i| [1.0, 0.0, 0.25, 2.0][i * 7 % 4]).collect();
        for g in [None, Some(&weights[..])] {
            let (y_wide, g_wide) = (wide(&y), g.map_or(vec![1.0; plane], wide));
            for simd in Simd::available() {
                let dssim = std::cell::RefCell::new(Dssim::new(simd));
                let forward = |x: &[f32], out: &mut [f32]| {
                    out[0] = dssim.borrow_mut().l1_dssim(&pair(size, x, &y, g), lambda).unwrap().loss as f32;
                };
                let backward = |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                    let pair = pair(size, x, &y, g);
                    dssim.borrow_mut().l1_dssim_backward(&pair, lambda, f64::from(bar[0]), x_bar).unwrap();
                };
                let lambda = f64::from(lambda);
                let forward_twin = |x: &[f64], out: &mut [f64]| out[0] = twin(size, x, &y_wide, &g_wide, lambda);
                let backward_twin = |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                    twin_backward(size, x, &y_wide, &g_wide, lambda, bar[0], x_bar);
                };
                // Central differences of a sum over all pixels lose digits to its size.
                let tolerances = PairTolerances {
                    values: Tolerance::new(1e-6, 1e-7),
                    twin: Tolerance::new(1e-6, 1e-8),
                    gradients: Tolerance::new(1e-5, 1e-9),
                };
                let single = (forward, backward);
                check_f32_pair(&x, &[1.5], single, (forward_twin, backward_twin), tolerances).unwrap();
            }
        }
    }
}

#[test]
fn bands_do_not_show() {
    // 300 rows are three bands of 100.
    let size = [1, 300, 19];
    let [x, y] = pictures(size, 0.1, 0.1);
    let (x_wide, y_wide, g) = (wide(&x), wide(&y), vec![1.0; 300 * 19]);
    let mut want = vec![0.0; x.len()];
    twin_backward(size, &x_wide, &y_wide, &g, 0.2, 1.0, &mut want);
    let value = twin(size, &x_wide, &y_wide, &g, 0.2);
    for simd in Simd::available() {
        let (loss, x_bar) = full(simd, &pair(size, &x, &y, None), 0.2);
        assert!((loss.loss - value).abs() < 1e-7, "{} {value}", loss.loss);
        compare("gradient", &x_bar, &want, Tolerance::new(1e-4, 0.0)).unwrap();
    }
}

#[test]
fn nearly_equal_pictures_keep_their_digits() {
    // 1 - s is about 1e-8 here: as 1 minus an f32 it would be 0 or 6e-8.
    let size = [1, 24, 33];
    let y: Vec<f32> = (0..24 * 33).map(|i| 0.9 + 0.1 * (i as f32 * 0.05).sin()).collect();
    let x: Vec<f32> = y.iter().enumerate().map(|(i, y)| y + 1e-5 * (i as f32 * 1.7).cos()).collect();
    let want = twin(size, &wide(&x), &wide(&y), &[1.0; 24 * 33], 1.0);
    let got = Dssim::new(Simd::best()).dssim(&pair(size, &x, &y, None)).unwrap();
    assert!((1e-9..1e-6).contains(&want) && (got - want).abs() < 0.01 * want, "{got} {want}");
}

#[test]
fn dssim_is_one_minus_the_metric_with_zero_padding() {
    let (width, height) = (31, 22);
    let bytes = |salt: usize| -> Vec<u8> { (0..width * height * 3).map(|i| ((i + salt) * 7919 % 251) as u8).collect() };
    let (a, b) = (bytes(0), bytes(9));
    let image = |data| Image::from_u8(width, height, 3, data).unwrap();
    let want = ssim(&image(&a), &image(&b), SsimVariant::ZERO_PADDED).unwrap();
    let x: Vec<f32> = (0..3).flat_map(|c| a.iter().skip(c).step_by(3).map(|&v| f32::from(v) / 255.0)).collect();
    let y: Vec<f32> = (0..3).flat_map(|c| b.iter().skip(c).step_by(3).map(|&v| f32::from(v) / 255.0)).collect();
    let mut dssim = Dssim::new(Simd::best());
    let of_bytes = Pair { channels: 3, height, width, x: &x, target: Target::Bytes(&b), weights: None };
    let got = dssim.dssim(&of_bytes).unwrap();
    assert!((1.0 - got - want).abs() < 1e-6, "{got} {want}");
    // Bytes are the same numbers as planes.
    assert_eq!(dssim.dssim(&pair([3, height, width], &x, &y, None)), Ok(got));
}

#[test]
fn equal_pictures_cost_nothing_and_black_against_white_all() {
    for simd in Simd::available() {
        for value in [0.0, 0.5, 1.0] {
            let x = vec![value; 12 * 40];
            let (loss, x_bar) = full(simd, &pair([1, 12, 40], &x, &x, None), 0.2);
            assert_eq!(loss, L1Dssim::default());
            assert!(x_bar.iter().all(|bar| *bar == 0.0));
        }
        let (black, white) = (vec![0.0; 12 * 40], vec![1.0; 12 * 40]);
        let (loss, x_bar) = full(simd, &pair([1, 12, 40], &black, &white, None), 0.2);
        assert!(loss.l1 == 1.0 && (0.999..=1.0).contains(&loss.dssim), "{loss:?}");
        assert!(x_bar.iter().all(|bar| bar.is_finite() && *bar < 0.0), "brighter is better everywhere");
    }
}

#[test]
fn weights_of_zero_everywhere_leave_no_loss_and_no_gradient() {
    let [x, y] = pictures([2, 9, 20], 0.3, 0.5);
    let (loss, x_bar) = full(Simd::best(), &pair([2, 9, 20], &x, &y, Some(&[0.0; 180])), 0.2);
    assert_eq!(loss, L1Dssim::default());
    assert!(x_bar.iter().all(|bar| *bar == 0.0));
}

#[test]
fn what_is_left_out_is_neither_seen_nor_pulled() {
    let size = [1, 20, 40];
    let [x, y] = pictures(size, 0.3, 0.5);
    let is_used = |i: usize| i % 40 < 10;
    let weights: Vec<f32> = (0..800).map(|i| f32::from(u8::from(is_used(i)))).collect();
    let (loss, x_bar) = full(Simd::best(), &pair(size, &x, &y, Some(&weights)), 0.2);
    for (i, bar) in x_bar.iter().enumerate() {
        assert_eq!(*bar == 0.0, !is_used(i), "{i}: {bar}");
    }
    let other = |x: &[f32]| -> Vec<f32> { (0..800).map(|i| if is_used(i) { x[i] } else { 7.0 - x[i] }).collect() };
    let (same_loss, same_bar) = full(Simd::best(), &pair(size, &other(&x), &other(&y), Some(&weights)), 0.2);
    assert_eq!((loss, x_bar), (same_loss, same_bar), "whatever is there");
}

#[test]
fn variances_that_drown_in_rounding_stay_harmless() {
    // Bright flat pictures: var is the rounding of 1e4, a thousand times C2.
    let size = [1, 14, 30];
    let (x, y) = (vec![100.0; 14 * 30], vec![100.25; 14 * 30]);
    for simd in Simd::available() {
        let (loss, x_bar) = full(simd, &pair(size, &x, &y, None), 1.0);
        assert!((0.0..=2.0).contains(&loss.dssim), "{loss:?}");
        assert!(x_bar.iter().all(|bar| bar.abs() < 1.0));
    }
}

#[test]
fn nan_stays_visible() {
    let size = [1, 30, 40];
    let [mut x, y] = pictures(size, 0.3, 0.5);
    x[15 * 40 + 20] = f32::NAN;
    for simd in Simd::available() {
        let (loss, x_bar) = full(simd, &pair(size, &x, &y, None), 0.2);
        assert!(loss.loss.is_nan() && loss.l1.is_nan() && loss.dssim.is_nan());
        assert!(x_bar[15 * 40 + 20].is_nan());
        // It reaches as far as two windows.
        assert!(x_bar[0].is_finite() && x_bar[29 * 40].is_finite());
    }
}

#[test]
fn empty_pictures_cost_nothing() {
    let mut dssim = Dssim::new(Simd::best());
    for size in [[0, 4, 4], [3, 0, 4], [3, 4, 0]] {
        let weights = vec![1.0; size[1] * size[2]];
        let pair = pair(size, &[], &[], Some(&weights));
        assert_eq!(dssim.l1_dssim_backward(&pair, 0.2, 1.0, &mut []), Ok(L1Dssim::default()));
    }
}

#[test]
fn lengths_and_lambda_are_checked() {
    let (x, mut dssim) = ([0.5; 12], Dssim::new(Simd::best()));
    let shape = |what, want, got| Err(LossError::Shape { what, want, got });
    let fine = pair([1, 3, 4], &x, &x, None);
    assert_eq!(dssim.dssim(&pair([1, 3, 5], &x, &x, None)), shape("x", 15, 12));
    assert_eq!(dssim.dssim(&pair([1, 3, 4], &x, &x[1..], None)), shape("target", 12, 11));
    assert_eq!(dssim.dssim(&Pair { target: Target::Bytes(&[1; 9]), ..fine }), shape("target", 12, 9));
    assert_eq!(dssim.dssim(&pair([1, 3, 4], &x, &x, Some(&x[2..]))), shape("weights", 12, 10));
    assert_eq!(dssim.dssim_backward(&fine, 1.0, &mut [0.0; 3]), shape("x_bar", 12, 3));
    assert_eq!(dssim.dssim(&pair([usize::MAX, 3, 4], &x, &x, None)), shape("x", usize::MAX, 12));
    for lambda in [-0.1, 1.1, f32::NAN] {
        assert!(matches!(dssim.l1_dssim(&fine, lambda), Err(LossError::Parameter { .. })));
    }
}

#[test]
fn a_dssim_of_many_sizes_is_that_of_one() {
    let mut used = Dssim::new(Simd::best());
    for size in [[3, 40, 50], [1, 3, 2], [2, 140, 17], [3, 40, 50]] {
        let [x, y] = pictures(size, 0.3, 0.2);
        let pair = pair(size, &x, &y, None);
        let mut x_bar = vec![0.0; x.len()];
        let loss = used.l1_dssim_backward(&pair, 0.2, 1.0, &mut x_bar).unwrap();
        assert_eq!((loss, x_bar), full(Simd::best(), &pair, 0.2));
        assert_eq!(used.l1_dssim(&pair, 0.2), Ok(loss), "with and without its gradient");
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    #[test]
    fn levels_agree_within_rounding(
        channels in 1_usize..4, height in 1_usize..40, width in 1_usize..70, contrast in 0.0_f32..0.5, apart in 1e-3_f32..0.5,
    ) {
        let size = [channels, height, width];
        let [x, y] = pictures(size, contrast, apart);
        let pair = pair(size, &x, &y, None);
        let (want, want_bar) = full(Simd::SCALAR, &pair, 0.2);
        for simd in Simd::available() {
            let (got, got_bar) = full(simd, &pair, 0.2);
            // Where contrast is low, variances are small differences: what sums up to 1 are rounded by, over `C2 = 9e-4`.
            prop_assert!((got.loss - want.loss).abs() <= 1e-6 * (want.loss + 1.0), "{got:?} {want:?}");
            prop_assert!((0.0..=2.0).contains(&got.dssim));
            compare("levels", &got_bar, &want_bar, Tolerance::new(1e-4, 0.0)).unwrap();
        }
    }
}

#[cfg(feature = "rayon")]
#[test]
fn threads_do_not_change_a_bit() {
    let size = [3, 300, 37];
    let [x, y] = pictures(size, 0.2, 0.3);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| full(Simd::best(), &pair(size, &x, &y, None), 0.2))
    };
    let one = on(1);
    assert!(on(2) == one && on(7) == one);
}
