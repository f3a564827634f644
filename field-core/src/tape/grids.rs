//! Grids and planes of learned features as tape operations.

use super::encode::Encoder;
use crate::FieldError;
use crate::encoding::EncodingBars;
use crate::encoding::dense_grid::DenseGrid;
use crate::encoding::hash_grid::HashGrid;
use crate::encoding::multi_distance::MultiDistance;
use crate::encoding::planes::{KPlanes, Planes};
use float_core::Simd;

/// A hash grid. Operations are shared by threads, so they cannot mark what they touch: entries without gradient are those
/// whose gradient is 0.
#[derive(Clone, Copy, Debug)]
pub struct HashGridTable<'g> {
    /// The grid.
    pub grid: &'g HashGrid,
}

/// [`Encoder`] of a grid with separate calls for the gradients of its table and of the positions. `$grid` is the field that
/// holds it, `$touched` what its calls take where they can mark the entries they add to.
macro_rules! grid_encoder {
    ($type:ty, $name:literal $(, grid: $grid:ident, touched: $touched:expr)?) => {
        impl Encoder for $type {
            const NAME: &'static str = $name;

            fn in_rows(&self) -> usize {
                3
            }

            fn out_rows(&self) -> usize {
                self$(.$grid)?.out_rows()
            }

            fn params_len(&self) -> usize {
                self$(.$grid)?.params_len()
            }

            fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
                self$(.$grid)?.encode(simd, table, x, out)
            }

            fn backward(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                out_bar: &[f32],
                bars: EncodingBars<'_>,
            ) -> Result<(), FieldError> {
                if let Some(bar) = bars.table {
                    self$(.$grid)?.encode_backward(simd, x, out_bar, bar $(, $touched)?)?;
                }
                bars.x.map_or(Ok(()), |bar| self$(.$grid)?.encode_backward_x(simd, table, x, out_bar, bar))
            }

            fn tangent(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                x_dot: &[f32],
                out_dot: &mut [f32],
            ) -> Result<(), FieldError> {
                self$(.$grid)?.tangent(simd, table, x, x_dot, out_dot)
            }

            fn tangent_backward(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                x_dot: &[f32],
                out_dot_bar: &[f32],
                bars: EncodingBars<'_>,
            ) -> Result<(), FieldError> {
                if let Some(bar) = bars.table {
                    self$(.$grid)?.tangent_backward(simd, x, x_dot, out_dot_bar, bar $(, $touched)?)?;
                }
                bars.x.map_or(Ok(()), |bar| self$(.$grid)?.tangent_backward_x(simd, table, x, x_dot, out_dot_bar, bar))
            }
        }
    };
}

// Methods of the grids themselves go before those of the trait.
grid_encoder!(HashGridTable<'_>, "hash_grid", grid: grid, touched: None);
grid_encoder!(DenseGrid, "dense_grid");
grid_encoder!(MultiDistance, "multi_distance");

/// [`Encoder`] of planes, whose gradients come in one call. `$linear` says whether the features are linear in the table.
macro_rules! planes_encoder {
    ($type:ty, $name:literal, |$planes:ident| $linear:expr) => {
        impl Encoder for $type {
            const NAME: &'static str = $name;

            fn in_rows(&self) -> usize {
                self.in_rows()
            }

            fn out_rows(&self) -> usize {
                self.out_rows()
            }

            fn params_len(&self) -> usize {
                self.params_len()
            }

            fn is_linear(&self) -> bool {
                let $planes = self;
                $linear
            }

            fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
                self.encode(simd, table, x, out)
            }

            fn backward(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                out_bar: &[f32],
                bars: EncodingBars<'_>,
            ) -> Result<(), FieldError> {
                self.encode_backward(simd, table, x, out_bar, bars)
            }

            fn tangent(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                x_dot: &[f32],
                out_dot: &mut [f32],
            ) -> Result<(), FieldError> {
                self.tangent(simd, table, x, x_dot, out_dot)
            }

            fn tangent_backward(
                &self,
                simd: Simd,
                table: &[f32],
                x: &[f32],
                x_dot: &[f32],
                out_dot_bar: &[f32],
                bars: EncodingBars<'_>,
            ) -> Result<(), FieldError> {
                self.tangent_backward(simd, table, x, x_dot, out_dot_bar, bars)
            }
        }
    };
}

planes_encoder!(Planes, "planes", |planes| planes.sums());
planes_encoder!(KPlanes, "k_planes", |_planes| false);
