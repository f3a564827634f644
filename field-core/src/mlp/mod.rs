//! Multilayer perceptrons of any width and depth, with skips: forward and backward for whole batches.
//!
//! Inputs and outputs are feature-major `[feature][sample]` with a stride. Inside, samples go through the network in
//! *panels* of [`PANEL`] samples, sample-major `[sample][feature]` with features padded to the vector width. A panel
//! stays in the L1 cache through all layers, and all three products of training (`Y = X Wᵀ`, `X̄ = Ȳ W`, `W̄ = Ȳᵀ X`)
//! run with SIMD lanes over features: none needs a transposed activation or a horizontal sum.
//!
//! Weights live in one flat slice, layer after layer, each `[out][in]` then biases `[out]` (if any): this is what
//! optimisers and checkpoints see. Kernels read a [`Packed`] copy, made once a step.
//!
//! [`Network`] owns all of it, for one network in one thread:
//!
//! ```
//! use field_core::mlp::{MlpConfig, Network};
//!
//! let mut network = Network::new(&MlpConfig::new(3, vec![16, 16], 2), 0)?;
//! let (x, mut y, mut x_bar) = ([1.0; 3 * 5], [0.0; 2 * 5], [0.0; 3 * 5]);
//! network.forward(&x, &mut y)?;
//! network.backward(&y, Some(&mut x_bar))?;
//! let (parameters, gradient) = network.parameters_and_gradient();
//! parameters.iter_mut().zip(gradient).for_each(|(p, g)| *p -= 0.01 * g);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`Mlp`] holds the layout alone. Its functions take all buffers from the caller, so that threads can share the parameters and
//! rows of a larger matrix can be inputs and outputs:
//!
//! ```
//! use field_core::mlp::{Mlp, MlpConfig, Packed};
//! use float_core::Simd;
//!
//! let mlp = Mlp::new(&MlpConfig::new(3, vec![16, 16], 2)).unwrap();
//! let params = vec![0.1; mlp.param_count()];
//! let mut packed = Packed::default();
//! mlp.pack(&params, &mut packed);
//! let (n, x) = (5, vec![1.0; 3 * 5]);
//! let (mut y, mut acts) = (vec![0.0; 2 * n], vec![0.0; mlp.activations_len(n)]);
//! mlp.forward(Simd::best(), &packed, &x, n, n, &mut y, n, &mut acts);
//! let (mut x_bar, mut grad) = (vec![0.0; 3 * n], vec![0.0; mlp.packed_grad_len()]);
//! let mut scratch = vec![0.0; mlp.backward_scratch_len()];
//! mlp.backward(Simd::best(), &packed, &acts, &y, n, n, Some((&mut x_bar, n)), &mut grad, &mut scratch);
//! let mut params_bar = vec![0.0; mlp.param_count()];
//! mlp.unpack_grad(&grad, &mut params_bar);
//! ```

mod activation;
mod backward;
mod batch;
mod bf16;
mod forward;
mod kernel;
mod network;
mod transpose;

pub use activation::Activation;
pub use network::Network;

use alloc::vec::Vec;
use core::ops::Range;

/// Samples that go through the network together. 48 = 2 x 24 = 4 x 12 = 8 x 6: every row block of the kernels divides it.
pub const PANEL: usize = 48;
/// Features are padded to a multiple of this, the widest vector.
const PAD: usize = 16;

/// Whether layers add a bias.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Bias {
    /// Biases, initialised to zero.
    #[default]
    Zero,
    /// No biases (instant-ngp).
    None,
}

/// Precision of the factors in a network's products. Parameters, sums, outputs and gradients are f32 either way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Precision {
    /// f32 throughout.
    #[default]
    F32,
    /// Weights, layer inputs and gradients of layer outputs rounded to bf16 (8 significant bits), to nearest, ties to
    /// even, before they are multiplied; products and sums in f32. Fast where the CPU has AVX512_BF16 and
    /// `vdpbf16ps` at full rate (Zen 4 and later); elsewhere the same numbers at about the speed of f32.
    Bf16,
}

/// Shape of a network.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct MlpConfig {
    /// Input features.
    pub inputs: usize,
    /// Width of each hidden layer; empty is a single linear layer.
    pub hidden: Vec<usize>,
    /// Output features.
    pub outputs: usize,
    /// Biases or none.
    pub bias: Bias,
    /// Activation after each hidden layer.
    pub hidden_activation: Activation,
    /// Activation after the last layer.
    pub output_activation: Activation,
    /// Layers (index, 0 is the first) that see `[network input, previous output]` instead of the previous output. NeRF: `[5]`.
    pub skips: Vec<usize>,
}

