//! The rules between samples: against the `f64` reference, the reference against closed forms and differences, and what
//! linear density must do.

use crate::rays::{self, pattern};
use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::{
    IntervalsBar, LastInterval, Points, PointsBar, Rule, Samples, Values, intervals, intervals_backward, reference,
    weights,
};
use testkit::analytic::integrate;
use testkit::gradient::{Tolerance, check_pair, compare, cotangent};
use testkit::strategies::{any_density, any_step};

/// Rays with three channels.
#[derive(Clone, Debug)]
struct Batch {
    offsets: Vec<u32>,
    dt: Vec<f32>,
    sigma: Vec<f32>,
    rgb: Vec<f32>,
    stride: usize,
}

impl Batch {
    fn new(lengths: &[usize], samples: &[(f32, f32)]) -> Self {
        let offsets = rays::offsets(lengths);
        let n = offsets[lengths.len()] as usize;
        let stride = n + 3;
        Self {
            offsets,
            dt: (0..n).map(|i| samples[i % samples.len()].0).collect(),
            sigma: (0..n).map(|i| samples[i % samples.len()].1).collect(),
            rgb: pattern(3 * stride, 37, 11),
            stride,
        }
    }

    fn points(&self) -> Points<'_> {
        let values = Values { data: &self.rgb, stride: self.stride, channels: 3 };
        Points { offsets: &self.offsets, dt: &self.dt, sigma: &self.sigma, values }
    }

    fn n(&self) -> usize {
        self.sigma.len()
    }

    fn forward(&self, simd: Simd, rule: Rule) -> (Vec<f32>, Vec<f32>) {
        let (mut tau, mut values) = (vec![f32::NAN; self.n()], vec![f32::NAN; self.rgb.len()]);
        intervals(simd, rule, self.points(), &mut tau, &mut values);
        (tau, values)
    }

    /// Gradients of densities, values and lengths.
    fn backward(&self, simd: Simd, rule: Rule, tau_bar: &[f32], values_bar: &[f32]) -> [Vec<f32>; 3] {
        let (mut sigma, mut values, mut dt) = (vec![0.0; self.n()], vec![0.0; self.rgb.len()], vec![0.0; self.n()]);
        let bar = IntervalsBar { tau: tau_bar, values: values_bar };
        let grads = PointsBar { sigma: &mut sigma, values: &mut values, dt: Some(&mut dt) };
        intervals_backward(simd, rule, self.points(), bar, grads);
        [sigma, values, dt]
    }

    /// One ray in f64: lengths, densities, values.
    fn ray(&self, r: usize) -> (Vec<f64>, Vec<f64>, Vec<[f64; 3]>) {
        let range = self.offsets[r] as usize..self.offsets[r + 1] as usize;
        (
            self.dt[range.clone()].iter().map(|&x| x.into()).collect(),
            self.sigma[range.clone()].iter().map(|&x| x.into()).collect(),
            range.map(|i| std::array::from_fn(|c| self.rgb[c * self.stride + i].into())).collect(),
        )
    }
}

fn any_batch() -> impl Strategy<Value = Batch> {
    let lengths = prop::collection::vec(prop_oneof![8 => 0_usize..71, 1 => 100_usize..300], 0..8);
    (lengths, prop::collection::vec((any_step(), any_density()), 1..97)).prop_map(|(l, s)| Batch::new(&l, &s))
}

fn noise(n: usize, seed: u64) -> Vec<f32> {
    cotangent(n, seed).iter().map(|&x| x as f32).collect()
}

