//! One convolution: columns of a tile of pixels, times the weights.

use super::columns::Windows;
use super::pad::Padded;
use super::{Padding, Size, Workspace, grown};
use crate::FieldError;
use crate::error::check_len;
use crate::init::Init;
use crate::mlp::{Activation, Mlp, MlpConfig, PANEL};
use crate::rng::Rng;
use alloc::vec::Vec;
use float_core::Simd;

/// A two-dimensional convolution (cross-correlation, as in every network library) with bias:
///
/// `y[o][i][j] = b[o] + sum(w[o][c][u][v] * x[c][stride * i + u - pad][stride * j + v - pad])`
///
/// Holds no parameters: see [`Conv2d::param_count`] for their order.
#[derive(Clone, Debug, PartialEq)]
pub struct Conv2d {
    inputs: usize,
    outputs: usize,
    kernel: usize,
    stride: usize,
    padding: Padding,
    /// One linear layer of `inputs * kernel * kernel` features.
    product: Mlp,
}

/// Numbers of a tile's columns: they stay in the L2 cache between being gathered and multiplied.
const TILE: usize = 1 << 16;

impl Conv2d {
    /// A convolution of `inputs` to `outputs` channels with a square kernel.
    ///
    /// # Errors
    /// [`FieldError::Config`] where a number of channels, the kernel or the stride is 0.
    pub fn new(
        inputs: usize,
        outputs: usize,
        kernel: usize,
        stride: usize,
        padding: Padding,
    ) -> Result<Self, FieldError> {
        let bad = [("inputs", inputs), ("outputs", outputs), ("kernel", kernel), ("stride", stride)];
        if let Some(&(what, _)) = bad.iter().find(|(_, n)| *n == 0) {
            return Err(FieldError::Config { what, got: 0.0, accepts: "at least 1" });
        }
        let product = Mlp::new(
            &MlpConfig::new(inputs * kernel * kernel, Vec::new(), outputs).with_hidden_activation(Activation::None),
        );
        // Neither width can be 0 here.
        let product = product.map_err(|_| FieldError::Config { what: "inputs", got: 0.0, accepts: "at least 1" })?;
        Ok(Self { inputs, outputs, kernel, stride, padding, product })
    }

    /// Input channels.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Output channels.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Trainable numbers: weights `[out][in][kernel][kernel]`, then biases `[out]`.
    #[must_use]
    pub fn param_count(&self) -> usize {
        self.product.param_count()
    }

    /// Multiplications for one output pixel.
    #[must_use]
    pub fn macs(&self) -> usize {
        self.product.macs()
    }

    /// Draw weights; biases start at 0.
    ///
    /// # Panics
    /// When `params` does not hold [`Conv2d::param_count`] numbers.
    pub fn init(&self, init: Init, rng: Rng, params: &mut [f32]) {
        assert_eq!(params.len(), self.param_count(), "conv: parameters");
        let taps = self.kernel * self.kernel;
        let (weights, biases) = params.split_at_mut(self.macs());
        init.fill(rng, self.inputs * taps, self.outputs * taps, weights);
        biases.fill(0.0);
    }

    /// Extent of the output for images of this size.
    ///
    /// # Errors
    /// [`FieldError::Config`] for images too small to be padded, or smaller than the kernel when padded.
    pub fn output_size(&self, size: Size) -> Result<Size, FieldError> {
        self.padding.check(size)?;
        let border = 2 * self.padding.width();
        let side = |what, n: usize| match (n + border).checked_sub(self.kernel) {
            Some(rest) => Ok(rest / self.stride + 1),
            None => {
                let accepts = "at least the kernel's size less the padding";
                Err(FieldError::Config { what, got: n as f64, accepts })
            }
        };
        Ok(Size { images: size.images, height: side("height", size.height)?, width: side("width", size.width)? })
    }

