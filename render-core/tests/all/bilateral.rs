//! The bilateral filter of depth maps against its formula in f64, and what it promises.

use proptest::prelude::*;
use render_core::bilateral::Bilateral;

const SIZE: [usize; 2] = [13, 9];

fn apply(filter: Bilateral, d: &[f32]) -> Vec<f32> {
    let mut out = vec![f32::NAN; d.len()];
    filter.apply(d, SIZE, &mut out).unwrap();
    out
}

/// The formula, in f64.
fn naive(Bilateral { radius, sigma_s, sigma_r }: Bilateral, d: &[f32]) -> Vec<f64> {
    let [width, height] = SIZE;
    let known = |d: f32| d.is_finite() && d > 0.0;
    let g = |x: f64, sigma: f32| (-0.5 * (x / f64::from(sigma)).powi(2)).exp();
    let of = |p: usize| {
        if !known(d[p]) {
            return 0.0;
        }
        let (mut sum, mut weight) = (0.0, 0.0);
        for q in 0..width * height {
            let [dx, dy] = [(q % width).abs_diff(p % width), (q / width).abs_diff(p / width)];
            if dx.max(dy) <= radius && known(d[q]) {
                let w = g((dx as f64).hypot(dy as f64), sigma_s) * g(f64::from(d[q]) - f64::from(d[p]), sigma_r);
                sum += w * f64::from(d[q]);
                weight += w;
            }
        }
        sum / weight
    };
    (0..d.len()).map(of).collect()
}

fn filters() -> impl Strategy<Value = Bilateral> {
    (0_usize..20, 0.3_f32..8.0, 0.01_f32..10.0).prop_map(|(radius, sigma_s, sigma_r)| Bilateral {
        radius,
        sigma_s,
        sigma_r,
    })
}

fn maps() -> impl Strategy<Value = Vec<f32>> {
    let depth = prop_oneof![8 => 0.5_f32..4.0, 1 => Just(0.0), 1 => Just(f32::NAN), 1 => Just(f32::INFINITY)];
    prop::collection::vec(depth, SIZE[0] * SIZE[1])
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn it_is_the_formula_and_holes_stay_holes(filter in filters(), d in maps()) {
        for (p, (got, want)) in apply(filter, &d).iter().zip(naive(filter, &d)).enumerate() {
            prop_assert!((f64::from(*got) - want).abs() <= 1e-5 * want.max(1.0), "{}: {} {}", p, got, want);
        }
    }

    #[test]
    fn constants_stay_and_a_constant_added_to_all_is_added_to_the_result(filter in filters(), d in maps(), c in 0.5_f32..4.0) {
        prop_assert!(apply(filter, &vec![c; d.len()]).iter().all(|out| *out == c));
        let plus: Vec<f32> = d.iter().map(|d| if *d > 0.0 { d + c } else { *d }).collect();
        for (a, b) in apply(filter, &d).iter().zip(apply(filter, &plus)) {
            prop_assert!(*a == 0.0 && b == 0.0 || (a + c - b).abs() < 1e-4, "{} {}", a + c, b);
        }
    }

    #[test]
    fn a_result_lies_between_the_depths_of_its_window(filter in filters(), d in maps()) {
        let known = d.iter().copied().filter(|d| d.is_finite() && *d > 0.0);
        let [low, high] = [known.clone().fold(f32::INFINITY, f32::min), known.fold(0.0, f32::max)];
        let inside = |out: &f32| *out == 0.0 || (low - 1e-5..=high + 1e-5).contains(out);
        prop_assert!(apply(filter, &d).iter().all(inside));
    }
}

#[test]
fn an_edge_stays_where_a_blur_moves_it() {
    let step: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|p| if p % SIZE[0] < 6 { 1.0 } else { 2.0 }).collect();
    let sharp = apply(Bilateral { radius: 4, sigma_s: 2.0, sigma_r: 0.05 }, &step);
    assert!(sharp.iter().zip(&step).all(|(a, b)| (a - b).abs() < 1e-6));
    let blur = apply(Bilateral { radius: 4, sigma_s: 2.0, sigma_r: 64.0 }, &step);
    assert!((blur[5] - 1.0).abs() > 0.2, "{}", blur[5]);
}

#[test]
fn extremes_are_finite_and_bad_input_is_an_error() {
    let filter = Bilateral { radius: 3, sigma_s: 1.0, sigma_r: 0.1 };
    let d: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|p| [f32::MIN_POSITIVE, f32::MAX, 1.0, 1e-30][p % 4]).collect();
    assert!(apply(filter, &d).iter().all(|out| out.is_finite()));
    assert!(filter.apply(&d, [2, 2], &mut vec![0.0; d.len()]).is_err());
    assert!(filter.apply(&d, SIZE, &mut [0.0]).is_err());
    assert!(filter.apply(&[], [0, 0], &mut []).is_ok());
    for sigma in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(Bilateral { sigma_s: sigma, ..filter }.apply(&d, SIZE, &mut vec![0.0; d.len()]).is_err());
        assert!(Bilateral { sigma_r: sigma, ..filter }.apply(&d, SIZE, &mut vec![0.0; d.len()]).is_err());
    }
}
