//! Networks that turn features of a Gaussian's place and the time into offsets of its parameters:
//!
//! ```text
//! h = relu(A_L relu(... A_0 f))         shared by all offsets
//! offset_k = C_k relu(B_k h)            of positions, sizes, rotations, ... ; C_k begins at 0: nothing moves
//! ```

use crate::buffers::sized;
use crate::fields::{NetworkParameters, RowNetwork};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::mlp::{Activation, MlpConfig};
use field_core::rng::Rng;
use float_core::Simd;
use optim::AdamConfig;
use splat_core::{Field, Gaussians};
use std::ops::Range;

/// As for the Gaussians: steps know no scale of the gradient.
const ADAM: AdamConfig = AdamConfig::DEFAULT.with_eps(1e-15);
/// Name in checkpoints.
const NAME: &str = "motion.networks";

/// Layers of the network of extra rows.
const LAYERS_OF_EXTRA: usize = 2;

/// The networks, and their optimiser.
pub(super) struct Decoder {
    trunk: RowNetwork,
    heads: Vec<Head>,
    params: NetworkParameters,
}

/// The network of one kind of offset.
struct Head {
    network: RowNetwork,
    /// `None`: the extra rows.
    field: Option<Field>,
    rows: Range<usize>,
}

/// Buffers of a chunk.
#[derive(Default)]
pub(super) struct DecoderScratch {
    hidden: Vec<f32>,
    hidden_bar: Vec<f32>,
    trunk_acts: Vec<f32>,
    head_acts: Vec<f32>,
    offsets: Vec<f32>,
    scratch: Vec<f32>,
}

/// The gradient of one chunk with respect to the parameters, network by network.
pub(super) type PackedGradients = Vec<Vec<f32>>;

