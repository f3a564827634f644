//! Sums and products of the planes' features, and their derivatives, in any ring.

use crate::encoding::lattice::cell::{BLOCK, Lanes};

/// Most planes there are: pairs of four axes.
pub(super) const MAX_PLANES: usize = 6;

/// How the planes' features become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// Of all planes.
    Sum,
    /// Of all planes.
    Product,
    /// Each plane times the plane of the other two axes, summed.
    Hex,
}

/// Numbers that can be added and multiplied, sixteen at a time.
pub(super) trait Ring: Copy {
    fn constant(x: f32) -> Self;
    fn add(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
}

impl Ring for Lanes {
    #[inline(always)]
    fn constant(x: f32) -> Self {
        [x; BLOCK]
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        core::array::from_fn(|i| self[i] + other[i])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        core::array::from_fn(|i| self[i] * other[i])
    }
}

/// A number and its derivative along a direction.
#[derive(Clone, Copy)]
pub(super) struct Dual {
    pub(super) value: Lanes,
    pub(super) dot: Lanes,
}

impl Ring for Dual {
    #[inline(always)]
    fn constant(x: f32) -> Self {
        Self { value: Lanes::constant(x), dot: Lanes::constant(0.0) }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { value: self.value.add(other.value), dot: self.dot.add(other.dot) }
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self {
            value: self.value.mul(other.value),
            dot: Ring::add(self.dot.mul(other.value), self.value.mul(other.dot)),
        }
    }
}

impl Rule {
    /// The features of the planes as one.
    #[inline(always)]
    pub(super) fn combine<T: Ring>(self, v: &[T]) -> T {
        match self {
            Self::Sum => v[1..].iter().fold(v[0], |sum, &v| sum.add(v)),
            Self::Product => v[1..].iter().fold(v[0], |product, &v| product.mul(v)),
            Self::Hex => v[0].mul(v[5]).add(v[1].mul(v[4])).add(v[2].mul(v[3])),
        }
    }

    /// Derivative of [`combine`](Self::combine) with respect to each plane. No division: features may be 0.
    #[inline(always)]
    pub(super) fn partials<T: Ring>(self, v: &[T]) -> [T; MAX_PLANES] {
        let mut d = [T::constant(1.0); MAX_PLANES];
        match self {
            Self::Sum => {}
            Self::Product => {
                for p in 1..v.len() {
                    d[p] = d[p - 1].mul(v[p - 1]);
                }
                let mut after = v[v.len() - 1];
                for p in (0..v.len() - 1).rev() {
                    d[p] = d[p].mul(after);
                    after = after.mul(v[p]);
                }
            }
            // Pairs are numbered so that the first and the last, the second and the last but one, ... share no axis.
            Self::Hex => {
                for (d, v) in d.iter_mut().zip(v.iter().rev()) {
                    *d = *v;
                }
            }
        }
        d
    }
}
