//! Sun and sky.

use crate::random::random;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Light on the square, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit direction to the sun.
    pub to_sun: DVec3,
    /// Radiance of a white matt surface that faces the sun, by the sun alone.
    pub sun: DVec3,
    /// Radiance of the sky, and of a white matt surface by the sky alone: the same on all sides.
    pub sky: DVec3,
}

impl Light {
    /// A clear day: what held-out views are lit by.
    #[must_use]
    pub fn neutral() -> Self {
        Self::of(0.6, 0.9, 0.15)
    }

    /// The light of photo `i`: the sun up to 60 degrees to either side of the neutral one, 25 to 70 degrees high, behind
    /// more or less cloud.
    pub(super) fn drawn(i: usize, seed: u64) -> Self {
        let draw = |k: u64| random(seed, 30_000 + 8 * i as u64 + k);
        Self::of(0.6 + (2.0 * draw(0) - 1.0) * PI / 3.0, 0.44 + 0.78 * draw(1), 0.9 * draw(2))
    }

    /// Azimuth and elevation in radians; cloud 0 to 1 dims the sun and fills the sky.
    fn of(azimuth: f64, elevation: f64, cloud: f64) -> Self {
        let to_sun = (DVec2::from_angle(azimuth) * elevation.cos()).extend(elevation.sin());
        // Low suns are red, high ones white; their skies the other way round.
        let high = (elevation / 1.2).clamp(0.0, 1.0);
        let sun = DVec3::new(0.95, 0.62, 0.38).lerp(DVec3::new(0.90, 0.88, 0.84), high) * (1.0 - 0.85 * cloud);
        let blue = DVec3::new(0.24, 0.34, 0.52).lerp(DVec3::new(0.26, 0.36, 0.50), high);
        Self { to_sun, sun, sky: blue.lerp(DVec3::new(0.55, 0.56, 0.58), cloud) }
    }

    /// What falls on a surface: the factor of its albedo.
    #[must_use]
    pub fn on(&self, normal: DVec3, sunlit: bool) -> DVec3 {
        let facing = if sunlit { normal.dot(self.to_sun).max(0.0) } else { 0.0 };
        self.sky + self.sun * facing
    }
}
