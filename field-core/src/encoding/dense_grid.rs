//! Dense grid: features at the vertices of a box of any resolution, blended trilinearly.

use float_core::Simd;

use super::lattice::kernel::Place;
use super::lattice::{Addressing, Interpolation, Lattice, groups};
use super::{axes, check_points};
use crate::FieldError;
use crate::error::check_len;

/// A dense grid over `[0, 1]^3`. The first vertex of an axis lies at 0, the last at 1.
///
/// # Shapes
/// * `params`, `grad` `[z][y][x][features]`
/// * `x` `[3][n]`; clamped, with zero gradient outside; NaN counts as 0
/// * `out` `[features][n]`
///
/// # Numerics
/// All SIMD levels give the same bits: sums run over the corners, then over the samples, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenseGrid {
    resolution: [u32; 3],
    features: usize,
    interpolation: Interpolation,
    lattice: Lattice,
}

impl DenseGrid {
    /// A grid of `resolution` vertices along x, y, z and any number of features.
    ///
    /// # Errors
    /// [`FieldError::Config`] for an empty grid, an axis of more than `2^22` vertices, or more than `2^32` parameters.
    pub fn new(resolution: [u32; 3], features: usize, interpolation: Interpolation) -> Result<Self, FieldError> {
        let refuse = |what, got, accepts| Err(FieldError::Config { what, got, accepts });
        if let Some(&r) = resolution.iter().find(|r| !(1..=1 << 22).contains(*r)) {
            return refuse("resolution", f64::from(r), "1 to 2^22");
        }
        if features == 0 {
            return refuse("features", 0.0, "at least 1");
        }
        let entries = resolution.iter().map(|&r| u128::from(r)).product::<u128>();
        let params = entries.saturating_mul(features as u128);
        if params > u128::from(u32::MAX) {
            return refuse("parameters", params as f64, "at most 2^32 - 1");
        }
        let [rx, ry, _] = resolution;
        let lattice = Lattice {
            scale: resolution.map(|r| (r - 1) as f32),
            shift: 0.0,
            // x = 1 belongs to the last cell.
            last_cell: resolution.map(|r| r.saturating_sub(2) as f32),
            strides: [rx, rx * ry],
            entries: entries as u32,
            addressing: Addressing::Dense,
        };
        Ok(Self { resolution, features, interpolation, lattice })
    }

    /// Vertices along x, y, z.
    #[must_use]
    pub fn resolution(&self) -> [u32; 3] {
        self.resolution
    }

    /// Features of a vertex.
    #[must_use]
    pub fn features(&self) -> usize {
        self.features
    }

    /// Rows of the output: the features.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.features
    }

    /// Length of the parameter buffer.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.lattice.entries as usize * self.features
    }

    /// Features at `x`: `out` `[features][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, params: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check(params.len(), x, x.len(), out.len())?;
        groups::gather(simd, self.place(x, None), params, out);
        Ok(())
    }

    /// Derivative along `x_dot` `[3][n]`: `out_dot` `[features][n]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(params.len(), x, x_dot.len(), out_dot.len())?;
        groups::gather(simd, self.place(x, Some(x_dot)), params, out_dot);
        Ok(())
    }

    /// Adds the gradient of the parameters to `grad`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(&self, simd: Simd, x: &[f32], out_bar: &[f32], grad: &mut [f32]) -> Result<(), FieldError> {
        self.check(grad.len(), x, x.len(), out_bar.len())?;
        groups::scatter(simd, self.place(x, None), out_bar, grad, None);
        Ok(())
    }

    /// Adds the gradient of the parameters through [`tangent`](Self::tangent).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward(
        &self,
        simd: Simd,
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        grad: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(grad.len(), x, x_dot.len(), out_dot_bar.len())?;
        groups::scatter(simd, self.place(x, Some(x_dot)), out_dot_bar, grad, None);
        Ok(())
    }

    /// Adds the gradient of the positions to `x_bar` `[3][n]`. Also the gradient of [`tangent`](Self::tangent) with
    /// respect to `x_dot`, given the tangent's cotangent.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward_x(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(params.len(), x, x_bar.len(), out_bar.len())?;
        groups::position_gradient(simd, self.place(x, None), params, out_bar, x_bar);
        Ok(())
    }

    /// Adds the gradient of the positions through [`tangent`](Self::tangent).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward_x(
        &self,
        simd: Simd,
        params: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(params.len(), x, x_dot.len(), out_dot_bar.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        groups::position_gradient(simd, self.place(x, Some(x_dot)), params, out_dot_bar, x_bar);
        Ok(())
    }

    fn check(&self, params: usize, x: &[f32], other: usize, out: usize) -> Result<(), FieldError> {
        check_len("params", params, self.params_len())?;
        check_points(x)?;
        check_len("x_dot", other, x.len())?;
        check_len("out", out, x.len() / 3 * self.features)
    }

    fn place<'a>(&self, x: &'a [f32], x_dot: Option<&'a [f32]>) -> Place<'a> {
        Place {
            lattice: self.lattice,
            stride: self.features,
            features: self.features,
            first: 0,
            interpolation: self.interpolation,
            x: axes(x),
            x_dot: x_dot.map(axes),
        }
    }
}
