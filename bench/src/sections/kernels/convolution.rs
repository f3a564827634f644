//! Convolutions against the peak of multiply-adds.

use super::found::{Found, Kernel, Row, passes};
use crate::bench::Bench;
use crate::error::BenchError;
use crate::machine::level_name;
use crate::measure::{interleaved, worst};
use crate::sections::ceilings::fma;
use field_core::conv::{Conv2d, Padding, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;
use std::hint::black_box;

/// A layer.
#[derive(Clone, Copy)]
struct Shape {
    inputs: usize,
    outputs: usize,
    kernel: usize,
    stride: usize,
}

/// A layer at work on a square picture whose border is in place.
struct Batch {
    conv: Conv2d,
    shape: Shape,
    size: Size,
    params: Vec<f32>,
    x: Vec<f32>,
    y: Vec<f32>,
    params_bar: Vec<f32>,
    x_bar: Vec<f32>,
    work: Workspace,
}

impl Kernel for Batch {
    /// The shapes are the layer's own: nothing is refused.
    fn forward(&mut self, simd: Simd) {
        let x = black_box(&self.x);
        let done = self.conv.forward(simd, &self.params, x, self.size, &mut self.y, &mut self.work);
        debug_assert!(done.is_ok());
    }

    /// Gradients of weights and picture; the outputs stand in for their own.
    fn backward(&mut self, simd: Simd) {
        let (x, x_bar) = (black_box(&self.x), Some(&mut self.x_bar[..]));
        let (params, y) = (&self.params, &self.y);
        let done = self.conv.backward(simd, params, x, self.size, y, &mut self.params_bar, x_bar, &mut self.work);
        debug_assert!(done.is_ok());
    }
}

impl Batch {
    fn new(shape: Shape, side: usize) -> Result<Self, BenchError> {
        let Shape { inputs, outputs, kernel, stride } = shape;
        let conv = Conv2d::new(inputs, outputs, kernel, stride, Padding::Zero(0)).map_err(BenchError::part)?;
        let size = Size::one(side, side);
        let to = conv.output_size(size).map_err(BenchError::part)?;
        let noise = |stream: u64, n: usize| {
            let rng = Rng::new(5, stream);
            (0..n as u64).map(|i| rng.uniform_at(i) * 2.0 - 1.0).collect::<Vec<f32>>()
        };
        let (params, x) = (noise(1, conv.param_count()), noise(2, size.len(inputs)));
        let (params_bar, x_bar, y) = (vec![0.0; params.len()], vec![0.0; x.len()], vec![0.0; to.len(outputs)]);
        Ok(Self { conv, shape, size, params, x, y, params_bar, x_bar, work: Workspace::default() })
    }

    /// Errors of outputs and of the gradients of weights against the definition.
    fn errors(&mut self, simd: Simd) -> Result<(f64, f64), BenchError> {
        self.params_bar.fill(0.0);
        self.forward(simd);
        self.backward(simd);
        let Shape { inputs, outputs, kernel, stride } = self.shape;
        let (side, to) = (self.size.width, self.conv.output_size(self.size).map_err(BenchError::part)?);
        let (mut values, mut bars) = (vec![0.0; self.y.len()], vec![0.0; self.params.len()]);
        let biases = outputs * inputs * kernel * kernel;
        for (at, value) in values.iter_mut().enumerate() {
            let (o, i, j) = (at / to.pixels(), at % to.pixels() / to.width, at % to.width);
            let bar = f64::from(self.y[at]);
            *value += f64::from(self.params[biases + o]);
            bars[biases + o] += bar;
            for k in 0..inputs * kernel * kernel {
                let (c, u, v) = (k / (kernel * kernel), k / kernel % kernel, k % kernel);
                let weight = o * inputs * kernel * kernel + k;
                let x = f64::from(self.x[(c * side + i * stride + u) * side + j * stride + v]);
                *value += f64::from(self.params[weight]) * x;
                bars[weight] += bar * x;
            }
        }
        Ok((worst(&self.y, &values), worst(&self.params_bar, &bars)))
    }
}

/// Layers of the image encoder for a photo of 128 pixels.
pub(super) fn run(bench: &Bench, found: &mut Found) -> Result<(), BenchError> {
    let layers = [
        (Shape { inputs: 16, outputs: 32, kernel: 4, stride: 2 }, 130),
        (Shape { inputs: 128, outputs: 256, kernel: 4, stride: 2 }, 34),
    ];
    for (shape, side) in layers {
        let (values, gradients) = Batch::new(shape, 12)?.errors(bench.simd)?;
        let Batch { conv, size, .. } = Batch::new(shape, side)?;
        let flops = 2.0 * (conv.macs() * conv.output_size(size).map_err(BenchError::part)?.pixels()) as f64;
        for threads in bench.pools.one_and_most() {
            let (peak, operations) = fma(&bench.pools, bench.simd, threads);
            // The shape was legal before.
            let state = move || Batch::new(shape, side).ok();
            let [forward, both] = passes(&bench.pools, bench.simd, threads, state);
            let mut cases = [peak, forward, both];
            let seconds = interleaved(bench.effort, &mut cases);
            let peak = operations / seconds[0];
            // Backward: the products for inputs and for weights, each as large as that of the forward pass.
            for (j, (job, products)) in [("forward", 1.0), ("forward+backward", 3.0)].into_iter().enumerate() {
                let Shape { inputs, outputs, kernel, stride } = shape;
                found.row(&Row {
                    kernel: &format!("convolution {inputs}x{outputs}, {kernel}x{kernel}/{stride}, side {side}, {job}"),
                    level: level_name(bench.simd.level()),
                    threads,
                    rate: threads as f64 / seconds[1 + j],
                    unit: "pictures",
                    ceiling: Some((peak / (flops * products), "f32 FMA peak of the level")),
                    error: (Some(values), (j == 1).then_some(gradients)),
                })?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convolutions_are_as_near_the_twin_as_their_tests_say() {
        for simd in Simd::available() {
            let shape = Shape { inputs: 3, outputs: 5, kernel: 4, stride: 2 };
            let (values, gradients) = Batch::new(shape, 12).unwrap().errors(simd).unwrap();
            assert!(values > 0.0 && values < 3e-6 && gradients > 0.0 && gradients < 3e-6, "{values} {gradients}");
        }
    }
}
