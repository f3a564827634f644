//! What things that move are painted with.

use crate::synthetic::surface::to_srgb;
use glam::DVec3;
use std::f64::consts::TAU;

/// Colours of material points: two waves whose crests are bent by a third, over painted light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::synthetic) struct Pattern {
    /// Linear RGB.
    colours: [DVec3; 3],
    /// Angular frequencies, radians per unit.
    k: [DVec3; 3],
}

/// Direction the painted light comes from, in the axes of each form at rest.
const PAINTED_LIGHT: DVec3 = DVec3::new(0.36, 0.48, 0.8);

impl Pattern {
    /// Waves of about `fine` radians per unit between three colours, linear RGB. Numbers of a seed, `jitter` in `[0, 1)`, move
    /// the colours a little, and say where the waves go.
    pub(in crate::synthetic) fn new(colours: [[f64; 3]; 3], fine: f64, jitter: impl Fn(u64) -> f64) -> Self {
        let colour = |c: usize| {
            let moved = |k: usize| (colours[c][k] + 0.1 * (jitter((3 * c + k) as u64) - 0.5)).clamp(0.02, 0.9);
            DVec3::new(moved(0), moved(1), moved(2))
        };
        // Nearly level and nearly upright waves, so that every face shows both.
        let wave = |k: u64, steep: f64, frequency: f64| {
            let angle = TAU * jitter(k);
            DVec3::new(angle.cos(), angle.sin(), steep) * (frequency * (0.9 + 0.2 * jitter(k + 1)))
        };
        Self {
            colours: [colour(0), colour(1), colour(2)],
            k: [wave(10, 0.6, fine), wave(12, -0.9, 0.8 * fine), wave(14, 0.8, 0.45 * fine)],
        }
    }

    /// Display-referred sRGB of a material point with an outward normal at rest: the same at all times, from all sides.
    pub(in crate::synthetic) fn rgb(&self, q: DVec3, rest_normal: DVec3) -> DVec3 {
        let bent = 1.3 * q.dot(self.k[2]).sin();
        // Steeper between crests than a sine: edges for the eye, smooth for derivatives.
        let wave = |phase: f64| {
            let s = 0.5 + 0.5 * phase.sin();
            let s = s * s * (3.0 - 2.0 * s);
            s * s * (3.0 - 2.0 * s)
        };
        let [a, b] = [wave(q.dot(self.k[0]) + bent), wave(q.dot(self.k[1]) - bent)];
        let albedo = self.colours[0].lerp(self.colours[1], a).lerp(self.colours[2], 0.7 * b);
        to_srgb(albedo * (0.45 + 0.55 * (0.5 + 0.5 * rest_normal.dot(PAINTED_LIGHT))))
    }
}
