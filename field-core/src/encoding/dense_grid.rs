//! Dense grid: features at the vertices of a box of any resolution, blended trilinearly.

use float_core::Simd;

use super::lattice::features::{Features, Packed};
use super::lattice::kernel::{Axes, Gather, Place, Scatter, Slope};
use super::lattice::{Addressing, Interpolation, Lattice};
use super::{axes, check_points, rows_mut};
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
        self.gather(simd, params, axes(x), None, out);
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
        self.gather(simd, params, axes(x), Some(axes(x_dot)), out_dot);
        Ok(())
    }

    /// Adds the gradient of the parameters to `grad`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(&self, simd: Simd, x: &[f32], out_bar: &[f32], grad: &mut [f32]) -> Result<(), FieldError> {
        self.check(grad.len(), x, x.len(), out_bar.len())?;
        self.scatter(simd, axes(x), None, out_bar, grad);
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
        self.scatter(simd, axes(x), Some(axes(x_dot)), out_dot_bar, grad);
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
        self.slope(simd, params, axes(x), None, out_bar, x_bar);
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
        self.slope(simd, params, axes(x), Some(axes(x_dot)), out_dot_bar, x_bar);
        Ok(())
    }

    fn check(&self, params: usize, x: &[f32], other: usize, out: usize) -> Result<(), FieldError> {
        check_len("params", params, self.params_len())?;
        check_points(x)?;
        check_len("x_dot", other, x.len())?;
        check_len("out", out, x.len() / 3 * self.features)
    }

    /// Groups of 8, 4, 2, 1 features: first feature and size.
    fn groups(&self) -> impl Iterator<Item = (usize, usize)> {
        let mut first = 0;
        core::iter::from_fn(move || {
            let rest = self.features - first;
            let size = [8, 4, 2, 1].into_iter().find(|&size| size <= rest)?;
            first += size;
            Some((first - size, size))
        })
    }

    fn place<'a>(&self, first: usize, x: Axes<'a>, x_dot: Option<Axes<'a>>) -> Place<'a> {
        Place { lattice: self.lattice, stride: self.features, first, interpolation: self.interpolation, x, x_dot }
    }

    fn gather(&self, simd: Simd, params: &[f32], x: Axes<'_>, x_dot: Option<Axes<'_>>, out: &mut [f32]) {
        let n = x[0].len();
        for (first, size) in self.groups() {
            let (place, out) = (self.place(first, x, x_dot), &mut out[first * n..(first + size) * n]);
            match size {
                1 => gather::<1>(simd, place, params, out),
                2 => gather::<2>(simd, place, params, out),
                4 => gather::<4>(simd, place, params, out),
                _ => gather::<8>(simd, place, params, out),
            }
        }
    }

    fn scatter(&self, simd: Simd, x: Axes<'_>, x_dot: Option<Axes<'_>>, out_bar: &[f32], grad: &mut [f32]) {
        let n = x[0].len();
        for (first, size) in self.groups() {
            let (place, out_bar) = (self.place(first, x, x_dot), &out_bar[first * n..(first + size) * n]);
            match size {
                1 => scatter::<1>(simd, place, out_bar, grad),
                2 => scatter::<2>(simd, place, out_bar, grad),
                4 => scatter::<4>(simd, place, out_bar, grad),
                _ => scatter::<8>(simd, place, out_bar, grad),
            }
        }
    }

    fn slope(
        &self,
        simd: Simd,
        table: &[f32],
        x: Axes<'_>,
        x_dot: Option<Axes<'_>>,
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) {
        let n = x[0].len();
        for (first, size) in self.groups() {
            let (place, out_bar) = (self.place(first, x, x_dot), &out_bar[first * n..(first + size) * n]);
            match size {
                1 => slope::<1>(simd, place, table, out_bar, x_bar),
                2 => slope::<2>(simd, place, table, out_bar, x_bar),
                4 => slope::<4>(simd, place, table, out_bar, x_bar),
                _ => slope::<8>(simd, place, table, out_bar, x_bar),
            }
        }
    }
}

fn gather<const F: usize>(simd: Simd, place: Place<'_>, table: &[f32], out: &mut [f32])
where
    Packed: Features<F>,
{
    simd.run(Gather::<F> { place, table, out: rows_mut(out) });
}

fn scatter<const F: usize>(simd: Simd, place: Place<'_>, out_bar: &[f32], grad: &mut [f32])
where
    Packed: Features<F>,
{
    simd.run(Scatter::<F> { place, out_bar: super::rows(out_bar), grad, touched: None });
}

fn slope<const F: usize>(simd: Simd, place: Place<'_>, table: &[f32], out_bar: &[f32], x_bar: &mut [f32]) {
    simd.run(Slope::<F> { place, table, out_bar: super::rows(out_bar), x_bar: rows_mut(x_bar) });
}
