//! Compositing of a static and a transient part against the stream of memory.

use super::found::{Found, Kernel, Row, passes};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{interleaved, worst};
use crate::sections::ceilings::{Big, LARGE_TABLE, read};
use float_core::Simd;
use render_core::quadrature::Values;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward, reference,
};

/// Rays with the same number of samples, forward and backward. Of the two parts the static one is first.
struct Batch {
    offsets: Vec<u32>,
    tau: [Vec<f32>; 2],
    rgb: [Vec<f32>; 2],
    beta: Vec<f32>,
    background: Vec<f32>,
    colour: Vec<f32>,
    /// Uncertainty, share of the transient part, transmittance at the end.
    of_ray: [Vec<f32>; 3],
    w: [Vec<f32>; 2],
    tau_bar: [Vec<f32>; 2],
    rgb_bar: [Vec<f32>; 2],
    beta_bar: Vec<f32>,
}

impl Kernel for Batch {
    fn forward(&mut self, simd: Simd) {
        let samples = TwoSamples { offsets: &self.offsets, tau_s: &self.tau[0], tau_t: &self.tau[1] };
        let ([beta, transient, trans_end], [w_s, w_t]) = (&mut self.of_ray, &mut self.w);
        let out = CompositeTwo { colour: &mut self.colour, beta, transient, trans_end, w_s, w_t };
        composite_two(simd, samples, Mixture::Paper, values(&self.rgb, &self.beta, &self.background), out);
    }

    /// Gradients; colour and uncertainty stand in for their own.
    fn backward(&mut self, simd: Simd) {
        let samples = TwoSamples { offsets: &self.offsets, tau_s: &self.tau[0], tau_t: &self.tau[1] };
        let [beta, _, trans_end] = &self.of_ray;
        let forward = WeightsTwo { w_s: &self.w[0], w_t: &self.w[1], trans_end };
        let (colour, beta) = (&self.colour[..], Some(&beta[..]));
        let bar = CompositeTwoBar { colour, beta, transient: None, trans_end: None, w_s: None, w_t: None };
        let ([tau_s, tau_t], [values_s, values_t]) = (&mut self.tau_bar, &mut self.rgb_bar);
        let grads = CompositeTwoGrads { tau_s, tau_t, values_s, values_t, beta: &mut self.beta_bar, background: None };
        let values = values(&self.rgb, &self.beta, &self.background);
        composite_two_backward(simd, samples, Mixture::Paper, values, forward, bar, grads);
    }
}

impl Batch {
    fn new(rays: usize, samples: usize) -> Self {
        let n = rays * samples;
        let rows = |count: usize, step: usize, scale: f32| -> Vec<f32> {
            (0..count).map(|i| (i * step % 101) as f32 * scale).collect()
        };
        // Between nothing and a depth of 2 along the ray.
        let tau = |step: usize| rows(n, step, 0.04 / samples as f32);
        Self {
            offsets: (0..=rays).map(|r| (r * samples) as u32).collect(),
            tau: [tau(7919), tau(31)],
            rgb: [rows(3 * n, 31, 0.01), rows(3 * n, 17, 0.01)],
            beta: rows(n, 13, 0.01),
            background: vec![1.0; 3 * rays],
            colour: vec![0.0; 3 * rays],
            of_ray: std::array::from_fn(|_| vec![0.0; rays]),
            w: std::array::from_fn(|_| vec![0.0; n]),
            tau_bar: std::array::from_fn(|_| vec![0.0; n]),
            rgb_bar: std::array::from_fn(|_| vec![0.0; 3 * n]),
            beta_bar: vec![0.0; n],
        }
    }

