//! Encodings of positions, directions and indices.
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
pub mod window;

use crate::FieldError;
use crate::error::check_len;

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