impl MlpConfig {
    /// Layers with biases and ReLU between them, none after the last, no skips. `hidden` holds the width of each hidden layer.
    #[must_use]
    pub fn new(inputs: usize, hidden: Vec<usize>, outputs: usize) -> Self {
        Self {
            inputs,
            hidden,
            outputs,
            bias: Bias::Zero,
            hidden_activation: Activation::Relu,
            output_activation: Activation::None,
            skips: Vec::new(),
        }
    }

    /// The same with or without biases.
    #[must_use]
    pub fn with_bias(self, bias: Bias) -> Self {
        Self { bias, ..self }
    }

    /// The same with another activation after the hidden layers.
    #[must_use]
    pub fn with_hidden_activation(self, hidden_activation: Activation) -> Self {
        Self { hidden_activation, ..self }
    }

    /// The same with another activation after the last layer.
    #[must_use]
    pub fn with_output_activation(self, output_activation: Activation) -> Self {
        Self { output_activation, ..self }
    }

    /// The same with skips to these layers.
    #[must_use]
    pub fn with_skips(self, skips: Vec<usize>) -> Self {
        Self { skips, ..self }
    }
}

/// Why a network cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MlpError {
    /// A layer (index) would have no outputs, or the network no inputs.
    EmptyLayer {
        /// Which layer; the input counts as layer 0.
        layer: usize,
    },
    /// A skip goes to a layer that does not exist, or to the first.
    Skip {
        /// The layer named.
        layer: usize,
        /// How many layers there are.
        layers: usize,
    },
    /// A layer (index) has more weights than can be counted.
    TooLarge {
        /// Which layer; the input counts as layer 0.
        layer: usize,
    },
}

impl core::fmt::Display for MlpError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::EmptyLayer { layer } => write!(f, "layer {layer} has width 0"),
            Self::Skip { layer, layers } => {
                write!(f, "a skip goes to layer {layer}: it must be at least 1 and below {layers}")
            }
            Self::TooLarge { layer } => {
                write!(f, "layer {layer} makes the network too large: {LONGEST} numbers in all are the most")
            }
        }
    }
}

impl core::error::Error for MlpError {}

/// One linear layer and its activation.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Input features, with those of a skip.
    pub inputs: usize,
    /// Output features.
    pub outputs: usize,
    /// Where `[out][in]` weights lie in the flat parameters.
    pub weights: Range<usize>,
    /// Where biases lie; empty without biases.
    pub biases: Range<usize>,
    /// Activation after the layer.
    pub activation: Activation,
    /// Features of the network's input in front of the previous output: 0, or all of them at a skip.
    pub skip_inputs: usize,
    /// `inputs` and `outputs` rounded up to [`PAD`].
    inputs_pad: usize,
    outputs_pad: usize,
    /// Where this layer's input panel begins in the activations of a panel.
    panel: usize,
    /// Where the packed forms begin: `[in][out_pad]` and bias `[out_pad]`, `[out][in_pad]`.
    forward: usize,
    backward: usize,
    /// Where the packed gradient begins: `[out_pad][in_pad]`, then bias `[out_pad]`.
    grad: usize,
}

/// A network's layout: where each layer's weights and biases lie in the flat parameters. Holds no parameters; [`Network`] does.
#[derive(Clone, Debug, PartialEq)]
pub struct Mlp {
    layers: Vec<Layer>,
    param_count: usize,
    panel_len: usize,
    forward_len: usize,
    backward_len: usize,
    grad_len: usize,
    widest: usize,
    precision: Precision,
}

/// Parameters in the layouts the kernels read: about twice the bytes of the flat form.
#[derive(Clone, Debug, Default)]
pub struct Packed {
    /// Per layer `[in][out_pad]`, then biases `[out_pad]`.
    forward: Vec<f32>,
    /// Per layer `[out][in_pad]`.
    backward: Vec<f32>,
    /// The same two in pairs of bf16, for networks of [`Precision::Bf16`]: see [`bf16::pack_pairs`].
    forward_pairs: Vec<u16>,
    backward_pairs: Vec<u16>,
    precision: Precision,
}

/// Most numbers of any buffer of a network, so that no product of a layer's widths wraps: the kernels rely on it.
const LONGEST: usize = isize::MAX as usize / 32;

/// Whether `rows` rows of `count` numbers, their starts `stride` apart, lie within `len` numbers. Nothing wraps for any stride:
/// pointers of kernels are checked with it.
const fn reaches(rows: usize, stride: usize, count: usize, len: usize) -> bool {
    let Some(last) = rows.saturating_sub(1).checked_mul(stride) else { return false };
    let Some(end) = last.checked_add(count) else { return false };
    end <= len
}

const fn pad(n: usize) -> usize {
    n.div_ceil(PAD) * PAD
}