    /// `y = conv(x)`.
    ///
    /// # Shapes
    /// * `params` [`Conv2d::param_count`] numbers; they are brought into the kernels' layout on every call
    /// * `x` `[images][inputs][height][width]`, of extent `size`
    /// * `y` `[images][outputs][height][width]`, of extent [`Conv2d::output_size`]: written
    ///
    /// # Errors
    /// [`FieldError::Shape`] for other lengths; as [`Conv2d::output_size`].
    ///
    /// # Panics
    /// If there is no memory for the padded image. May do so where a product of the extents does not fit `usize`.
    pub fn forward(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        size: Size,
        y: &mut [f32],
        work: &mut Workspace,
    ) -> Result<(), FieldError> {
        let to = self.check(params, x, size)?;
        check_len("y", y.len(), to.len(self.outputs))?;
        if size.images == 0 {
            return Ok(());
        }
        self.product.pack(params, &mut work.packed);
        let windows = self.windows(size, to);
        let tile = self.tile();
        let padded = grown(&mut work.padded, windows.padded.len());
        let columns = grown(&mut work.columns, self.product.inputs() * tile);
        let scratch = grown(&mut work.scratch, self.product.infer_scratch_len());
        for (x, y) in
            x.chunks_exact(size.len(self.inputs) / size.images).zip(y.chunks_exact_mut(to.pixels() * self.outputs))
        {
            windows.padded.pad(x, padded);
            for start in (0..to.pixels()).step_by(tile) {
                let n = tile.min(to.pixels() - start);
                windows.gather(padded, start..start + n, columns, tile);
                self.product.infer(simd, &work.packed, columns, tile, n, &mut y[start..], to.pixels(), scratch);
            }
        }
        Ok(())
    }

    /// Gradient of [`Conv2d::forward`]: **adds** into `params_bar` and `x_bar`. Without `x_bar` the gradient of the images is
    /// not worked out.
    ///
    /// # Shapes
    /// `y_bar` as `y`, `params_bar` as `params`, `x_bar` as `x`.
    ///
    /// # Errors
    /// As [`Conv2d::forward`].
    ///
    /// # Panics
    /// As [`Conv2d::forward`].
    #[expect(clippy::too_many_arguments, reason = "inputs, the gradient that comes and those that go")]
    pub fn backward(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        size: Size,
        y_bar: &[f32],
        params_bar: &mut [f32],
        mut x_bar: Option<&mut [f32]>,
        work: &mut Workspace,
    ) -> Result<(), FieldError> {
        let to = self.check(params, x, size)?;
        check_len("y_bar", y_bar.len(), to.len(self.outputs))?;
        check_len("params_bar", params_bar.len(), self.param_count())?;
        if let Some(x_bar) = &x_bar {
            check_len("x_bar", x_bar.len(), x.len())?;
        }
        if size.images == 0 {
            return Ok(());
        }
        self.product.pack(params, &mut work.packed);
        let windows = self.windows(size, to);
        let (tile, image) = (self.tile(), size.pixels() * self.inputs);
        let padded = grown(&mut work.padded, windows.padded.len());
        let padded_bar = grown(&mut work.padded_bar, windows.padded.len());
        let columns = grown(&mut work.columns, self.product.inputs() * tile);
        let columns_bar = grown(&mut work.columns_bar, self.product.inputs() * tile);
        let panels = grown(&mut work.panels, self.product.activations_len(tile));
        let scratch = grown(&mut work.scratch, self.product.backward_scratch_len());
        let grad = grown(&mut work.grad, self.product.packed_grad_len());
        grad.fill(0.0);
        for (i, y_bar) in y_bar.chunks_exact(to.pixels() * self.outputs).enumerate() {
            windows.padded.pad(&x[i * image..][..image], padded);
            padded_bar.fill(0.0);
            for start in (0..to.pixels()).step_by(tile) {
                let n = tile.min(to.pixels() - start);
                windows.gather(padded, start..start + n, columns, tile);
                self.product.keep_inputs(simd, columns, tile, n, panels);
                let bars = &y_bar[start..];
                let into = x_bar.is_some().then(|| {
                    columns_bar.fill(0.0);
                    (&mut columns_bar[..], tile)
                });
                self.product.backward(simd, &work.packed, panels, bars, to.pixels(), n, into, grad, scratch);
                if x_bar.is_some() {
                    windows.scatter(columns_bar, start..start + n, tile, padded_bar);
                }
            }
            if let Some(x_bar) = x_bar.as_deref_mut() {
                windows.padded.pad_backward(padded_bar, &mut x_bar[i * image..][..image]);
            }
        }
        self.product.unpack_grad(grad, params_bar);
        Ok(())
    }

    fn check(&self, params: &[f32], x: &[f32], size: Size) -> Result<Size, FieldError> {
        let to = self.output_size(size)?;
        check_len("params", params.len(), self.param_count())?;
        check_len("x", x.len(), size.len(self.inputs))?;
        Ok(to)
    }

    fn windows(&self, size: Size, to: Size) -> Windows {
        Windows {
            padded: Padded::new(self.padding, self.inputs, size, self.stride),
            kernel: self.kernel,
            stride: self.stride,
            out_width: to.width,
        }
    }

    /// Output pixels of a tile: whole panels.
    fn tile(&self) -> usize {
        (TILE / (PANEL * self.product.inputs())).clamp(1, 16) * PANEL
    }
}
