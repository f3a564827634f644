//! Networks against the peak of multiply-adds.

use super::found::{Found, Row};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{Case, interleaved, worst};
use crate::sections::ceilings::fma;
use field_core::mlp::{Mlp, MlpConfig, Packed, Precision};
use field_core::rng::Rng;
use float_core::Simd;
use testkit::reference::network::{self as twin, Network};

/// What is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// Values alone, as for pictures.
    Forward,
    /// Values and the gradients of inputs and weights, as in training.
    Both,
}

/// A network with weights, ready to run.
pub(crate) struct Shape {
    pub(crate) mlp: Mlp,
    widths: Vec<usize>,
    skips: Vec<usize>,
    pub(crate) params: Vec<f32>,
    pub(crate) packed: Packed,
}

/// A network with biases, ReLU between its layers, and weights that keep the size of what goes through.
pub(crate) fn shape(widths: &[usize], skips: &[usize]) -> Result<Shape, BenchError> {
    let [inputs, hidden @ .., outputs] = widths else {
        return Err(BenchError::Part("a network has inputs and outputs".into()));
    };
    let mlp = Mlp::new(&MlpConfig::new(*inputs, hidden.to_vec(), *outputs).with_skips(skips.to_vec()))
        .map_err(BenchError::part)?;
    let width = hidden.iter().copied().max().unwrap_or(1);
    let mut params = vec![0.0; mlp.param_count()];
    Rng::new(11, 0).fill_uniform(0, &mut params);
    let bound = (6.0 / width as f32).sqrt();
    params.iter_mut().for_each(|p| *p = (2.0 * *p - 1.0) * bound);
    let mut packed = Packed::default();
    mlp.pack(&params, &mut packed);
    Ok(Shape { mlp, widths: widths.to_vec(), skips: skips.to_vec(), params, packed })
}

/// Samples of one thread.
pub(crate) struct NetworkBatch {
    n: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    y_bar: Vec<f32>,
    acts: Vec<f32>,
    x_bar: Vec<f32>,
    grad: Vec<f32>,
    scratch: Vec<f32>,
}

impl NetworkBatch {
    pub(crate) fn new(shape: &Shape, n: usize) -> Self {
        let mlp = &shape.mlp;
        let numbers = |seed: u64, len: usize| {
            let mut x = vec![0.0; len];
            Rng::new(seed, 1).fill_uniform(0, &mut x);
            x.iter_mut().for_each(|x| *x = 2.0 * *x - 1.0);
            x
        };
        Self {
            n,
            x: numbers(1, mlp.inputs() * n),
            y: vec![0.0; mlp.outputs() * n],
            y_bar: numbers(2, mlp.outputs() * n),
            acts: vec![0.0; mlp.activations_len(n)],
            x_bar: vec![0.0; mlp.inputs() * n],
            grad: vec![0.0; mlp.packed_grad_len()],
            scratch: vec![0.0; mlp.backward_scratch_len().max(mlp.infer_scratch_len())],
        }
    }

    /// Do the job `times` times.
    pub(crate) fn run(&mut self, shape: &Shape, simd: Simd, job: Job, times: usize) {
        let Self { n, x, y, y_bar, acts, x_bar, grad, scratch } = self;
        let (n, mlp) = (*n, &shape.mlp);
        for _ in 0..times {
            match job {
                Job::Forward => mlp.infer(simd, &shape.packed, x, n, n, y, n, scratch),
                Job::Both => {
                    mlp.forward(simd, &shape.packed, x, n, n, y, n, acts);
                    mlp.backward(simd, &shape.packed, acts, y_bar, n, n, Some((x_bar, n)), grad, scratch);
                }
            }
        }
    }
}

impl Shape {
    /// The same weights with products of another precision.
    pub(crate) fn with_precision(&self, precision: Precision) -> Self {
        let mlp = self.mlp.clone().with_precision(precision);
        let mut packed = Packed::default();
        mlp.pack(&self.params, &mut packed);
        let Self { widths, skips, params, .. } = self;
        Self { mlp, widths: widths.clone(), skips: skips.clone(), params: params.clone(), packed }
    }

