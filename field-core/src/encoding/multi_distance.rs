//! Multi-distance interpolation: one grid of features read three times, at every vertex, at every second, at every fourth.
//!
//! The wide cells reach far for their gradient, the narrow ones hold detail; no parameter is added for it.
//! Fang et al., "TiNeuVox: Fast Dynamic Radiance Fields with Time-Aware Neural Voxels", 2022, section 3.3.

use alloc::vec::Vec;
use float_core::Simd;

use super::lattice::kernel::{BLOCK_FLOATS, Place};
use super::lattice::{Addressing, Interpolation, Lattice, groups};
use super::resample::{Axis, resample};
use super::{axes, check_points};
use crate::FieldError;
use crate::error::check_len;

/// Distances between the vertices that are read, in vertices.
pub const STRIDES: [usize; 3] = [1, 2, 4];

/// A dense grid over `[0, 1]^3`, blended trilinearly at each of [`STRIDES`].
///
/// Along an axis of `S` vertices the first lies at 0, the last at 1. The grid has `4 ceil((S - 1) / 4) + 1` of them, so that
/// the three lattices end at the same vertex: those past `S` lie past 1, where no position is, but they are corners of
/// wide cells and are trained as the others are. Positions are not stretched to the padded grid.
///
/// # Shapes
/// * `table`, `table_bar` `[z][y][x][features]`, padded
/// * `x`, `x_bar` `[3][n]`; clamped, with zero gradient outside; NaN counts as 0
/// * `out`, `out_bar` `[stride][features][n]`; of one stride `[features][n]`
///
/// # Numerics
/// All SIMD levels give the same bits: sums run over the corners, then over the samples, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultiDistance {
    resolution: [u32; 3],
    vertices: [u32; 3],
    features: usize,
}

impl MultiDistance {
    /// A grid of `resolution` vertices along x, y, z in the box, and any number of features.
    ///
    /// # Errors
    /// [`FieldError::Config`] for an axis of less than 2 or more than `2^20` vertices, no features, or more than `2^32`
    /// parameters.
    pub fn new(resolution: [u32; 3], features: usize) -> Result<Self, FieldError> {
        let refuse = |what, got, accepts| Err(FieldError::Config { what, got, accepts });
        if let Some(&r) = resolution.iter().find(|r| !(2..=1 << 20).contains(*r)) {
            return refuse("resolution", f64::from(r), "2 to 2^20");
        }
        if features == 0 {
            return refuse("features", 0.0, "at least 1");
        }
        let vertices = resolution.map(|s| 4 * (s - 1).div_ceil(4) + 1);
        let params = vertices.iter().map(|&r| u128::from(r)).product::<u128>().saturating_mul(features as u128);
        if params > u128::from(u32::MAX) {
            return refuse("parameters", params as f64, "at most 2^32 - 1");
        }
        Ok(Self { resolution, vertices, features })
    }

    /// Vertices along x, y, z in the box.
    #[must_use]
    pub fn resolution(&self) -> [u32; 3] {
        self.resolution
    }

    /// Vertices along x, y, z of the padded grid.
    #[must_use]
    pub fn vertices(&self) -> [u32; 3] {
        self.vertices
    }

    /// Features of a vertex.
    #[must_use]
    pub fn features(&self) -> usize {
        self.features
    }

