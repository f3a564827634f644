//! The quadrature against values and gradients made elsewhere: the `f64` reference tightly, the kernels at every level.

use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, DepthBar, LastInterval, Samples, Values, Weights, composite,
    composite_backward, depth_expected, depth_expected_backward, depth_median, depth_median_exact, depth_raw, opacity,
    reference,
};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/composite.json")).unwrap()
}

/// Below this a transmittance is 0 in `f32`: the kernels end at an optical depth of 87.
const UNDERFLOW: f64 = 2e-38;

/// Tolerances for `f32`: (values, gradients), each (rtol, atol). A floor of two subnormals stands in for relative precision
/// where `f32` has none, and [`UNDERFLOW`] where the ray is opaque to `f32`.
fn tolerance(record: &Record, tau: &[f32]) -> [(f64, f64); 2] {
    let floor = if tau.iter().sum::<f32>() > 87.0 { UNDERFLOW } else { 3e-45 };
    match record.kind {
        Kind::Random => [(2e-6, 1e-6), (5e-5, 1e-5)],
        _ => [(1e-4, floor), (1e-3, floor)],
    }
}

/// Absolute tolerance of gradients beyond [`tolerance`]. Automatic differentiation made the golden gradients with
/// `d expm1(-x) = 1 + expm1(-x)`, which is 0 in `f64` from `x = 37` on; at `x = 80` it lost terms of `e^-80 = 1.8e-35`
/// (80-digit arithmetic agrees with the code here). They enter the gradient of `delta` times `sigma = 80`.
fn lost_by_the_oracle(record: &Record) -> f64 {
    if record.name == "x_80_each" { 4.0 * (-80.0_f64).exp() } else { 0.0 }
}

/// Gradient of the loss with respect to the weights, other than through the colour, when every transmittance but the last is
/// written as `T[i] = 1 - sum(w[j], j < i)`.
fn weight_bar(record: &Record) -> Vec<f64> {
    let (n, t) = (record.input("t").data.len(), &record.input("t").data);
    let trans_bar = &record.cotangent("transmittance").data;
    let mut behind = 0.0;
    let mut out = vec![0.0; n];
    for i in (0..n).rev() {
        out[i] = record.cotangent("weights").data[i] + record.cotangent("depth").scalar() * t[i] - behind;
        behind += trans_bar[i];
    }
    out
}

#[test]
fn the_reference_matches_in_f64() {
    let golden = golden();
    for record in golden.op("composite") {
        let label = record.label();
        let input = |name: &str| &record.input(name).data;
        let (sigma, delta, t) = (input("sigma"), input("delta"), input("t"));
        let tau: Vec<f64> = sigma.iter().zip(delta).map(|(s, d)| s * d).collect();
        let rgb: Vec<[f64; 3]> = input("rgb").chunks(3).map(|c| [c[0], c[1], c[2]]).collect();
        let background = [0, 1, 2].map(|c| input("background")[c]);
        let ray = reference::weights(&tau, LastInterval::Finite);
        let colour = reference::colour(&ray, &rgb, background);
        let depth: f64 = ray.w.iter().zip(t).map(|(w, t)| w * t).sum();
        let ((rtol, atol), grad_rtol, grad_atol) = match record.kind {
            Kind::Random => ((1e-12, 1e-13), 1e-10, 1e-12),
            // A few subnormals.
            _ => ((1e-10, 1e-322), 1e-8, 1e-322),
        };
        let check = |name: &str, got: &[f64]| {
            assert_close(&format!("{label} {name}"), got, &record.output(name).data, rtol, atol);
        };
        check("weights", &ray.w);
        check("transmittance", &ray.trans);
        check("opacity", &[ray.opacity]);
        check("colour", &colour);
        check("depth", &[depth]);

        let colour_bar = &record.cotangent("colour").data;
        let depth_bar = record.cotangent("depth").scalar();
        let w_bar: Vec<f64> = (0..t.len())
            .map(|i| {
                let through_colour: f64 = (0..3).map(|c| colour_bar[c] * rgb[i][c]).sum();
                record.cotangent("weights").data[i] + depth_bar * t[i] + through_colour
            })
            .collect();
        let mut trans_bar = record.cotangent("transmittance").data.clone();
        let through_background: f64 = (0..3).map(|c| colour_bar[c] * background[c]).sum();
        trans_bar[t.len()] += through_background - record.cotangent("opacity").scalar();
        let tau_bar = reference::tau_bar(&tau, LastInterval::Finite, &w_bar, &trans_bar);
        let check = |name: &str, got: Vec<f64>| {
            let atol = grad_atol + 80.0 * lost_by_the_oracle(record);
            assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, atol);
        };
        check("sigma", tau_bar.iter().zip(delta).map(|(b, d)| b * d).collect());
        check("delta", tau_bar.iter().zip(sigma).map(|(b, s)| b * s).collect());
        check("rgb", ray.w.iter().flat_map(|w| colour_bar.iter().map(move |b| w * b)).collect());
        check("background", colour_bar.iter().map(|b| b * ray.trans[t.len()]).collect());
        check("t", ray.w.iter().map(|w| w * depth_bar).collect());
    }
}

