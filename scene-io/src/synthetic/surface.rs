//! What surfaces look like: paint, matt reflection, a small highlight.

use glam::DVec3;

/// Colour of a surface point, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// Alternating cubes of two colours in the shape's axes.
    Checker {
        /// The two colours.
        colours: [DVec3; 2],
        /// Edge length.
        size: f64,
    },
    /// A smooth wave between two colours.
    Wave {
        /// The two colours.
        colours: [DVec3; 2],
        /// Direction and angular frequency, radians per unit, in the shape's axes.
        k: DVec3,
    },
}

impl Paint {
    /// Linear RGB at a point in the shape's axes.
    #[must_use]
    pub fn at(&self, p: DVec3) -> DVec3 {
        match *self {
            Self::Checker { colours, size } => {
                // A hair off the lattice, so that flat faces on it do not flicker with rounding.
                let cell = ((p + DVec3::splat(1e-6)) / size).floor();
                let parity = (cell.x + cell.y + cell.z).rem_euclid(2.0);
                colours[usize::from(parity >= 0.5)]
            }
            Self::Wave { colours, k } => colours[0].lerp(colours[1], 0.5 + 0.5 * p.dot(k).sin()),
        }
    }
}

/// Paint and gloss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Colour.
    pub paint: Paint,
    /// Height of the highlight, linear; 0 is matt.
    pub gloss: f64,
}

/// Direction to the sun.
pub(super) const TO_SUN: DVec3 = DVec3::new(0.405_616_101_250_715_07, 0.304_212_075_938_036_3, 0.861_934_215_157_769_5);
const SUN: DVec3 = DVec3::new(0.95, 0.90, 0.80);
const SKY: DVec3 = DVec3::new(0.22, 0.25, 0.30);
const GROUND: DVec3 = DVec3::new(0.10, 0.09, 0.08);
/// Sharpness of the highlight: about 12 degrees wide, which low-degree spherical harmonics can follow roughly.
const SHININESS: i32 = 30;

impl Surface {
    /// Linear RGB of a point with a normal seen along `d`, lit by the sun where it is not in `shadow`.
    pub(super) fn shade(&self, albedo: DVec3, n: DVec3, d: DVec3, shadow: bool) -> DVec3 {
        let ambient = GROUND.lerp(SKY, 0.5 + 0.5 * n.z);
        if shadow {
            return albedo * ambient;
        }
        let lambert = n.dot(TO_SUN).max(0.0);
        let mirrored = d - n * (2.0 * n.dot(d));
        let highlight = if lambert > 0.0 { self.gloss * mirrored.dot(TO_SUN).max(0.0).powi(SHININESS) } else { 0.0 };
        albedo * (ambient + SUN * lambert) + SUN * highlight
    }
}

/// Linear RGB to display-referred sRGB in `[0, 1]` (IEC 61966-2-1).
pub(super) fn to_srgb(linear: DVec3) -> DVec3 {
    let encode = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
    };
    DVec3::new(encode(linear.x), encode(linear.y), encode(linear.z))
}

/// A value of `[0, 1]` as a byte, to the nearest; what lies outside ends at 0 and 255.
pub(super) fn to_byte(x: f64) -> u8 {
    (x * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE_GREY: [DVec3; 2] = [DVec3::ONE, DVec3::splat(0.5)];

    #[test]
    fn checkers_alternate_along_every_axis() {
        let paint = Paint::Checker { colours: WHITE_GREY, size: 0.5 };
        let start = DVec3::new(0.1, -0.9, 0.3);
        for axis in DVec3::AXES {
            for i in -5..5 {
                let (a, b) =
                    (paint.at(start + axis * (0.5 * f64::from(i))), paint.at(start + axis * (0.5 * f64::from(i + 1))));
                assert_ne!(a, b);
            }
        }
    }

    #[test]
    fn waves_stay_between_their_colours() {
        let paint = Paint::Wave { colours: WHITE_GREY, k: DVec3::new(3.0, 1.0, 0.0) };
        let values: Vec<f64> = (0..100).map(|i| paint.at(DVec3::splat(0.1 * f64::from(i))).x).collect();
        assert!(values.iter().all(|v| (0.5..=1.0).contains(v)));
        assert!(values.iter().any(|v| *v < 0.55) && values.iter().any(|v| *v > 0.95));
    }

    #[test]
    fn the_sun_direction_is_unit_and_the_highlight_is_view_dependent() {
        assert!((TO_SUN.length() - 1.0).abs() < 1e-15);
        let glossy = Surface { paint: Paint::Wave { colours: WHITE_GREY, k: DVec3::X }, gloss: 0.2 };
        let n = DVec3::Z;
        let towards_mirror = TO_SUN * DVec3::new(1.0, 1.0, -1.0);
        let bright = glossy.shade(WHITE_GREY[1], n, towards_mirror, false);
        let plain = glossy.shade(WHITE_GREY[1], n, -DVec3::X, false);
        assert!(((bright - plain).x - 0.2 * SUN.x).abs() < 1e-9, "{bright} {plain}");
        assert_eq!(
            glossy.shade(WHITE_GREY[1], n, towards_mirror, true),
            glossy.shade(WHITE_GREY[1], n, -DVec3::X, true)
        );
        let matt = Surface { gloss: 0.0, ..glossy };
        assert_eq!(matt.shade(WHITE_GREY[1], n, towards_mirror, false), matt.shade(WHITE_GREY[1], n, -DVec3::X, false));
    }

    #[test]
    fn srgb_matches_its_definition_at_known_points() {
        let dark = to_srgb(DVec3::new(-1.0, 0.0, 0.001));
        assert!((dark - DVec3::new(0.0, 0.0, 0.01292)).length() < 1e-15, "{dark}");
        let mid = to_srgb(DVec3::new(0.214_041_14, 1.0, 7.0));
        assert!((mid - DVec3::new(0.5, 1.0, 1.0)).length() < 1e-7, "{mid}");
    }
}
