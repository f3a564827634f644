//! Conical frusta as Gaussians: what a pixel's cone sees between two distances along its ray.
//!
//! A pixel is not a ray but a cone, of radius `r` at distance 1 (see
//! [`Prepared::cone_radius`](crate::camera::Prepared::cone_radius)). The part of it between two distances is approximated by
//! the Gaussian with the mean and the covariance of the uniform density on it: along the ray first ([`Moments`]), then in
//! space, with the diagonal of the covariance ([`Moments::diagonal`]) or all of it ([`Moments::covariance`]).
//! [`Moments::covariance_backward`] goes back to the ray, for distances and radii that stay; these have no gradient.
//!
//! ```
//! use render_core::frustum::Moments;
//!
//! let m = Moments::conical(1.0_f64, 1.5, 0.1);
//! assert!((m.mean_t - 1.28289).abs() < 1e-5 && (m.var_t - 0.019971).abs() < 1e-6);
//! let (mean, var) = m.diagonal([0.0; 3], [0.0, 0.0, 1.0]);
//! assert_eq!((mean[2], var[2], var[0]), (m.mean_t, m.var_t, m.var_r));
//! ```

use crate::real::Real;

/// Shape of what lies between two distances along a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Frustum {
    /// Of a cone with its apex at the ray's origin: perspective cameras.
    #[default]
    Cone,
    /// Of a cylinder: orthographic cameras, and normalised device coordinates, where all pixels of a camera run parallel.
    Cylinder,
}

/// Mean and variances of a frustum's uniform density, in the ray's own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments<T> {
    /// Mean distance along the ray.
    pub mean_t: T,
    /// Variance along the ray.
    pub var_t: T,
    /// Variance across the ray, in each direction.
    pub var_r: T,
}

impl<T: Real> Moments<T> {
    /// Moments of `shape` between `t0` and `t1`; see [`Moments::conical`] and [`Moments::cylindrical`].
    #[inline(always)]
    #[must_use]
    pub fn new(shape: Frustum, t0: T, t1: T, radius: T) -> Self {
        match shape {
            Frustum::Cone => Self::conical(t0, t1, radius),
            Frustum::Cylinder => Self::cylindrical(t0, t1, radius),
        }
    }

    /// The frustum of a cone of radius `radius * t`.
    ///
    /// With `mu = (t0 + t1) / 2`, `h = (t1 - t0) / 2`, `D = 3 mu^2 + h^2`:
    /// `mean_t = mu + 2 mu h^2 / D`, `var_t = h^2 / 3 - (4/15) h^4 (12 mu^2 - h^2) / D^2`,
    /// `var_r = r^2 (mu^2 / 4 + 5 h^2 / 12 - (4/15) h^4 / D)`.
    ///
    /// # Units
    /// `0 <= t0 <= t1` in units of the direction's length; `radius` at distance 1, `>= 0`.
    ///
    /// # Numerics
    /// No difference of powers of the distances, which would cancel for thin frusta. Computed in units of the larger of `mu`
    /// and `h`: nothing but the results overflows, and `t0 = t1 = 0` gives zeros. Relative error in `f32` below 1e-6.
    ///
    /// # Source
    /// Barron et al., "Mip-NeRF", 2021, eq. 7.
    #[inline(always)]
    #[must_use]
    pub fn conical(t0: T, t1: T, radius: T) -> Self {
        let half = T::of(0.5);
        let (mu, h) = (half * (t0 + t1), half * (t1 - t0));
        let unit = mu.abs().max(h.abs());
        if unit == T::ZERO {
            return Self { mean_t: mu, var_t: T::ZERO, var_r: T::ZERO };
        }
        let (a, b) = (mu / unit, h / unit);
        let (a2, b2) = (a * a, b * b);
        let d = T::of(3.0) * a2 + b2;
        // Shares of D: mu^2 / D <= 1/3, h^2 / D <= 1.
        let (p, q) = (a2 / d, b2 / d);
        let k = T::of(4.0 / 15.0);
        let var_t = b2 * (T::of(1.0 / 3.0) - k * q * (T::of(12.0) * p - q));
        let var_r = T::of(0.25) * a2 + b2 * (T::of(5.0 / 12.0) - k * q);
        let across = radius * unit;
        Self { mean_t: mu + T::TWO * mu * q, var_t: var_t * unit * unit, var_r: var_r * across * across }
    }

