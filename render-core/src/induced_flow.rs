//! Flow that a moving field induces: where the camera of a neighbouring frame sees what a ray sees here.
//!
//! Letters: `x` samples at their places in the neighbouring frame, that is, with their scene flow added; `w` their weights; `p` the point
//! that a ray is expected to see; `(R, c)` the neighbour's pose.
//!
//! ```text
//! p = sum w x                                  in the coordinates of the field, see Coordinates
//! X = world(p),  x_camera = R^T (X - c)        flow = project(x_camera) - pixel
//! ```
//!
//! The mean is taken before the way back to the world, as published code does: on a ray with one sample both are the same, on others
//! the mean in contracted coordinates lies nearer. `pixel` is the place that the ray went through; here, the centre of a pixel: with
//! any other place a point at rest would have flow.
//!
//! A point that the neighbour has behind it, or closer than `z_min`, has no flow: it is not seen, and has no gradient.
//!
//! Source: Li et al., "Neural scene flow fields", 2021, section 3.2 (geometric consistency); Gao et al., "Dynamic view synthesis from
//! dynamic monocular video", 2021, motion matching; Liu et al., "Robust dynamic radiance fields", 2023 (weights of sum 1).

use crate::camera::{CameraBar, PoseBar, Prepared};
use crate::space_map::SpaceMap;
use glam::{DMat3, DVec2, DVec3};

/// Weights of a smaller sum count as of this one in [`Rest::Shared`].
pub const SMALLEST_SUM: f64 = 1e-6;

/// What is done with the share of a ray that its weights leave, `1 - sum w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rest<'a> {
    /// Nothing: the point is drawn towards the origin of the coordinates (NSFF, DynamicNeRF). Theirs are NDC, whose origin is the middle
    /// of the unit cube: there the same is [`Rest::AtEnd`] of `0.5`.
    Dropped,
    /// The samples share it: weights are divided by their sum, at least [`SMALLEST_SUM`] (RoDynRF, moving part).
    Shared,
    /// It is at the end of the ray (RoDynRF, static part): `[3][rays]`, in the coordinates of the samples. Constants: no gradient.
    AtEnd(&'a [f32]),
}

impl Rest<'_> {
    /// What is done with the sum of a ray's samples, whose weights have the sum `sum`.
    fn of_ray(&self, ray: usize, rays: usize, sum: f64) -> RestOfRay {
        match *self {
            Self::Dropped => RestOfRay { scale: 1.0, end: DVec3::ZERO, left: 0.0 },
            Self::Shared => RestOfRay { scale: 1.0 / sum.max(SMALLEST_SUM), end: DVec3::ZERO, left: 0.0 },
            Self::AtEnd(end) => RestOfRay { scale: 1.0, end: point(end, ray, rays), left: 1.0 - sum },
        }
    }

    /// Whether a ray without any weight sees something.
    fn is_seen_without_weight(&self) -> bool {
        matches!(self, Self::AtEnd(_))
    }
}

/// The sum of a ray's samples is multiplied by `scale`, and `left` times `end` is added.
struct RestOfRay {
    scale: f64,
    end: DVec3,
    left: f64,
}

/// Points that rays are expected to see: `p` `[3][rays]`, written. A ray whose weights are all 0 sees nothing, and `p` is NaN, unless
/// there is something at its end.
///
/// # Shapes and units
/// * `offsets` `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`
/// * `x` `[3][n]` positions of the samples, in coordinates of which means may be taken: world, unit cube
/// * `w` `[n]` weights
///
/// # Numerics
/// Sums are `f64` in index order, rounded once.
///
/// # Panics
/// When the lengths disagree, or the offsets decrease or do not end at the last sample.
pub fn expected_points(offsets: &[u32], x: &[f32], w: &[f32], rest: Rest<'_>, p: &mut [f32]) {
    let rays = check_rays(offsets, x, w, rest, p.len());
    for (r, ends) in offsets.windows(2).enumerate() {
        let span = ends[0] as usize..ends[1] as usize;
        let mean = mean(x, w, span, |sum| rest.of_ray(r, rays, sum));
        let mean = match mean {
            Some(Mean { p, .. }) => p,
            None if rest.is_seen_without_weight() => rest.of_ray(r, rays, 0.0).end,
            None => DVec3::NAN,
        };
        (p[r], p[rays + r], p[2 * rays + r]) = (mean.x as f32, mean.y as f32, mean.z as f32);
    }
}