    /// Errors of values and of gradients (of weights and inputs, the larger), by the twin, for `n` samples.
    pub(crate) fn errors(&self, simd: Simd, n: usize) -> (f64, f64) {
        let mut batch = NetworkBatch::new(self, n);
        batch.run(self, simd, Job::Both, 1);
        let net = Network { widths: &self.widths, skips: &self.skips, bias: twin::Bias::Each };
        let params: Vec<f64> = self.params.iter().map(|&p| f64::from(p)).collect();
        let (inputs, outputs) = (self.mlp.inputs(), self.mlp.outputs());
        let (mut y, mut x_bar) = (vec![0.0; outputs * n], vec![0.0; inputs * n]);
        let mut params_bar = vec![0.0; params.len()];
        for s in 0..n {
            let column = |data: &[f32], rows: usize| (0..rows).map(|r| f64::from(data[r * n + s])).collect::<Vec<_>>();
            let (x, y_bar) = (column(&batch.x, inputs), column(&batch.y_bar, outputs));
            for (r, value) in net.forward(&params, &x).into_iter().enumerate() {
                y[r * n + s] = value;
            }
            for (r, value) in net.backward(&params, &x, &y_bar, &mut params_bar).into_iter().enumerate() {
                x_bar[r * n + s] = value;
            }
        }
        let mut grad = vec![0.0; params.len()];
        self.mlp.unpack_grad(&batch.grad, &mut grad);
        (worst(&batch.y, &y), worst(&grad, &params_bar).max(worst(&batch.x_bar, &x_bar)))
    }
}

/// A network, what it is called, the tile it runs on, and what is wanted of it: forward and both, target and peer.
struct Wanted {
    name: &'static str,
    widths: Vec<usize>,
    skips: &'static [usize],
    tile: usize,
    tiles: usize,
    goals: Option<[(f64, f64); 2]>,
}

pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let deep = [vec![63], vec![256; 8], vec![4]].concat();
    for wanted in [
        Wanted {
            name: "network 32-64-64-16",
            widths: vec![32, 64, 64, 16],
            skips: &[],
            tile: 768,
            tiles: 16,
            goals: Some([(16.0, 9.1), (5.0, 2.3)]),
        },
        Wanted { name: "network 63-8x256-4", widths: deep, skips: &[5], tile: 96, tiles: 2, goals: None },
    ] {
        one(bench, found, &wanted)?;
    }
    Ok(())
}

fn one(bench: &Bench, found: &mut Found, wanted: &Wanted) -> Result<(), BenchError> {
    let shape = shape(&wanted.widths, wanted.skips)?;
    let (tile, tiles) = (wanted.tile, wanted.tiles);
    let flops = 2.0 * shape.mlp.macs() as f64;
    // Every level on one thread, the best on all.
    let most = bench.pools.most();
    let mut runs: Vec<(Simd, usize)> = Simd::available().map(|simd| (simd, 1)).collect();
    if most > 1 {
        runs.push((bench.simd, most));
    }
    let (mut cases, mut peak) = (Vec::new(), Vec::new());
    for &(simd, threads) in &runs {
        let (case, operations) = fma(&bench.pools, simd, threads);
        peak.push(operations);
        cases.push(case);
        for job in [Job::Forward, Job::Both] {
            let shape = &shape;
            let state = move || NetworkBatch::new(shape, tile);
            cases.push(Case::parallel(&bench.pools, threads, state, move |b: &mut NetworkBatch| {
                b.run(shape, simd, job, tiles);
            }));
        }
    }
    let seconds = interleaved(bench.effort, &mut cases);
    for (k, &(simd, threads)) in runs.iter().enumerate() {
        let peak = peak[k] / seconds[3 * k];
        let (values, gradients) = shape.errors(simd, 96);
        let samples = (tile * tiles * threads) as f64;
        // Backward: the products for inputs and for weights, each as large as that of the forward pass.
        for (j, (job, products)) in [("forward", 1.0), ("forward+backward", 3.0)].into_iter().enumerate() {
            let row = Row {
                kernel: &format!("{} {job}", wanted.name),
                level: level_name(simd.level()),
                threads,
                rate: samples / seconds[3 * k + 1 + j],
                unit: "samples",
                ceiling: Some((peak / (flops * products), "f32 FMA peak of the level")),
                error: (Some(values), (j == 1).then_some(gradients)),
            };
            found.row(&row)?;
            if let Some(goals) = wanted.goals
                && simd == bench.simd
                && threads == most
            {
                found.goal(&row, goals[j].0, goals[j].1);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_are_as_near_the_twin_as_their_tests_say() {
        for simd in Simd::available() {
            for (widths, skips) in [(vec![32, 64, 64, 16], &[][..]), (vec![3, 16, 16, 16, 2], &[2])] {
                let (values, gradients) = shape(&widths, skips).unwrap().errors(simd, 96);
                assert!(values > 0.0 && values < 2e-5 && gradients < 1e-4, "{simd:?}: {values} {gradients}");
            }
        }
    }
}
