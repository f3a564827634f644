//! Joint compositing of a static and a transient part against values and gradients made elsewhere (as published): the
//! `f64` reference tightly, the kernels at every level.

use float_core::Simd;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward, reference,
};
use render_core::quadrature::{LastInterval, Samples, Values, Weights, WeightsBar, weights, weights_backward};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/composite_two.json")).unwrap()
}

/// Below this a transmittance is 0 in `f32`: the kernels end at an optical depth of 87.
const UNDERFLOW: f64 = 2e-38;

fn rows(data: &[f64]) -> Vec<[f64; 3]> {
    data.chunks(3).map(|c| [c[0], c[1], c[2]]).collect()
}

/// What reaches the two parts' colours: through the total and through the part's own.
fn part_bar(record: &Record, part: &str) -> [f64; 3] {
    [0, 1, 2].map(|c| record.cotangent("colour").data[c] + record.cotangent(part).data[c])
}

/// Gradient with respect to the transmittances other than through colours, where the joint weights are written as
/// `T[i] - T[i + 1]` and the opacity as `1 - T[n]`.
fn trans_bar(record: &Record) -> Vec<f64> {
    let mut bar = record.cotangent("transmittance").data.clone();
    for (i, b) in record.cotangent("weights").data.iter().enumerate() {
        bar[i] += b;
        bar[i + 1] -= b;
    }
    *bar.last_mut().unwrap() -= record.cotangent("opacity").scalar();
    bar
}

#[test]
fn the_reference_matches_in_f64() {
    let golden = golden();
    for record in golden.op("nerfw") {
        let label = record.label();
        let input = |name: &str| &record.input(name).data;
        let delta = input("delta");
        let depths = |name: &str| -> Vec<f64> { input(name).iter().zip(delta).map(|(s, d)| s * d).collect() };
        let (tau_s, tau_t) = (depths("sigma_s"), depths("sigma_t"));
        let (rgb_s, rgb_t, beta) = (rows(input("rgb_s")), rows(input("rgb_t")), input("beta"));
        let background = [0, 1, 2].map(|c| input("background")[c]);
        let ray = reference::weights(Mixture::Paper, &tau_s, &tau_t);
        let pixel = reference::pixel(&ray, &rgb_s, &rgb_t, beta, background);
        let n = tau_s.len();
        let ((rtol, atol), grad_rtol, grad_atol) = match record.kind {
            Kind::Random => ((1e-12, 1e-13), 1e-10, 1e-12),
            // A few subnormals.
            _ => ((1e-10, 1e-322), 1e-8, 1e-322),
        };
        let check = |name: &str, got: &[f64]| {
            assert_close(&format!("{label} {name}"), got, &record.output(name).data, rtol, atol);
        };
        check("weights_static", &ray.w_s);
        check("weights_transient", &ray.w_t);
        check("transmittance", &ray.trans);
        check("colour", &pixel.colour);
        check("beta", &[pixel.beta + record.param("beta_min").f64()]);

        let (s_bar, t_bar) = (part_bar(record, "colour_static"), part_bar(record, "colour_transient"));
        let beta_bar = record.cotangent("beta").scalar();
        let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let w_s_bar: Vec<f64> =
            (0..n).map(|i| record.cotangent("weights_static").data[i] + dot(&s_bar, &rgb_s[i])).collect();
        let w_t_bar: Vec<f64> = (0..n)
            .map(|i| record.cotangent("weights_transient").data[i] + dot(&t_bar, &rgb_t[i]) + beta_bar * beta[i])
            .collect();
        let mut trans_bar = trans_bar(record);
        let colour_bar = [0, 1, 2].map(|c| record.cotangent("colour").data[c]);
        trans_bar[n] += dot(&colour_bar, &background);
        let bars = reference::tau_bar(Mixture::Paper, &tau_s, &tau_t, [&w_s_bar, &w_t_bar], &trans_bar);
        let check = |name: &str, got: Vec<f64>| {
            assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, grad_atol);
        };
        check("sigma_s", bars[0].iter().zip(delta).map(|(b, d)| b * d).collect());
        check("sigma_t", bars[1].iter().zip(delta).map(|(b, d)| b * d).collect());
        let by_delta = |i: usize| bars[0][i] * input("sigma_s")[i] + bars[1][i] * input("sigma_t")[i];
        check("delta", (0..n).map(by_delta).collect());
        check("rgb_s", ray.w_s.iter().flat_map(|w| s_bar.map(|b| w * b)).collect());
        check("rgb_t", ray.w_t.iter().flat_map(|w| t_bar.map(|b| w * b)).collect());
        check("beta", ray.w_t.iter().map(|w| w * beta_bar).collect());
        check("background", colour_bar.iter().map(|b| b * ray.trans[n]).collect());
    }
}

