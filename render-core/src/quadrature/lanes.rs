//! Vectors at the end of a ray, where fewer samples are left than there are lanes.

use super::MAX_LANES;
use float_core::Vector;

/// The first values of `x`, with zeros where it is shorter than a vector: the last vector of a ray.
#[inline(always)]
pub(super) fn load_part<V: Vector>(x: &[f32]) -> V {
    if x.len() >= V::LANES {
        return V::load(x);
    }
    let mut padded = [0.0; MAX_LANES];
    padded[..x.len()].copy_from_slice(x);
    V::load(&padded)
}

/// As much of `v` as `out` has room for.
#[inline(always)]
pub(super) fn store_part<V: Vector>(v: V, out: &mut [f32]) {
    if out.len() >= V::LANES {
        return v.store(out);
    }
    let mut padded = [0.0; MAX_LANES];
    v.store(&mut padded);
    out.copy_from_slice(&padded[..out.len()]);
}

/// As [`load_part`] of `x[i..end]`, zeros where there is nothing.
#[inline(always)]
pub(super) fn load_some<V: Vector>(x: Option<&[f32]>, i: usize, end: usize) -> V {
    match x {
        Some(x) => load_part(&x[i..end]),
        None => V::splat(0.0),
    }
}
