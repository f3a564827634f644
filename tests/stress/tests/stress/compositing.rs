//! Densities times lengths from nothing to overflow, and rays of 1 to 10^6 samples, against `f64`.

#![expect(clippy::needless_range_loop, reason = "several slices are read at one index")]

use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, check_density, composite,
    composite_backward, depth_expected, depth_median, depth_median_exact, disparity, reference,
};
use stress::{MAGNITUDES, Tally, Verdict, close, ensure, finite};

/// Depth from which a transmittance counts as 0; `exp(-87) = 1.6e-38`.
const DARK: f64 = 1.7e-38;
const LENGTHS: [usize; 15] = [1, 2, 3, 7, 8, 15, 16, 17, 511, 512, 513, 1000, 10_000, 100_000, 1_000_000];

/// One ray: what the kernels made of it.
struct Rendered {
    w: Vec<f32>,
    colour: Vec<f32>,
    opacity: f32,
    trans_end: f32,
    tau_bar: Vec<f32>,
    values_bar: Vec<f32>,
    background_bar: Vec<f32>,
}

/// Composite three channels of one ray over a background, and take `bar` back through it.
fn render(simd: Simd, tau: &[f32], last: LastInterval, values: &[f32], background: &[f32], bar: &[f32]) -> Rendered {
    let n = tau.len();
    let offsets = [0, n as u32];
    let samples = Samples { offsets: &offsets, tau, last };
    let values = Values { data: values, stride: n, channels: 3 };
    // NaN where the kernel must write.
    let mut r = Rendered {
        w: vec![f32::NAN; n],
        colour: vec![f32::NAN; 3],
        opacity: f32::NAN,
        trans_end: f32::NAN,
        tau_bar: vec![f32::NAN; n],
        values_bar: vec![f32::NAN; 3 * n],
        background_bar: vec![0.0; 3],
    };
    let (mut opacity, mut trans_end) = ([f32::NAN], [f32::NAN]);
    let out = Composite { colour: &mut r.colour, opacity: &mut opacity, w: &mut r.w, trans_end: &mut trans_end };
    composite(simd, samples, values, background, out);
    let forward = Weights { w: &r.w, trans_end: &trans_end };
    let bars = CompositeBar { colour: bar, w: None, trans_end: None };
    let grads =
        CompositeGrads { tau: &mut r.tau_bar, values: &mut r.values_bar, background: Some(&mut r.background_bar) };
    composite_backward(simd, samples, values, background, forward, bars, grads);
    (r.opacity, r.trans_end) = (opacity[0], trans_end[0]);
    r
}

/// Everything the kernels give, against the reference. Colours and gradients of order 1.
fn matches_reference(simd: Simd, tau: &[f32], last: LastInterval) -> Verdict {
    let n = tau.len();
    let values: Vec<f32> = (0..3 * n).map(|i| 0.5 + 0.5 * (i as f32 * 1.7).sin()).collect();
    let (background, bar) = ([0.25_f32, 1.0, 0.0], [1.0_f32, -0.5, 0.25]);
    let got = render(simd, tau, last, &values, &background, &bar);
    let exact_tau: Vec<f64> = tau.iter().map(|&x| f64::from(x)).collect();
    let want = reference::weights(&exact_tau, last);
    let mut depth = 0.0;
    for i in 0..n {
        // Rounding of the summed depth, a few ulps of the exponentials, and the end of the normal numbers.
        let bound = want.w[i] * (1e-6 + 1.2e-7 * f64::min(depth, 90.0)) + DARK;
        close(&format!("w[{i}]"), got.w[i].into(), want.w[i], bound)?;
        depth += exact_tau[i];
    }
    let end = want.trans[n];
    close("trans_end", got.trans_end.into(), end, end * (1e-6 + 1.2e-7 * depth.min(90.0)) + DARK)?;
    close("opacity", got.opacity.into(), want.opacity, 1e-6 * want.opacity + 1e-44)?;
    let rows: Vec<[f64; 3]> = (0..n).map(|i| [0, 1, 2].map(|c| f64::from(values[c * n + i]))).collect();
    let colour = reference::colour(&want, &rows, background.map(f64::from));
    for c in 0..3 {
        close(&format!("colour[{c}]"), got.colour[c].into(), colour[c], 2e-6)?;
        close(
            &format!("background_bar[{c}]"),
            got.background_bar[c].into(),
            end * f64::from(bar[c]),
            1e-5 * end + DARK,
        )?;
    }
    let exact_bar = |at: &dyn Fn(usize) -> f32| (0..3).map(|c| f64::from(at(c)) * f64::from(bar[c])).sum::<f64>();
    let w_bar: Vec<f64> = (0..n).map(|i| exact_bar(&|c| values[c * n + i])).collect();
    let mut trans_bar = vec![0.0; n + 1];
    trans_bar[n] = exact_bar(&|c| background[c]);
    let tau_bar = reference::tau_bar(&exact_tau, last, &w_bar, &trans_bar);
    for i in 0..n {
        close(&format!("tau_bar[{i}]"), got.tau_bar[i].into(), tau_bar[i], 4e-6)?;
        for c in 0..3 {
            let (got, want) = (got.values_bar[c * n + i], want.w[i] * f64::from(bar[c]));
            close(&format!("values_bar[{c}][{i}]"), got.into(), want, 2e-5 * want.abs() + DARK)?;
        }
    }
    Ok(())
}

