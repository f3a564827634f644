//! The part of an orbit that a set of cameras covers.

use alloc::vec::Vec;
use core::f64::consts::{PI, TAU};
use float_core::m64;
use glam::DVec3;

use super::Ends;
use crate::{bounds::percentile, pose::Pose};

/// A gap in azimuth between neighbouring cameras that ends the arc, radians; wider where few cameras are spread evenly.
const GAP: f64 = 40.0 * PI / 180.0;
/// Standard deviation of the weights, in azimuth, of the cameras that an azimuth takes its values from, radians.
const WIDTH: f64 = 16.0 * PI / 180.0;
/// Cameras nearer to the axis than this part of their distance have no azimuth.
const OVERHEAD: f64 = 0.15;
/// Cameras this many times farther or nearer than the median are not part of the arc.
const FAR: f64 = 3.0;
/// Arcs shorter than this are not arcs, radians.
const LEAST: f64 = 2.0 * PI / 180.0;
/// What an azimuth has values of: distance from the axis, height, and the direction of view outward, along the circle and up.
const VALUES: usize = 5;

/// An arc about an axis. Distance, height and direction of view follow those of the cameras at each azimuth.
#[derive(Clone, Debug, PartialEq)]
pub struct Arc {
    /// Point on the axis that heights count from.
    pub centre: DVec3,
    /// The axis, unit; up in the pictures.
    pub up: DVec3,
    /// Direction of azimuth 0, unit, at a right angle to `up`.
    pub zero: DVec3,
    /// First azimuth, radians, counter-clockwise seen from above.
    pub from: f64,
    /// Last azimuth, radians, `from..=from + 2 pi`.
    pub to: f64,
    /// [`Ends::Closed`] for a whole turn; open arcs are travelled to and fro.
    pub ends: Ends,
    stations: Vec<Station>,
    mean: [f64; VALUES],
    /// How much of what the cameras near an azimuth differ from the mean is more than chance, `0..=1`.
    trust: [f64; VALUES],
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Station {
    azimuth: f64,
    values: [f64; VALUES],
}

impl Arc {
    /// The arc of a set of cameras about the axis `up` through `centre`: the longest run of them without a wide gap in azimuth.
    ///
    /// `None` with fewer than two cameras that have an azimuth, or where all have the same.
    #[must_use]
    pub fn fit(poses: &[Pose], centre: DVec3, up: DVec3) -> Option<Self> {
        let up = up.try_normalize()?;
        let mut distances: Vec<f64> = poses.iter().map(|p| p.c.distance(centre)).collect();
        distances.sort_unstable_by(f64::total_cmp);
        let typical = percentile(&distances, 0.5).filter(|d| *d > 0.0 && d.is_finite())?;
        let fits = |p: &&Pose| {
            let (d, aside) = (p.c.distance(centre), (p.c - centre).reject_from_normalized(up).length());
            d < FAR * typical && d > typical / FAR && aside > OVERHEAD * d
        };
        let used: Vec<&Pose> = poses.iter().filter(fits).collect();
        let zero = (used.first()?.c - centre).reject_from_normalized(up).normalize();
        let mut stations: Vec<Station> = used.iter().map(|p| Station::new(p, centre, up, zero)).collect();
        stations.sort_by(|a, b| a.azimuth.total_cmp(&b.azimuth));
        let (from, to, ends) = match run(&stations)? {
            Run::Turn => (0.0, TAU, Ends::Closed),
            Run::Part(from, to) => (from, to, Ends::Open),
        };
        if to - from < LEAST {
            return None;
        }
        let inside = |s: &Station| turned(s.azimuth - from) <= to - from + 1e-12;
        stations.retain(inside);
        let n = stations.len() as f64;
        let mean = core::array::from_fn(|k| stations.iter().map(|s| s.values[k]).sum::<f64>() / n);
        let mut arc = Self { centre, up, zero, from, to, ends, stations, mean, trust: [1.0; VALUES] };
        arc.trust = arc.trusted();
        Some(arc)
    }

    /// The part between two azimuths, open.
    #[must_use]
    pub fn part(&self, from: f64, to: f64) -> Self {
        Self { from, to: to.max(from).min(from + TAU), ends: Ends::Open, ..self.clone() }
    }

    /// The camera at an azimuth; `None` where it has no direction to look into.
    #[must_use]
    pub fn pose(&self, azimuth: f64) -> Option<Pose> {
        let near = self.near(azimuth).0;
        let [radius, height, out, along, above] =
            core::array::from_fn(|k| self.mean[k] + self.trust[k] * (near[k] - self.mean[k]));
        let [outward, onward] = directions(self.up, self.zero, azimuth);
        let eye = self.centre + outward * radius + self.up * height;
        Pose::look_at(eye, eye + outward * out + onward * along + self.up * above, self.up)
    }