#[track_caller]
fn close(got: f32, want: f64, abs: f64, rel: f64, what: impl std::fmt::Display) {
    let bound = abs + rel * want.abs();
    assert!((f64::from(got) - want).abs() <= bound, "{what}: got {got:e}, want {want:e}, bound {bound:e}");
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn every_rule_matches_the_reference_at_every_level(b in any_batch()) {
        for (simd, rule) in Simd::available().flat_map(|s| Rule::ALL.map(|r| (s, r))) {
            let (tau, values) = b.forward(simd, rule);
            for r in 0..b.offsets.len() - 1 {
                let (dt, sigma, rgb) = b.ray(r);
                let (want_tau, want_rgb) = reference::intervals(rule, &dt, &sigma, &rgb);
                for k in 0..sigma.len() {
                    let i = b.offsets[r] as usize + k;
                    // Two roundings; products of denormals go to 0.
                    close(tau[i], want_tau[k].min(f64::from(f32::MAX)), 1e-37, 4e-7, format_args!("{simd:?} {rule:?} tau[{i}]"));
                    if want_tau[k] < 1e-29 && rule == Rule::PiecewiseLinear {
                        continue; // The centre is 1/2 there by convention, whatever the densities.
                    }
                    for c in 0..3 {
                        close(values[c * b.stride + i], want_rgb[k][c], 2e-6, 0.0, format_args!("{simd:?} {rule:?} value {c} of {i}"));
                    }
                }
            }
        }
    }

    #[test]
    fn transmittance_never_rises_along_a_ray_under_any_rule(
        samples in prop::collection::vec((any_step(), any_density()), 0..60),
        opaque in any::<bool>(),
    ) {
        let b = Batch::new(&[samples.len()], if samples.is_empty() { &[(0.0, 0.0)] } else { &samples });
        let (offsets, places) = rays::beginnings(samples.len());
        for (simd, rule) in Simd::available().flat_map(|s| Rule::ALL.map(|r| (s, r))) {
            let (tau, _) = b.forward(simd, rule);
            let all: Vec<f32> = places.iter().map(|&i| tau[i]).collect();
            let (mut w, mut trans) = (vec![0.0; all.len()], vec![f32::NAN; samples.len() + 1]);
            let rays = Samples { offsets: &offsets, tau: &all, last: LastInterval::Finite };
            weights(simd, rays, &mut w, &mut trans);
            let mut taken: Vec<f64> = tau.iter().map(|&x| x.into()).collect();
            rays::check_transmittance(&trans, &taken, format_args!("{simd:?} {rule:?}"));
            // With a wall as its last interval nothing is left of the ray, and all before it is as it was.
            if opaque && !samples.is_empty() {
                let whole = Samples { offsets: &[0, samples.len() as u32], tau: &tau, last: LastInterval::Opaque };
                let end = trans.len() - 1;
                weights(simd, whole, &mut w[..samples.len()], &mut trans[end..]);
                prop_assert_eq!(trans[end], 0.0);
                taken[samples.len() - 1] = f64::INFINITY;
                rays::check_transmittance(&trans, &taken, format_args!("{simd:?} {rule:?}, opaque"));
            }
        }
    }

    #[test]
    fn gradients_match_the_reference_at_every_level(b in any_batch(), seed in any::<u64>()) {
        let (tau_bar, values_bar) = (noise(b.n(), seed), noise(b.rgb.len(), seed ^ 1));
        for (simd, rule) in Simd::available().flat_map(|s| Rule::ALL.map(|r| (s, r))) {
            let [sigma_bar, rgb_bar, dt_bar] = b.backward(simd, rule, &tau_bar, &values_bar);
            for r in 0..b.offsets.len() - 1 {
                let (dt, sigma, rgb) = b.ray(r);
                let range = b.offsets[r] as usize..b.offsets[r + 1] as usize;
                let tb: Vec<f64> = tau_bar[range.clone()].iter().map(|&x| x.into()).collect();
                let vb: Vec<[f64; 3]> = range.clone().map(|i| std::array::from_fn(|c| values_bar[c * b.stride + i].into())).collect();
                let want = reference::intervals_backward(rule, &dt, &sigma, &rgb, &tb, &vb);
                // Thinner than this the gradient of the centre is a convention, see there; its factors 1 / tau are past f32.
                let thin = |k: usize| (k.max(1) - 1..=k).any(|j| {
                    let next = sigma[(j + 1).min(sigma.len() - 1)];
                    let tau = 0.5 * dt[j] * (sigma[j] + next);
                    !(1e-28..=1e29).contains(&tau)
                });
                // What one interval may contribute: 2 from its depth, and what its centre moves by, at most its colour
                // step times 3 / tau.
                let size = |k: usize| (k.max(1) - 1..=k).map(|j| {
                    let next = sigma[(j + 1).min(sigma.len() - 1)];
                    dt[j] * (2.0 + 6.0 / (0.5 * dt[j] * (sigma[j] + next)).max(1e-28))
                }).fold(0.0, f64::max);
                for (k, i) in range.enumerate() {
                    if rule == Rule::PiecewiseLinear && thin(k) {
                        prop_assert!(sigma_bar[i].is_finite());
                        continue;
                    }
                    close(sigma_bar[i], want.sigma[k], 1e-5 * size(k) + 1e-35, 1e-5, format_args!("{simd:?} {rule:?} sigma_bar[{i}]"));
                    for c in 0..3 {
                        close(rgb_bar[c * b.stride + i], want.values[k][c], 1e-5, 0.0, format_args!("{simd:?} {rule:?} value_bar {c} of {i}"));
                    }
                    let next = sigma[(k + 1).min(sigma.len() - 1)];
                    let bound = 1e-5 * (2.0 * (sigma[k] + next) + 8.0 / dt[k].max(1e-30));
                    if dt[k] > 0.0 {
                        close(dt_bar[i], want.dt[k], bound, 1e-5, format_args!("{simd:?} {rule:?} dt_bar[{i}]"));
                    }
                }
            }
        }
    }

    #[test]
    fn a_ray_does_not_depend_on_its_place_in_the_batch(b in any_batch()) {
        let simd = Simd::best();
        let (tau_bar, values_bar) = (noise(b.n(), 5), noise(b.rgb.len(), 6));
        for rule in Rule::ALL {
            let (tau, values) = b.forward(simd, rule);
            let all = b.backward(simd, rule, &tau_bar, &values_bar);
            for r in 0..b.offsets.len() - 1 {
                // The same ray as the only one, over the same arrays: the others are left alone.
                let alone = Batch { offsets: b.offsets[r..r + 2].to_vec(), ..b.clone() };
                let (own_tau, own_values) = alone.forward(simd, rule);
                let own = alone.backward(simd, rule, &tau_bar, &values_bar);
                for i in 0..b.n() {
                    let inside = (b.offsets[r]..b.offsets[r + 1]).contains(&(i as u32));
                    if inside {
                        prop_assert_eq!(own_tau[i], tau[i]);
                        prop_assert_eq!(own[0][i], all[0][i]);
                        prop_assert_eq!(own[2][i], all[2][i]);
                    } else {
                        prop_assert!(own_tau[i].is_nan() && own[0][i] == 0.0 && own[2][i] == 0.0);
                    }
                    for c in (0..3).map(|c| c * b.stride + i) {
                        let same = if inside { own_values[c] == values[c] } else { own_values[c].is_nan() };
                        prop_assert!(same);
                        prop_assert_eq!(own[1][c], if inside { all[1][c] } else { 0.0 });
                    }
                }
            }
        }
    }

    #[test]
    fn values_stay_between_those_at_the_ends(b in any_batch()) {
        let (_, values) = b.forward(Simd::best(), Rule::PiecewiseLinear);
        for r in 0..b.offsets.len() - 1 {
            for i in b.offsets[r] as usize..b.offsets[r + 1] as usize {
                let j = (i + 1).min(b.offsets[r + 1] as usize - 1);
                for c in (0..3).map(|c| c * b.stride) {
                    let (x, y) = (b.rgb[c + i], b.rgb[c + j]);
                    prop_assert!(x.min(y) - 1e-6 <= values[c + i] && values[c + i] <= x.max(y) + 1e-6);
                }
            }
        }
    }

    #[test]
    fn the_centroid_is_inside_and_symmetric_for_thin_intervals(a in 0.0_f64..1e4, b in 0.0_f64..1e4) {
        let mu = reference::centroid(a, b);
        prop_assert!((0.0..=2.0 / 3.0 + 1e-12).contains(&mu), "{mu}");
        // Denser in front: earlier. (Denser behind is later while thin, and earlier when nothing gets there.)
        prop_assert!(reference::centroid(a + 0.1, b) <= mu + 1e-12);
        let thin = 1e-7 / (a + b).max(1.0);
        let sum = reference::centroid(a * thin, b * thin) + reference::centroid(b * thin, a * thin);
        prop_assert!((sum - 1.0).abs() < 1e-6);
    }
}