#[test]
fn the_kernels_match_at_every_level() {
    let golden = golden();
    for record in golden.op("composite").filter(|r| r.f32_inputs_exact) {
        for simd in Simd::available() {
            kernels_match(record, simd);
        }
    }
}

fn kernels_match(record: &Record, simd: Simd) {
    let label = format!("{simd:?} {}", record.label());
    let input = |name: &str| record.input(name).f32();
    let (sigma, delta, t) = (input("sigma"), input("delta"), input("t"));
    let tau: Vec<f32> = sigma.iter().zip(&delta).map(|(s, d)| s * d).collect();
    let n = tau.len();
    let rgb_rows = input("rgb");
    // Channel by channel, with room between the channels.
    let stride = n + 5;
    let mut rgb = vec![0.0; 3 * stride];
    for (i, c) in rgb_rows.chunks(3).enumerate() {
        (0..3).for_each(|k| rgb[k * stride + i] = c[k]);
    }
    let background = input("background");
    let far = record.param("far").f32();
    let offsets = [0, n as u32];
    let samples = Samples { offsets: &offsets, tau: &tau, last: LastInterval::Finite };
    let values = Values { data: &rgb, stride, channels: 3 };
    let (mut colour, mut opaque, mut w, mut trans_end) = ([0.0; 3], [0.0], vec![0.0; n], [0.0]);
    let out = Composite { colour: &mut colour, opacity: &mut opaque, w: &mut w, trans_end: &mut trans_end };
    composite(simd, samples, values, &background, out);

    let [(rtol, atol), (grad_rtol, grad_atol)] = tolerance(record, &tau);
    let check = |name: &str, got: &[f32], want: &[f64]| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} {name}: {got:?}");
        assert_close(&format!("{label} {name}"), got, want, rtol, atol);
    };
    check("weights", &w, &record.output("weights").data);
    check("residual", &trans_end, &record.output("transmittance").data[n..]);
    check("colour", &colour, &record.output("colour").data);
    check("opacity", &opaque, &record.output("opacity").data);
    let mut one = [0.0];
    opacity(&offsets, &w, &mut one);
    check("opacity as a sum", &one, &record.output("opacity").data);
    depth_raw(&offsets, &w, &t, &mut one);
    check("depth", &one, &record.output("depth").data);
    let median = record.output("median_index").indices()[0];
    let sums: Vec<f64> = record
        .output("weights")
        .data
        .iter()
        .scan(0.0, |s, w| {
            *s += w;
            Some(*s)
        })
        .collect();
    // The median jumps where a running sum is one half up to rounding.
    if sums.iter().all(|s| (s - 0.5).abs() > 1e-6) {
        depth_median(&offsets, &w, &t, far, &mut one);
        assert_eq!(one[0], t.get(median).copied().unwrap_or(far), "{label} median");
    }
    if let Some(want) =
        record.get("outputs", "median_depth_exact").filter(|_| sums.iter().all(|s| (s - 0.5).abs() > 1e-6))
    {
        let start: Vec<f32> = t.iter().zip(&delta).map(|(t, d)| t - 0.5 * d).collect();
        depth_median_exact(samples, &start, &delta, far, &mut one);
        assert_close(&format!("{label} exact median"), &one, &want.data, 1e-5, 1e-6);
    }

    let w_bar: Vec<f32> = weight_bar(record).iter().map(|&x| x as f32).collect();
    let end_bar = record.cotangent("transmittance").data[n] - record.cotangent("opacity").scalar();
    let colour_bar = record.cotangent("colour").f32();
    let (mut tau_bar, mut values_bar, mut background_bar) = (vec![0.0; n], vec![0.0; 3 * stride], [0.0; 3]);
    let bar = CompositeBar { colour: &colour_bar, w: Some(&w_bar), trans_end: Some(&[end_bar as f32]) };
    let grads = CompositeGrads { tau: &mut tau_bar, values: &mut values_bar, background: Some(&mut background_bar) };
    composite_backward(simd, samples, values, &background, Weights { w: &w, trans_end: &trans_end }, bar, grads);
    let check = |name: &str, got: Vec<f64>| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} d{name}: {got:?}");
        let atol = grad_atol + 80.0 * lost_by_the_oracle(record);
        assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, atol);
    };
    let times = |x: &[f32]| tau_bar.iter().zip(x).map(|(b, x)| f64::from(*b) * f64::from(*x)).collect();
    check("sigma", times(&delta));
    check("delta", times(&sigma));
    check("rgb", (0..3 * n).map(|i| values_bar[i % 3 * stride + i / 3].into()).collect());
    check("background", background_bar.iter().map(|&x| x.into()).collect());
}