impl Mlp {
    /// Lay out a network.
    ///
    /// # Errors
    /// [`MlpError`] for a layer of width 0, a skip to a layer that does not exist, or more numbers than can be counted.
    pub fn new(config: &MlpConfig) -> Result<Self, MlpError> {
        let count = config.hidden.len() + 1;
        if config.inputs == 0 {
            return Err(MlpError::EmptyLayer { layer: 0 });
        }
        let narrow = |width: usize| width <= LONGEST / (8 * PANEL);
        if !narrow(config.inputs) {
            return Err(MlpError::TooLarge { layer: 0 });
        }
        if let Some(&layer) = config.skips.iter().find(|&&s| s == 0 || s >= count) {
            return Err(MlpError::Skip { layer, layers: count });
        }
        let mut mlp = Self {
            layers: Vec::with_capacity(count),
            param_count: 0,
            panel_len: 0,
            forward_len: 0,
            backward_len: 0,
            grad_len: 0,
            widest: 0,
            precision: Precision::F32,
        };
        let mut previous = config.inputs;
        for (i, &outputs) in config.hidden.iter().chain(core::iter::once(&config.outputs)).enumerate() {
            if outputs == 0 {
                return Err(MlpError::EmptyLayer { layer: i + 1 });
            }
            let too_large = MlpError::TooLarge { layer: i + 1 };
            if !narrow(outputs) {
                return Err(too_large);
            }
            let skip_inputs = if config.skips.contains(&i) { config.inputs } else { 0 };
            let inputs = previous + skip_inputs;
            // The previous layer writes whole vectors behind the skipped inputs, so leave room for its padding.
            let inputs_pad = pad(inputs).max(if i == 0 { 0 } else { pad(skip_inputs + pad(previous)) });
            // The largest of the buffers below, with room for all layers before.
            let most = (inputs_pad + 1).checked_mul(pad(outputs)).and_then(|most| most.checked_add(PANEL * inputs_pad));
            if most.is_none_or(|most| most > LONGEST - mlp.grad_len.max(mlp.panel_len)) {
                return Err(too_large);
            }
            let biases = if config.bias == Bias::Zero { outputs } else { 0 };
            let weights = mlp.param_count..mlp.param_count + inputs * outputs;
            let biases = weights.end..weights.end + biases;
            let layer = Layer {
                inputs,
                outputs,
                activation: if i + 1 == count { config.output_activation } else { config.hidden_activation },
                skip_inputs,
                inputs_pad,
                outputs_pad: pad(outputs),
                panel: mlp.panel_len,
                forward: mlp.forward_len,
                backward: mlp.backward_len,
                grad: mlp.grad_len,
                weights,
                biases,
            };
            mlp.param_count = layer.biases.end;
            mlp.panel_len += PANEL * layer.inputs_pad;
            mlp.forward_len += (layer.inputs + 1) * layer.outputs_pad;
            mlp.backward_len += layer.outputs * layer.inputs_pad;
            mlp.grad_len += layer.outputs_pad * layer.inputs_pad + layer.outputs_pad;
            mlp.widest = mlp.widest.max(layer.inputs_pad).max(layer.outputs_pad);
            mlp.layers.push(layer);
            previous = outputs;
        }
        if mlp.keeps_outputs() {
            mlp.panel_len += PANEL * config.outputs;
        }
        Ok(mlp)
    }

    /// The same network with products of another precision; [`Mlp::new`] takes [`Precision::F32`]. Lengths of buffers and packed
    /// parameters depend on it: call this first.
    #[must_use]
    pub fn with_precision(mut self, precision: Precision) -> Self {
        self.precision = precision;
        self
    }

    /// Precision of the products.
    #[must_use]
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// The token for kernels on pairs of bf16, where this network uses them and the CPU has them.
    #[cfg(target_arch = "x86_64")]
    fn pairs(&self, simd: float_core::Simd) -> Option<float_core::Bf16> {
        float_core::Bf16::of(simd).filter(|_| self.precision == Precision::Bf16)
    }

    /// Round a panel as the network's precision asks.
    #[inline(always)]
    fn round(&self, panel: &mut [f32]) {
        if self.precision == Precision::Bf16 {
            bf16::round_all(panel);
        }
    }

    /// Whether outputs are kept, `[outputs][PANEL]` behind the last layer's input, for the derivative of the last activation.
    fn keeps_outputs(&self) -> bool {
        self.layers.last().is_some_and(|l| l.activation != Activation::None)
    }

    /// Floats of the last layer's output panel; with bf16, any layer's passes through it before it is rounded.
    fn output_panel_len(&self) -> usize {
        match self.precision {
            Precision::F32 => PANEL * pad(self.outputs()),
            Precision::Bf16 => PANEL * self.widest,
        }
    }

