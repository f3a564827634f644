//! The tissue: a sheet `z = H(x, y, t)` before the camera, in the camera's own axes (CV: x right, y down, z forward), mm.

use crate::random::random;
use crate::synthetic::surface::to_srgb;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Depth of the sheet at rest, mm.
pub(super) const REST: f64 = 80.0;
/// Nothing of the sheet is nearer or farther, mm: sums of the amplitudes below.
pub(super) const RANGE: [f64; 2] = [58.0, 92.0];
/// Where the sheet is pulled, in material coordinates, mm.
const PULLED: DVec2 = DVec2::new(5.0, -2.0);
/// Width of the pull, mm.
const PULL_WIDTH: f64 = 15.0;

/// The sheet of a seed. A material point is `(a, b)`, mm: where it lies across the sheet when nothing is sheared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sheet {
    phase: [f64; 12],
}

/// The sheet at a time. Material points are sheared along x by a function of `b`, then along y by a function of the new `x`:
///
/// ```text
/// x = a + f(b),  y = b + g(x)      and back:  b = y - g(x),  a = x - f(b)
/// z = rest - relief(a, b) - breath(a, t) - pull(a, b, t)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SheetSnapshot {
    sheet: Sheet,
    shear: [f64; 2],
    breath: f64,
    pull: f64,
}

impl Sheet {
    pub(super) fn new(seed: u64) -> Self {
        Self { phase: core::array::from_fn(|i| TAU * random(seed, 70_000 + i as u64)) }
    }

    pub(super) fn at(&self, time: f64) -> SheetSnapshot {
        let p = &self.phase;
        // Two breaths over the sequence, and a pull and a half.
        let pull = (1.5 * TAU * 0.5 * time + 0.5).sin();
        SheetSnapshot {
            sheet: *self,
            shear: [TAU * 1.7 * time + p[0], TAU * 1.1 * time + p[1]],
            breath: 3.0 * (TAU * 2.0 * time + p[2]).sin(),
            pull: pull * pull,
        }
    }

    /// Height over the sheet's rest, mm.
    fn relief(&self, a: f64, b: f64) -> f64 {
        let p = &self.phase;
        4.0 * (0.075 * a + 0.045 * b + p[3]).sin()
            + 3.0 * (0.09 * b - 0.05 * a + p[4]).sin()
            + 0.8 * (0.19 * a + 0.12 * b + p[5]).sin()
    }

    /// Display-referred sRGB of a material point: flesh, dark vessels, pale spots.
    pub(super) fn rgb(&self, q: DVec2) -> DVec3 {
        let (p, DVec2 { x: a, y: b }) = (&self.phase, q);
        let vessel = |along: f64, width: f64| {
            let s = along.sin() / width;
            (-s * s).exp()
        };
        let thick = vessel(0.105 * a + 0.035 * b + 1.1 * (0.085 * b + p[6]).sin() + p[7], 0.20);
        let thin = vessel(0.16 * b - 0.09 * a + 1.4 * (0.13 * a + p[8]).sin() + p[9], 0.22);
        // Crests bent by slower waves: no two spots are alike.
        let bend = 1.8 * (0.17 * b + 0.06 * a + p[3]).sin() + 1.5 * (0.11 * a - 0.07 * b + p[4]).sin();
        let spots = (0.50 * a + 0.21 * b + p[10] + bend).sin() * (0.45 * b - 0.26 * a + p[11] - 1.3 * bend).sin();
        let flesh = DVec3::new(0.62, 0.22, 0.17).lerp(DVec3::new(0.80, 0.52, 0.40), 0.5 + 0.5 * spots);
        let albedo =
            flesh.lerp(DVec3::new(0.30, 0.03, 0.05), 0.85 * thick).lerp(DVec3::new(0.20, 0.08, 0.22), 0.6 * thin);
        // Light painted on: what stands out at rest is brighter.
        to_srgb(albedo * (0.78 + 0.028 * self.relief(a, b)))
    }
}

impl SheetSnapshot {
    fn f(&self, b: f64) -> f64 {
        let s = (b - PULLED.y) / PULL_WIDTH;
        3.0 * (0.09 * b + self.shear[0]).sin() + 4.0 * self.pull * (-0.5 * s * s).exp()
    }

    fn g(&self, x: f64) -> f64 {
        2.5 * (0.08 * x + self.shear[1]).sin()
    }

