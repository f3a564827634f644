//! A network that owns its parameters, their gradient and all buffers.

use super::{Mlp, MlpConfig, MlpError, Packed};
use crate::FieldError;
use crate::error::check_len;
use crate::init::Init;
use crate::rng::Rng;
use alloc::{vec, vec::Vec};
use float_core::Simd;

/// An [`Mlp`] with its parameters, their gradient and the buffers of both passes: for those who train one network with one
/// thread. Values and gradients are those of the functions on slices, bit for bit.
///
/// # Shapes
/// `x`, `x_bar` `[inputs][n]` and `y`, `y_bar` `[outputs][n]`, without gaps between rows; any `n`, and 0 is legal. Buffers grow
/// to the largest batch and stay.
///
/// # Example
/// Fit a line by gradient descent:
///
/// ```
/// use field_core::mlp::{MlpConfig, Network};
///
/// let mut network = Network::new(&MlpConfig::new(1, vec![], 1), 7)?;
/// let (x, truth) = ([-1.0, 0.0, 1.0, 2.0], [-1.0, 1.0, 3.0, 5.0]);
/// let mut y = [0.0; 4];
/// for _ in 0..200 {
///     network.forward(&x, &mut y)?;
///     let y_bar: Vec<f32> = y.iter().zip(&truth).map(|(y, t)| 2.0 * (y - t) / 4.0).collect();
///     network.clear_gradient();
///     network.backward(&y_bar, None)?;
///     let (parameters, gradient) = network.parameters_and_gradient();
///     parameters.iter_mut().zip(gradient).for_each(|(p, g)| *p -= 0.1 * g);
/// }
/// network.infer(&[10.0], &mut y[..1])?;
/// assert!((y[0] - 21.0).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Network {
    mlp: Mlp,
    simd: Simd,
    params: Vec<f32>,
    gradient: Vec<f32>,
    packed: Packed,
    /// Whether `packed` holds `params`.
    packed_is_current: bool,
    packed_grad: Vec<f32>,
    /// Samples of the last forward pass whose activations are still those of `params`; 0 for none.
    kept: usize,
    acts: Vec<f32>,
    scratch: Vec<f32>,
}

impl Network {
    /// A network with [`Init::HeUniform`] weights drawn from `seed`, layer by layer, and biases of 0.
    ///
    /// # Errors
    /// [`MlpError`] as [`Mlp::new`].
    pub fn new(config: &MlpConfig, seed: u64) -> Result<Self, MlpError> {
        Ok(Self::with_init(Mlp::new(config)?, Init::HeUniform, seed))
    }

    /// A network of any layout and precision, with weights from `init` and biases of 0. Layer `l` draws from stream `l` of `seed`.
    #[must_use]
    pub fn with_init(mlp: Mlp, init: Init, seed: u64) -> Self {
        let mut params = vec![0.0; mlp.param_count()];
        for (stream, layer) in (0..).zip(mlp.layers()) {
            init.fill(Rng::new(seed, stream), layer.inputs, layer.outputs, &mut params[layer.weights.clone()]);
        }
        Self::assemble(mlp, params)
    }

    /// A network with given parameters, in the flat order of [`Mlp`], as from a checkpoint.
    ///
    /// # Errors
    /// [`FieldError::Shape`] unless there are [`Mlp::param_count`] of them.
    pub fn from_parameters(mlp: Mlp, parameters: Vec<f32>) -> Result<Self, FieldError> {
        check_len("parameters", parameters.len(), mlp.param_count())?;
        Ok(Self::assemble(mlp, parameters))
    }

    fn assemble(mlp: Mlp, params: Vec<f32>) -> Self {
        Self {
            simd: Simd::best(),
            gradient: vec![0.0; params.len()],
            packed: Packed::default(),
            packed_is_current: false,
            packed_grad: Vec::new(),
            kept: 0,
            acts: Vec::new(),
            scratch: Vec::new(),
            params,
            mlp,
        }
    }

    /// The same network, computed at a SIMD level other than [`Simd::best`].
    #[must_use]
    pub fn with_simd(mut self, simd: Simd) -> Self {
        self.simd = simd;
        self
    }

    /// The layout.
    #[must_use]
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// The parameters, layer after layer: weights `[out][in]`, then biases `[out]`.
    #[must_use]
    pub fn parameters(&self) -> &[f32] {
        &self.params
    }

