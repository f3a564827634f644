//! The filter of SF-NeRF in `f64`, from its definition: its gradients are tested against this twin.

use super::filter::{Filter, OUTPUTS};
use field_core::mlp::Activation;
use std::f64::consts::PI;

/// Flat parameters of the networks: place, features, joined.
#[derive(Clone)]
pub(super) struct Twin {
    pub(super) nets: [Vec<f64>; 3],
    layers: [Vec<(usize, usize)>; 3],
    octaves: usize,
}

/// A value and its derivative along one direction.
type Dual = [f64; 2];

impl Twin {
    pub(super) fn of(filter: &Filter) -> Self {
        let nets = [Some(&filter.place), filter.features.as_ref(), Some(&filter.joined)];
        let layers = nets.map(|net| {
            net.map_or(Vec::new(), |net| {
                let last = net.mlp.layers().len() - 1;
                let relu = |l: usize| if l < last { Activation::Relu } else { Activation::None };
                assert!(net.mlp.layers().iter().enumerate().all(|(l, layer)| layer.activation == relu(l)));
                net.mlp.layers().iter().map(|l| (l.inputs, l.outputs)).collect()
            })
        });
        let nets = nets.map(|net| net.map_or(Vec::new(), |net| net.params.iter().map(|&p| f64::from(p)).collect()));
        Self { nets, layers, octaves: filter.shape.octaves }
    }

    fn through(&self, net: usize, mut x: Vec<Dual>) -> Vec<Dual> {
        let mut params = &self.nets[net][..];
        for (l, &(inputs, outputs)) in self.layers[net].iter().enumerate() {
            let (weights, rest) = params.split_at(inputs * outputs);
            let (biases, rest) = rest.split_at(outputs);
            params = rest;
            x = (0..outputs)
                .map(|o| {
                    let sum = |k: usize| (0..inputs).map(|i| weights[o * inputs + i] * x[i][k]).sum::<f64>();
                    let z = [biases[o] + sum(0), sum(1)];
                    if l + 1 < self.layers[net].len() && z[0] <= 0.0 { [0.0; 2] } else { z }
                })
                .collect();
        }
        x
    }

    /// Raw outputs, and their derivative along row `row` of the encoded place.
    pub(super) fn raw(&self, place: [f64; 2], code: &[f64], features: &[f64], row: usize) -> [Dual; OUTPUTS] {
        let mut x: Vec<Dual> = (0..self.octaves)
            .flat_map(|k| {
                let at = place.map(|p| f64::powi(2.0, k as i32) * PI * p);
                [at[0].sin(), at[1].sin(), at[0].cos(), at[1].cos()]
            })
            .map(|value| [value, 0.0])
            .collect();
        x[row][1] = 1.0;
        x.extend(code.iter().map(|&c| [c, 0.0]));
        let mut hidden = self.through(0, x);
        if !self.layers[1].is_empty() {
            hidden.extend(self.through(1, features.iter().map(|&f| [f, 0.0]).collect()));
        }
        self.through(2, hidden).try_into().expect("five outputs")
    }

    /// `sum_k 2^k |d alpha / d gamma_k|` of a pixel.
    pub(super) fn roughness(&self, place: [f64; 2], code: &[f64], features: &[f64], kappa: f64, noise: f64) -> f64 {
        let row = |row: usize| {
            let [h, along] = self.raw(place, code, features, row)[0];
            let alpha = alpha(h, kappa, noise);
            // d ln(softplus(h)) / dh
            let inner = logistic(h) / softplus(h);
            f64::powi(2.0, (row / 4) as i32) * (alpha * (1.0 - alpha) / kappa * inner * along).abs()
        };
        (0..4 * self.octaves).map(row).sum()
    }
}

pub(super) fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

pub(super) fn softplus(x: f64) -> f64 {
    x.exp().ln_1p()
}

pub(super) fn alpha(h: f64, kappa: f64, noise: f64) -> f64 {
    logistic((softplus(h).ln() + noise) / kappa)
}

/// Central differences of `f` with respect to every number that `numbers` names.
pub(super) fn differences(n: usize, f: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    // Small: the smoothness prior jumps where a unit passes 0, and a step across such a place does not give a derivative.
    const H: f64 = 1e-7;
    (0..n).map(|i| (f(i, H) - f(i, -H)) / (2.0 * H)).collect()
}

/// Compare with the largest of a gradient: small entries of a sum have the absolute error of its terms.
pub(super) fn assert_near(what: &str, got: &[f32], want: &[f64]) {
    assert_eq!(got.len(), want.len(), "{what}");
    let largest = want.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    assert!(largest > 0.0, "{what}: a gradient of zeros tests nothing");
    for (i, (&got, want)) in got.iter().zip(want).enumerate() {
        let error = (f64::from(got) - want).abs();
        assert!(error <= 1e-4 * largest, "{what} {i}: {got} against {want}, largest {largest}");
    }
}
