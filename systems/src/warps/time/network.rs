//! `MLP_t(gamma(t))`: octaves of the time through a network of one hidden layer (TiNeuVox, section 3.2).

use super::frames::Times;
use super::gamma::Gamma;
use super::input::{TimeInput, transposed};
use crate::networks::parts;
use crate::warps::parameters::NetworkShape;
use engine::system::SystemError;
use field_core::init::Init;
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;

/// A network on the octaves of a time.
pub(super) struct TimeNetwork {
    gamma: Gamma,
    mlp: Mlp,
    packed: Packed,
    /// `[views]`
    of_views: Vec<f64>,
}

impl TimeNetwork {
    /// Its initial parameters are put into `params`.
    pub(super) fn new(
        gamma: Gamma,
        width: usize,
        dims: usize,
        times: &Times,
        rng: Rng,
        params: &mut Vec<f32>,
    ) -> Result<Self, SystemError> {
        let mlp = NetworkShape { inputs: gamma.dims(), depth: 1, width, outputs: dims }.mlp()?;
        params.resize(mlp.param_count(), 0.0);
        parts::init([&mlp], Init::XavierUniform, rng, params);
        Ok(Self { gamma, mlp, packed: Packed::default(), of_views: times.of_views().collect() })
    }
}

impl TimeInput for TimeNetwork {
    fn dims(&self) -> usize {
        self.mlp.outputs()
    }

    fn rows(&self, _params: &[f32], times: &[f64]) -> Vec<f32> {
        let (mlp, dims, n) = (&self.mlp, self.dims(), times.len());
        let x = self.gamma.of(times);
        let (mut y, mut scratch) = (vec![0.0; dims * n], vec![0.0; mlp.infer_scratch_len()]);
        mlp.infer(self.gamma.simd(), &self.packed, &x, n, n, &mut y, n, &mut scratch);
        transposed(dims, n, &y)
    }

    fn backward(&self, _params: &[f32], rows_bar: &[f32], params_bar: &mut [f32]) {
        let (mlp, dims, n, simd) = (&self.mlp, self.dims(), self.of_views.len(), self.gamma.simd());
        let x = self.gamma.of(&self.of_views);
        let y_bar = transposed(n, dims, rows_bar);
        let mut acts = vec![0.0; mlp.activations_len(n)];
        let mut y = vec![0.0; dims * n];
        mlp.forward(simd, &self.packed, &x, n, n, &mut y, n, &mut acts);
        let mut packed = vec![0.0; mlp.packed_grad_len()];
        let mut scratch = vec![0.0; mlp.backward_scratch_len()];
        mlp.backward(simd, &self.packed, &acts, &y_bar, n, n, None, &mut packed, &mut scratch);
        mlp.unpack_grad(&packed, params_bar);
    }

    fn renew(&mut self, params: &[f32]) {
        self.mlp.pack(params, &mut self.packed);
    }
}
