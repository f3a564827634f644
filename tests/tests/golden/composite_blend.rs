//! The blend of a static and a dynamic part against values and gradients made elsewhere, in the letters of both papers: the
//! `f64` reference tightly, the kernels at every level.

use float_core::Simd;
use render_core::quadrature::blend::{
    BlendSamples, BlendTrans, BlendValues, CompositeBlend, CompositeBlendBar, CompositeBlendGrads, composite_blend,
    composite_blend_backward, reference,
};
use render_core::quadrature::reference as single;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

/// Function, the name of its weight, and whether that is the share of the static part.
const OPS: [(&str, &str, bool); 2] = [("blend_dynerf", "b", true), ("blend_rodynrf", "m", false)];

/// Below this a transmittance of one part alone is 0 in `f32`: the kernels end at an optical depth of 87.
const UNDERFLOW: f64 = 2e-38;

/// Records whose gradient of the weight was rounded away where it was made: it is zeros, the densities are not, and differences of
/// 80 digits agree with the code here. There the size alone is compared, that of the optical depths.
const LOST: [&str; 2] = ["tiny_1e-20", "denormal_1e-41"];

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/composite_two.json")).unwrap()
}

/// Values of a sample: three colours, and the distance for a depth.
fn rows(rgb: &[f64], t: &[f64]) -> Vec<[f64; 4]> {
    rgb.chunks(3).zip(t).map(|(c, &t)| [c[0], c[1], c[2], t]).collect()
}

/// What reaches the four channels of the blend, or of one part alone.
fn channels_bar(record: &Record, part: &str) -> [f64; 4] {
    let c = &record.cotangent(&format!("colour{part}")).data;
    [c[0], c[1], c[2], record.cotangent(&format!("depth{part}")).scalar()]
}

fn dot(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test]
fn the_reference_matches_in_f64() {
    let golden = golden();
    for (op, letter, is_static) in OPS {
        for record in golden.op(op) {
            reference_matches(record, letter, is_static);
        }
    }
}

fn reference_matches(record: &Record, letter: &str, is_static: bool) {
    let label = record.label();
    let input = |name: &str| &record.input(name).data;
    let delta = input("delta");
    let depths = |name: &str| -> Vec<f64> { input(name).iter().zip(delta).map(|(s, d)| s * d).collect() };
    let tau = [depths("sigma_s"), depths("sigma_d")];
    let m: Vec<f64> = input(letter).iter().map(|&x| if is_static { 1.0 - x } else { x }).collect();
    let values = [rows(input("rgb_s"), input("t")), rows(input("rgb_d"), input("t"))];
    let n = m.len();
    let ((rtol, atol), grad_rtol, grad_atol) = match record.kind {
        Kind::Random => ((1e-12, 1e-13), 1e-10, 1e-12),
        // A few subnormals.
        _ => ((1e-10, 1e-322), 1e-8, 1e-322),
    };
    let ray = reference::weights(&tau[0], &tau[1], &m);
    let seen = reference::colour(&ray, &values[0], &values[1], [0.0; 4]);
    let check = |name: &str, got: &[f64]| {
        assert_close(&format!("{label} {name}"), got, &record.output(name).data, rtol, atol);
    };
    check("transmittance", &ray.trans);
    check("weights_static", &ray.w_s);
    check("weights_dynamic", &ray.w_d);
    check("weight_sum", &[ray.w_s.iter().chain(&ray.w_d).sum()]);
    check("colour", &seen[..3]);
    check("depth", &seen[3..]);
    check("dynamicness", &[ray.dynamic]);

    let (bar, sum_bar) = (channels_bar(record, ""), record.cotangent("weight_sum").scalar());
    let w_bar = ["static", "dynamic"].map(|part| record.cotangent(&format!("weights_{part}")).data.clone());
    let w_bar =
        [0, 1].map(|k| -> Vec<f64> { (0..n).map(|i| w_bar[k][i] + sum_bar + dot(&bar, &values[k][i])).collect() });
    let ray_bar = reference::RayBar {
        w_s: &w_bar[0],
        w_d: &w_bar[1],
        trans: &record.cotangent("transmittance").data,
        dynamic: record.cotangent("dynamicness").scalar(),
    };
    let blend = reference::weights_backward(&tau[0], &tau[1], &m, ray_bar);
    let mut tau_bar = [blend.tau_s, blend.tau_d];
    let mut values_bar = [&ray.w_s, &ray.w_d].map(|w| w.iter().map(|w| bar.map(|b| w * b)).collect::<Vec<_>>());
    // Each part alone, with its own transmittance.
    for (k, part) in ["static_only", "dynamic_only"].into_iter().enumerate() {
        let alone = single::weights(&tau[k], LastInterval::Finite);
        let bar = channels_bar(record, &format!("_{part}"));
        let sum = |c: usize| alone.w.iter().zip(&values[k]).map(|(w, v)| w * v[c]).sum::<f64>();
        check(&format!("colour_{part}"), &[0, 1, 2].map(sum));
        check(&format!("depth_{part}"), &[sum(3)]);
        let up: Vec<f64> = values[k].iter().map(|v| dot(&bar, v)).collect();
        let own = single::tau_bar(&tau[k], LastInterval::Finite, &up, &vec![0.0; n + 1]);
        for i in 0..n {
            tau_bar[k][i] += own[i];
            (0..4).for_each(|c| values_bar[k][i][c] += alone.w[i] * bar[c]);
        }
    }
    let check = |name: &str, got: Vec<f64>| {
        assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, grad_atol);
    };
    check("sigma_s", (0..n).map(|i| tau_bar[0][i] * delta[i]).collect());
    check("sigma_d", (0..n).map(|i| tau_bar[1][i] * delta[i]).collect());
    let by_delta = |i: usize| tau_bar[0][i] * input("sigma_s")[i] + tau_bar[1][i] * input("sigma_d")[i];
    check("delta", (0..n).map(by_delta).collect());
    let m_bar: Vec<f64> = blend.m.iter().map(|&m| if is_static { -m } else { m }).collect();
    if LOST.contains(&&*record.name) {
        is_small(record, letter, &m_bar, &tau.concat());
    } else {
        check(letter, m_bar);
    }
    check("rgb_s", values_bar[0].iter().flat_map(|v| v[..3].to_vec()).collect());
    check("rgb_d", values_bar[1].iter().flat_map(|v| v[..3].to_vec()).collect());
    check("t", (0..n).map(|i| values_bar[0][i][3] + values_bar[1][i][3]).collect());
}