#[test]
fn the_kernels_match_at_every_level() {
    let golden = golden();
    for record in golden.op("nerfw").filter(|r| r.f32_inputs_exact) {
        for simd in Simd::available() {
            kernels_match(record, simd);
        }
    }
}

/// Sample by sample to channel by channel, with room between the channels.
fn channels(rows: &[f32], stride: usize) -> Vec<f32> {
    let mut out = vec![0.0; 3 * stride];
    for (i, c) in rows.chunks(3).enumerate() {
        (0..3).for_each(|k| out[k * stride + i] = c[k]);
    }
    out
}

/// The inner transmittances and the joint weights are those of one part with the sum of both optical depths, in front of what is
/// missing from 1: their gradients come from there.
fn joint_gradient(record: &Record, simd: Simd, offsets: &[u32], tau: &[f32]) -> Vec<f32> {
    let n = tau.len();
    let joint = Samples { offsets, tau, last: LastInterval::Finite };
    let (mut w, mut end) = (vec![0.0; n], [0.0]);
    weights(simd, joint, &mut w, &mut end);
    let cotangents = &record.cotangent("transmittance").data;
    let mut behind = 0.0;
    let mut w_bar = vec![0.0; n];
    for i in (0..n).rev() {
        w_bar[i] = (record.cotangent("weights").data[i] - behind) as f32;
        behind += cotangents[i];
    }
    let end_bar = [(cotangents[n] - record.cotangent("opacity").scalar()) as f32];
    let mut joint_bar = vec![0.0; n];
    let bar = WeightsBar { w: &w_bar, trans_end: Some(&end_bar) };
    weights_backward(simd, joint, Weights { w: &w, trans_end: &end }, bar, &mut joint_bar);
    joint_bar
}