/// Gradient of [`expected_points`]: adds into `x_bar` `[3][n]` and `w_bar` `[n]`. The gradient of scene flow is that of `x`. A ray
/// whose weights are all 0 adds nothing.
///
/// # Panics
/// As [`expected_points`].
pub fn expected_points_backward(
    offsets: &[u32],
    x: &[f32],
    w: &[f32],
    rest: Rest<'_>,
    p_bar: &[f32],
    x_bar: &mut [f32],
    w_bar: &mut [f32],
) {
    let rays = check_rays(offsets, x, w, rest, p_bar.len());
    let n = w.len();
    assert_eq!((x_bar.len(), w_bar.len()), (3 * n, n), "gradients are as long as what they are of");
    for (r, ends) in offsets.windows(2).enumerate() {
        let span = ends[0] as usize..ends[1] as usize;
        let Some(Mean { p, sum, rest: of_ray }) = mean(x, w, span.clone(), |sum| rest.of_ray(r, rays, sum)) else {
            continue;
        };
        let p_bar = point(p_bar, r, rays);
        // Where more of one sample moves the point away from.
        let from = match rest {
            Rest::Dropped => DVec3::ZERO,
            Rest::Shared if sum > SMALLEST_SUM => p,
            Rest::Shared => DVec3::ZERO,
            Rest::AtEnd(_) => of_ray.end,
        };
        for i in span {
            let bar = p_bar * (of_ray.scale * f64::from(w[i]));
            x_bar[i] += bar.x as f32;
            x_bar[n + i] += bar.y as f32;
            x_bar[2 * n + i] += bar.z as f32;
            w_bar[i] += (of_ray.scale * p_bar.dot(point(x, i, n) - from)) as f32;
        }
    }
}

/// What a ray is expected to see, and the sum of its weights.
struct Mean {
    p: DVec3,
    sum: f64,
    rest: RestOfRay,
}

/// `None` where all weights are 0.
fn mean(x: &[f32], w: &[f32], span: core::ops::Range<usize>, rest: impl Fn(f64) -> RestOfRay) -> Option<Mean> {
    let (mut sum, mut total) = (0.0, DVec3::ZERO);
    let mut any = false;
    for i in span {
        let weight = f64::from(w[i]);
        // Samples of no weight may be anywhere, also where the map of space ends.
        if weight != 0.0 {
            any = true;
            sum += weight;
            total += point(x, i, w.len()) * weight;
        }
    }
    any.then(|| {
        let rest = rest(sum);
        Mean { p: total * rest.scale + rest.end * rest.left, sum, rest }
    })
}

/// Point `i` of a `[3][n]` array.
fn point(x: &[f32], i: usize, n: usize) -> DVec3 {
    DVec3::new(x[i].into(), x[n + i].into(), x[2 * n + i].into())
}

fn check_rays(offsets: &[u32], x: &[f32], w: &[f32], rest: Rest<'_>, p: usize) -> usize {
    let rays = offsets.len().saturating_sub(1);
    assert!(offsets.is_sorted(), "offsets decrease");
    assert_eq!(offsets.last().copied().unwrap_or(0) as usize, w.len(), "offsets end at the last sample");
    assert_eq!(x.len(), 3 * w.len(), "a sample has three coordinates");
    assert_eq!(p, 3 * rays, "a ray sees one point");
    if let Rest::AtEnd(end) = rest {
        assert_eq!(end.len(), 3 * rays, "a ray has one end");
    }
    rays
}

/// What points are given in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coordinates<'a> {
    /// The world.
    World,
    /// The unit cube of a field: contracted coordinates and NDC, shifted and scaled, so that means are the same there.
    Unit(&'a SpaceMap),
}

impl Coordinates<'_> {
    fn world(&self, p: DVec3) -> DVec3 {
        match self {
            Self::World => p,
            Self::Unit(map) => map.world_point(p),
        }
    }

    fn world_backward(&self, p: DVec3, x_bar: DVec3) -> DVec3 {
        match self {
            Self::World => x_bar,
            Self::Unit(map) => map.world_point_backward(p, x_bar),
        }
    }
}

/// Cameras of neighbouring frames, and which ray has which of them.
#[derive(Clone, Copy, Debug)]
pub struct Neighbours<'a> {
    /// `[cameras]`, each once.
    pub cameras: &'a [Prepared],
    /// `[rays]` index of the camera of each ray's neighbour.
    pub of_ray: &'a [u32],
    /// Smallest z depth at which a camera sees something, world units, `>= 0`.
    pub z_min: f64,
}

/// Gradient with respect to one camera of [`Neighbours`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NeighbourBar {
    /// Of its pose.
    pub pose: PoseBar,
    /// Of its intrinsics and lens.
    pub camera: CameraBar,
}

