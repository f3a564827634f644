//! Grids and planes of learned features as tape operations.

use super::encode::Encoder;
use crate::FieldError;
use crate::encoding::dense_grid::DenseGrid;
use crate::encoding::hash_grid::HashGrid;
use crate::encoding::multi_distance::MultiDistance;
use crate::encoding::planes::Planes;
use float_core::Simd;

/// A hash grid. Operations are shared by threads, so they cannot mark what they touch: entries without gradient are those
/// whose gradient is 0.
#[derive(Clone, Copy, Debug)]
pub struct HashGridTable<'g> {
    /// The grid.
    pub grid: &'g HashGrid,
}

impl Encoder for HashGridTable<'_> {
    const NAME: &'static str = "hash_grid";

    fn in_rows(&self) -> usize {
        3
    }

    fn out_rows(&self) -> usize {
        self.grid.out_rows()
    }

    fn params_len(&self) -> usize {
        self.grid.params_len()
    }

    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.grid.encode(simd, table, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        out_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            self.grid.encode_backward(simd, x, out_bar, bar, None)?;
        }
        x_bar.map_or(Ok(()), |bar| self.grid.encode_backward_x(simd, table, x, out_bar, bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.grid.tangent(simd, table, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            self.grid.tangent_backward(simd, x, x_dot, out_dot_bar, bar, None)?;
        }
        x_bar.map_or(Ok(()), |bar| self.grid.tangent_backward_x(simd, table, x, x_dot, out_dot_bar, bar))
    }
}

impl Encoder for DenseGrid {
    const NAME: &'static str = "dense_grid";

    fn in_rows(&self) -> usize {
        3
    }

    fn out_rows(&self) -> usize {
        self.features()
    }

    fn params_len(&self) -> usize {
        DenseGrid::params_len(self)
    }

    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        DenseGrid::encode(self, simd, table, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        out_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            self.encode_backward(simd, x, out_bar, bar)?;
        }
        x_bar.map_or(Ok(()), |bar| self.encode_backward_x(simd, table, x, out_bar, bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        DenseGrid::tangent(self, simd, table, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            DenseGrid::tangent_backward(self, simd, x, x_dot, out_dot_bar, bar)?;
        }
        x_bar.map_or(Ok(()), |bar| self.tangent_backward_x(simd, table, x, x_dot, out_dot_bar, bar))
    }
}

impl Encoder for MultiDistance {
    const NAME: &'static str = "multi_distance";

    fn in_rows(&self) -> usize {
        3
    }

    fn out_rows(&self) -> usize {
        MultiDistance::out_rows(self)
    }

    fn params_len(&self) -> usize {
        MultiDistance::params_len(self)
    }

    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        MultiDistance::encode(self, simd, table, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        out_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            self.encode_backward(simd, x, out_bar, bar)?;
        }
        x_bar.map_or(Ok(()), |bar| self.encode_backward_x(simd, table, x, out_bar, bar))
    }

    fn tangent(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        MultiDistance::tangent(self, simd, table, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        if let Some(bar) = table_bar {
            MultiDistance::tangent_backward(self, simd, x, x_dot, out_dot_bar, bar)?;
        }
        x_bar.map_or(Ok(()), |bar| self.tangent_backward_x(simd, table, x, x_dot, out_dot_bar, bar))
    }
}

impl Encoder for Planes {
    const NAME: &'static str = "planes";

    fn in_rows(&self) -> usize {
        Planes::in_rows(self)
    }

    fn out_rows(&self) -> usize {
        self.features()
    }

    fn params_len(&self) -> usize {
        Planes::params_len(self)
    }

    fn is_linear(&self) -> bool {
        self.sums()
    }

    fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        Planes::encode(self, simd, table, x, out)
    }

    fn backward(
        &self,
        simd: Simd,
        at: (&[f32], &[f32]),
        out_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        self.encode_backward(simd, at, out_bar, table_bar, x_bar)
    }

    fn tangent(
        &self,
        simd: Simd,
        (table, x): (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        Planes::tangent(self, simd, table, x, x_dot, out_dot)
    }

    fn tangent_backward(
        &self,
        simd: Simd,
        at: (&[f32], &[f32]),
        x_dot: &[f32],
        out_dot_bar: &[f32],
        table_bar: Option<&mut [f32]>,
        x_bar: Option<&mut [f32]>,
    ) -> Result<(), FieldError> {
        Planes::tangent_backward(self, simd, at, x_dot, out_dot_bar, table_bar, x_bar)
    }
}
