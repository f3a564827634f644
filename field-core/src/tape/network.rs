//! Networks as tape operations: fused, or layer by layer.

use super::args::{BackwardArgs, Bar, View};
use super::custom::CustomOp;
use super::error::TapeError;
use super::shape::{Node, Shape};
use super::state::Tape;
use crate::mlp::{Activation, Layer, Mlp, Packed};
use float_core::Simd;

/// A whole network as one operation: inputs `[x, params]`, `x` `[inputs x n]`, `params` the network's flat parameters in any
/// shape.
///
/// Its tangent records the layers one by one ([`layers`]), for each direction again; where Jacobians are
/// the rule rather than the exception, record the layers in the first place.
///
/// # Panics
/// Recording it does so where `packed` was packed for another network or precision.
#[derive(Clone, Copy, Debug)]
pub struct MlpOp<'m> {
    /// The network.
    pub mlp: &'m Mlp,
    /// The kernels' copy of the numbers given as `params`: a stale copy gives wrong values.
    pub packed: &'m Packed,
    /// Level of the kernels.
    pub simd: Simd,
}

const NAME: &str = "mlp";

impl CustomOp for MlpOp<'_> {
    fn name(&self) -> &'static str {
        NAME
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        let [x, params] = *inputs else {
            return Err(TapeError::Length { op: NAME, what: "inputs", want: 2, got: inputs.len() });
        };
        check(self.mlp, x, params)
    }

    fn saved_len(&self, inputs: &[Shape]) -> usize {
        self.mlp.activations_len(inputs[0].cols)
    }

    fn scratch_len(&self, _inputs: &[Shape]) -> usize {
        self.mlp.packed_grad_len() + self.mlp.backward_scratch_len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        let n = inputs[0].cols;
        self.mlp.forward(self.simd, self.packed, inputs[0].data, n, n, out, n, saved);
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, saved, out_bar, .. } = args;
        let n = inputs[0].cols;
        let (grad, scratch) = scratch.split_at_mut(self.mlp.packed_grad_len());
        grad.fill(0.0);
        let x_bar = super::encode::wanted(&mut bars[..1]).map(|bar| (bar, n));
        self.mlp.backward(self.simd, self.packed, saved, out_bar, n, n, x_bar, grad, scratch);
        if let Some(params_bar) = super::encode::wanted(&mut bars[1..]) {
            self.mlp.unpack_grad(grad, params_bar);
        }
        Ok(())
    }

    fn tangent<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        inputs: &[Node],
        input_tangents: &[Option<Node>],
        _output: Node,
    ) -> Result<Node, TapeError> {
        let y = layers(tape, self.mlp, inputs[0], inputs[1])?;
        let mut seeds = [(inputs[0], inputs[0]); 2];
        let mut count = 0;
        for (&input, tangent) in inputs.iter().zip(input_tangents) {
            if let Some(tangent) = *tangent {
                seeds[count] = (input, tangent);
                count += 1;
            }
        }
        let [y_dot] = tape.jvp([y], &seeds[..count])?;
        Ok(y_dot)
    }
}

/// Record the layers of a network one by one: `x` `[inputs x n]`, `params` the network's flat parameters in any shape.
/// The parameters are looked into, not copied.
///
/// # Errors
/// [`TapeError::Shape`], [`TapeError::Length`], [`TapeError::ForeignNode`].
pub fn layers(tape: &mut Tape<'_>, mlp: &Mlp, x: Node, params: Node) -> Result<Node, TapeError> {
    check(mlp, tape.shape(x)?, tape.shape(params)?)?;
    let mut h = x;
    for layer in mlp.layers() {
        let Layer { inputs, outputs, skip_inputs, activation, .. } = *layer;
        if skip_inputs > 0 {
            h = tape.concat(&[x, h])?;
        }
        let w = tape.alias(params, layer.weights.start, Shape::new(outputs, inputs));
        let b = (!layer.biases.is_empty()).then(|| tape.alias(params, layer.biases.start, Shape::new(outputs, 1)));
        h = tape.linear(w, b, h)?;
        h = activate(tape, activation, h)?;
    }
    Ok(h)
}

/// Record an activation.
///
/// # Errors
/// [`TapeError::ForeignNode`].
pub fn activate(tape: &mut Tape<'_>, activation: Activation, x: Node) -> Result<Node, TapeError> {
    match activation {
        Activation::None => Ok(x),
        Activation::Relu => tape.relu(x),
        Activation::LeakyRelu { slope } => tape.leaky_relu(x, slope),
        Activation::Softplus { shift } => tape.softplus(x, shift),
        Activation::Logistic { pad } => {
            let y = tape.logistic(x)?;
            if pad == 0.0 { Ok(y) } else { tape.affine(y, 1.0 + 2.0 * pad, -pad) }
        }
        Activation::Tanh => tape.tanh(x),
        Activation::TruncExp => tape.trunc_exp(x),
    }
}

fn check(mlp: &Mlp, x: Shape, params: Shape) -> Result<Shape, TapeError> {
    let want = Shape::new(mlp.inputs(), x.cols);
    if x != want {
        return Err(TapeError::Shape { op: NAME, what: "x", want, got: x });
    }
    if params.len() != mlp.param_count() {
        return Err(TapeError::Length { op: NAME, what: "params", want: mlp.param_count(), got: params.len() });
    }
    Ok(Shape::new(mlp.outputs(), x.cols))
}
