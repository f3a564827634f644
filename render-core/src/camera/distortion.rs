//! The polynomial lens map on a plane, its Jacobian and its inverse.
//!
//! Letters: `(x, y)` ideal plane coordinates, `r2 = x^2 + y^2`, `(x_d, y_d)` distorted ones. On a perspective lens the
//! plane is the tangent plane `(X / Z, Y / Z)`; on a fisheye it is the equidistant one, where the radius is the angle
//! to the optical axis.

use float_core::m64;
use glam::{DMat2, DVec2};

use super::polynomial::{Coefficients, first_sign_change};

/// Newton steps before an inversion gives up.
const MAX_STEPS: usize = 20;
/// Residual, relative to `max(1, |target|)`, of an inversion that counts as converged.
const CONVERGED: f64 = 1e-12;
/// Smallest determinant of the lens map that is still inverted.
const MIN_DET: f64 = 1e-9;

/// `(x, y) g(r2)` plus tangential and thin-prism terms, `g = (1 + num . r2^i) / (1 + den . r2^i)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Distortion {
    pub(super) num: [f64; 4],
    pub(super) den: [f64; 3],
    pub(super) p: [f64; 2],
    pub(super) s: [f64; 2],
}

impl Distortion {
    /// True when the map is the identity.
    pub(super) fn is_identity(&self) -> bool {
        let zero = |c: &[f64]| c.iter().all(|&c| c == 0.0);
        zero(&self.num) && zero(&self.den) && self.is_radial()
    }

    /// True without tangential and prism terms.
    pub(super) fn is_radial(&self) -> bool {
        self.p == [0.0; 2] && self.s == [0.0; 2]
    }

    /// Numerator, denominator and their derivatives with respect to `r2`.
    fn fraction(&self, r2: f64) -> [f64; 4] {
        let ([a, b, c, d], [e, f, g]) = (self.num, self.den);
        [
            1.0 + r2 * (a + r2 * (b + r2 * (c + r2 * d))),
            1.0 + r2 * (e + r2 * (f + r2 * g)),
            a + r2 * (2.0 * b + r2 * (3.0 * c + r2 * 4.0 * d)),
            e + r2 * (2.0 * f + r2 * 3.0 * g),
        ]
    }

    /// Radial factor `g` and `dg / dr2`.
    pub(super) fn radial(&self, r2: f64) -> (f64, f64) {
        let [n, d, dn, dd] = self.fraction(r2);
        let g = n / d;
        (g, (dn - g * dd) / d)
    }

    /// Distorted coordinates.
    pub(super) fn apply(&self, q: DVec2) -> DVec2 {
        let (r2, [p1, p2], [s1, s2]) = (q.length_squared(), self.p, self.s);
        let (g, _) = self.radial(r2);
        let xy2 = 2.0 * q.x * q.y;
        DVec2::new(
            q.x * g + p1 * xy2 + p2 * (r2 + 2.0 * q.x * q.x) + s1 * r2,
            q.y * g + p2 * xy2 + p1 * (r2 + 2.0 * q.y * q.y) + s2 * r2,
        )
    }

    /// `d(x_d, y_d) / d(x, y)`.
    pub(super) fn jacobian(&self, q: DVec2) -> DMat2 {
        let ([p1, p2], [s1, s2]) = (self.p, self.s);
        let (g, dg) = self.radial(q.length_squared());
        let (x, y) = (q.x, q.y);
        let cross = 2.0 * x * y * dg;
        DMat2::from_cols(
            DVec2::new(
                g + 2.0 * x * x * dg + 2.0 * p1 * y + 6.0 * p2 * x + 2.0 * s1 * x,
                cross + 2.0 * p2 * y + 2.0 * p1 * x + 2.0 * s2 * x,
            ),
            DVec2::new(
                cross + 2.0 * p1 * x + 2.0 * p2 * y + 2.0 * s1 * y,
                g + 2.0 * y * y * dg + 2.0 * p2 * x + 6.0 * p1 * y + 2.0 * s2 * y,
            ),
        )
    }

    /// Adds `(x_d, y_d)_bar . d(x_d, y_d) / d(coefficient)` for each coefficient.
    pub(super) fn parameters_backward(&self, q: DVec2, d_bar: DVec2, bar: &mut Self) {
        let r2 = q.length_squared();
        let [n, d, ..] = self.fraction(r2);
        let radial_bar = q.dot(d_bar);
        let mut power = 1.0;
        for (i, num_bar) in bar.num.iter_mut().enumerate() {
            power *= r2;
            *num_bar += radial_bar * power / d;
            if let Some(den_bar) = bar.den.get_mut(i) {
                *den_bar -= radial_bar * power * n / (d * d);
            }
        }
        let xy2 = 2.0 * q.x * q.y;
        bar.p[0] += d_bar.x * xy2 + d_bar.y * (r2 + 2.0 * q.y * q.y);
        bar.p[1] += d_bar.x * (r2 + 2.0 * q.x * q.x) + d_bar.y * xy2;
        bar.s[0] += d_bar.x * r2;
        bar.s[1] += d_bar.y * r2;
    }

