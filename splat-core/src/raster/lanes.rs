//! Questions to all lanes at once.

use float_core::Vector;

/// Whether no lane is above 0.
#[inline(always)]
pub(super) fn none_positive<V: Vector>(x: V) -> bool {
    // The smallest number above 0.
    x.all_below(V::splat(f32::from_bits(1)))
}

/// Whether every lane is above 0.
#[inline(always)]
pub(super) fn all_positive<V: Vector>(x: V) -> bool {
    (-x).all_below(V::splat(0.0))
}
