//! The first parameters of a network, and the gradient of many chunks.

use field_core::init::Init;
use field_core::mlp::Mlp;
use field_core::rng::Rng;

/// Xavier weights of a network, no biases.
pub(crate) fn xavier(mlp: &Mlp, rng: Rng) -> Vec<f32> {
    let mut params = vec![0.0; mlp.param_count()];
    for (i, l) in mlp.layers().iter().enumerate() {
        let weights = &mut params[l.weights.clone()];
        Init::XavierUniform.fill(rng.substream(i as u64), l.inputs, l.outputs, weights);
    }
    params
}

/// The sum of the chunks' packed gradients of a network, in order: `out`, written.
pub(crate) fn fold_gradients<'g>(
    mlp: &Mlp,
    grads: impl Iterator<Item = &'g [f32]>,
    packed: &mut Vec<f32>,
    out: &mut [f32],
) {
    packed.clear();
    packed.resize(mlp.packed_grad_len(), 0.0);
    for grad in grads {
        for (sum, g) in packed.iter_mut().zip(grad) {
            *sum += g;
        }
    }
    out.fill(0.0);
    mlp.unpack_grad(packed, out);
}