    /// Length of the table.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.vertices.iter().map(|&v| v as usize).product::<usize>() * self.features
    }

    /// Rows of the output: those of stride 1, of stride 2, of stride 4.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        STRIDES.len() * self.features
    }

    /// Words that mark which blocks of [`BLOCK_FLOATS`] parameters were touched: bit
    /// `b % 64` of word `b / 64` stands for block `b`.
    #[must_use]
    pub fn touched_words(&self) -> usize {
        self.params_len().div_ceil(BLOCK_FLOATS).div_ceil(64)
    }

    /// Features at `x`, all strides.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check("table", table.len(), x, out.len(), self.out_rows())?;
        for (stride, out) in self.parts_mut(x, out) {
            groups::gather(simd, self.place(stride, x, None), table, out);
        }
        Ok(())
    }

    /// Features at `x` of [`STRIDES`]`[stride]`.
    ///
    /// # Errors
    /// [`FieldError::Shape`]; [`FieldError::Index`] for a stride that does not exist.
    pub fn encode_stride(
        &self,
        simd: Simd,
        stride: usize,
        table: &[f32],
        x: &[f32],
        out: &mut [f32],
    ) -> Result<(), FieldError> {
        check_stride(stride)?;
        self.check("table", table.len(), x, out.len(), self.features)?;
        groups::gather(simd, self.place(stride, x, None), table, out);
        Ok(())
    }

    /// Derivative along `x_dot` `[3][n]`, all strides.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check("table", table.len(), x, out_dot.len(), self.out_rows())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        for (stride, out_dot) in self.parts_mut(x, out_dot) {
            groups::gather(simd, self.place(stride, x, Some(x_dot)), table, out_dot);
        }
        Ok(())
    }

    /// Adds the gradient of the table.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(
        &self,
        simd: Simd,
        x: &[f32],
        out_bar: &[f32],
        table_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check("table_bar", table_bar.len(), x, out_bar.len(), self.out_rows())?;
        for (stride, out_bar) in self.parts(x, out_bar) {
            groups::scatter(simd, self.place(stride, x, None), out_bar, table_bar, None);
        }
        Ok(())
    }

    /// Adds one stride's gradient of the table; `out_bar` `[features][n]` is that of the stride.
    ///
    /// # Errors
    /// As [`encode_stride`](Self::encode_stride).
    pub fn encode_stride_backward(
        &self,
        simd: Simd,
        stride: usize,
        x: &[f32],
        out_bar: &[f32],
        table_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        check_stride(stride)?;
        self.check("table_bar", table_bar.len(), x, out_bar.len(), self.features)?;
        groups::scatter(simd, self.place(stride, x, None), out_bar, table_bar, None);
        Ok(())
    }

    /// As [`encode_stride_backward`](Self::encode_stride_backward), and marks the blocks that were added to in `touched`, of
    /// [`touched_words`](Self::touched_words).
    ///
    /// # Errors
    /// As [`encode_stride`](Self::encode_stride).
    pub fn encode_stride_backward_touched(
        &self,
        simd: Simd,
        stride: usize,
        x: &[f32],
        out_bar: &[f32],
        table_bar: &mut [f32],
        touched: &mut [u64],
    ) -> Result<(), FieldError> {
        check_stride(stride)?;
        self.check("table_bar", table_bar.len(), x, out_bar.len(), self.features)?;
        check_len("touched", touched.len(), self.touched_words())?;
        groups::scatter(simd, self.place(stride, x, None), out_bar, table_bar, Some(touched));
        Ok(())
    }

    /// Adds the gradient of the table through [`tangent`](Self::tangent).
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward(
        &self,
        simd: Simd,
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        table_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check("table_bar", table_bar.len(), x, out_dot_bar.len(), self.out_rows())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        for (stride, bar) in self.parts(x, out_dot_bar) {
            groups::scatter(simd, self.place(stride, x, Some(x_dot)), bar, table_bar, None);
        }
        Ok(())
    }

    /// Adds the gradient of the positions. Also the gradient of [`tangent`](Self::tangent) with respect to `x_dot`, given
    /// the tangent's cotangent.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward_x(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check("table", table.len(), x, out_bar.len(), self.out_rows())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        for (stride, out_bar) in self.parts(x, out_bar) {
            groups::position_gradient(simd, self.place(stride, x, None), table, out_bar, x_bar);
        }
        Ok(())
    }

    /// Adds one stride's gradient of the positions; `out_bar` `[features][n]` is that of the stride.
    ///
    /// # Errors
    /// As [`encode_stride`](Self::encode_stride).
    pub fn encode_stride_backward_x(
        &self,
        simd: Simd,
        stride: usize,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        check_stride(stride)?;
        self.check("table", table.len(), x, out_bar.len(), self.features)?;
        check_len("x_bar", x_bar.len(), x.len())?;
        groups::position_gradient(simd, self.place(stride, x, None), table, out_bar, x_bar);
        Ok(())
    }

    /// Adds the gradient of the positions through [`tangent`](Self::tangent): mixed second derivatives, the pure ones are 0
    /// inside cells.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward_x(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        x_bar: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check("table", table.len(), x, out_dot_bar.len(), self.out_rows())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        check_len("x_bar", x_bar.len(), x.len())?;
        for (stride, bar) in self.parts(x, out_dot_bar) {
            groups::position_gradient(simd, self.place(stride, x, Some(x_dot)), table, bar, x_bar);
        }
        Ok(())
    }

    /// The table of a grid of another resolution that holds the same field, as far as its vertices can: the stride-1 blend of
    /// `table` at the vertices of `finer`. Exact where vertices coincide, and everywhere in the box if the cells of `finer`
    /// are a whole fraction of these. Past the last vertex of this grid, the value there.
    ///
    /// # Panics
    /// If `table` has the wrong length or the numbers of features differ.
    #[must_use]
    pub fn upsampled(&self, table: &[f32], finer: &Self) -> Vec<f32> {
        assert_eq!(table.len(), self.params_len(), "the table has the wrong length");
        assert_eq!(self.features, finer.features, "the grids have different numbers of features");
        resample(self.box3(), finer.box3(), self.features, table)
    }

    fn box3(&self) -> [Axis; 3] {
        core::array::from_fn(|a| Axis { vertices: self.vertices[a] as usize, cells: self.resolution[a] as usize - 1 })
    }

    fn check(&self, what: &'static str, table: usize, x: &[f32], out: usize, rows: usize) -> Result<(), FieldError> {
        check_len(what, table, self.params_len())?;
        check_points(x)?;
        check_len("out", out, x.len() / 3 * rows)
    }

    /// Each stride's part of an output.
    fn parts<'a>(&self, x: &[f32], out: &'a [f32]) -> impl Iterator<Item = (usize, &'a [f32])> + use<'a> {
        // Chunks of 0 do not exist; no samples, no parts.
        out.chunks((x.len() / 3 * self.features).max(1)).enumerate()
    }

    fn parts_mut<'a>(&self, x: &[f32], out: &'a mut [f32]) -> impl Iterator<Item = (usize, &'a mut [f32])> + use<'a> {
        out.chunks_mut((x.len() / 3 * self.features).max(1)).enumerate()
    }

    fn place<'a>(&self, stride: usize, x: &'a [f32], x_dot: Option<&'a [f32]>) -> Place<'a> {
        let s = STRIDES[stride] as u32;
        let [vx, vy, vz] = self.vertices;
        let lattice = Lattice {
            scale: self.resolution.map(|r| (r - 1) as f32 / s as f32),
            shift: 0.0,
            last_cell: self.vertices.map(|v| ((v - 1) / s - 1) as f32),
            // An entry is `s` vertices: a step along y is `vx` of them, as in the full grid.
            strides: [vx, vx * vy],
            // The last vertex is the last of every lattice; numbers of vertices are 1 modulo 4.
            entries: (vx * vy * vz - 1) / s + 1,
            addressing: Addressing::Dense,
        };
        Place {
            lattice,
            stride: s as usize * self.features,
            features: self.features,
            first: 0,
            interpolation: Interpolation::Linear,
            x: axes(x),
            x_dot: x_dot.map(axes),
        }
    }
}

fn check_stride(stride: usize) -> Result<(), FieldError> {
    if stride < STRIDES.len() {
        return Ok(());
    }
    Err(FieldError::Index { what: "stride", index: 0, got: stride, limit: STRIDES.len() })
}
