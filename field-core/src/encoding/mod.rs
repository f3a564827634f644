//! Encodings of positions and directions.
//!
//! | module | of | source |
//! | --- | --- | --- |
//! | [`frequency`], [`window`] | numbers: sines and cosines of octaves, and weights that open them coarse to fine | NeRF; Nerfies |
//! | [`integrated`] | Gaussians: the mean of those over them | mip-NeRF |
//! | [`spherical_harmonics`] | directions | instant-ngp |
//! | [`hash_grid`] | positions: learned features of several levels, in hashed tables | instant-ngp |
//! | [`dense_grid`], [`multi_distance`] | positions: learned features at all vertices; the same read at three distances | TiNeuVox |
//! | [`time_hash`] | positions with time: learned features of several levels, in hashed tables | MSTH |
//! | [`planes`] | positions, with time: learned features of planes, summed or multiplied | tri-planes, K-Planes, HexPlane |
//!
//! All batches are feature-major. Functions that vectorise take the [`Simd`](float_core::Simd) level to run at.

pub mod dense_grid;
pub mod frequency;
pub mod hash_grid;
pub mod integrated;
mod lattice;
pub mod multi_distance;
pub mod planes;
mod resample;
pub mod spherical_harmonics;
pub mod time_hash;
pub mod window;

use crate::FieldError;
use crate::error::check_len;

/// Where the gradients of an encoding with a table are added; `None` skips one.
#[derive(Debug, Default)]
pub struct EncodingBars<'b> {
    /// Gradient of the table, as long as that.
    pub table: Option<&'b mut [f32]>,
    /// Gradient of the positions, `[in_rows][n]`.
    pub x: Option<&'b mut [f32]>,
}

impl<'b> EncodingBars<'b> {
    /// Only the gradient of the table.
    #[must_use]
    pub fn table(table: &'b mut [f32]) -> Self {
        Self { table: Some(table), x: None }
    }

    /// Only the gradient of the positions.
    #[must_use]
    pub fn x(x: &'b mut [f32]) -> Self {
        Self { table: None, x: Some(x) }
    }

    /// Both.
    #[must_use]
    pub fn both(table: &'b mut [f32], x: &'b mut [f32]) -> Self {
        Self { table: Some(table), x: Some(x) }
    }
}

/// The three rows of `[3][n]`.
fn axes(x: &[f32]) -> [&[f32]; 3] {
    rows(x)
}

/// The `N` equally long rows of a matrix.
fn rows<const N: usize>(x: &[f32]) -> [&[f32]; N] {
    let n = x.len() / N;
    core::array::from_fn(|r| &x[r * n..(r + 1) * n])
}

/// The same, to be written.
fn rows_mut<const N: usize>(x: &mut [f32]) -> [&mut [f32]; N] {
    let n = x.len() / N;
    let mut rest = x;
    core::array::from_fn(|_| {
        let (row, tail) = core::mem::take(&mut rest).split_at_mut(n);
        rest = tail;
        row
    })
}

/// Whether `x` is `[3][n]`.
fn check_points(x: &[f32]) -> Result<(), FieldError> {
    check_len("x", x.len(), x.len() / 3 * 3)
}
