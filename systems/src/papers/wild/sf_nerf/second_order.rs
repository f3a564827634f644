//! The derivative of a pixel's opacity with respect to its encoded place, and the gradient of that, layer by layer: the
//! smoothness of opacities ([`super::smoothness`]) is a loss on it.

use super::filter::Filter;
use super::layer::opacity;
use field_core::mlp::{Activation, Layer};
use losses::concrete::BinaryConcrete;
use losses::smoothness::{smoothness, smoothness_backward};

/// Rows of an octave: sine and cosine of both coordinates.
const OCTAVE_ROWS: usize = 4;

/// Layers from the place to the raw opacity.
const DEPTH: usize = 6;

/// The layer whose outputs are joined with those of the features' branch.
const JOINT: usize = 2;

/// One of these layers.
#[derive(Clone, Copy)]
struct Link<'a> {
    /// `[out][in]`
    weights: &'a [f32],
    biases: &'a [f32],
    /// Where the weights begin in the flat parameters of the network.
    first: usize,
    inputs: usize,
    relu: bool,
}

impl<'a> Link<'a> {
    fn of(params: &'a [f32], layer: &Layer, outputs: usize) -> Self {
        Self {
            weights: &params[layer.weights.clone()][..outputs * layer.inputs],
            biases: &params[layer.biases.clone()][..outputs],
            first: layer.weights.start,
            inputs: layer.inputs,
            relu: layer.activation == Activation::Relu,
        }
    }

    fn rows(self) -> impl Iterator<Item = &'a [f32]> {
        self.weights.chunks_exact(self.inputs)
    }
}

/// The layers from the place of a pixel to its raw opacity, without the other outputs.
pub(super) struct Chain<'a> {
    links: [Link<'a>; DEPTH],
    octaves: usize,
}

/// The prior, and the parts of its gradient that an ordinary backward pass does not give.
#[derive(Default)]
pub(super) struct Terms {
    /// The sum of the prior over the pixels.
    pub(super) value: f64,
    /// `a''(h) h'` of each pixel.
    pub(super) h_bar: Vec<f32>,
    /// `a'(h) g_l t_l^T`, of the flat parameters of the branch of the place and of the joined layers.
    pub(super) place: Vec<f32>,
    pub(super) joined: Vec<f32>,
}

/// Buffers of one pixel.
#[derive(Default)]
pub(super) struct Pass {
    /// Inputs of the layers; the last is `h`.
    pub(super) x: [Vec<f32>; DEPTH + 1],
    /// Derivative of `h` with respect to what the layers give before their ReLU.
    g: [Vec<f32>; DEPTH],
    /// Derivatives of the inputs along `s`.
    t: [Vec<f32>; DEPTH + 1],
    x_bar: Vec<f32>,
    d: Vec<f32>,
    s: Vec<f32>,
}

impl<'a> Chain<'a> {
    pub(super) fn of(filter: &'a Filter) -> Self {
        let links = std::array::from_fn(|l| {
            let net = if l <= JOINT { &filter.place } else { &filter.joined };
            let layer = &net.mlp.layers()[l % (JOINT + 1)];
            Link::of(&net.params, layer, if l + 1 == DEPTH { 1 } else { layer.outputs })
        });
        Self { links, octaves: filter.shape.octaves }
    }

    /// Add one pixel, whose input of the first layer is in `pass`; `beside` is the output of the features' branch.
    pub(super) fn add(
        &self,
        pass: &mut Pass,
        beside: &[f32],
        concrete: BinaryConcrete,
        noise: f32,
        weight: f64,
        out: &mut Terms,
    ) {
        let Pass { x, g, t, x_bar, d, s } = pass;
        // h.
        for (l, link) in self.links.iter().enumerate() {
            let (input, output) = x.split_at_mut(l + 1);
            let (input, output) = (&input[l], &mut output[0]);
            output.clear();
            output.extend(link.rows().zip(link.biases).map(|(row, b)| dot(row, input) + b));
            if link.relu {
                output.iter_mut().for_each(|y| *y = y.max(0.0));
            }
            if l == JOINT {
                output.extend_from_slice(beside);
            }
        }
        let h = x[DEPTH][0];
        let [_, first, second] = opacity(concrete, h, noise);

        // g, and dh/dgamma.
        g[DEPTH - 1].clear();
        g[DEPTH - 1].push(1.0);
        for l in (0..DEPTH).rev() {
            let link = &self.links[l];
            x_bar.clear();
            x_bar.resize(link.inputs, 0.0);
            for (row, &g) in link.rows().zip(&g[l]).filter(|(_, g)| **g != 0.0) {
                axpy(g, row, x_bar);
            }
            if let Some(before) = l.checked_sub(1) {
                let gate = |(&bar, &y): (&f32, &f32)| if self.links[before].relu && y <= 0.0 { 0.0 } else { bar };
                let outputs = self.links[before].biases.len();
                g[before].clear();
                g[before].extend(x_bar.iter().zip(&x[l]).take(outputs).map(gate));
            }
        }
        d.clear();
        d.extend(x_bar[..OCTAVE_ROWS * self.octaves].iter().map(|bar| first * bar));

        // The prior, and its derivative with respect to d.
        let fits = "whole octaves";
        out.value += weight * smoothness(d, self.octaves, OCTAVE_ROWS).expect(fits);
        s.clear();
        s.resize(d.len(), 0.0);
        smoothness_backward(d, self.octaves, OCTAVE_ROWS, weight, s).expect(fits);

        // h' along s: biases are constants, and so is all beside the octaves.
        t[0].clear();
        t[0].extend_from_slice(s);
        t[0].resize(self.links[0].inputs, 0.0);
        for (l, link) in self.links.iter().enumerate() {
            let (input, output) = t.split_at_mut(l + 1);
            let (input, output) = (&input[l], &mut output[0]);
            output.clear();
            output.extend(
                link.rows().zip(&x[l + 1]).map(|(row, &y)| if link.relu && y <= 0.0 { 0.0 } else { dot(row, input) }),
            );
            if l == JOINT {
                output.resize(output.len() + beside.len(), 0.0);
            }
        }
        out.h_bar.push(second * t[DEPTH][0]);
        for (l, link) in self.links.iter().enumerate() {
            let grad = if l <= JOINT { &mut out.place } else { &mut out.joined };
            let rows = grad[link.first..][..link.weights.len()].chunks_exact_mut(link.inputs);
            for (row, &g) in rows.zip(&g[l]).filter(|(_, g)| **g != 0.0) {
                axpy(first * g, &t[l], row);
            }
        }
    }
}

/// Sixteen sums side by side, then their sum: the same on every machine.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 16];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<16>(), b.as_chunks::<16>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..16 {
            sums[k] += a[k] * b[k];
        }
    }
    a_rest.iter().zip(b_rest).fold(sums.iter().sum(), |sum, (a, b)| sum + a * b)
}

/// `y += a x`.
fn axpy(a: f32, x: &[f32], y: &mut [f32]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}
