//! What the quadrature must do because of what it means: units, visibility, convergence, depth and normals.

use float_core::Simd;
use proptest::prelude::*;
use render_core::quadrature::{
    Composite, LastInterval, Samples, Values, accumulate, composite, depth_median, depth_median_exact, depth_raw,
    disparity, normalise, opacity,
};
use render_core::sample::dt_from_edges;

/// Colour and residual of one ray.
fn render(tau: &[f32], rgb: &[[f32; 3]], background: [f32; 3]) -> ([f32; 3], f32) {
    let n = tau.len();
    let rgb: Vec<f32> = (0..3 * n).map(|i| rgb[i % n][i / n]).collect();
    let (mut colour, mut opaque, mut w, mut end) = ([0.0; 3], [0.0], vec![0.0; n], [0.0]);
    let out = Composite { colour: &mut colour, opacity: &mut opaque, w: &mut w, trans_end: &mut end };
    let samples = Samples { offsets: &[0, n as u32], tau, last: LastInterval::Finite };
    composite(Simd::best(), samples, Values { data: &rgb, stride: n, channels: 3 }, &background, out);
    (colour, end[0])
}

fn any_ray() -> impl Strategy<Value = (Vec<f32>, Vec<f32>, Vec<[f32; 3]>)> {
    prop::collection::vec((0.0_f32..20.0, 1e-3_f32..0.3, [0.0_f32..1.0, 0.0_f32..1.0, 0.0_f32..1.0]), 1..60).prop_map(
        |samples| {
            (
                samples.iter().map(|s| s.0).collect(),
                samples.iter().map(|s| s.1).collect(),
                samples.iter().map(|s| s.2).collect(),
            )
        },
    )
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn the_unit_of_length_does_not_matter((sigma, dt, rgb) in any_ray(), k in 0.01_f32..100.0) {
        let tau: Vec<f32> = sigma.iter().zip(&dt).map(|(s, d)| s * d).collect();
        let scaled: Vec<f32> = sigma.iter().zip(&dt).map(|(s, d)| (s / k) * (d * k)).collect();
        let (a, b) = (render(&tau, &rgb, [0.5; 3]), render(&scaled, &rgb, [0.5; 3]));
        for c in 0..3 {
            prop_assert!((a.0[c] - b.0[c]).abs() <= 5e-6, "{a:?} {b:?}");
        }
    }

    #[test]
    fn what_is_behind_a_wall_does_not_matter((sigma, dt, rgb) in any_ray(), wall in 0_usize..60, shift in 1_usize..60) {
        let wall = wall % sigma.len();
        let mut tau: Vec<f32> = sigma.iter().zip(&dt).map(|(s, d)| s * d).collect();
        tau[wall] = 200.0;
        let (mut moved, mut colours) = (tau.clone(), rgb.clone());
        let behind = moved.len() - wall - 1;
        if behind > 0 {
            moved[wall + 1..].rotate_left(shift % behind);
            colours[wall + 1..].rotate_left(shift % behind);
        }
        prop_assert_eq!(render(&tau, &rgb, [0.5; 3]), render(&moved, &colours, [0.1; 3]));
    }

    #[test]
    fn equal_neighbours_merge((sigma, dt, rgb) in any_ray(), parts in 2_usize..20) {
        let tau: Vec<f32> = sigma.iter().zip(&dt).map(|(s, d)| s * d).collect();
        let fine: Vec<f32> = tau.iter().flat_map(|t| vec![t / parts as f32; parts]).collect();
        let colours: Vec<[f32; 3]> = rgb.iter().flat_map(|c| vec![*c; parts]).collect();
        let (a, b) = (render(&tau, &rgb, [0.5; 3]), render(&fine, &colours, [0.5; 3]));
        for c in 0..3 {
            prop_assert!((a.0[c] - b.0[c]).abs() <= 5e-6, "{a:?} {b:?}");
        }
    }

    #[test]
    fn the_exact_median_is_where_half_of_the_light_is_left((sigma, dt, _) in any_ray()) {
        let tau: Vec<f32> = sigma.iter().zip(&dt).map(|(s, d)| s * d).collect();
        let mut edges = vec![1.0];
        dt.iter().for_each(|d| edges.push(edges[edges.len() - 1] + d));
        let samples = Samples { offsets: &[0, tau.len() as u32], tau: &tau, last: LastInterval::Finite };
        let mut median = [0.0];
        depth_median_exact(samples, &edges[..tau.len()], &dt, 1e3, &mut median);
        let depth: f64 = (0..tau.len()).map(|i| {
            let share = ((f64::from(median[0]) - f64::from(edges[i])) / f64::from(dt[i])).clamp(0.0, 1.0);
            share * f64::from(tau[i])
        }).sum();
        if median[0] == 1e3 {
            prop_assert!((-depth).exp() > 0.5 - 1e-6);
        } else {
            // The density at the point times an ulp of the distance.
            prop_assert!(((-depth).exp() - 0.5).abs() < 1e-4, "{median:?} {depth}");
        }
    }
}