/// See [`LOST`].
fn is_small(record: &Record, letter: &str, m_bar: &[f64], tau: &[f64]) {
    let label = record.label();
    assert!(record.grad(letter).data.iter().all(|&x| x == 0.0), "{label}: made anew? compare it");
    let largest = tau.iter().copied().fold(0.0, f64::max);
    assert!(m_bar.iter().all(|x| x.abs() < 20.0 * largest), "{label} d{letter}: {m_bar:?}");
}

#[test]
fn the_kernels_match_at_every_level() {
    let golden = golden();
    for (op, letter, is_static) in OPS {
        for record in golden.op(op).filter(|r| r.f32_inputs_exact) {
            for simd in Simd::available() {
                kernels_match(record, letter, is_static, simd);
            }
        }
    }
}

/// Colours and distances of both parts, channel by channel.
fn colours_and_depths(record: &Record, stride: [usize; 2], n: usize) -> [Vec<f32>; 2] {
    [0, 1].map(|k| {
        let rgb = record.input(["rgb_s", "rgb_d"][k]).f32();
        let (mut out, t) = (vec![0.0; 4 * stride[k]], record.input("t").f32());
        for i in 0..n {
            (0..3).for_each(|c| out[c * stride[k] + i] = rgb[3 * i + c]);
            out[3 * stride[k] + i] = t[i];
        }
        out
    })
}

/// Relative and absolute tolerance of values, and of gradients.
fn tolerances(record: &Record, depth: f32) -> [(f64, f64); 2] {
    let floor = if depth > 87.0 { UNDERFLOW } else { 3e-45 };
    match record.kind {
        Kind::Random => [(2e-6, 1e-6), (5e-5, 1e-5)],
        _ => [(1e-4, floor), (1e-3, floor)],
    }
}