fn kernels_match(record: &Record, simd: Simd) {
    let label = format!("{simd:?} {}", record.label());
    let input = |name: &str| record.input(name).f32();
    let (sigma_s, sigma_t, delta, beta) = (input("sigma_s"), input("sigma_t"), input("delta"), input("beta"));
    let depths = |sigma: &[f32]| -> Vec<f32> { sigma.iter().zip(&delta).map(|(s, d)| s * d).collect() };
    let (tau_s, tau_t) = (depths(&sigma_s), depths(&sigma_t));
    let n = delta.len();
    let (stride_s, stride_t) = (n + 5, n + 2);
    let (rgb_s, rgb_t) = (channels(&input("rgb_s"), stride_s), channels(&input("rgb_t"), stride_t));
    let background = input("background");
    let offsets = [0, n as u32];
    let samples = TwoSamples { offsets: &offsets, tau_s: &tau_s, tau_t: &tau_t };
    let values_s = Values { data: &rgb_s, stride: stride_s, channels: 3 };
    let values_t = Values { data: &rgb_t, stride: stride_t, channels: 3 };
    let values = TwoValues { values_s, values_t, beta: &beta, background: &background };
    let (mut colour, mut uncertain, mut transient, mut trans_end) = ([0.0; 3], [0.0], [0.0], [0.0]);
    let (mut w_s, mut w_t) = (vec![0.0; n], vec![0.0; n]);
    let out = CompositeTwo {
        colour: &mut colour,
        beta: &mut uncertain,
        transient: &mut transient,
        trans_end: &mut trans_end,
        w_s: &mut w_s,
        w_t: &mut w_t,
    };
    composite_two(simd, samples, Mixture::Paper, values, out);

    let tau: Vec<f32> = tau_s.iter().zip(&tau_t).map(|(s, t)| s + t).collect();
    let floor = if tau.iter().sum::<f32>() > 87.0 { UNDERFLOW } else { 3e-45 };
    let [(rtol, atol), (grad_rtol, grad_atol)] = match record.kind {
        Kind::Random => [(2e-6, 1e-6), (5e-5, 1e-5)],
        _ => [(1e-4, floor), (1e-3, floor)],
    };
    let check = |name: &str, got: &[f32], want: &[f64]| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} {name}: {got:?}");
        assert_close(&format!("{label} {name}"), got, want, rtol, atol);
    };
    check("weights_static", &w_s, &record.output("weights_static").data);
    check("weights_transient", &w_t, &record.output("weights_transient").data);
    check("residual", &trans_end, &record.output("transmittance").data[n..]);
    check("colour", &colour, &record.output("colour").data);
    check("beta", &[uncertain[0] + record.param("beta_min").f32()], &record.output("beta").data);
    check("transient", &transient, &[record.output("weights_transient").data.iter().sum()]);

    // The colours of the two parts alone have no output here: their cotangents enter through the weights.
    let colour_bar = record.cotangent("colour").f32();
    let beta_bar = record.cotangent("beta").f32();
    let own = |part: &str, rgb: &str, weights: &str| -> Vec<f32> {
        let bar = &record.cotangent(part).data;
        let rows = record.input(rgb).data.chunks(3);
        let through = rows.map(|c| c.iter().zip(bar).map(|(c, b)| c * b).sum::<f64>());
        through.zip(&record.cotangent(weights).data).map(|(x, w)| (x + w) as f32).collect()
    };
    let w_s_bar = own("colour_static", "rgb_s", "weights_static");
    let w_t_bar = own("colour_transient", "rgb_t", "weights_transient");
    let bar = CompositeTwoBar {
        colour: &colour_bar,
        beta: Some(&beta_bar),
        transient: None,
        trans_end: None,
        w_s: Some(&w_s_bar),
        w_t: Some(&w_t_bar),
    };
    let (mut tau_s_bar, mut tau_t_bar, mut by_beta) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let (mut s_bar, mut t_bar, mut background_bar) = (vec![0.0; 3 * stride_s], vec![0.0; 3 * stride_t], [0.0; 3]);
    let grads = CompositeTwoGrads {
        tau_s: &mut tau_s_bar,
        tau_t: &mut tau_t_bar,
        values_s: &mut s_bar,
        values_t: &mut t_bar,
        beta: &mut by_beta,
        background: Some(&mut background_bar),
    };
    let forward = WeightsTwo { w_s: &w_s, w_t: &w_t, trans_end: &trans_end };
    composite_two_backward(simd, samples, Mixture::Paper, values, forward, bar, grads);

    let joint_bar = joint_gradient(record, simd, &offsets, &tau);

    let check = |name: &str, got: Vec<f64>| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} d{name}: {got:?}");
        assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, grad_atol);
    };
    let both = |bar: &[f32], i: usize| f64::from(bar[i]) + f64::from(joint_bar[i]);
    check("sigma_s", (0..n).map(|i| both(&tau_s_bar, i) * f64::from(delta[i])).collect());
    check("sigma_t", (0..n).map(|i| both(&tau_t_bar, i) * f64::from(delta[i])).collect());
    let by_delta = |i: usize| both(&tau_s_bar, i) * f64::from(sigma_s[i]) + both(&tau_t_bar, i) * f64::from(sigma_t[i]);
    check("delta", (0..n).map(by_delta).collect());
    check("beta", by_beta.iter().map(|&x| x.into()).collect());
    // The gradients of the colours carry the total only; the own cotangents are the weights times those.
    let colours = |bar: &[f32], stride: usize, w: &[f32], own: &str| -> Vec<f64> {
        let own = &record.cotangent(own).data;
        let entry = |i: usize| f64::from(bar[i % 3 * stride + i / 3]) + f64::from(w[i / 3]) * own[i % 3];
        (0..3 * n).map(entry).collect()
    };
    check("rgb_s", colours(&s_bar, stride_s, &w_s, "colour_static"));
    check("rgb_t", colours(&t_bar, stride_t, &w_t, "colour_transient"));
    check("background", background_bar.iter().map(|&x| x.into()).collect());
}
