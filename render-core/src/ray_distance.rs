//! Normalised distance along a ray: `s` in `[0, 1]` between near and far, evenly spaced in a function of the distance.
//!
//! `s(t) = (g(t) - g(near)) / (g(far) - g(near))`. Intervals are placed, resampled and regularised in `s`; densities use the
//! metric lengths. The map and its inverse work in `f64` and are rounded once: near `s = 1` an `f32` of `s` resolves inverse
//! distances of `6e-8 / near`, so distances far beyond `1e6 near` are noise whatever the map does.
//!
//! ```
//! use render_core::ray_distance::{RayDistance, RaySpacing};
//!
//! let map = RayDistance::new(RaySpacing::Reciprocal, 0.2, 1e6)?;
//! assert_eq!((map.s_of(0.2), map.s_of(1e6)), (0.0, 1.0));
//! // Half of the samples see the first near plane's length beyond the near plane.
//! assert!((map.t_of(0.5) - 0.4).abs() < 1e-6);
//! # Ok::<(), render_core::ray_distance::RayDistanceError>(())
//! ```

use core::fmt;
use float_core::m64;

/// Function of the distance whose values are evenly spaced along the ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RaySpacing {
    /// The distance, `g(t) = t`.
    Linear,
    /// Its inverse, `g(t) = 1 / t`: pixels of parallax. Needs `near > 0`; `far` may be infinite.
    #[default]
    Reciprocal,
    /// Its logarithm. Needs `near > 0`.
    Log,
    /// Half linear up to 1, half inverse beyond: `g(t) = t / 2` below 1, `1 - 1 / (2 t)` from there on. Takes `near = 0`
    /// and an infinite `far`.
    Piecewise,
}

/// Near and far that a map cannot take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayDistanceError {
    /// The map.
    pub spacing: RaySpacing,
    /// What was given.
    pub near: f64,
    /// What was given.
    pub far: f64,
}

impl fmt::Display for RayDistanceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { spacing, near, far } = self;
        write!(f, "no {spacing:?} distance between {near} and {far}: expected ")?;
        match spacing {
            RaySpacing::Linear => write!(f, "0 <= near < far, finite"),
            RaySpacing::Reciprocal => write!(f, "0 < near < far"),
            RaySpacing::Log => write!(f, "0 < near < far, finite"),
            RaySpacing::Piecewise => write!(f, "0 <= near < far"),
        }
    }
}

impl core::error::Error for RayDistanceError {}

/// The map between distance and normalised distance of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayDistance {
    spacing: RaySpacing,
    near: f64,
    far: f64,
    /// `g` of them; not used where differences of `g` would cancel.
    g: [f64; 2],
}

/// `g` of [`RaySpacing::Piecewise`].
#[inline(always)]
fn piecewise(t: f64) -> f64 {
    if t < 1.0 { 0.5 * t } else { 1.0 - 0.5 / t }
}

impl RayDistance {
    /// The map between `near` and `far`, in the unit of the distances.
    ///
    /// # Errors
    /// [`RayDistanceError`] unless `0 <= near < far`, and `near > 0` or `far` finite where the map needs it.
    pub fn new(spacing: RaySpacing, near: f64, far: f64) -> Result<Self, RayDistanceError> {
        let starts = if matches!(spacing, RaySpacing::Reciprocal | RaySpacing::Log) { near > 0.0 } else { near >= 0.0 };
        let ends = far.is_finite()
            || (matches!(spacing, RaySpacing::Reciprocal | RaySpacing::Piecewise) && far == f64::INFINITY);
        if !(starts && ends && near < far && near.is_finite()) {
            return Err(RayDistanceError { spacing, near, far });
        }
        // From 1 on it is the inverse distance, which does not take differences of numbers that are nearly 1.
        let spacing = if spacing == RaySpacing::Piecewise && near >= 1.0 { RaySpacing::Reciprocal } else { spacing };
        let g = match spacing {
            RaySpacing::Linear => [near, far],
            RaySpacing::Reciprocal => [1.0 / near, 1.0 / far],
            RaySpacing::Log => [m64::ln(near), m64::ln(far)],
            RaySpacing::Piecewise => [piecewise(near), piecewise(far)],
        };
        Ok(Self { spacing, near, far, g })
    }

    /// Where `s` is 0.
    #[must_use]
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Where `s` is 1.
    #[must_use]
    pub fn far(&self) -> f64 {
        self.far
    }

    /// The normalised distance at `t`; distances outside of near and far count as these. Non-decreasing.
    #[inline(always)]
    #[must_use]
    pub fn s_of(&self, t: f64) -> f64 {
        if t <= self.near {
            return 0.0;
        }
        if t >= self.far {
            return 1.0;
        }
        let [a, b] = self.g;
        let s = match self.spacing {
            RaySpacing::Linear => (t - a) / (b - a),
            // (1/near - 1/t) / (1/near - 1/far) without the difference of nearly equal inverses.
            RaySpacing::Reciprocal => (t - self.near) / t / (1.0 - self.near / self.far),
            RaySpacing::Log => m64::ln(t / self.near) / (b - a),
            RaySpacing::Piecewise => (piecewise(t) - a) / (b - a),
        };
        s.clamp(0.0, 1.0)
    }

    /// The distance at normalised distance `s`, clamped to `[0, 1]`; both ends are met exactly. Non-decreasing.
    #[inline(always)]
    #[must_use]
    pub fn t_of(&self, s: f64) -> f64 {
        if s <= 0.0 {
            return self.near;
        }
        if s >= 1.0 {
            return self.far;
        }
        let [a, b] = self.g;
        let g = (1.0 - s) * a + s * b;
        let t = match self.spacing {
            RaySpacing::Linear => g,
            RaySpacing::Reciprocal => 1.0 / g,
            RaySpacing::Log => self.near * m64::exp(s * (b - a)),
            RaySpacing::Piecewise if g < 0.5 => 2.0 * g,
            RaySpacing::Piecewise => 0.5 / (1.0 - g),
        };
        t.clamp(self.near, self.far)
    }

    /// [`s_of`](Self::s_of) of many: `s` `[n]` out.
    ///
    /// # Panics
    /// When the lengths differ.
    pub fn normalise(&self, t: &[f32], s: &mut [f32]) {
        assert_eq!(t.len(), s.len(), "one normalised distance a distance");
        for (s, &t) in s.iter_mut().zip(t) {
            *s = self.s_of(t.into()) as f32;
        }
    }

    /// [`t_of`](Self::t_of) of many: `t` `[n]` out, at most the largest `f32`.
    ///
    /// # Panics
    /// When the lengths differ.
    pub fn distances(&self, s: &[f32], t: &mut [f32]) {
        assert_eq!(t.len(), s.len(), "one distance a normalised distance");
        for (t, &s) in t.iter_mut().zip(s) {
            *t = self.t_of(s.into()).min(f32::MAX.into()) as f32;
        }
    }
}