    /// The material point above a place of the camera's xy plane.
    pub(super) fn material(&self, x: DVec2) -> DVec2 {
        let b = x.y - self.g(x.x);
        DVec2::new(x.x - self.f(b), b)
    }

    /// Where a material point is.
    pub(super) fn place(&self, q: DVec2) -> DVec3 {
        let x = q.x + self.f(q.y);
        DVec3::new(x, q.y + self.g(x), self.height(q))
    }

    fn height(&self, q: DVec2) -> f64 {
        let breath = self.breath * (0.7 + 0.3 * (0.04 * q.x + self.sheet.phase[2]).sin());
        let pull = 9.0 * self.pull * (-0.5 * (q - PULLED).length_squared() / (PULL_WIDTH * PULL_WIDTH)).exp();
        REST - self.sheet.relief(q.x, q.y) - breath - pull
    }

    /// Depth `z` where the line `(slope.x z, slope.y z, z)` through the camera meets the sheet.
    ///
    /// Heights change by less than the line does (a test bounds the slopes), so there is one root, and the secant's error
    /// falls in every step; a bracket holds it in any case.
    pub(super) fn meet(&self, slope: DVec2) -> f64 {
        let beyond = |z: f64| z - self.height(self.material(slope * z));
        let ([mut low, mut high], mut before) = (RANGE, (REST, beyond(REST)));
        let mut z = (before.0 - before.1).clamp(low, high);
        for _ in 0..60 {
            let y = beyond(z);
            if y.abs() < 1e-12 {
                break;
            }
            if y > 0.0 {
                high = z;
            } else {
                low = z;
            }
            let secant = z - y * (z - before.0) / (y - before.1);
            before = (z, y);
            let next = if secant > low && secant < high { secant } else { 0.5 * (low + high) };
            if next == z {
                break;
            }
            z = next;
        }
        z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> impl Iterator<Item = (SheetSnapshot, DVec2)> {
        let moments = (0..4_u64).flat_map(|seed| (0..11).map(move |i| Sheet::new(seed).at(f64::from(i) * 0.1)));
        let places = || (-24..=24).flat_map(|i| (-18..=18).map(move |j| DVec2::new(f64::from(i), f64::from(j)) * 2.5));
        moments.flat_map(move |m| places().map(move |x| (m, x)))
    }

    #[test]
    fn material_points_and_places_belong_to_each_other() {
        for (snapshot, x) in grid() {
            let q = snapshot.material(x);
            assert!((snapshot.place(q).truncate() - x).length() < 1e-12);
        }
    }

    #[test]
    fn every_line_meets_the_sheet_once() {
        // The corner of the picture is 0.703 from its middle: steeper slopes than 1 / 0.703 = 1.42 could be met twice.
        let mut steepest = 0.0_f64;
        for (snapshot, x) in grid() {
            let height = |x: DVec2| snapshot.height(snapshot.material(x));
            let h = 1e-5;
            let slope = DVec2::new(
                height(x + DVec2::X * h) - height(x - DVec2::X * h),
                height(x + DVec2::Y * h) - height(x - DVec2::Y * h),
            ) / (2.0 * h);
            steepest = steepest.max(slope.length());
            assert!((RANGE[0]..RANGE[1]).contains(&height(x)), "{}", height(x));
        }
        assert!(steepest < 1.2, "{steepest}");
    }

    #[test]
    fn lines_meet_the_sheet_where_it_is() {
        for (snapshot, x) in grid().step_by(7) {
            let slope = x / 100.0;
            let z = snapshot.meet(slope);
            assert!((z - snapshot.height(snapshot.material(slope * z))).abs() < 1e-10, "{z}");
            let q = snapshot.material(slope * z);
            assert!((snapshot.place(q) - (slope * z).extend(z)).length() < 1e-10);
        }
    }

    #[test]
    fn the_sheet_moves_at_all_times_and_everywhere_without_jumps() {
        let sheet = Sheet::new(1);
        for i in 0..200 {
            let time = f64::from(i) * 5e-3;
            let (a, b, c) = (sheet.at(time), sheet.at(time + 1e-4), sheet.at(time + 2e-4));
            let q = DVec2::new(0.2 * f64::from(i % 50) - 5.0, 3.0);
            let (u, v) = ((b.place(q) - a.place(q)) * 1e4, (c.place(q) - b.place(q)) * 1e4);
            assert!(u.length() > 0.5 && u.length() < 150.0 && (u - v).length() < 0.5, "{u} then {v} mm at {time}");
        }
    }
}