/// `erfc(x) exp(x^2)` for `x >= 0`: from the library, or as a continued fraction where that has no digits left.
fn erfcx(x: f64) -> f64 {
    if x < 20.0 {
        return libm::erfc(x) * (x * x).exp();
    }
    let fraction = (1..=40).rev().fold(0.0, |f, k| 0.5 * f64::from(k) / (x + f));
    1.0 / (std::f64::consts::PI.sqrt() * (x + fraction))
}

/// Dawson's function `exp(-x^2) int(exp(y^2), 0..x)`, by integration.
fn dawson(x: f64) -> f64 {
    integrate(0.0, x, 1e-16, |y| ((y - x) * (y + x)).exp())
}

/// The centroid in closed form. With `k = |b - a| / 2`, `p = a / (2 sqrt k)`, `q = b / (2 sqrt k)` the integral of the
/// transmittance is `(F(p) - exp(-tau) F(q)) / sqrt k`, `F` being `sqrt(pi) / 2 erfcx` or Dawson's function.
fn closed_form(a: f64, b: f64) -> f64 {
    let tau = 0.5 * (a + b);
    let root = (0.5 * (b - a).abs()).sqrt();
    let f = |x: f64| if b > a { 0.5 * std::f64::consts::PI.sqrt() * erfcx(x) } else { dawson(x) };
    let trans =
        if root > 0.0 { (f(0.5 * a / root) - (-tau).exp() * f(0.5 * b / root)) / root } else { -(-tau).exp_m1() / tau };
    (trans - (-tau).exp()) / -(-tau).exp_m1()
}