/// Flow of one point: its pixel in the neighbour's picture minus `pixel`. `None` where the neighbour does not see it: at or below
/// `z_min`, beyond the fold of the lens, not finite. The pixel may lie outside of the picture.
#[must_use]
pub fn flow_of_point(
    p: DVec3,
    coordinates: Coordinates<'_>,
    camera: &Prepared,
    z_min: f64,
    pixel: DVec2,
) -> Option<DVec2> {
    let x_camera = camera.camera().pose.to_camera(coordinates.world(p));
    // False for NaN as well.
    let before = x_camera.z > z_min;
    if !before {
        return None;
    }
    let flow = camera.project_from_camera(x_camera)? - pixel;
    flow.is_finite().then_some(flow)
}

/// Gradient of [`flow_of_point`]: that of the point is returned, those of the camera are added into `camera_bar`. 0 where the
/// neighbour does not see the point. The gradient of `pixel` is `-flow_bar` where it does.
pub fn flow_of_point_backward(
    p: DVec3,
    coordinates: Coordinates<'_>,
    camera: &Prepared,
    z_min: f64,
    flow_bar: DVec2,
    camera_bar: &mut NeighbourBar,
) -> DVec3 {
    let pose = &camera.camera().pose;
    let from_centre = coordinates.world(p) - pose.c;
    let x_camera = pose.r.transpose() * from_centre;
    let before = x_camera.z > z_min;
    if !before || camera.project_from_camera(x_camera).is_none() {
        return DVec3::ZERO;
    }
    let mut bar = DVec3::ZERO;
    camera.project_backward(x_camera, flow_bar, &mut bar, &mut camera_bar.camera);
    let x_bar = pose.r * bar;
    camera_bar.pose.c += -x_bar;
    camera_bar.pose.r += DMat3::from_cols(from_centre * bar.x, from_centre * bar.y, from_centre * bar.z);
    coordinates.world_backward(p, x_bar)
}

/// Flow of what rays see: `flow` and `seen` `[rays]`, written; 0 and `false` where the neighbour does not see the point.
///
/// # Shapes and units
/// * `p` `[3][rays]` points, see [`expected_points`]
/// * `pixels` `[rays]` column and row that each ray went through in its own picture; centres are at `+ 0.5`
/// * `flow` `[rays]` pixels, x to the right, y down
///
/// # Numerics
/// `f64` inside, rounded once.
///
/// # Panics
/// When the lengths disagree, or a ray names a camera that is not there.
pub fn induced_flow(
    p: &[f32],
    coordinates: Coordinates<'_>,
    neighbours: Neighbours<'_>,
    pixels: &[[f32; 2]],
    flow: &mut [[f32; 2]],
    seen: &mut [bool],
) {
    let rays = neighbours.of_ray.len();
    assert_eq!(p.len(), 3 * rays, "a ray sees one point");
    assert_eq!((pixels.len(), flow.len(), seen.len()), (rays, rays, rays), "a ray has one pixel, one flow");
    for (r, &camera) in neighbours.of_ray.iter().enumerate() {
        let camera = &neighbours.cameras[camera as usize];
        let pixel = DVec2::from_array(pixels[r].map(f64::from));
        let found = flow_of_point(point(p, r, rays), coordinates, camera, neighbours.z_min, pixel);
        seen[r] = found.is_some();
        flow[r] = found.map_or([0.0; 2], |flow| flow.to_array().map(|x| x as f32));
    }
}

/// Gradient of [`induced_flow`]: adds into `p_bar` `[3][rays]`, and into `camera_bars` `[cameras]`, or none where cameras are fixed.
/// Points that are not seen add nothing, whatever `flow_bar` `[rays]` holds there.
///
/// # Numerics
/// Gradients of cameras are added in the order of the rays.
///
/// # Panics
/// As [`induced_flow`].
pub fn induced_flow_backward(
    p: &[f32],
    coordinates: Coordinates<'_>,
    neighbours: Neighbours<'_>,
    flow_bar: &[[f32; 2]],
    p_bar: &mut [f32],
    camera_bars: &mut [NeighbourBar],
) {
    let rays = neighbours.of_ray.len();
    assert_eq!((p.len(), p_bar.len(), flow_bar.len()), (3 * rays, 3 * rays, rays), "a ray sees one point");
    let cameras = neighbours.cameras.len();
    assert!(camera_bars.is_empty() || camera_bars.len() == cameras, "gradients of all cameras, or of none");
    for (r, &at) in neighbours.of_ray.iter().enumerate() {
        let at = at as usize;
        let mut fixed = NeighbourBar::default();
        let camera_bar = camera_bars.get_mut(at).unwrap_or(&mut fixed);
        let bar = DVec2::from_array(flow_bar[r].map(f64::from));
        let (p, z_min) = (point(p, r, rays), neighbours.z_min);
        let bar = flow_of_point_backward(p, coordinates, &neighbours.cameras[at], z_min, bar, camera_bar);
        p_bar[r] += bar.x as f32;
        p_bar[rays + r] += bar.y as f32;
        p_bar[2 * rays + r] += bar.z as f32;
    }
}