#[test]
fn the_quadrature_converges_on_a_smooth_density() {
    // sigma(t) = 3 (1 + sin 5t), colour(t) = t / 2 on [0, 2], seen by the midpoints. The integral by Simpson with 2^16 intervals.
    let sigma = |t: f64| 3.0 * (1.0 + (5.0 * t).sin());
    let depth = |t: f64| 3.0 * (t + (1.0 - (5.0 * t).cos()) / 5.0);
    let integrand = |t: f64| sigma(t) * (-depth(t)).exp() * t / 2.0;
    let m = 1 << 16;
    let h = 2.0 / f64::from(m);
    let simpson: f64 = (0..m)
        .map(|i| {
            let t = f64::from(i) * h;
            h / 6.0 * (integrand(t) + 4.0 * integrand(t + h / 2.0) + integrand(t + h))
        })
        .sum();
    let mut errors = vec![];
    for n in [8, 16, 32, 64, 128] {
        let edges: Vec<f32> = (0..=n).map(|i| 2.0 * i as f32 / n as f32).collect();
        let mut dt = vec![0.0; n];
        dt_from_edges(&edges, &mut dt);
        let mid: Vec<f64> = edges.windows(2).map(|e| f64::from(e[0] + e[1]) / 2.0).collect();
        let tau: Vec<f32> = mid.iter().zip(&dt).map(|(&t, d)| sigma(t) as f32 * d).collect();
        let rgb: Vec<[f32; 3]> = mid.iter().map(|t| [*t as f32 / 2.0; 3]).collect();
        errors.push((f64::from(render(&tau, &rgb, [0.0; 3]).0[0]) - simpson).abs());
    }
    // Second order: a factor near 4 for twice the samples.
    for pair in errors.windows(2) {
        assert!(pair[1] < pair[0] / 3.0, "{errors:?}");
    }
    assert!(errors[4] < 1e-4, "{errors:?}");
}

#[test]
fn depth_layers_of_known_rays() {
    // A thin sheet at 3, nothing, a wall at 5.
    let offsets = [0, 3, 3, 4];
    let (w, t) = ([0.25, 0.0, 0.5, 1.0], [3.0, 3.5, 4.0, 5.0]);
    let mut out = [0.0; 3];
    depth_raw(&offsets, &w, &t, &mut out);
    assert_eq!(out, [2.75, 0.0, 5.0]);
    opacity(&offsets, &w, &mut out);
    assert_eq!(out, [0.75, 0.0, 1.0]);
    disparity(&offsets, &w, &t, &mut out);
    assert_eq!(out, [0.75 / 2.75, 0.0, 0.2]);
    depth_median(&offsets, &w, &t, f32::INFINITY, &mut out);
    assert_eq!(out, [4.0, f32::INFINITY, 5.0]);
    // Inside the interval: depth ln 2 is reached half way through the second one.
    let ln2 = core::f32::consts::LN_2;
    let tau = [0.5 * ln2, ln2, 7.0, 0.0];
    for (last, want) in [(LastInterval::Finite, 9.0), (LastInterval::Opaque, 5.0)] {
        let samples = Samples { offsets: &offsets, tau: &tau, last };
        depth_median_exact(samples, &t, &[0.5, 0.5, 1.0, 1.0], 9.0, &mut out);
        assert_eq!(out[0], 3.75);
        assert_eq!(out[1..], [9.0, want]);
    }
    depth_median(&[], &[], &[], 1.0, &mut []);
    opacity(&[0], &[], &mut []);
}

#[test]
fn normals_accumulate_and_normalise() {
    let (offsets, w) = ([0, 2, 2, 3], [0.25, 0.25, 0.5]);
    // x, y, z of the three samples, with a stride of 4.
    let n = [1.0, 0.0, 0.0, 9.0, 0.0, 1.0, 0.0, 9.0, 0.0, 0.0, -1.0, 9.0];
    let mut out = [f32::NAN; 9];
    accumulate(Simd::best(), &offsets, &w, Values { data: &n, stride: 4, channels: 3 }, &mut out);
    assert_eq!(out, [0.25, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.5]);
    normalise(&mut out);
    let r = core::f32::consts::FRAC_1_SQRT_2;
    for (x, want) in out.iter().zip([r, r, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0]) {
        assert!((x - want).abs() < 1e-6, "{out:?}");
    }
}