    /// The layers, first to last.
    #[must_use]
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Input features.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.layers[0].inputs
    }

    /// Output features.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.layers[self.layers.len() - 1].outputs
    }

    /// Trainable numbers.
    #[must_use]
    pub fn param_count(&self) -> usize {
        self.param_count
    }

    /// Floats that [`Mlp::forward`] keeps for the backward pass of `n` samples.
    #[must_use]
    pub fn activations_len(&self, n: usize) -> usize {
        if n == 0 { 0 } else { n.div_ceil(PANEL) * self.panel_len + self.output_panel_len() }
    }

    /// Floats of scratch that [`Mlp::infer`] needs, whatever the batch.
    #[must_use]
    pub fn infer_scratch_len(&self) -> usize {
        self.panel_len + self.output_panel_len()
    }

    /// Floats of scratch that [`Mlp::backward`] needs, whatever the batch.
    #[must_use]
    pub fn backward_scratch_len(&self) -> usize {
        // A row more than the panel: rows may begin inside wider ones.
        let panels = 2 * (PANEL + 1) * self.widest;
        match self.precision {
            Precision::F32 => panels,
            // Two such panels of bf16, two of pairs of samples, one of f32 and the turned output.
            Precision::Bf16 => panels + PANEL * (self.widest + pad(self.outputs())),
        }
    }

    /// Floats of a packed gradient: the flat one with padding.
    #[must_use]
    pub fn packed_grad_len(&self) -> usize {
        self.grad_len
    }

    /// Multiplications of one sample's forward pass (without padding).
    #[must_use]
    pub fn macs(&self) -> usize {
        self.layers.iter().map(|l| l.inputs * l.outputs).sum()
    }

    /// Copy flat parameters into the kernels' layouts.
    ///
    /// # Panics
    /// Where `params` does not hold [`Mlp::param_count`] numbers.
    pub fn pack(&self, params: &[f32], packed: &mut Packed) {
        assert_eq!(params.len(), self.param_count, "mlp: parameters");
        packed.forward.clear();
        packed.forward.resize(self.forward_len, 0.0);
        packed.backward.clear();
        packed.backward.resize(self.backward_len, 0.0);
        packed.precision = self.precision;
        packed.forward_pairs.clear();
        packed.backward_pairs.clear();
        for l in &self.layers {
            let w = &params[l.weights.clone()];
            if self.precision == Precision::Bf16 {
                bf16::pack_pairs(l, w, &mut packed.forward_pairs, &mut packed.backward_pairs);
            }
            let (forward, rest) = packed.forward[l.forward..].split_at_mut(l.inputs * l.outputs_pad);
            for (o, row) in w.chunks_exact(l.inputs).enumerate() {
                for (i, &w) in row.iter().enumerate() {
                    forward[i * l.outputs_pad + o] = w;
                }
                packed.backward[l.backward + o * l.inputs_pad..][..l.inputs].copy_from_slice(row);
            }
            self.round(forward);
            self.round(&mut packed.backward[l.backward..][..l.outputs * l.inputs_pad]);
            rest[..l.biases.len()].copy_from_slice(&params[l.biases.clone()]);
        }
    }

    /// Add a packed gradient to a flat one.
    ///
    /// # Panics
    /// Where lengths differ from [`Mlp::packed_grad_len`] and [`Mlp::param_count`].
    pub fn unpack_grad(&self, packed: &[f32], params_bar: &mut [f32]) {
        assert_eq!(packed.len(), self.grad_len, "mlp: packed gradient");
        assert_eq!(params_bar.len(), self.param_count, "mlp: gradient");
        for l in &self.layers {
            let g = &packed[l.grad..];
            for (o, row) in params_bar[l.weights.clone()].chunks_exact_mut(l.inputs).enumerate() {
                for (p, g) in row.iter_mut().zip(&g[o * l.inputs_pad..]) {
                    *p += g;
                }
            }
            let bias = &g[l.outputs_pad * l.inputs_pad..];
            for (p, g) in params_bar[l.biases.clone()].iter_mut().zip(bias) {
                *p += g;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{PANEL, reaches};

    #[test]
    fn rows_that_wrap_around_do_not_reach() {
        assert!(reaches(1, usize::MAX, 4, 4) && reaches(3, 5, 2, 12) && reaches(PANEL, 16, 16, 16 * PANEL));
        assert!(!reaches(3, 5, 2, 11) && !reaches(2, usize::MAX, 1, 8));
        // (9 - 1) * 2^61 is 2^64: with 64 bits it would wrap to 0, and 8 numbers would seem enough.
        assert!(!reaches(9, 1 << (usize::BITS - 3), 1, 8));
        assert!(!reaches(2, usize::MAX, usize::MAX, usize::MAX));
    }
}