    /// The parameters, to be changed. Activations of an earlier [`forward`](Self::forward) are void from then on.
    pub fn parameters_mut(&mut self) -> &mut [f32] {
        self.parameters_and_gradient().0
    }

    /// The parameters, to be changed, and their gradient: what an optimiser's step takes. Activations of an earlier
    /// [`forward`](Self::forward) are void from then on.
    pub fn parameters_and_gradient(&mut self) -> (&mut [f32], &[f32]) {
        (self.packed_is_current, self.kept) = (false, 0);
        (&mut self.params, &self.gradient)
    }

    /// Copy parameters in the flat order of [`parameters`](Self::parameters).
    ///
    /// # Errors
    /// [`FieldError::Shape`] unless there are as many.
    pub fn set_parameters(&mut self, parameters: &[f32]) -> Result<(), FieldError> {
        check_len("parameters", parameters.len(), self.params.len())?;
        self.parameters_mut().copy_from_slice(parameters);
        Ok(())
    }

    /// Sum of the gradients of all [`backward`](Self::backward) calls since [`clear_gradient`](Self::clear_gradient), in the
    /// order of [`parameters`](Self::parameters).
    #[must_use]
    pub fn gradient(&self) -> &[f32] {
        &self.gradient
    }

    /// Set the gradient to 0.
    pub fn clear_gradient(&mut self) {
        self.gradient.fill(0.0);
    }

    /// `y = network(x)`, keeping the activations for [`backward`](Self::backward).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn forward(&mut self, x: &[f32], y: &mut [f32]) -> Result<(), FieldError> {
        let n = self.samples(x, y.len())?;
        self.pack();
        grow(&mut self.acts, self.mlp.activations_len(n));
        self.mlp.forward(self.simd, &self.packed, x, n, n, y, n, &mut self.acts);
        self.kept = n;
        Ok(())
    }

    /// `y = network(x)` without a way back. The activations of an earlier [`forward`](Self::forward) stay.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn infer(&mut self, x: &[f32], y: &mut [f32]) -> Result<(), FieldError> {
        let n = self.samples(x, y.len())?;
        self.pack();
        grow(&mut self.scratch, self.mlp.infer_scratch_len());
        self.mlp.infer(self.simd, &self.packed, x, n, n, y, n, &mut self.scratch);
        Ok(())
    }

    /// Gradients of the batch that the last [`forward`](Self::forward) saw, given that of its output: adds that of the
    /// parameters to [`gradient`](Self::gradient), and that of the inputs to `x_bar` where wanted.
    ///
    /// # Errors
    /// [`FieldError::Shape`] unless `y_bar` and `x_bar` are as long as that batch. Without one, and where parameters were
    /// changed since, the batch is empty.
    pub fn backward(&mut self, y_bar: &[f32], x_bar: Option<&mut [f32]>) -> Result<(), FieldError> {
        let n = self.kept;
        check_len("y_bar", y_bar.len(), n * self.mlp.outputs())?;
        if let Some(x_bar) = &x_bar {
            check_len("x_bar", x_bar.len(), n * self.mlp.inputs())?;
        }
        grow(&mut self.scratch, self.mlp.backward_scratch_len());
        grow(&mut self.packed_grad, self.mlp.packed_grad_len());
        self.packed_grad.fill(0.0);
        let (x_bar, grad) = (x_bar.map(|x_bar| (x_bar, n)), &mut self.packed_grad);
        self.mlp.backward(self.simd, &self.packed, &self.acts, y_bar, n, n, x_bar, grad, &mut self.scratch);
        self.mlp.unpack_grad(&self.packed_grad, &mut self.gradient);
        Ok(())
    }

    fn samples(&self, x: &[f32], y: usize) -> Result<usize, FieldError> {
        let n = x.len() / self.mlp.inputs();
        check_len("x", x.len(), n * self.mlp.inputs())?;
        check_len("y", y, n * self.mlp.outputs())?;
        Ok(n)
    }

    fn pack(&mut self) {
        if !self.packed_is_current {
            self.mlp.pack(&self.params, &mut self.packed);
            self.packed_is_current = true;
        }
    }
}

/// Make a buffer at least `len` long.
fn grow(buffer: &mut Vec<f32>, len: usize) {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
}