    /// The part of a cylinder of radius `radius`: `mean_t = (t0 + t1) / 2`, `var_t = (t1 - t0)^2 / 12`, `var_r = r^2 / 4`.
    ///
    /// # Source
    /// Barron et al., "Mip-NeRF", 2021, released code (`cylinder_to_gaussian`).
    #[inline(always)]
    #[must_use]
    pub fn cylindrical(t0: T, t1: T, radius: T) -> Self {
        let length = t1 - t0;
        Self {
            mean_t: T::of(0.5) * (t0 + t1),
            var_t: length * length * T::of(1.0 / 12.0),
            var_r: radius * radius * T::of(0.25),
        }
    }

    /// Mean and diagonal of the covariance in space: `o + mean_t d`, and for each axis
    /// `var_t d_a^2 + var_r (1 - d_a^2 / |d|^2)`.
    ///
    /// `d` need not have unit length; a zero direction gives a ball of variance `var_r`.
    ///
    /// # Source
    /// Barron et al., "Mip-NeRF", 2021, eqs. 8 and 16.
    #[inline(always)]
    #[must_use]
    pub fn diagonal(&self, o: [T; 3], d: [T; 3]) -> ([T; 3], [T; 3]) {
        let along = self.along(d);
        let mean = core::array::from_fn(|a| o[a] + self.mean_t * d[a]);
        (mean, core::array::from_fn(|a| self.entry(along, d[a], d[a], T::ONE).max(T::ZERO)))
    }

    /// Mean and covariance in space: `o + mean_t d` and `var_t d d^T + var_r (I - d d^T / |d|^2)`, the upper triangle
    /// `[xx, xy, xz, yy, yz, zz]`.
    ///
    /// # Source
    /// Barron et al., "Mip-NeRF", 2021, eq. 8.
    #[inline(always)]
    #[must_use]
    pub fn covariance(&self, o: [T; 3], d: [T; 3]) -> ([T; 3], [T; 6]) {
        let along = self.along(d);
        let mean = core::array::from_fn(|a| o[a] + self.mean_t * d[a]);
        let on = |a: usize| self.entry(along, d[a], d[a], T::ONE).max(T::ZERO);
        let off = |a: usize, b: usize| self.entry(along, d[a], d[b], T::ZERO);
        (mean, [on(0), off(0, 1), off(0, 2), on(1), off(1, 2), on(2)])
    }

    /// Gradient of [`Moments::covariance`] for moments that stay: adds to `o_bar` and `d_bar`. `cov_bar` is that of the entries of the
    /// triangle, 0 off the diagonal for [`Moments::diagonal`].
    ///
    /// With `k = var_t - var_r / |d|^2` the covariance is `k d d^T + var_r I`. The cut at 0 is of rounding alone and takes no part; a
    /// zero direction, where the covariance jumps, has the gradient of the mean.
    #[inline(always)]
    pub fn covariance_backward(
        &self,
        d: [T; 3],
        mean_bar: [T; 3],
        cov_bar: [T; 6],
        o_bar: &mut [T; 3],
        d_bar: &mut [T; 3],
    ) {
        let [xx, xy, xz, yy, yz, zz] = cov_bar;
        let along = self.along(d);
        // Of `d d^T` alone.
        let outer = crate::real::mat_vec(&symmetric([xx + xx, xy, xz, yy + yy, yz, zz + zz]), d);
        // `k_bar` times `dk / d(|d|^2)` times 2.
        let length = crate::real::dot(d, outer) * self.var_r * along * along;
        for a in 0..3 {
            o_bar[a] += mean_bar[a];
            d_bar[a] += self.mean_t * mean_bar[a] + (self.var_t - self.var_r * along) * outer[a] + length * d[a];
        }
    }

    /// `1 / |d|^2`, 0 for a zero direction.
    #[inline(always)]
    fn along(&self, d: [T; 3]) -> T {
        let length2 = crate::real::dot(d, d);
        if length2 > T::ZERO { T::ONE / length2 } else { T::ZERO }
    }

    #[inline(always)]
    fn entry(&self, along: T, da: T, db: T, identity: T) -> T {
        self.var_t * (da * db) + self.var_r * (identity - da * db * along)
    }
}

/// The symmetric matrix of an upper triangle `[xx, xy, xz, yy, yz, zz]`.
#[inline(always)]
#[must_use]
pub fn symmetric<T: Copy>([xx, xy, xz, yy, yz, zz]: [T; 6]) -> [[T; 3]; 3] {
    [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
}

/// Gradient of [`symmetric`]: adds to that of the triangle's entries.
#[inline(always)]
pub fn symmetric_backward<T: Real>(m_bar: &[[T; 3]; 3], upper_bar: &mut [T; 6]) {
    let [x, y, z] = m_bar;
    let sums = [x[0], x[1] + y[0], x[2] + z[0], y[1], y[2] + z[1], z[2]];
    for (bar, sum) in upper_bar.iter_mut().zip(sums) {
        *bar += sum;
    }
}