#[test]
fn the_centroid_has_a_closed_form() {
    for a in [0.0, 1e-2, 0.3, 1.0, 4.0, 17.0, 90.0] {
        for b in [0.0, 1e-2, 0.3, 1.0, 4.0, 17.0, 90.0] {
            if a + b > 0.0 {
                let (got, want) = (reference::centroid(a, b), closed_form(a, b));
                assert!((got - want).abs() < 1e-11, "{a} {b}: {got} {want}");
            }
        }
    }
    // Even density: 1 / tau - 1 / (exp(tau) - 1). Thin: (a + 2 b) / (3 (a + b)). Far past the cut: the near end.
    let tau = 3.0_f64;
    assert!((reference::centroid(tau, tau) - (1.0 / tau - 1.0 / tau.exp_m1())).abs() < 1e-14);
    assert!((reference::centroid(1e-9, 3e-9) - 7.0 / 12.0).abs() < 1e-9);
    assert!((reference::centroid(1e9, 1e9) * 1e9 - 1.0).abs() < 1e-9);
}

#[test]
fn the_closed_form_in_f32_has_no_digits_left_where_intervals_are_thin() {
    // What the Gauss points are there for, and what they cost in accuracy: the same formula with every step rounded to f32,
    // with functions right to the last digit.
    let round = |x: f64| f64::from(x as f32);
    let single = |a: f64, b: f64| {
        let (tau, root) = (round(0.5 * (a + b)), round((0.5 * (b - a)).sqrt()));
        let f = |x: f64| round(0.5 * std::f64::consts::PI.sqrt() * erfcx(x));
        let e = round((-tau).exp());
        let difference = round(f(round(0.5 * a / root)) - round(e * f(round(0.5 * b / root))));
        round(round(round(difference / root) - e) / round(-(-tau).exp_m1()))
    };
    let kernel = |a: f64, b: f64| {
        let points = Points {
            offsets: &[0, 2],
            dt: &[1.0, 0.0],
            sigma: &[a as f32, b as f32],
            values: Values { data: &[0.0, 1.0], stride: 2, channels: 1 },
        };
        let (mut tau, mut values) = ([0.0; 2], [0.0; 2]);
        intervals(Simd::best(), Rule::PiecewiseLinear, points, &mut tau, &mut values);
        f64::from(values[0])
    };
    for (tau, at_least) in [(1e-1, 1e-6), (1e-2, 1e-5), (1e-3, 1e-3), (1e-4, 1e-2)] {
        let (mut worst, mut ours) = (0.0_f64, 0.0_f64);
        for k in 1..10 {
            let a = f64::from((tau * f64::from(k) / 10.0) as f32);
            let b = f64::from((2.0 * tau - a) as f32);
            let want = reference::centroid(a, b);
            worst = worst.max((single(a, b) - want).abs());
            ours = ours.max((kernel(a, b) - want).abs());
        }
        assert!(worst > at_least, "tau {tau}: the closed form is off by {worst:e} only");
        assert!(ours < 1e-6, "tau {tau}: {ours:e}");
    }
}

