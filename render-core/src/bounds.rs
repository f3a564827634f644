//! Boxes, rays through them, and the extent of a scene.

use alloc::vec::Vec;
use glam::DVec3;

use crate::{camera::Camera, real::Real};

/// An axis-aligned box, faces included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
}

impl Aabb {
    /// The cube of half side `half` around `centre`.
    #[must_use]
    pub fn cube(centre: DVec3, half: f64) -> Self {
        Self { min: centre - half, max: centre + half }
    }

    /// The smallest box around some points; `None` without any.
    #[must_use]
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Option<Self> {
        points.into_iter().map(|p| Self { min: p, max: p }).reduce(|a, b| a.union(&b))
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether a point is inside, faces included.
    #[must_use]
    pub fn contains(&self, x: DVec3) -> bool {
        x.cmpge(self.min).all() && x.cmple(self.max).all()
    }

    /// Centre.
    #[must_use]
    pub fn centre(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// Length of each side.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Grown by `factor` around its centre.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let half = 0.5 * factor * self.size();
        Self { min: self.centre() - half, max: self.centre() + half }
    }

    /// Where the ray `o + t d` is inside, within `[near, far]`; see [`intersect_box`].
    #[must_use]
    pub fn intersect(&self, o: DVec3, d: DVec3, near: f64, far: f64) -> Option<[f64; 2]> {
        intersect_box(o.to_array(), d.to_array(), self.min.to_array(), self.max.to_array(), near, far)
    }
}

/// The `[t0, t1]` within `[near, far]` on which the ray `o + t d` is in the box, `None` where it misses.
///
/// Slabs: along an axis with `d = 0` the ray is inside for all `t` or for none, decided by `o` (no `0 * inf`). A ray
/// that lies in a face is inside; one that only touches a corner gives `t0 = t1`. NaN anywhere is a miss.
///
/// Source: Kay and Kajiya, "Ray tracing complex scenes", 1986, section 2.
#[inline]
#[must_use]
pub fn intersect_box<T: Real>(o: [T; 3], d: [T; 3], min: [T; 3], max: [T; 3], near: T, far: T) -> Option<[T; 2]> {
    near.partial_cmp(&far)?; // no order: NaN
    let (mut t0, mut t1) = (near, far);
    for a in 0..3 {
        if d[a] == T::ZERO {
            let inside = o[a] >= min[a] && o[a] <= max[a];
            if !inside {
                return None;
            }
            continue;
        }
        // Divided, not multiplied by 1/d: the reciprocal of a denormal is infinite.
        let (a0, a1) = ((min[a] - o[a]) / d[a], (max[a] - o[a]) / d[a]);
        let (enter, leave) = if a0.partial_cmp(&a1)?.is_le() { (a0, a1) } else { (a1, a0) };
        t0 = t0.max(enter);
        t1 = t1.min(leave);
    }
    (t0 <= t1).then_some([t0, t1])
}

/// Gradient of [`intersect_box`] with respect to the ray: adds to `o_bar` and `d_bar`; nothing where the ray misses.
///
/// `t_bar` is that of `[t0, t1]`. A distance that is `near` or `far` does not depend on the ray and gives nothing; where the
/// ray runs through an edge of the box the first axis counts.
#[expect(
    clippy::too_many_arguments,
    reason = "the arguments of the forward function, the gradient that comes and those that go"
)]
pub fn intersect_box_backward<T: Real>(
    o: [T; 3],
    d: [T; 3],
    min: [T; 3],
    max: [T; 3],
    near: T,
    far: T,
    t_bar: [T; 2],
    o_bar: &mut [T; 3],
    d_bar: &mut [T; 3],
) {
    let Some(t) = intersect_box(o, d, min, max, near, far) else { return };
    for (end, (t, bar)) in t.into_iter().zip(t_bar).enumerate() {
        if t == if end == 0 { near } else { far } {
            continue;
        }
        // The face that the distance was taken from: t = (face - o) / d.
        let on = |a: usize| {
            let face = if (d[a] > T::ZERO) == (end == 0) { min[a] } else { max[a] };
            d[a] != T::ZERO && (face - o[a]) / d[a] == t
        };
        if let Some(a) = (0..3).find(|&a| on(a)) {
            let through = bar / d[a];
            o_bar[a] += -through;
            d_bar[a] += -through * t;
        }
    }
}

/// The value below which a share `q` of the sorted `values` lies, interpolated linearly; `None` without values.
///
/// `q` is clamped to `[0, 1]`.
#[must_use]
pub fn percentile(sorted: &[f64], q: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = q.clamp(0.0, 1.0) * last as f64;
    let i = (at as usize).min(last);
    let (a, b) = (sorted[i], sorted[(i + 1).min(last)]);
    Some(a + (b - a) * (at - i as f64))
}

/// The box that holds the middle of a point cloud along each axis: from percentile `q` to `1 - q`.
///
/// Structure-from-motion clouds have strays far outside of the scene; `q = 0.01` leaves out most. Points that are not
/// finite don't count. `None` when none is left.
#[must_use]
pub fn robust_box(points: &[DVec3], q: f64) -> Option<Aabb> {
    let mut sorted = Vec::with_capacity(points.len());
    let mut bounds = [[0.0; 2]; 3];
    for (a, bound) in bounds.iter_mut().enumerate() {
        sorted.clear();
        sorted.extend(points.iter().filter(|p| p.is_finite()).map(|p| p[a]));
        sorted.sort_unstable_by(f64::total_cmp);
        *bound = [percentile(&sorted, q)?, percentile(&sorted, 1.0 - q)?];
    }
    let [x, y, z] = bounds;
    Some(Aabb { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) })
}

/// Depths along the optical axis, sorted, of the points a camera sees in its image.
#[must_use]
pub fn visible_depths(camera: &Camera, points: &[DVec3]) -> Vec<f64> {
    let prepared = camera.prepare();
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let mut depths: Vec<f64> = points
        .iter()
        .filter(|&&x| {
            let seen = prepared.project(x);
            seen.is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x <= w && p.y <= h)
        })
        .map(|&x| camera.pose.to_camera(x).z)
        .filter(|&z| z > 0.0)
        .collect();
    depths.sort_unstable_by(f64::total_cmp);
    depths
}

/// Near and far z depth of each camera from the points in its image: percentiles `q` and `1 - q`.
///
/// Cameras that see fewer than `least` points get the medians of the others. `None` when no camera sees enough.
#[must_use]
pub fn depth_ranges(cameras: &[Camera], points: &[DVec3], q: f64, least: usize) -> Option<Vec<[f64; 2]>> {
    let own = |camera: &Camera| {
        let depths = visible_depths(camera, points);
        let range = [percentile(&depths, q)?, percentile(&depths, 1.0 - q)?];
        (depths.len() >= least.max(1)).then_some(range)
    };
    let ranges: Vec<Option<[f64; 2]>> = cameras.iter().map(own).collect();
    let median = |end: usize| {
        let mut values: Vec<f64> = ranges.iter().flatten().map(|r| r[end]).collect();
        values.sort_unstable_by(f64::total_cmp);
        percentile(&values, 0.5)
    };
    let fallback = [median(0)?, median(1)?];
    Some(ranges.into_iter().map(|r| r.unwrap_or(fallback)).collect())
}
