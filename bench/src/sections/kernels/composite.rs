//! Compositing against the stream of memory.

use super::found::{Found, Row};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, interleaved, worst};
use crate::sections::ceilings::{Big, LARGE_TABLE, read};
use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
    reference,
};

/// Rays with the same number of samples, forward and backward.
pub(crate) struct Batch {
    offsets: Vec<u32>,
    tau: Vec<f32>,
    rgb: Vec<f32>,
    background: Vec<f32>,
    colour: Vec<f32>,
    opacity: Vec<f32>,
    w: Vec<f32>,
    trans_end: Vec<f32>,
    tau_bar: Vec<f32>,
    rgb_bar: Vec<f32>,
}

impl Batch {
    pub(crate) fn new(rays: usize, samples: usize) -> Self {
        let n = rays * samples;
        Self {
            offsets: (0..=rays).map(|r| (r * samples) as u32).collect(),
            // Between nothing and a depth of 2 along the ray.
            tau: (0..n).map(|i| (i * 7919 % 101) as f32 * 0.04 / samples as f32).collect(),
            rgb: (0..3 * n).map(|i| (i * 31 % 97) as f32 / 97.0).collect(),
            background: vec![1.0; 3 * rays],
            colour: vec![0.0; 3 * rays],
            opacity: vec![0.0; rays],
            w: vec![0.0; n],
            trans_end: vec![0.0; rays],
            tau_bar: vec![0.0; n],
            rgb_bar: vec![0.0; 3 * n],
        }
    }

    pub(crate) fn forward(&mut self, simd: Simd) {
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.rgb, stride: self.tau.len(), channels: 3 };
        let out = Composite {
            colour: &mut self.colour,
            opacity: &mut self.opacity,
            w: &mut self.w,
            trans_end: &mut self.trans_end,
        };
        composite(simd, samples, values, &self.background, out);
    }

    /// Gradients; the colour stands in for its own.
    pub(crate) fn backward(&mut self, simd: Simd) {
        let samples = Samples { offsets: &self.offsets, tau: &self.tau, last: LastInterval::Finite };
        let values = Values { data: &self.rgb, stride: self.tau.len(), channels: 3 };
        let bar = CompositeBar { colour: &self.colour, w: None, trans_end: None };
        let grads = CompositeGrads { tau: &mut self.tau_bar, values: &mut self.rgb_bar, background: None };
        let forward = Weights { w: &self.w, trans_end: &self.trans_end };
        composite_backward(simd, samples, values, &self.background, forward, bar, grads);
    }

    /// Errors of colours and of the gradients of optical depths against the reference.
    fn errors(&mut self, simd: Simd) -> (f64, f64) {
        self.tau_bar.fill(0.0);
        self.forward(simd);
        self.backward(simd);
        let stride = self.tau.len();
        let (mut colours, mut tau_bars) = (Vec::new(), Vec::new());
        for (r, bounds) in self.offsets.windows(2).enumerate() {
            let range = bounds[0] as usize..bounds[1] as usize;
            let tau: Vec<f64> = self.tau[range.clone()].iter().map(|&t| f64::from(t)).collect();
            let rgb: Vec<[f64; 3]> = range.map(|i| [0, 1, 2].map(|c| f64::from(self.rgb[c * stride + i]))).collect();
            let background = [0, 1, 2].map(|c| f64::from(self.background[3 * r + c]));
            let ray = reference::weights(&tau, LastInterval::Finite);
            colours.extend(reference::colour(&ray, &rgb, background));
            let bar = [0, 1, 2].map(|c| f64::from(self.colour[3 * r + c]));
            let along = |v: &[f64; 3]| v.iter().zip(bar).map(|(v, b)| v * b).sum::<f64>();
            let w_bar: Vec<f64> = rgb.iter().map(along).collect();
            let mut trans_bar = vec![0.0; tau.len() + 1];
            trans_bar[tau.len()] = along(&background);
            tau_bars.extend(reference::tau_bar(&tau, LastInterval::Finite, &w_bar, &trans_bar));
        }
        (worst(&self.colour, &colours), worst(&self.tau_bar, &tau_bars))
    }
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    const RAYS: usize = 4096;
    const SAMPLES: usize = 128;
    let big = Big::new(LARGE_TABLE);
    let most = bench.pools.most();
    let mut runs: Vec<(Simd, usize)> = Simd::available().map(|simd| (simd, 1)).collect();
    if most > 1 {
        runs.push((bench.simd, most));
    }
    let (mut cases, mut streams) = (Vec::new(), Vec::new());
    for &(simd, threads) in &runs {
        let (stream, bytes) = read(&bench.pools, simd, threads, &big);
        streams.push(bytes);
        cases.push(stream);
        let state = move || Batch::new(RAYS / threads, SAMPLES);
        cases.push(Case::parallel(&bench.pools, threads, state, move |b: &mut Batch| b.forward(simd)));
        cases.push(Case::parallel(&bench.pools, threads, state, move |b: &mut Batch| {
            b.forward(simd);
            b.backward(simd);
        }));
    }
    let seconds = interleaved(bench.effort, &mut cases);
    for (k, &(simd, threads)) in runs.iter().enumerate() {
        let bandwidth = streams[k] / seconds[3 * k];
        let (values, gradients) = Batch::new(16, SAMPLES).errors(simd);
        // Forward: depth and colour in, weight out. Backward: the three in, the gradients of depth and colour in and out.
        for (j, (job, bytes)) in [("forward", 20.0), ("forward+backward", 72.0)].into_iter().enumerate() {
            let row = Row {
                kernel: &format!("compositing {RAYS} x {SAMPLES} {job}"),
                level: level_name(simd.level()),
                threads,
                rate: (RAYS / threads * threads * SAMPLES) as f64 / seconds[3 * k + 1 + j],
                unit: "samples",
                ceiling: Some((bandwidth / bytes, "streaming reads (caches may beat it)")),
                error: (Some(values), (j == 1).then_some(gradients)),
            };
            found.row(&row)?;
            if j == 1 && simd == bench.simd && threads == most {
                found.goal(&row, 150.0, 19.0);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compositing_is_as_near_the_reference_as_its_tests_say() {
        for simd in Simd::available() {
            let (values, gradients) = Batch::new(7, 33).errors(simd);
            assert!(values > 0.0 && values < 1e-5 && gradients > 0.0 && gradients < 1e-4, "{values} {gradients}");
        }
    }
}