    /// Errors of colours and of the gradients of the transient part's optical depths against the reference.
    fn errors(&mut self, simd: Simd) -> (f64, f64) {
        self.forward(simd);
        self.backward(simd);
        let stride = self.tau[0].len();
        let (mut colours, mut tau_bars) = (Vec::new(), Vec::new());
        for r in 0..self.offsets.len() - 1 {
            let range = self.offsets[r] as usize..self.offsets[r + 1] as usize;
            let wide = |x: &[f32]| x[range.clone()].iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();
            let [tau_s, tau_t] = [0, 1].map(|part| wide(&self.tau[part]));
            let rgb = [0, 1].map(|part: usize| {
                let at = |i: usize| [0, 1, 2].map(|c| f64::from(self.rgb[part][c * stride + i]));
                range.clone().map(at).collect::<Vec<[f64; 3]>>()
            });
            let beta = wide(&self.beta);
            let background = [0, 1, 2].map(|c| f64::from(self.background[3 * r + c]));
            let ray = reference::weights(Mixture::Paper, &tau_s, &tau_t);
            colours.extend(reference::pixel(&ray, &rgb[0], &rgb[1], &beta, background).colour);
            let (bar, beta_bar) = ([0, 1, 2].map(|c| f64::from(self.colour[3 * r + c])), f64::from(self.of_ray[0][r]));
            let along = |v: &[f64; 3]| v.iter().zip(bar).map(|(v, b)| v * b).sum::<f64>();
            let w_s: Vec<f64> = rgb[0].iter().map(along).collect();
            let w_t: Vec<f64> = rgb[1].iter().zip(&beta).map(|(v, b)| along(v) + b * beta_bar).collect();
            let mut trans_bar = vec![0.0; tau_s.len() + 1];
            trans_bar[tau_s.len()] = along(&background);
            let [_, of_t] = reference::tau_bar(Mixture::Paper, &tau_s, &tau_t, [&w_s, &w_t], &trans_bar);
            tau_bars.extend(of_t);
        }
        (worst(&self.colour, &colours), worst(&self.tau_bar[1], &tau_bars))
    }
}

/// What is composited.
fn values<'a>(rgb: &'a [Vec<f32>; 2], beta: &'a [f32], background: &'a [f32]) -> TwoValues<'a> {
    let part = |rgb: &'a [f32]| Values { data: rgb, stride: rgb.len() / 3, channels: 3 };
    TwoValues { values_s: part(&rgb[0]), values_t: part(&rgb[1]), beta, background }
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    const RAYS: usize = 4096;
    const SAMPLES: usize = 64;
    let (big, simd) = (Big::new(LARGE_TABLE), bench.simd);
    let (values, gradients) = Batch::new(16, SAMPLES).errors(simd);
    for threads in bench.pools.one_and_most() {
        let (stream, bytes) = read(&bench.pools, simd, threads, &big);
        let state = || Some(Batch::new(RAYS / threads, SAMPLES));
        let [forward, both] = passes(&bench.pools, simd, threads, state);
        let mut cases = [stream, forward, both];
        let seconds = interleaved(bench.effort, &mut cases);
        // Forward: two depths, two colours and an uncertainty in, two weights out. Backward: all of these in, and the gradients of
        // the nine inputs out.
        for (j, (job, bytes_each)) in [("forward", 44.0), ("forward+backward", 124.0)].into_iter().enumerate() {
            found.row(&Row {
                kernel: &format!("joint compositing of two parts, {RAYS} x {SAMPLES} {job}"),
                level: level_name(simd.level()),
                threads,
                rate: (RAYS / threads * threads * SAMPLES) as f64 / seconds[1 + j],
                unit: "samples",
                ceiling: Some((bytes / seconds[0] / bytes_each, "streaming reads (caches may beat it)")),
                error: (Some(values), (j == 1).then_some(gradients)),
            })?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joint_compositing_is_as_near_the_reference_as_its_tests_say() {
        for simd in Simd::available() {
            let (values, gradients) = Batch::new(16, 64).errors(simd);
            assert!(values > 0.0 && values < 1e-6 && gradients > 0.0 && gradients < 3e-6, "{values} {gradients}");
        }
    }
}
