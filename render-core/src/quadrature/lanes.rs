//! Vectors at the end of a ray, where fewer samples are left than there are lanes.

use float_core::Vector;

/// The first values of `x`, with zeros where it is shorter than a vector: the last vector of a ray.
#[inline(always)]
pub(super) fn load_part<V: Vector>(x: &[f32]) -> V {
    V::load_part(x)
}

/// As much of `v` as `out` has room for.
#[inline(always)]
pub(super) fn store_part<V: Vector>(v: V, out: &mut [f32]) {
    v.store_part(out);
}

/// As [`load_part`] of `x[i..end]`, zeros where there is nothing.
#[inline(always)]
pub(super) fn load_some<V: Vector>(x: Option<&[f32]>, i: usize, end: usize) -> V {
    match x {
        Some(x) => load_part(&x[i..end]),
        None => V::splat(0.0),
    }
}
