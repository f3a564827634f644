//! A network from its definition, in f64, and both passes of the kernels in the same form, to set beside it.
#![allow(dead_code, reason = "shared by a test and a benchmark, which use different parts")]
use field_core::mlp::{Activation, Mlp, Packed};
use field_core::rng::Rng;
use float_core::Simd;

pub(crate) fn noise(seed: u64, n: usize, scale: f32) -> Vec<f32> {
    let rng = Rng::new(seed, 9);
    (0..n).map(|i| (rng.uniform_at(i as u64) * 2.0 - 1.0) * scale).collect()
}

/// Weights as a network has them: uniform, variance `2 / inputs` of the layer; small biases.
pub(crate) fn weights(mlp: &Mlp, seed: u64) -> Vec<f32> {
    let mut params = vec![0.0; mlp.param_count()];
    for (i, l) in mlp.layers().iter().enumerate() {
        let w = noise(seed + i as u64, l.weights.len(), (6.0 / l.inputs as f32).sqrt());
        params[l.weights.clone()].copy_from_slice(&w);
        params[l.biases.clone()].copy_from_slice(&noise(seed + 100 + i as u64, l.biases.len(), 0.1));
    }
    params
}

/// Outputs `[outputs][n]`, input gradients `[inputs][n]`, parameter gradients.
#[derive(Debug, PartialEq)]
pub(crate) struct Run<T> {
    pub(crate) y: Vec<T>,
    pub(crate) x_bar: Vec<T>,
    pub(crate) params_bar: Vec<T>,
}

/// Both passes, in pieces that begin at the samples in `cuts`.
pub(crate) fn run(
    mlp: &Mlp,
    simd: Simd,
    params: &[f32],
    x: &[f32],
    y_bar: &[f32],
    n: usize,
    cuts: &[usize],
) -> Run<f32> {
    let mut packed = Packed::default();
    mlp.pack(params, &mut packed);
    let mut out =
        Run { y: vec![f32::NAN; mlp.outputs() * n], x_bar: vec![0.0; x.len()], params_bar: vec![0.0; params.len()] };
    let mut grad = vec![0.0; mlp.packed_grad_len()];
    let mut scratch = vec![f32::NAN; mlp.backward_scratch_len()];
    for (i, &a) in cuts.iter().enumerate() {
        let m = cuts.get(i + 1).copied().unwrap_or(n) - a;
        let mut acts = vec![f32::NAN; mlp.activations_len(m)];
        mlp.forward(simd, &packed, &x[a..], n, m, &mut out.y[a..], n, &mut acts);
        let x_bar = Some((&mut out.x_bar[a..], n));
        mlp.backward(simd, &packed, &acts, &y_bar[a..], n, m, x_bar, &mut grad, &mut scratch);
    }
    mlp.unpack_grad(&grad, &mut out.params_bar);
    let (mut y, mut scratch) = (vec![0.0; out.y.len()], vec![f32::NAN; mlp.infer_scratch_len()]);
    mlp.infer(simd, &packed, x, n, n, &mut y, n, &mut scratch);
    assert_eq!(y, out.y, "infer and forward differ");
    out
}

/// Both passes from the definition, in f64: ReLU or nothing between layers.
pub(crate) fn twin(mlp: &Mlp, params: &[f64], x: &[f64], y_bar: &[f64], n: usize) -> Run<f64> {
    let mut out =
        Run { y: vec![0.0; mlp.outputs() * n], x_bar: vec![0.0; x.len()], params_bar: vec![0.0; params.len()] };
    let layers = mlp.layers();
    for s in 0..n {
        let mut inputs = vec![(0..mlp.inputs()).map(|i| x[i * n + s]).collect::<Vec<f64>>()];
        for (i, l) in layers.iter().enumerate() {
            if l.skip_inputs > 0 {
                inputs[i] = inputs[0].iter().chain(&inputs[i]).copied().collect();
            }
            let (w, b, h) = (&params[l.weights.clone()], &params[l.biases.clone()], &inputs[i]);
            let y = w.chunks_exact(l.inputs).zip(b).map(|(w, b)| b + w.iter().zip(h).map(|(w, h)| w * h).sum::<f64>());
            inputs.push(if l.activation == Activation::Relu { y.map(|y| y.max(0.0)).collect() } else { y.collect() });
        }
        let mut bar: Vec<f64> = (0..mlp.outputs()).map(|o| y_bar[o * n + s]).collect();
        let mut x_bar = vec![0.0; mlp.inputs()];
        for (o, y) in inputs[layers.len()].iter().enumerate() {
            out.y[o * n + s] = *y;
        }
        for (i, l) in layers.iter().enumerate().rev() {
            let (w, h) = (&params[l.weights.clone()], &inputs[i]);
            let mut below = vec![0.0; l.inputs];
            for (o, bar) in bar.iter().enumerate() {
                out.params_bar[l.biases.start + o] += bar;
                for k in 0..l.inputs {
                    out.params_bar[l.weights.start + o * l.inputs + k] += bar * h[k];
                    below[k] += bar * w[o * l.inputs + k];
                }
            }
            if l.skip_inputs > 0 {
                x_bar.iter_mut().zip(below.drain(..l.skip_inputs)).for_each(|(x, b)| *x += b);
            }
            if i > 0 && layers[i - 1].activation == Activation::Relu {
                let h = &h[l.skip_inputs..];
                below.iter_mut().zip(h).filter(|(_, h)| **h <= 0.0).for_each(|(b, _)| *b = 0.0);
            }
            bar = below;
        }
        for (i, (a, b)) in bar.iter().zip(&x_bar).enumerate() {
            out.x_bar[i * n + s] = a + b;
        }
    }
    out
}

/// `|a - b| / |b|`, Euclidean.
fn distance<T: Copy + Into<f64>, U: Copy + Into<f64>>(a: &[T], b: &[U]) -> f64 {
    assert_eq!(a.len(), b.len());
    let (mut e, mut norm) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        let (a, b): (f64, f64) = ((*a).into(), (*b).into());
        e += (a - b) * (a - b);
        norm += b * b;
    }
    (e / norm.max(1e-300)).sqrt()
}

pub(crate) fn distances<T: Copy + Into<f64>, U: Copy + Into<f64>>(a: &Run<T>, b: &Run<U>) -> [f64; 3] {
    [distance(&a.y, &b.y), distance(&a.x_bar, &b.x_bar), distance(&a.params_bar, &b.params_bar)]
}

pub(crate) fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|x| f64::from(*x)).collect()
}
