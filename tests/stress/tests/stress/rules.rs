//! Rules between samples: pairs of densities from nothing to infinity on lengths from nothing to overflow.

use float_core::Simd;
use render_core::quadrature::{
    IntervalsBar, Points, PointsBar, Rule, Values, intervals, intervals_backward, reference,
};
use stress::{MAGNITUDES, Tally, Verdict, close, ensure};

const LENGTHS: [f32; 9] = [0.0, 1e-45, 1e-38, 1e-20, 1e-3, 1.0, 1e10, 1e20, 3e38];
/// Values at the two ends.
const V: [f32; 2] = [0.25, 0.75];

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    let densities: Vec<f32> = MAGNITUDES.into_iter().chain([f32::INFINITY]).collect();
    for &a in &densities {
        for &b in &densities {
            tally.case(
                format!("densities {a:e} and {b:e}"),
                "optical depth of two roundings, a value between those of the ends, no NaN in the gradients",
                || {
                    LENGTHS
                        .iter()
                        .try_for_each(|&dt| Rule::ALL.iter().try_for_each(|&rule| pair(simd, rule, [a, b], dt)))
                },
            );
        }
    }
}

fn pair(simd: Simd, rule: Rule, sigma: [f32; 2], dt: f32) -> Verdict {
    let (offsets, dts) = ([0, 2], [dt, 0.0]);
    let values = Values { data: &V, stride: 2, channels: 1 };
    let points = Points { offsets: &offsets, dt: &dts, sigma: &sigma, values };
    let (mut tau, mut data) = ([f32::NAN; 2], [f32::NAN; 2]);
    intervals(simd, rule, points, &mut tau, &mut data);
    let said = |problem: String| format!("{rule:?}, length {dt:e}: {problem}");

    let [a, b, long] = [sigma[0], sigma[1], dt].map(f64::from);
    let mean = if rule == Rule::PiecewiseConstant { a } else { 0.5 * (a + b) };
    let want = if long == 0.0 { 0.0 } else { mean * long };
    let got = f64::from(tau[0]);
    if want > f64::from(f32::MAX) {
        ensure(got >= 0.999 * f64::from(f32::MAX), || format!("optical depth {got:e} where there is {want:e}"))
    } else {
        // Denormal means and products keep an absolute error.
        close("optical depth", got, want, 2.5e-7 * want + 1.5e-45 * (1.0 + long))
    }
    .map_err(said)?;
    ensure(tau[1] == 0.0 && data[1] == V[1], || said(format!("the end became {:e}, {}", tau[1], data[1])))?;
    let share = (f64::from(data[0]) - 0.25) / 0.5;
    match rule {
        Rule::PiecewiseConstant => ensure(share == 0.0, || said(format!("share {share}")))?,
        Rule::Trapezoid => close("share", share, 0.5, 1e-6).map_err(said)?,
        Rule::PiecewiseLinear => {
            ensure((-2e-6..=1.0 + 2e-6).contains(&share), || said(format!("share {share}")))?;
            if want > 1e-20 && long > 0.0 {
                let [a, b] = [a, b].map(|x| (x * long).min(1e30));
                close("share", share, reference::centroid(a, b), 3e-6).map_err(said)?;
            }
        }
    }
    let (mut sigma_bar, mut dt_bar, mut v_bar) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    let grads = PointsBar { sigma: &mut sigma_bar, values: &mut v_bar, dt: Some(&mut dt_bar) };
    intervals_backward(simd, rule, points, IntervalsBar { tau: &[1.0; 2], values: &[1.0; 2] }, grads);
    let bars = [sigma_bar, dt_bar, v_bar].concat();
    ensure(bars.iter().all(|g| !g.is_nan()), || said(format!("gradients {bars:?}")))?;
    close("sum of the gradients of the values", (v_bar[0] + v_bar[1]).into(), 2.0, 1e-5).map_err(said)
}