    /// Radius, at most `limit`, of a disc on which the map is one to one.
    ///
    /// Past the fold of a lens several points of the scene meet in one pixel. For a radial map this is where `r g(r2)`
    /// stops growing, or has a pole. Tangential and prism terms change the smallest stretch of the map at radius `r`
    /// by at most `skew r`, `skew = 6 |p| + 2 |s|`; a map whose symmetrised Jacobian is positive on a disc is one to
    /// one there. So `skew r` is taken off: a little inside of the true fold, and the same in all directions.
    pub(super) fn fold_radius(&self, limit: f64) -> f64 {
        let n = [1.0, self.num[0], self.num[1], self.num[2], self.num[3]];
        let d = [1.0, self.den[0], self.den[1], self.den[2]];
        let skew = 6.0 * m64::hypot(self.p[0], self.p[1]) + 2.0 * m64::hypot(self.s[0], self.s[1]);
        // As polynomials in u = r^2 without skew, else in r.
        let (stride, limit) = if skew == 0.0 { (1, limit * limit) } else { (2, limit) };
        let (mut along, mut across, mut pole): (Coefficients, Coefficients, Coefficients) = Default::default();
        for (j, d_j) in d.iter().enumerate() {
            pole[stride * j] = *d_j;
            // Stretch along the radius, times D^2: (N + 2 u N') D - 2 u N D' - skew r D^2.
            for (i, n_i) in n.iter().enumerate() {
                along[stride * (i + j)] += (1.0 + 2.0 * i as f64 - 2.0 * j as f64) * n_i * d_j;
            }
            if skew > 0.0 {
                for (i, d_i) in d.iter().enumerate() {
                    along[2 * (i + j) + 1] -= skew * d_i * d_j;
                }
                // Across it, times D: N - skew r D.
                across[2 * j + 1] -= skew * d_j;
            }
        }
        for (i, n_i) in n.iter().enumerate() {
            across[stride * i] += n_i;
        }
        let first = [along, across, pole].iter().fold(limit, |first, c| first_sign_change(c, first));
        if skew == 0.0 { m64::sqrt(first) } else { first }
    }

    /// The point within `r_max` that the map sends to `target`, `None` where there is none.
    ///
    /// Newton with step halving, first from the target itself, then (strong distortion) from the inverse of the radial
    /// part alone.
    pub(super) fn invert(&self, target: DVec2, r_max: f64) -> Option<DVec2> {
        if !target.is_finite() {
            return None;
        }
        if self.is_identity() {
            return (target.length() <= r_max).then_some(target);
        }
        let near = if target.length() <= r_max { self.newton(target, target, r_max) } else { None };
        near.or_else(|| self.newton(target, self.invert_radial(target, r_max), r_max))
    }

    fn newton(&self, target: DVec2, start: DVec2, r_max: f64) -> Option<DVec2> {
        let norm = |f: DVec2| f.abs().max_element();
        let scale = norm(target).max(1.0);
        let converged = |f: DVec2| norm(f) <= CONVERGED * scale;
        let mut q = start;
        let mut f = self.apply(q) - target;
        for _ in 0..MAX_STEPS {
            let jacobian = self.jacobian(q);
            // A negative determinant lies beyond a fold, where the picture is mirrored.
            let sound = jacobian.determinant() > MIN_DET; // false for NaN, too
            if !sound {
                return None;
            }
            // Quadratic: one more step reaches rounding, but near a fold, where it may take two.
            let close = norm(f) < 1e-7 * scale;
            let mut step = jacobian.inverse() * f;
            let mut better = None;
            for _ in 0..12 {
                let next = q - step;
                let f_next = self.apply(next) - target;
                if next.length() <= r_max && norm(f_next) < norm(f) {
                    better = Some((next, f_next));
                    break;
                }
                if converged(f) {
                    break; // rounding: there is nothing left to gain
                }
                step *= 0.5;
            }
            match better {
                Some((next, f_next)) => (q, f) = (next, f_next),
                None => break,
            }
            if close && converged(f) {
                break;
            }
        }
        (converged(f) && self.jacobian(q).determinant() > MIN_DET).then_some(q)
    }

    /// Inverse of the radial part by bisection; targets past the fold give a point just inside of it.
    fn invert_radial(&self, target: DVec2, r_max: f64) -> DVec2 {
        let r_d = target.length();
        if r_d == 0.0 {
            return DVec2::ZERO;
        }
        let (mut lo, mut hi) = (0.0, r_max);
        for _ in 0..100 {
            let mid = 0.5 * (lo + hi);
            if mid * self.radial(mid * mid).0 < r_d { lo = mid } else { hi = mid }
        }
        target * (lo.min(0.999 * r_max) / r_d)
    }
}
