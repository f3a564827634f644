//! From the world to the coordinates that a field is evaluated at, for positions and for rays, and the gradients back.
//!
//! *Internal* coordinates are those in which rays stay straight and samples are placed; a grid sees the *unit cube*:
//!
//! | map | internal `p` | unit cube `u` |
//! | --- | --- | --- |
//! | [`SpaceMap::Box`] | `(x - centre) / radius` | `(p + 1) / 2` |
//! | [`SpaceMap::Contracted`] | the same | `(contract(p) + 2) / 4` |
//! | [`SpaceMap::Ndc`] | normalised device coordinates of a reference camera | `(p + 1) / 2` |
//!
//! So a gradient with respect to the unit cube takes [`SpaceMap::unit_backward`] to internal positions,
//! [`sample_positions_backward`](crate::ray::sample_positions_backward) to internal rays, and
//! [`SpaceMap::internal_ray_backward`] to rays of the world. Where samples are placed on rays of the world instead, it takes
//! [`SpaceMap::unit_backward`], [`SpaceMap::internal_backward`], and then the samples' twin.
//!
//! The way back to the world, [`SpaceMap::world`], is for losses that compare with something there: projections, motion in world
//! units. The far end of the world is [`FAR_GAP`] before the end of the unit cube.
//!
//! All of it is `f64` inside and rounded once; every sample and every ray by itself, so the bits depend on nothing else.
//!
//! ```
//! use glam::DVec3;
//! use render_core::contract::Norm;
//! use render_core::space_map::SpaceMap;
//!
//! let map = SpaceMap::Contracted { norm: Norm::Max, centre: DVec3::ZERO, radius: 2.0 };
//! let (mut p, mut u) = ([0.0; 3], [0.0; 3]);
//! map.internal(&[6.0, 0.0, 0.0], &mut p);
//! map.unit(&p, &mut u);
//! assert_eq!((p[0], u[1]), (3.0, 0.5));
//! assert!((u[0] - (2.0 - 1.0 / 3.0 + 2.0) / 4.0).abs() < 1e-6);
//! ```

use crate::contract::{Norm, contract, contract_backward, inv_contract_within, inv_contract_within_backward};
use crate::ndc::{Ndc, NdcRay};
use crate::pose::Pose;
use crate::ray::{Ray, RayBar, normalise_backward};
use glam::DVec3;

/// How far before infinity [`SpaceMap::world`] ends: contracted norms above `2 - FAR_GAP` and NDC depths above `1 - FAR_GAP` count as
/// that, and have no derivative. Positions in `f32` tell distances there apart to a few parts in ten thousand.
pub const FAR_GAP: f64 = 1e-3;

/// How the world is laid out for a field.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum SpaceMap {
    /// A cube of half side `radius` around `centre`, world units.
    Box {
        /// Centre of the cube.
        centre: DVec3,
        /// Half its side, `> 0`.
        radius: f64,
    },
    /// The same, and all space around it contracted.
    Contracted {
        /// Norm of the contraction.
        norm: Norm,
        /// What is at the origin of internal coordinates.
        centre: DVec3,
        /// World units that are one internal unit, `> 0`.
        radius: f64,
    },
    /// Normalised device coordinates of a reference camera.
    Ndc {
        /// Its pose, CV axes.
        pose: Pose,
        /// Its frustum.
        ndc: Ndc<f64>,
    },
}

impl SpaceMap {
    /// Internal coordinates of positions in the world: `p` `[3][n]`, written.
    ///
    /// # Shapes and units
    /// * `x` `[3][n]` world units; not finite in NDC where a point lies in the reference camera's image plane
    ///
    /// # Panics
    /// When the lengths differ or are not a multiple of 3.
    pub fn internal(&self, x: &[f32], p: &mut [f32]) {
        each(x, p, |x| self.internal_point(x));
    }

    /// Gradient of [`SpaceMap::internal`]: adds into `x_bar` `[3][n]`.
    ///
    /// # Panics
    /// As [`SpaceMap::internal`].
    pub fn internal_backward(&self, x: &[f32], p_bar: &[f32], x_bar: &mut [f32]) {
        each_backward(x, p_bar, x_bar, |x, p_bar| self.internal_point_backward(x, p_bar));
    }