impl Decoder {
    /// For `features` rows of features: networks of `width` units with `layers` shared layers besides the first, that move `fields` of a
    /// cloud of spherical harmonics of `degree`, and its `extra` rows: by a network with a layer more.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(super) fn new(
        features: usize,
        width: usize,
        layers: usize,
        fields: &[Field],
        degree: usize,
        extra: usize,
        rng: Rng,
    ) -> Result<Self, SystemError> {
        let refused = |e: &dyn std::fmt::Display| SystemError::Config {
            field: "motion_width, motion_layers",
            value: format!("{width}, {layers}"),
            problem: e.to_string(),
        };
        let mut params = Vec::new();
        let trunk = MlpConfig::new(features, vec![width; layers], width).with_output_activation(Activation::Relu);
        let trunk = RowNetwork::new(&trunk, rng.substream(0), &mut params).map_err(|e| refused(&e))?;
        let one = Gaussians::new(1, degree).map_err(|e| refused(&e))?;
        let of_one =
            |field: Field| one.fields().iter().find(|(name, _)| *name == field).map_or(0, |(_, row)| row.len());
        let (mut heads, mut first) = (Vec::new(), 0);
        let each = fields.iter().map(|&field| (Some(field), of_one(field))).chain([(None, extra)]);
        for (k, (field, count)) in each.enumerate() {
            let rows = first..first + count;
            if rows.is_empty() {
                continue;
            }
            first = rows.end;
            let layers = if field.is_some() { 1 } else { LAYERS_OF_EXTRA };
            let config = MlpConfig::new(width, vec![width; layers], rows.len());
            let network =
                RowNetwork::new(&config, rng.substream(k as u64 + 1), &mut params).map_err(|e| refused(&e))?;
            network.begin_at_zero(&mut params);
            heads.push(Head { network, field, rows });
        }
        let mut new = Self { trunk, heads, params: NetworkParameters::new(NAME, params, ADAM) };
        new.pack();
        Ok(new)
    }

    /// Which parameters of a Gaussian have offsets, and which rows of the output these are.
    pub(super) fn fields(&self) -> impl Iterator<Item = (Field, Range<usize>)> + '_ {
        self.heads.iter().filter_map(|head| Some((head.field?, head.rows.clone())))
    }

    /// Which rows of the output are offsets of extra rows.
    pub(super) fn extra(&self) -> Range<usize> {
        self.heads.last().filter(|head| head.field.is_none()).map_or(0..0, |head| head.rows.clone())
    }

    /// Rows of the output.
    pub(super) fn rows(&self) -> usize {
        self.heads.last().map_or(0, |head| head.rows.end)
    }

    /// Offsets `[rows][n]` of `n` Gaussians with `features` `[features][n]`.
    pub(super) fn offsets(
        &self,
        simd: Simd,
        features: &[f32],
        n: usize,
        out: &mut [f32],
        scratch: &mut DecoderScratch,
    ) {
        let DecoderScratch { hidden, scratch, .. } = scratch;
        let networks = std::iter::once(&self.trunk).chain(self.heads.iter().map(|head| &head.network));
        let room = networks.map(RowNetwork::infer_scratch_len).max().unwrap_or(0);
        let (hidden, scratch) = (sized(hidden, self.width() * n), sized(scratch, room));
        self.trunk.infer(simd, features, n, hidden, scratch);
        for head in &self.heads {
            head.network.infer(simd, hidden, n, &mut out[head.rows.start * n..head.rows.end * n], scratch);
        }
    }

    /// Backward twin of [`offsets`](Self::offsets), which it does once more. `bar` `[rows][n]`; adds to `features_bar`
    /// `[features][n]`, and returns the gradient with respect to the parameters.
    pub(super) fn backward(
        &self,
        simd: Simd,
        features: &[f32],
        n: usize,
        bar: &[f32],
        features_bar: &mut [f32],
        scratch: &mut DecoderScratch,
    ) -> PackedGradients {
        let DecoderScratch { hidden, hidden_bar, trunk_acts, head_acts, offsets, scratch } = scratch;
        let (hidden, hidden_bar) = (sized(hidden, self.width() * n), sized(hidden_bar, self.width() * n));
        hidden_bar.fill(0.0);
        let acts = self.trunk.forward(simd, features, n, hidden, trunk_acts);
        let mut gradients = vec![Vec::new()];
        for head in &self.heads {
            let rows = head.rows.start * n..head.rows.end * n;
            let offsets = sized(offsets, rows.len());
            let acts = head.network.forward(simd, hidden, n, offsets, head_acts);
            gradients.push(head.network.backward(simd, acts, &bar[rows], n, hidden_bar, scratch));
        }
        gradients[0] = self.trunk.backward(simd, acts, hidden_bar, n, features_bar, scratch);
        gradients
    }

    /// One step with the gradients of chunks, summed in their order. Returns how many entries were not finite.
    pub(super) fn step(&mut self, simd: Simd, lr: f64, chunks: &[&PackedGradients]) -> usize {
        let gradient = self.gradient(chunks);
        let bad = self.params.step(simd, lr, &gradient);
        self.pack();
        bad
    }

    /// The gradient of chunks, summed in their order, in the order of the parameters.
    pub(super) fn gradient(&self, chunks: &[&PackedGradients]) -> Vec<f32> {
        let mut gradient = vec![0.0; self.params.values.len()];
        let mut packed = Vec::new();
        let networks = std::iter::once(&self.trunk).chain(self.heads.iter().map(|head| &head.network));
        for (k, network) in networks.enumerate() {
            network.fold(chunks.iter().map(|chunk| &chunk[k][..]), &mut packed, &mut gradient);
        }
        gradient
    }

    /// Number of parameters.
    pub(super) fn param_count(&self) -> usize {
        self.params.values.len()
    }

    #[cfg(test)]
    pub(super) fn parameters(&self) -> &[f32] {
        &self.params.values
    }

    #[cfg(test)]
    pub(super) fn set_parameters(&mut self, params: Vec<f32>) {
        self.params.values = params;
        self.pack();
    }

    pub(super) fn state(&self) -> Vec<Tensor<'_>> {
        self.params.state()
    }

    /// What [`state`](Self::state) wrote. Nothing has changed where it does not fit.
    pub(super) fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.params.load(state)?;
        self.pack();
        Ok(())
    }

    fn width(&self) -> usize {
        self.trunk.outputs()
    }

    fn pack(&mut self) {
        for network in std::iter::once(&mut self.trunk).chain(self.heads.iter_mut().map(|head| &mut head.network)) {
            network.pack(&self.params.values);
        }
    }
}