#[test]
fn expected_depth_matches() {
    let golden = golden();
    for record in golden.op("composite_depth_normalised").filter(|r| r.f32_inputs_exact) {
        let label = record.label();
        let input = |name: &str| record.input(name).f32();
        let (sigma, delta, t) = (input("sigma"), input("delta"), input("t"));
        let tau: Vec<f32> = sigma.iter().zip(&delta).map(|(s, d)| s * d).collect();
        let offsets = [0, tau.len() as u32];
        let samples = Samples { offsets: &offsets, tau: &tau, last: LastInterval::Finite };
        assert_eq!(record.param("eps").f64(), render_core::quadrature::MIN_OPACITY);
        let (mut w, mut end, mut depth) = (vec![0.0; tau.len()], [0.0], [0.0]);
        render_core::quadrature::weights(Simd::best(), samples, &mut w, &mut end);
        depth_expected(&offsets, &w, &t, 123.0, &mut depth);
        if w.iter().all(|&w| w == 0.0) {
            // Undefined: the golden file has 0 and the slope there, here it is the far value without one.
            assert_eq!(depth, [123.0], "{label}");
            continue;
        }
        let [(rtol, atol), (grad_rtol, grad_atol)] = tolerance(record, &tau);
        assert_close(&label, &depth, &record.output("depth_normalised").data, rtol, atol);
        let depth_bar = record.cotangent("depth_normalised").f32();
        let (mut w_bar, mut t_bar) = (vec![0.0; tau.len()], vec![0.0; tau.len()]);
        let bar = DepthBar { w: &mut w_bar, t: Some(&mut t_bar) };
        depth_expected_backward(&offsets, &w, &t, &depth_bar, bar);
        let mut tau_bar = vec![0.0; tau.len()];
        let bar = render_core::quadrature::WeightsBar { w: &w_bar, trans_end: None };
        let forward = Weights { w: &w, trans_end: &end };
        render_core::quadrature::weights_backward(Simd::best(), samples, forward, bar, &mut tau_bar);
        let check = |name: &str, got: Vec<f64>| {
            assert!(got.iter().all(|x| x.is_finite()), "{label} d{name}: {got:?}");
            assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, grad_atol);
        };
        let times = |x: &[f32]| tau_bar.iter().zip(x).map(|(b, x)| f64::from(*b) * f64::from(*x)).collect();
        check("t", t_bar.iter().map(|&x| x.into()).collect());
        check("sigma", times(&delta));
        check("delta", times(&sigma));
    }
}
