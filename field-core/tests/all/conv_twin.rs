//! Convolutions written from their definition in `f64`: slow and obvious.

use field_core::conv::{EncoderConfig, Padding, Size};

/// One layer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
    pub(crate) kernel: usize,
    pub(crate) stride: usize,
    pub(crate) padding: Padding,
}

impl Layer {
    pub(crate) fn params(&self) -> usize {
        self.outputs * (self.inputs * self.kernel * self.kernel + 1)
    }

    pub(crate) fn output(&self, size: Size) -> Size {
        let side = |n: usize| (n + 2 * self.padding.width() - self.kernel) / self.stride + 1;
        Size { images: size.images, height: side(size.height), width: side(size.width) }
    }

    /// The pixel that a place of the padded image shows.
    fn source(&self, at: isize, n: usize) -> Option<usize> {
        let n = n as isize;
        match self.padding {
            Padding::Zero(_) => (0..n).contains(&at).then_some(at as usize),
            // Fold until inside, as mirrors do.
            Padding::Reflect(_) => {
                let mut at = at;
                while !(0..n).contains(&at) {
                    at = if at < 0 { -at } else { 2 * (n - 1) - at };
                }
                Some(at as usize)
            }
        }
    }

    /// `f(output, weight, input)` for every product of the convolution; `None` for the bias.
    fn each(&self, size: Size, mut f: impl FnMut(usize, usize, Option<usize>)) {
        let (to, k, pad) = (self.output(size), self.kernel, self.padding.width() as isize);
        let mut out = 0;
        for n in 0..size.images {
            for o in 0..self.outputs {
                for i in 0..to.height {
                    for j in 0..to.width {
                        f(out, self.outputs * self.inputs * k * k + o, None);
                        for c in 0..self.inputs {
                            for u in 0..k {
                                for v in 0..k {
                                    let y = self.source((i * self.stride + u) as isize - pad, size.height);
                                    let x = self.source((j * self.stride + v) as isize - pad, size.width);
                                    if let Some((y, x)) = y.zip(x) {
                                        let input = ((n * self.inputs + c) * size.height + y) * size.width + x;
                                        f(out, ((o * self.inputs + c) * k + u) * k + v, Some(input));
                                    }
                                }
                            }
                        }
                        out += 1;
                    }
                }
            }
        }
    }

    pub(crate) fn forward(&self, params: &[f64], x: &[f64], size: Size) -> Vec<f64> {
        let mut y = vec![0.0; self.output(size).len(self.outputs)];
        self.each(size, |out, weight, input| y[out] += params[weight] * input.map_or(1.0, |i| x[i]));
        y
    }

    /// Adds into both gradients.
    pub(crate) fn backward(
        &self,
        params: &[f64],
        x: &[f64],
        size: Size,
        y_bar: &[f64],
        params_bar: &mut [f64],
        x_bar: &mut [f64],
    ) {
        self.each(size, |out, weight, input| {
            params_bar[weight] += y_bar[out] * input.map_or(1.0, |i| x[i]);
            if let Some(i) = input {
                x_bar[i] += y_bar[out] * params[weight];
            }
        });
    }
}

/// The layers of an encoder.
pub(crate) fn layers(config: &EncoderConfig) -> Vec<Layer> {
    let mut inputs = config.inputs;
    let mut all = Vec::new();
    for (i, &outputs) in config.channels.iter().enumerate() {
        let (kernel, stride, pad) = if i == 0 { (7, 1, 3) } else { (4, 2, 1) };
        all.push(Layer { inputs, outputs, kernel, stride, padding: Padding::Reflect(pad) });
        inputs = outputs;
    }
    all.push(Layer { inputs, outputs: config.code, kernel: 1, stride: 1, padding: Padding::Zero(0) });
    all
}

/// An encoder: what each layer saw, last the codes.
pub(crate) fn encode(config: &EncoderConfig, params: &[f64], images: &[f64], size: Size) -> Vec<(Size, Vec<f64>)> {
    let mut seen = vec![(size, images.to_vec())];
    let mut start = 0;
    for layer in layers(config) {
        let (mut size, mut x) = seen.last().unwrap().clone();
        if layer.kernel == 1 {
            x = x.chunks(size.pixels()).map(|map| map.iter().sum::<f64>() / size.pixels() as f64).collect();
            size = Size { height: 1, width: 1, ..size };
            seen.push((size, x.clone()));
        }
        let mut y = layer.forward(&params[start..start + layer.params()], &x, size);
        if layer.kernel > 1 {
            y.iter_mut().for_each(|y| *y = y.max(0.0));
        }
        start += layer.params();
        seen.push((layer.output(size), y));
    }
    seen
}

/// Gradients of an encoder's parameters and images.
pub(crate) fn encode_backward(
    config: &EncoderConfig,
    params: &[f64],
    images: &[f64],
    size: Size,
    codes_bar: &[f64],
) -> (Vec<f64>, Vec<f64>) {
    let seen = encode(config, params, images, size);
    let mut params_bar = vec![0.0; params.len()];
    let mut bar = codes_bar.to_vec();
    let mut at = seen.len() - 2;
    let mut end = params.len();
    for layer in layers(config).into_iter().rev() {
        let start = end - layer.params();
        if layer.kernel > 1 {
            bar.iter_mut().zip(&seen[at + 1].1).for_each(|(b, y)| *b = if *y > 0.0 { *b } else { 0.0 });
        }
        let (size, x) = &seen[at];
        let mut x_bar = vec![0.0; x.len()];
        layer.backward(&params[start..end], x, *size, &bar, &mut params_bar[start..end], &mut x_bar);
        bar = x_bar;
        end = start;
        if layer.kernel == 1 {
            at -= 1;
            let pixels = seen[at].0.pixels();
            bar = bar.iter().flat_map(|b| std::iter::repeat_n(b / pixels as f64, pixels)).collect();
        }
        at = at.saturating_sub(1);
    }
    (params_bar, bar)
}