    /// Unit cube coordinates of internal positions: `u` `[3][n]`, written.
    ///
    /// # Panics
    /// When the lengths differ or are not a multiple of 3.
    pub fn unit(&self, p: &[f32], u: &mut [f32]) {
        each(p, u, |p| self.unit_point(p));
    }

    /// Gradient of [`SpaceMap::unit`]: adds into `p_bar` `[3][n]`.
    ///
    /// # Panics
    /// As [`SpaceMap::unit`].
    pub fn unit_backward(&self, p: &[f32], u_bar: &[f32], p_bar: &mut [f32]) {
        each_backward(p, u_bar, p_bar, |p, u_bar| self.unit_point_backward(p, u_bar));
    }

    /// Positions in the world of unit cube coordinates, the inverse of [`SpaceMap::unit`] after [`SpaceMap::internal`]: `x` `[3][n]`
    /// world units, written. What is beyond [`FAR_GAP`] comes back at that distance.
    ///
    /// # Panics
    /// When the lengths differ or are not a multiple of 3.
    pub fn world(&self, u: &[f32], x: &mut [f32]) {
        each(u, x, |u| self.world_point(u));
    }

    /// Gradient of [`SpaceMap::world`]: adds into `u_bar` `[3][n]`.
    ///
    /// # Panics
    /// As [`SpaceMap::world`].
    pub fn world_backward(&self, u: &[f32], x_bar: &[f32], u_bar: &mut [f32]) {
        each_backward(u, x_bar, u_bar, |u, x_bar| self.world_point_backward(u, x_bar));
    }

    /// [`SpaceMap::world`] of one point.
    #[must_use]
    pub fn world_point(&self, u: DVec3) -> DVec3 {
        match *self {
            Self::Box { centre, radius } => centre + radius * (u * 2.0 - 1.0),
            Self::Contracted { norm, centre, radius } => {
                let p = inv_contract_within(norm, (u * 4.0 - 2.0).to_array(), FAR_GAP);
                centre + radius * DVec3::from(p)
            }
            Self::Ndc { pose, ndc } => pose.to_world(gl(ndc.inv_point((u * 2.0 - 1.0).to_array(), FAR_GAP).into())),
        }
    }

    /// Gradient of [`SpaceMap::world_point`] with respect to the point.
    #[must_use]
    pub fn world_point_backward(&self, u: DVec3, x_bar: DVec3) -> DVec3 {
        let mut bar = [0.0; 3];
        match *self {
            Self::Box { radius, .. } => x_bar * (2.0 * radius),
            Self::Contracted { norm, radius, .. } => {
                let y = (u * 4.0 - 2.0).to_array();
                inv_contract_within_backward(norm, y, FAR_GAP, (x_bar * radius).to_array(), &mut bar);
                DVec3::from(bar) * 4.0
            }
            Self::Ndc { pose, ndc } => {
                let p = (u * 2.0 - 1.0).to_array();
                ndc.inv_point_backward(p, FAR_GAP, gl(pose.r.transpose() * x_bar).to_array(), &mut bar);
                DVec3::from(bar) * 2.0
            }
        }
    }

    /// A ray of the world in internal coordinates, its direction of unit length there; `None` where NDC has no such ray (see
    /// [`Ndc::ray`]).
    #[must_use]
    pub fn internal_ray(&self, ray: &Ray) -> Option<Ray> {
        match *self {
            Self::Box { centre, radius } | Self::Contracted { centre, radius, .. } => {
                Some(Ray { o: (ray.o - centre) / radius, d: ray.d })
            }
            Self::Ndc { pose, ndc } => {
                let (o, d) = gl_ray(&pose, ray);
                let q = ndc.ray(o, d)?;
                Some(Ray { o: DVec3::from(q.o), d: DVec3::from(q.d).normalize() })
            }
        }
    }

