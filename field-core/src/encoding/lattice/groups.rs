//! All features of a grid: the kernels one after the other, each for as many features as registers hold.

use float_core::Simd;

use super::features::{Features, Packed};
use super::kernel::{Gather, Place, PositionGradient, Scatter};
use crate::encoding::{rows, rows_mut};

/// Groups of 8, 6, 4, 2, 1 features: first feature and size.
pub(crate) fn groups(features: usize) -> impl Iterator<Item = (usize, usize)> {
    let mut first = 0;
    core::iter::from_fn(move || {
        let rest = features - first;
        let size = [8, 6, 4, 2, 1].into_iter().find(|&size| size <= rest)?;
        first += size;
        Some((first - size, size))
    })
}

/// `out` `[features][n]`.
pub(crate) fn gather(simd: Simd, place: Place<'_>, table: &[f32], out: &mut [f32]) {
    fn some<const F: usize>(simd: Simd, place: Place<'_>, table: &[f32], out: &mut [f32])
    where
        Packed: Features<F>,
    {
        simd.run(Gather::<F> { place, table, out: rows_mut(out) });
    }
    let n = place.x[0].len();
    for (first, size) in groups(place.features) {
        let (place, out) = (Place { first, ..place }, &mut out[first * n..(first + size) * n]);
        match size {
            1 => some::<1>(simd, place, table, out),
            2 => some::<2>(simd, place, table, out),
            4 => some::<4>(simd, place, table, out),
            6 => some::<6>(simd, place, table, out),
            _ => some::<8>(simd, place, table, out),
        }
    }
}

/// Adds to `grad`, given `out_bar` `[features][n]`; marks blocks in `touched`.
pub(crate) fn scatter(
    simd: Simd,
    place: Place<'_>,
    out_bar: &[f32],
    grad: &mut [f32],
    mut touched: Option<&mut [u64]>,
) {
    fn some<const F: usize>(
        simd: Simd,
        place: Place<'_>,
        out_bar: &[f32],
        grad: &mut [f32],
        touched: Option<&mut [u64]>,
    ) where
        Packed: Features<F>,
    {
        simd.run(Scatter::<F> { place, out_bar: rows(out_bar), grad, touched });
    }
    let n = place.x[0].len();
    for (first, size) in groups(place.features) {
        let (place, out_bar) = (Place { first, ..place }, &out_bar[first * n..(first + size) * n]);
        let touched = touched.as_deref_mut();
        match size {
            1 => some::<1>(simd, place, out_bar, grad, touched),
            2 => some::<2>(simd, place, out_bar, grad, touched),
            4 => some::<4>(simd, place, out_bar, grad, touched),
            6 => some::<6>(simd, place, out_bar, grad, touched),
            _ => some::<8>(simd, place, out_bar, grad, touched),
        }
    }
}

/// Adds to `x_bar` `[3][n]`, given `out_bar` `[features][n]`.
pub(crate) fn position_gradient(simd: Simd, place: Place<'_>, table: &[f32], out_bar: &[f32], x_bar: &mut [f32]) {
    fn some<const F: usize>(simd: Simd, place: Place<'_>, table: &[f32], out_bar: &[f32], x_bar: &mut [f32])
    where
        Packed: Features<F>,
    {
        simd.run(PositionGradient::<F> { place, table, out_bar: rows(out_bar), x_bar: rows_mut(x_bar) });
    }
    let n = place.x[0].len();
    for (first, size) in groups(place.features) {
        let (place, out_bar) = (Place { first, ..place }, &out_bar[first * n..(first + size) * n]);
        match size {
            1 => some::<1>(simd, place, table, out_bar, x_bar),
            2 => some::<2>(simd, place, table, out_bar, x_bar),
            4 => some::<4>(simd, place, table, out_bar, x_bar),
            6 => some::<6>(simd, place, table, out_bar, x_bar),
            _ => some::<8>(simd, place, table, out_bar, x_bar),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn groups_cover_every_feature_once() {
        for features in 0..40 {
            let mut next = 0;
            for (first, size) in super::groups(features) {
                assert_eq!(first, next);
                next += size;
            }
            assert_eq!(next, features);
        }
    }
}
