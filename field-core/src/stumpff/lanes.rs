//! Stumpff functions over whole rows: series in lanes, closed form for the few large angles.

use super::{coefficient_ratio, first_coefficient, series_bound, stumpff_derivative};
use float_core::{MAX_LANES, Vector};

/// Terms of the series: the first left out is below 1e-9 of the first for `k <= 9`.
const TERMS: usize = 13;

/// One derivative of one Stumpff function.
#[derive(Clone, Copy)]
pub(crate) struct Lanes {
    k: u32,
    order: u32,
    coefficients: [f32; TERMS],
    bound: f32,
}

impl Lanes {
    pub(crate) fn new(k: u32, order: u32) -> Self {
        let mut c = first_coefficient(k, order);
        let coefficients = core::array::from_fn(|j| {
            let this = c as f32;
            c *= coefficient_ratio(k, order, j as u32);
            this
        });
        Self { k, order, coefficients, bound: series_bound(k) }
    }

    /// `y = f(u)`.
    #[inline(always)]
    pub(crate) fn map<V: Vector>(&self, u: &[f32], y: &mut [f32]) {
        for (u, y) in u.chunks(V::LANES).zip(y.chunks_mut(V::LANES)) {
            y.copy_from_slice(&self.lanes::<V>(u)[..u.len()]);
        }
    }

    /// `out += f(u) * g`.
    #[inline(always)]
    pub(crate) fn fold<V: Vector>(&self, u: &[f32], g: &[f32], out: &mut [f32]) {
        for ((u, g), out) in u.chunks(V::LANES).zip(g.chunks(V::LANES)).zip(out.chunks_mut(V::LANES)) {
            let f = self.lanes::<V>(u);
            for ((out, &g), &f) in out.iter_mut().zip(g).zip(&f) {
                *out += f * g;
            }
        }
    }

    /// Up to one vector of values. A value depends on its argument alone, not on its neighbours.
    #[inline(always)]
    pub(crate) fn lanes<V: Vector>(&self, u: &[f32]) -> [f32; MAX_LANES] {
        let mut y = [0.0; MAX_LANES];
        let x = V::load_part(u);
        let mut sum = V::splat(self.coefficients[TERMS - 1]);
        for &c in self.coefficients[..TERMS - 1].iter().rev() {
            sum = sum.mul_add(x, V::splat(c));
        }
        sum.store(&mut y);
        if u.iter().any(|u| u.abs() > self.bound) {
            self.large(u, &mut y);
        }
        y
    }

    #[cold]
    #[inline(never)]
    fn large(&self, u: &[f32], y: &mut [f32]) {
        for (&u, y) in u.iter().zip(y) {
            if u.abs() > self.bound {
                *y = stumpff_derivative(self.k, self.order, f64::from(u)) as f32;
            }
        }
    }
}