#[test]
fn the_kernel_holds_its_bound_over_the_whole_range() {
    let (mut worst, mut worst_gradient) = (0.0_f64, 0.0_f64);
    for share in [0.0, 1e-6, 1e-3, 0.05, 0.2, 0.45, 0.5, 0.55, 0.8, 0.97, 0.9999, 1.0] {
        for step in 0..=140 {
            let tau = 10_f64.powf(-6.0 + 0.1 * f64::from(step));
            let (a, b) = ((2.0 * tau * share) as f32, (2.0 * tau * (1.0 - share)) as f32);
            let batch = Batch {
                offsets: vec![0, 2],
                dt: vec![1.0, 0.0],
                sigma: vec![a, b],
                rgb: vec![0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
                stride: 2,
            };
            let (a, b) = (f64::from(a), f64::from(b));
            let tau = 0.5 * (a + b);
            for simd in Simd::available() {
                let (_, values) = batch.forward(simd, Rule::PiecewiseLinear);
                worst = worst.max((f64::from(values[0]) - reference::centroid(a, b)).abs());
                let [g, ..] = batch.backward(simd, Rule::PiecewiseLinear, &[0.0; 2], &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
                for (got, want) in g.iter().zip(reference::centroid_gradient(a, b)) {
                    // The gradient of a thin interval goes with 1 / tau, that of a dense one with 1 / tau^2 or so.
                    worst_gradient = worst_gradient.max((f64::from(*got) - want).abs() * tau);
                }
            }
        }
    }
    assert!(worst < 1e-6, "{worst:e}");
    assert!(worst_gradient < 1e-5, "{worst_gradient:e}");
}

#[test]
fn the_gradient_of_the_reference_matches_central_differences() {
    let n = 7;
    for rule in Rule::ALL {
        for scale in [1e-3, 0.1, 1.0, 8.0] {
            let x: Vec<f64> = (0..5 * n)
                .map(|i| if i < 2 * n { scale } else { 1.0 } * (0.2 + ((i * 7 + 3) % 11) as f64 / 10.0))
                .collect();
            let split = |x: &[f64]| {
                let rgb: Vec<[f64; 3]> = (0..n).map(|i| [x[2 * n + i], x[3 * n + i], x[4 * n + i]]).collect();
                (x[..n].to_vec(), x[n..2 * n].to_vec(), rgb)
            };
            let forward = |x: &[f64], out: &mut [f64]| {
                let (dt, sigma, rgb) = split(x);
                let (tau, values) = reference::intervals(rule, &dt, &sigma, &rgb);
                out[..n].copy_from_slice(&tau);
                out[n..].copy_from_slice(values.as_flattened());
            };
            let backward = |x: &[f64], out_bar: &[f64], x_bar: &mut [f64]| {
                let (dt, sigma, rgb) = split(x);
                let values_bar: Vec<[f64; 3]> = out_bar[n..].as_chunks::<3>().0.to_vec();
                let bar = reference::intervals_backward(rule, &dt, &sigma, &rgb, &out_bar[..n], &values_bar);
                for i in 0..n {
                    x_bar[i] += bar.dt[i];
                    x_bar[n + i] += bar.sigma[i];
                    (0..3).for_each(|c| x_bar[(2 + c) * n + i] += bar.values[i][c]);
                }
            };
            // Steps of 1e-6 are a thousandth of the smallest inputs here.
            let tolerance = Tolerance::new(if scale < 0.1 { 1e-5 } else { 1e-6 }, 1e-8);
            check_pair(&x, &cotangent(4 * n, 3), forward, backward, tolerance)
                .unwrap_or_else(|e| panic!("{rule:?} {scale}: {e}"));
        }
    }
}

#[test]
fn backward_adds() {
    let b = Batch::new(&[70, 3], &[(0.1, 2.0), (0.2, 0.5), (0.05, 9.0)]);
    let (tau_bar, values_bar) = (noise(b.n(), 1), noise(b.rgb.len(), 2));
    for rule in Rule::ALL {
        let fresh = b.backward(Simd::best(), rule, &tau_bar, &values_bar);
        let mut again = fresh.clone();
        let [sigma, values, dt] = &mut again;
        let grads = PointsBar { sigma, values, dt: Some(dt) };
        intervals_backward(Simd::best(), rule, b.points(), IntervalsBar { tau: &tau_bar, values: &values_bar }, grads);
        for (again, fresh) in again.iter().zip(&fresh) {
            let twice: Vec<f32> = fresh.iter().map(|x| 2.0 * x).collect();
            compare("twice", again, &twice, Tolerance::new(1e-6, 1e-6)).unwrap();
        }
    }
}

#[test]
fn density_and_value_linear_along_the_ray_are_exact_with_two_samples() {
    // sigma = 0.4 + 1.1 t, v = 1 - 0.3 t on [0, 2]: one interval, or a hundred, is the same pixel.
    let want = integrate(0.0, 2.0, 1e-14, |t| (-0.4 * t - 0.55 * t * t).exp() * (0.4 + 1.1 * t) * (1.0 - 0.3 * t));
    for n in [2, 3, 17, 101] {
        let step = 2.0 / (n - 1) as f32;
        let t: Vec<f32> = (0..n).map(|i| i as f32 * step).collect();
        let sigma: Vec<f32> = t.iter().map(|t| 0.4 + 1.1 * t).collect();
        let v: Vec<f32> = t.iter().map(|t| 1.0 - 0.3 * t).collect();
        let mut dt = vec![step; n];
        dt[n - 1] = 0.0;
        let offsets = [0, n as u32];
        let points =
            Points { offsets: &offsets, dt: &dt, sigma: &sigma, values: Values { data: &v, stride: n, channels: 1 } };
        let (mut tau, mut values, mut w, mut end) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], [0.0]);
        intervals(Simd::best(), Rule::PiecewiseLinear, points, &mut tau, &mut values);
        weights(Simd::best(), Samples { offsets: &offsets, tau: &tau, last: LastInterval::Finite }, &mut w, &mut end);
        let got: f64 = w.iter().zip(&values).map(|(&w, &v)| f64::from(w) * f64::from(v)).sum();
        assert!((got - want).abs() < 1e-6, "{n}: {got} {want}");
    }
}

