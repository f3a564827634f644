//! A multilayer perceptron with ReLU, from its definition.

/// Shape of a network whose hidden layers end in ReLU and whose last layer is linear.
#[derive(Clone, Copy, Debug)]
pub struct Network<'a> {
    /// Input features, hidden widths, output features.
    pub widths: &'a [usize],
    /// Layers (index, 0 is the first) that see `[network input, previous output]`.
    pub skips: &'a [usize],
    /// Whether each layer adds a bias.
    pub bias: Bias,
}

/// Whether layers add a bias.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bias {
    /// Behind the weights of each layer.
    Each,
    /// None.
    Omit,
}

/// What one layer saw and gave.
struct Layer {
    /// Where its weights begin.
    at: usize,
    input: Vec<f64>,
    output: Vec<f64>,
}

impl Network<'_> {
    /// Number of parameters: layer after layer, `[out][in]`, then biases `[out]`.
    #[must_use]
    pub fn param_count(&self) -> usize {
        (0..self.layers()).map(|l| self.widths[l + 1] * (self.inputs(l) + self.biases())).sum()
    }

    /// The outputs for one sample `x` `[inputs]`.
    ///
    /// # Panics
    /// Where `x` or `params` is too short.
    #[must_use]
    pub fn forward(&self, params: &[f64], x: &[f64]) -> Vec<f64> {
        self.run(params, x).pop().map_or_else(|| x.to_vec(), |layer| layer.output)
    }

    /// Gradient of `<y_bar, forward(x)>` for one sample: with respect to `x` returned, with respect to the parameters added
    /// to `params_bar`.
    ///
    /// # Panics
    /// Where a slice is too short.
    #[must_use]
    pub fn backward(&self, params: &[f64], x: &[f64], y_bar: &[f64], params_bar: &mut [f64]) -> Vec<f64> {
        let layers = self.run(params, x);
        let mut x_bar = vec![0.0; x.len()];
        let mut bar = y_bar.to_vec();
        for (l, layer) in layers.iter().enumerate().rev() {
            let n = layer.input.len();
            let mut input_bar = vec![0.0; n];
            for (o, &output_bar) in bar.iter().enumerate() {
                // The last layer is linear; elsewhere ReLU passes what is positive.
                if l + 1 < layers.len() && layer.output[o] <= 0.0 {
                    continue;
                }
                for i in 0..n {
                    params_bar[layer.at + o * n + i] += output_bar * layer.input[i];
                    input_bar[i] += output_bar * params[layer.at + o * n + i];
                }
                if self.bias == Bias::Each {
                    params_bar[layer.at + bar.len() * n + o] += output_bar;
                }
            }
            if l == 0 || self.skips.contains(&l) {
                x_bar.iter_mut().zip(&input_bar).for_each(|(x, i)| *x += i);
                input_bar.drain(..x.len());
            }
            bar = input_bar;
        }
        x_bar
    }

    fn layers(&self) -> usize {
        self.widths.len() - 1
    }

    fn biases(&self) -> usize {
        usize::from(self.bias == Bias::Each)
    }

    fn inputs(&self, layer: usize) -> usize {
        self.widths[layer] + if self.skips.contains(&layer) { self.widths[0] } else { 0 }
    }

    fn run(&self, params: &[f64], x: &[f64]) -> Vec<Layer> {
        let (mut at, mut h) = (0, x.to_vec());
        (0..self.layers())
            .map(|l| {
                let input = if self.skips.contains(&l) { [x, &h].concat() } else { h.clone() };
                let (n, outputs) = (input.len(), self.widths[l + 1]);
                h = (0..outputs)
                    .map(|o| {
                        let bias = if self.bias == Bias::Each { params[at + outputs * n + o] } else { 0.0 };
                        let y = bias + (0..n).map(|i| params[at + o * n + i] * input[i]).sum::<f64>();
                        if l + 1 < self.layers() { y.max(0.0) } else { y }
                    })
                    .collect();
                let layer = Layer { at, input, output: h.clone() };
                at += outputs * (n + self.biases());
                layer
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers without a pattern that the network could hide behind.
    fn numbers(n: usize, seed: f64) -> Vec<f64> {
        (0..n).map(|i| (seed + 12.9898 * i as f64).sin()).collect()
    }

    #[test]
    fn a_network_of_one_layer_is_a_product() {
        let net = Network { widths: &[2, 2], skips: &[], bias: Bias::Each };
        assert_eq!(net.param_count(), 6);
        assert_eq!(net.forward(&[1.0, 2.0, 3.0, 4.0, 10.0, -10.0], &[1.0, -1.0]), [9.0, -11.0]);
    }

    #[test]
    fn backward_is_the_derivative_of_forward() {
        for (skips, bias) in [(&[][..], Bias::Omit), (&[][..], Bias::Each), (&[2][..], Bias::Each)] {
            let net = Network { widths: &[3, 5, 4, 2], skips, bias };
            let (params, x, y_bar) = (numbers(net.param_count(), 0.3), numbers(3, 1.7), [0.7, -1.3]);
            let loss = |params: &[f64], x: &[f64]| -> f64 {
                net.forward(params, x).iter().zip(y_bar).map(|(y, bar)| y * bar).sum()
            };
            let mut params_bar = vec![0.0; params.len()];
            let x_bar = net.backward(&params, &x, &y_bar, &mut params_bar);
            let difference = |values: &[f64], i: usize, loss: &dyn Fn(&[f64]) -> f64| {
                let step = |h: f64| {
                    let mut v = values.to_vec();
                    v[i] += h;
                    loss(&v)
                };
                (step(1e-6) - step(-1e-6)) / 2e-6
            };
            for (i, got) in params_bar.iter().enumerate() {
                let want = difference(&params, i, &|p| loss(p, &x));
                assert!((got - want).abs() < 1e-8, "{skips:?} {bias:?} parameter {i}: {got} {want}");
            }
            for (i, got) in x_bar.iter().enumerate() {
                let want = difference(&x, i, &|x| loss(&params, x));
                assert!((got - want).abs() < 1e-8, "{skips:?} {bias:?} input {i}: {got} {want}");
            }
        }
    }
}