fn kernels_match(record: &Record, letter: &str, is_static: bool, simd: Simd) {
    let label = format!("{simd:?} {}", record.label());
    let input = |name: &str| record.input(name).f32();
    let (sigma_s, sigma_d, delta) = (input("sigma_s"), input("sigma_d"), input("delta"));
    let depths = |sigma: &[f32]| -> Vec<f32> { sigma.iter().zip(&delta).map(|(s, d)| s * d).collect() };
    let tau = [depths(&sigma_s), depths(&sigma_d)];
    // The weights of the records are multiples of 1/1024: nothing is lost here.
    let m: Vec<f32> = input(letter).iter().map(|&x| if is_static { 1.0 - x } else { x }).collect();
    let n = m.len();
    let stride = [n + 5, n + 2];
    let values = colours_and_depths(record, stride, n);
    let part = |k: usize| Values { data: &values[k], stride: stride[k], channels: 4 };
    let offsets = [0, n as u32];
    let samples = BlendSamples { offsets: &offsets, tau_s: &tau[0], tau_d: &tau[1], m: &m };
    let blended = BlendValues { values_s: part(0), values_d: part(1), background: &[0.0; 4] };
    let (mut colour, mut dynamic, mut trans_end) = ([0.0; 4], [0.0], [0.0]);
    let (mut w_s, mut w_d, mut trans) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let out = CompositeBlend {
        colour: &mut colour,
        dynamic: &mut dynamic,
        trans_end: &mut trans_end,
        w_s: &mut w_s,
        w_d: &mut w_d,
        trans: &mut trans,
    };
    composite_blend(simd, samples, blended, out);

    let [(rtol, atol), (grad_rtol, grad_atol)] = tolerances(record, tau.iter().flatten().sum());
    let check = |name: &str, got: &[f32]| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} {name}: {got:?}");
        assert_close(&format!("{label} {name}"), got, &record.output(name).data, rtol, atol);
    };
    check("transmittance", &[&trans[..], &trans_end].concat());
    check("weights_static", &w_s);
    check("weights_dynamic", &w_d);
    check("weight_sum", &[w_s.iter().chain(&w_d).sum()]);
    check("colour", &colour[..3]);
    check("depth", &colour[3..]);
    check("dynamicness", &dynamic);

    let narrow = |x: &[f64; 4]| x.map(|x| x as f32);
    let colour_bar = narrow(&channels_bar(record, ""));
    let sum_bar = record.cotangent("weight_sum").f32()[0];
    let w_bar = ["weights_static", "weights_dynamic"]
        .map(|name| record.cotangent(name).f32().iter().map(|w| w + sum_bar).collect::<Vec<f32>>());
    let trans_bar = record.cotangent("transmittance").f32();
    let dynamic_bar = record.cotangent("dynamicness").f32();
    let bar = CompositeBlendBar {
        colour: &colour_bar,
        dynamic: Some(&dynamic_bar),
        trans_end: Some(&trans_bar[n..]),
        w_s: Some(&w_bar[0]),
        w_d: Some(&w_bar[1]),
        trans: Some(&trans_bar[..n]),
    };
    let (mut tau_bar, mut m_bar) = ([vec![0.0; n], vec![0.0; n]], vec![0.0; n]);
    let mut values_bar = stride.map(|stride| vec![0.0; 4 * stride]);
    let ([tau_s, tau_d], [values_s, values_d]) = (&mut tau_bar, &mut values_bar);
    let grads = CompositeBlendGrads { tau_s, tau_d, m: &mut m_bar, values_s, values_d, background: None };
    let forward = BlendTrans { trans: &trans, trans_end: &trans_end };
    composite_blend_backward(simd, samples, blended, forward, bar, grads);

    // Each part alone, with its own transmittance.
    let mut tau_bar = tau_bar.map(|bar| bar.iter().map(|&x| f64::from(x)).collect::<Vec<_>>());
    let mut values_bar = values_bar.map(|bar| bar.iter().map(|&x| f64::from(x)).collect::<Vec<_>>());
    for (k, name) in ["static_only", "dynamic_only"].into_iter().enumerate() {
        let samples = Samples { offsets: &offsets, tau: &tau[k], last: LastInterval::Finite };
        let (mut colour, mut opacity, mut w, mut end) = ([0.0; 4], [0.0], vec![0.0; n], [0.0]);
        let out = Composite { colour: &mut colour, opacity: &mut opacity, w: &mut w, trans_end: &mut end };
        composite(simd, samples, part(k), &[0.0; 4], out);
        check(&format!("colour_{name}"), &colour[..3]);
        check(&format!("depth_{name}"), &colour[3..]);
        let colour_bar = narrow(&channels_bar(record, &format!("_{name}")));
        let bar = CompositeBar { colour: &colour_bar, w: None, trans_end: None };
        let (mut own, mut values_own) = (vec![0.0; n], vec![0.0; 4 * stride[k]]);
        let grads = CompositeGrads { tau: &mut own, values: &mut values_own, background: None };
        composite_backward(simd, samples, part(k), &[0.0; 4], Weights { w: &w, trans_end: &end }, bar, grads);
        tau_bar[k].iter_mut().zip(&own).for_each(|(sum, own)| *sum += f64::from(*own));
        values_bar[k].iter_mut().zip(&values_own).for_each(|(sum, own)| *sum += f64::from(*own));
    }
    let check = |name: &str, got: Vec<f64>| {
        assert!(got.iter().all(|x| x.is_finite()), "{label} d{name}: {got:?}");
        assert_close(&format!("{label} d{name}"), &got, &record.grad(name).data, grad_rtol, grad_atol);
    };
    check("sigma_s", (0..n).map(|i| tau_bar[0][i] * f64::from(delta[i])).collect());
    check("sigma_d", (0..n).map(|i| tau_bar[1][i] * f64::from(delta[i])).collect());
    let by_delta = |i: usize| tau_bar[0][i] * f64::from(sigma_s[i]) + tau_bar[1][i] * f64::from(sigma_d[i]);
    check("delta", (0..n).map(by_delta).collect());
    let m_bar: Vec<f64> = m_bar.iter().map(|&m| f64::from(if is_static { -m } else { m })).collect();
    if LOST.contains(&&*record.name) {
        is_small(record, letter, &m_bar, &tau.concat().iter().map(|&tau| f64::from(tau)).collect::<Vec<_>>());
    } else {
        check(letter, m_bar);
    }
    let entry = |k: usize, c: usize, i: usize| values_bar[k][c * stride[k] + i];
    for (k, name) in ["rgb_s", "rgb_d"].into_iter().enumerate() {
        check(name, (0..3 * n).map(|j| entry(k, j % 3, j / 3)).collect());
    }
    check("t", (0..n).map(|i| entry(0, 3, i) + entry(1, 3, i)).collect());
}