#[test]
fn extreme_densities_and_lengths_stay_finite() {
    let x = [0.0, f32::from_bits(1), 1e-38, 1e-30, 1e-20, 1e-6, 1.0, 1e6, 1e20, 1e30, f32::MAX, f32::INFINITY];
    for (simd, rule) in Simd::available().flat_map(|s| Rule::ALL.map(|r| (s, r))) {
        for a in x {
            for b in x {
                for dt in [0.0, f32::from_bits(1), 1e-38, 1e-20, 1.0, 1e20, f32::MAX] {
                    let batch = Batch::new(&[3], &[(dt, a), (dt, b), (0.0, b)]);
                    let (tau, values) = batch.forward(simd, rule);
                    assert!(tau.iter().all(|t| *t >= 0.0), "{rule:?} {a:e} {b:e} {dt:e}: {tau:?}");
                    assert!((0..3).all(|c| values[c * batch.stride..][..3].iter().all(|v| (0.0..=1.0).contains(v))));
                    if dt == 0.0 {
                        assert_eq!(tau, [0.0; 3], "{rule:?} {a:e} {b:e}");
                    }
                    if a.is_finite() && b.is_finite() && (f64::from(a) + f64::from(b)) * f64::from(dt) < 1e30 {
                        let [_, rgb, _] = batch.backward(simd, rule, &[1.0; 3], &vec![1.0; batch.rgb.len()]);
                        assert!(rgb.iter().all(|g| (0.0..=2.0 + 1e-6).contains(g)));
                    }
                }
            }
        }
    }
}

#[test]
fn nothing_is_legal() {
    let values = Values { data: &[], stride: 0, channels: 3 };
    for rule in Rule::ALL {
        for offsets in [&[][..], &[0], &[0, 0, 0]] {
            let points = Points { offsets, dt: &[], sigma: &[], values };
            intervals(Simd::best(), rule, points, &mut [], &mut []);
            let grads = PointsBar { sigma: &mut [], values: &mut [], dt: None };
            intervals_backward(Simd::best(), rule, points, IntervalsBar { tau: &[], values: &[] }, grads);
        }
        // No channels: densities only.
        let points = Points {
            offsets: &[0, 2],
            dt: &[1.0, 0.0],
            sigma: &[1.0, 3.0],
            values: Values { data: &[], stride: 2, channels: 0 },
        };
        let mut tau = [0.0; 2];
        intervals(Simd::best(), rule, points, &mut tau, &mut []);
        assert_eq!(tau, [if rule == Rule::PiecewiseConstant { 1.0 } else { 2.0 }, 0.0]);
    }
}

#[test]
fn the_last_interval_of_a_ray_is_constant() {
    let b = Batch::new(&[2, 1, 0, 2], &[(0.5, 1.0), (2.0, 3.0)]);
    for rule in Rule::ALL {
        let (tau, values) = b.forward(Simd::best(), rule);
        for last in [1, 2, 4] {
            assert_eq!(tau[last], b.dt[last] * b.sigma[last]);
            assert_eq!(values[last], b.rgb[last]);
        }
    }
}