/// Constant density over a total depth: the opacity does not depend on the number of samples, the weights fall
/// geometrically, and the gradient is the closed form.
fn constant_density(simd: Simd, n: usize, total: f64) -> Verdict {
    let tau = vec![(total / n as f64) as f32; n];
    let (step, values) = (f64::from(tau[0]), vec![1.0_f32; 3 * n]);
    let got = render(simd, &tau, LastInterval::Finite, &values, &[0.0; 3], &[1.0, 0.0, 0.0]);
    let depth = step * n as f64;
    let opacity = -(-depth).exp_m1();
    // One f32 rounding of the depth in front of each sample, whatever their number.
    let relative = 2e-6 + 1.2e-7 * depth.min(90.0);
    close("opacity", got.opacity.into(), opacity, 1e-6 * opacity)?;
    close("trans_end", got.trans_end.into(), (-depth).exp(), relative * (-depth).exp() + DARK)?;
    for c in 0..3 {
        close(&format!("colour[{c}]"), got.colour[c].into(), opacity, (relative + 1e-6) * opacity)?;
    }
    let sum: f64 = got.w.iter().map(|&w| f64::from(w)).sum();
    close("sum(w) + trans_end", sum + f64::from(got.trans_end), 1.0, 2e-6)?;
    for i in [0, n / 3, n / 2, n - 1] {
        let before = step * i as f64;
        let want = (-before).exp() * -(-step).exp_m1();
        close(&format!("w[{i}]"), got.w[i].into(), want, want * relative + DARK)?;
        // All colours 1 over black: more density anywhere lets less of the background through.
        let want = (-depth).exp();
        close(&format!("tau_bar[{i}]"), got.tau_bar[i].into(), want, 1e-5 * want + 1e-6 * opacity + DARK)?;
    }
    finite("tau_bar", &got.tau_bar)?;
    finite("values_bar", &got.values_bar)
}

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    for sigma in MAGNITUDES {
        for dt in MAGNITUDES {
            // May overflow to infinity, which is opaque.
            let tau = sigma * dt;
            for (mode, last) in [("finite", LastInterval::Finite), ("opaque", LastInterval::Opaque)] {
                let name = format!("sigma {sigma:e} x dt {dt:e}, last interval {mode}");
                tally.case(name, "forward and backward within 4e-6 of f64", || {
                    matches_reference(simd, &[0.3, 1e-3, tau, 0.2, 1e-8], last)?;
                    matches_reference(simd, &[tau; 9], last)?;
                    matches_reference(simd, &[tau], last)
                });
            }
        }
    }
    for n in LENGTHS {
        for total in [1e-36, 1e-6, 0.7, 30.0, 80.0, 1e4, 1e30] {
            let promise = "opacity, weights and gradients of the closed form, whatever the number of samples";
            tally.case(format!("{n} samples of depth {total:e} in all"), promise, || constant_density(simd, n, total));
        }
    }
    for colour in [1e-45_f32, 1e-38, 1e-20, 1e10, 1e18, 1e30] {
        tally.case(
            format!("radiance {colour:e}"),
            "the pixel is the weighted mean to 2e-6, gradients are finite",
            || {
                let got = render(simd, &[0.5; 20], LastInterval::Finite, &[colour; 60], &[colour; 3], &[1.0; 3]);
                for c in 0..3 {
                    close("colour", got.colour[c].into(), colour.into(), 2e-6 * f64::from(colour) + 1e-44)?;
                }
                finite("tau_bar", &got.tau_bar)?;
                finite("values_bar", &got.values_bar)
            },
        );
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, -1e-45] {
        tally.case(format!("density {bad} at the boundary"), "one error that names the sample", || {
            let mut sigma = vec![1.0; 700];
            sigma[513] = bad;
            match check_density("sigma", &sigma) {
                Err(e) => ensure(e.index == 513 && e.to_string().contains("sigma[513]"), || format!("said: {e}")),
                Ok(()) => Err("was let through".into()),
            }
        });
    }
}

pub(crate) fn depths(tally: &mut Tally) {
    for tau in MAGNITUDES {
        for t in MAGNITUDES {
            let name = format!("optical depth {tau:e} at distance {t:e}");
            tally.case(name, "depths finite and between the samples, or exactly `far`", || {
                let (far, offsets) = (f32::MAX, [0_u32, 3]);
                let at = [t, t * 1.5, t * 2.0].map(|t| t.min(f32::MAX));
                let reference = reference::weights(&[f64::from(tau); 3], LastInterval::Finite);
                let w: Vec<f32> = reference.w.iter().map(|&w| w as f32).collect();
                let mut out = [f32::NAN];
                depth_expected(&offsets, &w, &at, far, &mut out);
                let hit = w.iter().any(|&w| w > 0.0);
                let opacity: f64 = w.iter().map(|&w| f64::from(w)).sum();
                // Below the smallest opacity the depth fades to 0, by contract.
                let fades = opacity < render_core::quadrature::MIN_OPACITY;
                let within = |x: f32| x >= at[0] * 0.999_999 && x <= at[2];
                ensure(if hit { within(out[0]) || fades && out[0] <= at[2] } else { out[0] == far }, || {
                    format!("expected depth {:e} of samples at {at:?}", out[0])
                })?;
                depth_median(&offsets, &w, &at, far, &mut out);
                ensure(if opacity < 0.499_999 { out[0] == far } else { within(out[0]) || out[0] == far }, || {
                    format!("median depth {:e}, opacity {opacity}", out[0])
                })?;
                let dt = [at[1] - at[0], at[2] - at[1], 0.0];
                let samples = Samples { offsets: &offsets, tau: &[tau; 3], last: LastInterval::Finite };
                depth_median_exact(samples, &at, &dt, far, &mut out);
                ensure(within(out[0]) || out[0] == far, || format!("exact median depth {:e} of {at:?}", out[0]))?;
                disparity(&offsets, &w, &at, &mut out);
                ensure(out[0] >= 0.0 && !out[0].is_nan(), || format!("disparity {}", out[0]))
            });
        }
    }
}