    /// Gradient of [`SpaceMap::internal_ray`]: adds to `ray_bar`; nothing where there is no internal ray.
    pub fn internal_ray_backward(&self, ray: &Ray, internal_bar: &RayBar, ray_bar: &mut RayBar) {
        match *self {
            Self::Box { radius, .. } | Self::Contracted { radius, .. } => {
                *ray_bar += RayBar { o: internal_bar.o / radius, d: internal_bar.d };
            }
            Self::Ndc { pose, ndc } => {
                let (o, d) = gl_ray(&pose, ray);
                let Some(q) = ndc.ray(o, d) else { return };
                let d_bar = normalise_backward(DVec3::from(q.d), internal_bar.d);
                let q_bar = NdcRay { o: internal_bar.o.to_array(), d: d_bar.to_array() };
                let (mut o_bar, mut d_bar) = ([0.0; 3], [0.0; 3]);
                ndc.ray_backward(o, d, &q_bar, &mut o_bar, &mut d_bar);
                *ray_bar += RayBar { o: pose.r * gl(o_bar.into()), d: pose.r * gl(d_bar.into()) };
            }
        }
    }

    /// [`SpaceMap::internal`] of one point.
    fn internal_point(&self, x: DVec3) -> DVec3 {
        match *self {
            Self::Box { centre, radius } | Self::Contracted { centre, radius, .. } => (x - centre) / radius,
            Self::Ndc { pose, ndc } => ndc.point(gl(pose.to_camera(x)).to_array()).into(),
        }
    }

    fn internal_point_backward(&self, x: DVec3, p_bar: DVec3) -> DVec3 {
        match *self {
            Self::Box { radius, .. } | Self::Contracted { radius, .. } => p_bar / radius,
            Self::Ndc { pose, ndc } => {
                let mut bar = [0.0; 3];
                ndc.point_backward(gl(pose.to_camera(x)).to_array(), p_bar.to_array(), &mut bar);
                pose.r * gl(bar.into())
            }
        }
    }

    /// [`SpaceMap::unit`] of one point.
    fn unit_point(&self, p: DVec3) -> DVec3 {
        match *self {
            Self::Box { .. } | Self::Ndc { .. } => p * 0.5 + 0.5,
            Self::Contracted { norm, .. } => DVec3::from(contract(norm, p.to_array())) * 0.25 + 0.5,
        }
    }

    fn unit_point_backward(&self, p: DVec3, u_bar: DVec3) -> DVec3 {
        match *self {
            Self::Box { .. } | Self::Ndc { .. } => u_bar * 0.5,
            Self::Contracted { norm, .. } => {
                let mut bar = [0.0; 3];
                contract_backward(norm, p.to_array(), (u_bar * 0.25).to_array(), &mut bar);
                bar.into()
            }
        }
    }
}

/// GL axes of a CV camera's point or direction, and back: y and z turn.
fn gl(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.y, -v.z)
}

/// Origin and direction of a ray of the world in the GL axes of a camera.
fn gl_ray(pose: &Pose, ray: &Ray) -> ([f64; 3], [f64; 3]) {
    (gl(pose.to_camera(ray.o)).to_array(), gl(pose.r.transpose() * ray.d).to_array())
}

/// Point `i` of a `[3][n]` array.
fn point(x: &[f32], i: usize) -> DVec3 {
    let n = x.len() / 3;
    DVec3::new(x[i].into(), x[n + i].into(), x[2 * n + i].into())
}

fn each(x: &[f32], out: &mut [f32], f: impl Fn(DVec3) -> DVec3) {
    check(x.len(), out.len());
    let n = x.len() / 3;
    for i in 0..n {
        let y = f(point(x, i));
        (out[i], out[n + i], out[2 * n + i]) = (y.x as f32, y.y as f32, y.z as f32);
    }
}

fn each_backward(x: &[f32], out_bar: &[f32], x_bar: &mut [f32], f: impl Fn(DVec3, DVec3) -> DVec3) {
    check(x.len(), out_bar.len());
    check(x.len(), x_bar.len());
    let n = x.len() / 3;
    for i in 0..n {
        let bar = f(point(x, i), point(out_bar, i));
        x_bar[i] += bar.x as f32;
        x_bar[n + i] += bar.y as f32;
        x_bar[2 * n + i] += bar.z as f32;
    }
}

fn check(n: usize, other: usize) {
    assert_eq!(n % 3, 0, "positions hold three coordinates");
    assert_eq!(n, other, "both hold three coordinates of the same points");
}
