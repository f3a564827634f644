//! A ray in world space, the positions of samples on it, and the gradient that comes back to it.
//!
//! The way back from samples to a camera is three steps, each the twin of a step forward:
//!
//! | forward | backward |
//! | --- | --- |
//! | [`Prepared::ray`](crate::camera::Prepared::ray): pixel, pose, intrinsics to ray | [`Prepared::ray_backward`](crate::camera::Prepared::ray_backward), [`Prepared::rays_backward`](crate::camera::Prepared::rays_backward) |
//! | [`sample_positions`]: ray and distances to positions | [`sample_positions_backward`] |
//! | [`SpaceMap`](crate::space_map::SpaceMap): positions to the coordinates of a field | its `_backward` functions |
//!
//! A field that depends on the view direction adds its gradient to [`RayBar::d`]: the view direction is the ray's.

use core::ops::AddAssign;
use glam::DVec3;

/// A half line `o + t d`, `t >= 0`.
///
/// `o` is in world units and `d` has unit length, so `t` is a metric distance (not a z depth).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin, world units.
    pub o: DVec3,
    /// Unit direction.
    pub d: DVec3,
}

impl Ray {
    /// The point at distance `t`.
    #[must_use]
    pub fn at(&self, t: f64) -> DVec3 {
        self.o + self.d * t
    }
}

/// Gradient with respect to a [`Ray`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RayBar {
    /// Of the origin, loss / world unit.
    pub o: DVec3,
    /// Of the direction as three free numbers: its part along the direction is not removed here, but where the direction
    /// is normalised.
    pub d: DVec3,
}

impl AddAssign for RayBar {
    fn add_assign(&mut self, other: Self) {
        self.o += other.o;
        self.d += other.d;
    }
}

/// Gradient with respect to `v` of `v / |v|`; 0 for a zero vector.
pub(crate) fn normalise_backward(v: DVec3, unit_bar: DVec3) -> DVec3 {
    let length = v.length();
    if length == 0.0 {
        return DVec3::ZERO;
    }
    let unit = v / length;
    (unit_bar - unit * unit.dot(unit_bar)) / length
}

/// Positions of the samples of a batch of rays, `x[i] = o + t[i] d`, written; samples that belong to no ray are left alone.
///
/// # Shapes and units
/// * `offsets` `[rays.len() + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`
/// * `t` `[n]` distances along the rays, in units of the directions' lengths
/// * `x` `[3][n]` out, unit of the origins
///
/// # Numerics
/// In `f64`, rounded once.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn sample_positions(rays: &[Ray], offsets: &[u32], t: &[f32], x: &mut [f32]) {
    let n = t.len();
    check(rays.len(), offsets, n);
    assert_eq!(x.len(), 3 * n, "x holds three coordinates of as many samples as t");
    for (ray, ends) in rays.iter().zip(offsets.windows(2)) {
        for i in ends[0] as usize..ends[1] as usize {
            let p = ray.at(t[i].into());
            (x[i], x[n + i], x[2 * n + i]) = (p.x as f32, p.y as f32, p.z as f32);
        }
    }
}

/// Where [`sample_positions_backward`] adds its gradients.
#[derive(Debug)]
pub struct SamplePositionsGrads<'a> {
    /// `[rays]`, added to.
    pub rays: &'a mut [RayBar],
    /// `[n]`, added to; nothing where the distances do not learn.
    pub t: Option<&'a mut [f32]>,
}

/// Gradient of [`sample_positions`]: adds `sum(x_bar[i])` to the origin's, `sum(t[i] x_bar[i])` to the direction's and
/// `x_bar[i] . d` to the distances'.
///
/// # Shapes and units
/// As [`sample_positions`]; `x_bar` `[3][n]`.
///
/// # Numerics
/// Sums are `f64` in index order over the samples of a ray, and a ray's gradient depends on its own samples alone: the same
/// bits however a batch is cut, with any number of threads.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or run past the samples.
pub fn sample_positions_backward(
    rays: &[Ray],
    offsets: &[u32],
    t: &[f32],
    x_bar: &[f32],
    grads: SamplePositionsGrads<'_>,
) {
    let n = t.len();
    check(rays.len(), offsets, n);
    assert_eq!(x_bar.len(), 3 * n, "x_bar holds three coordinates of as many samples as t");
    assert_eq!(grads.rays.len(), rays.len(), "the gradient of rays holds one entry a ray");
    let mut t_bar = grads.t;
    assert!(t_bar.as_ref().is_none_or(|x| x.len() == n), "t and its gradient differ in length");
    for ((ray, ray_bar), ends) in rays.iter().zip(grads.rays).zip(offsets.windows(2)) {
        let mut sum = RayBar::default();
        for i in ends[0] as usize..ends[1] as usize {
            let bar = DVec3::new(x_bar[i].into(), x_bar[n + i].into(), x_bar[2 * n + i].into());
            sum.o += bar;
            sum.d += bar * f64::from(t[i]);
            if let Some(t_bar) = t_bar.as_deref_mut() {
                t_bar[i] += bar.dot(ray.d) as f32;
            }
        }
        *ray_bar += sum;
    }
}

fn check(rays: usize, offsets: &[u32], n: usize) {
    assert_eq!(
        offsets.len(),
        if rays == 0 { offsets.len().min(1) } else { rays + 1 },
        "offsets hold one entry more than rays"
    );
    assert!(offsets.is_sorted(), "offsets decrease");
    let last = offsets.last().copied().unwrap_or(0) as usize;
    assert!(last <= n, "offsets end at {last}, past the {n} samples");
}