    /// Azimuth of frame `i` of `n`: evenly once around, or to and fro as a pendulum, from the middle and back to it.
    #[must_use]
    pub fn azimuth(&self, i: usize, n: usize) -> f64 {
        let turn = TAU * i as f64 / n.max(1) as f64;
        match self.ends {
            Ends::Closed => self.from + turn,
            Ends::Open => 0.5 * (self.from + self.to) + 0.5 * (self.to - self.from) * m64::sin(turn),
        }
    }

    /// `n` poses; the one after the last is the first again.
    #[must_use]
    pub fn poses(&self, n: usize) -> Vec<Pose> {
        (0..n).filter_map(|i| self.pose(self.azimuth(i, n))).collect()
    }

    /// Weighted mean and variance of the cameras about an azimuth, and how many of them that are.
    fn near(&self, azimuth: f64) -> ([f64; VALUES], [f64; VALUES], f64) {
        let weight = |s: &Station| {
            let away = turned(s.azimuth - azimuth + PI) - PI;
            m64::exp(-0.5 * (away / WIDTH) * (away / WIDTH)) + 1e-30
        };
        let (mut sum, mut squares) = (0.0, 0.0);
        let (mut mean, mut variance) = ([0.0; VALUES], [0.0; VALUES]);
        for station in &self.stations {
            let w = weight(station);
            sum += w;
            squares += w * w;
            for (mean, value) in mean.iter_mut().zip(station.values) {
                *mean += w * value;
            }
        }
        let mean = mean.map(|m| m / sum);
        for station in &self.stations {
            let w = weight(station) / sum;
            for ((variance, mean), value) in variance.iter_mut().zip(mean).zip(station.values) {
                *variance += w * (value - mean) * (value - mean);
            }
        }
        (mean, variance, sum * sum / squares)
    }

    /// Cameras in a hemisphere have heights that say nothing of the azimuth: the variance that chance explains is taken off.
    fn trusted(&self) -> [f64; VALUES] {
        let n = self.stations.len() as f64;
        let (mut signal, mut noise) = ([0.0; VALUES], [0.0; VALUES]);
        for station in &self.stations {
            let (mean, variance, count) = self.near(station.azimuth);
            for k in 0..VALUES {
                signal[k] += (mean[k] - self.mean[k]) * (mean[k] - self.mean[k]) / n;
                // Of `count` independent cameras.
                noise[k] += variance[k] / (count - 1.0).max(1.0) / n;
            }
        }
        core::array::from_fn(|k| {
            let rest = signal[k] - noise[k];
            if rest > 0.0 { rest / signal[k] } else { 0.0 }
        })
    }
}

impl Station {
    fn new(pose: &Pose, centre: DVec3, up: DVec3, zero: DVec3) -> Self {
        let from = pose.c - centre;
        let side = up.cross(zero);
        let azimuth = turned(m64::atan2(from.dot(side), from.dot(zero)));
        let [outward, onward] = directions(up, zero, azimuth);
        let look = pose.r.z_axis;
        let values = [from.dot(outward), from.dot(up), look.dot(outward), look.dot(onward), look.dot(up)];
        Self { azimuth, values }
    }
}

enum Run {
    /// There is no wide gap.
    Turn,
    /// From one azimuth to another.
    Part(f64, f64),
}

/// The run of cameras with the most of them between two wide gaps.
fn run(stations: &[Station]) -> Option<Run> {
    let n = stations.len();
    if n < 2 {
        return None;
    }
    let widest = GAP.max(1.5 * TAU / n as f64);
    // Cameras at one azimuth are a whole turn from the last to the first.
    let step = |i: usize| {
        let (here, next) = (i % n, (i + 1) % n);
        stations[next].azimuth - stations[here].azimuth + if next == 0 { TAU } else { 0.0 }
    };
    let wide: Vec<usize> = (0..n).filter(|&i| step(i) > widest).collect();
    if wide.is_empty() && n > 2 {
        return Some(Run::Turn);
    }
    // Two cameras have two gaps; the wider one is outside.
    let wide = if wide.is_empty() { [if step(0) > step(1) { 0 } else { 1 }].to_vec() } else { wide };
    let runs = (0..wide.len()).map(|k| {
        let (first, next) = (wide[k] + 1, wide[(k + 1) % wide.len()]);
        let count = (next + n - first % n) % n;
        let from = stations[first % n].azimuth;
        let length: f64 = (0..count).map(|i| step(first + i)).sum();
        (count, from, from + length)
    });
    let best = runs.fold((0, 0.0, 0.0), |best, run| if run.0 > best.0 { run } else { best });
    (best.0 > 0).then_some(Run::Part(best.1, best.2))
}

/// Outward and counter-clockwise at an azimuth.
fn directions(up: DVec3, zero: DVec3, azimuth: f64) -> [DVec3; 2] {
    let side = up.cross(zero);
    let (sin, cos) = m64::sin_cos(azimuth);
    [zero * cos + side * sin, side * cos - zero * sin]
}

/// An angle in `[0, 2 pi)`.
fn turned(angle: f64) -> f64 {
    let rest = angle - TAU * m64::floor(angle / TAU);
    if rest >= TAU { 0.0 } else { rest }
}
