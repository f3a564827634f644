//! The map between the scene's frame and internal coordinates.

use super::config::SpaceKind;
use super::ray::InternalRay;
use float_core::Simd;
use glam::{DMat3, DVec3};
use render_core::bounds::intersect_box;
use render_core::camera::{Camera, Pose};
use render_core::contract::{Norm, contract_backward, contract_batch, inv_contract};
use render_core::ndc::Ndc;
use render_core::ray::Ray;
use render_core::sample::Spacing;
use render_core::space_map::SpaceMap;

/// The map between the scene's frame and internal coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Space {
    kind: SpaceKind,
    centre: DVec3,
    radius: f64,
    /// Where cascades of an occupancy grid end, internal units: 1 for a box.
    extent: f64,
    near: f64,
    reference: Reference,
}

/// Reference camera of NDC.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reference {
    pose: Pose,
    ndc: Ndc<f64>,
}

/// GL axes of a CV camera's point or direction: y and z turn.
fn gl(v: DVec3) -> [f64; 3] {
    [v.x, -v.y, -v.z]
}

/// Depth, in near planes, to which a forward-facing scene is exported: what is further has hardly any parallax.
const NDC_EXPORT_DEPTH: f64 = 10.0;
/// Room around the lateral extent of NDC, so that no training ray runs along the cube's face.
const NDC_MARGIN: f64 = 1.02;

impl Space {
    /// A cube of half side `radius` about `centre`.
    #[must_use]
    pub fn boxed(centre: DVec3, radius: f64, near: f64) -> Self {
        Self { kind: SpaceKind::Box, centre, radius, extent: 1.0, near, reference: Reference::none() }
    }

    /// A contracted space whose samples end at `extent` internal units.
    #[must_use]
    pub fn contracted(centre: DVec3, radius: f64, extent: f64, near: f64) -> Self {
        Self { kind: SpaceKind::Contracted, centre, radius, extent, near, reference: Reference::none() }
    }

    /// NDC of the pose `reference` with its near plane at `near` world units, wide enough for all `cameras`.
    /// `None` where a camera's rays run backward or along the image plane of the reference.
    #[must_use]
    pub fn ndc(reference: Pose, near: f64, cameras: &[Camera]) -> Option<Self> {
        let mut ndc = Ndc { scale: [1.0; 2], shift: [0.0; 2], near };
        let mut widest = [0.0_f64; 2];
        for camera in cameras {
            let (w, h) = (f64::from(camera.width), f64::from(camera.height));
            for (u, v) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (w / 2.0, 0.0), (0.0, h / 2.0)] {
                let ray = camera.ray(glam::DVec2::new(u, v))?;
                let q = ndc.ray(gl(reference.to_camera(ray.o)), gl(reference.r.transpose() * ray.d))?;
                for (a, widest) in widest.iter_mut().enumerate() {
                    *widest = widest.max(q.o[a].abs()).max((q.o[a] + q.d[a]).abs());
                }
            }
        }
        let usable = widest.iter().all(|w| *w > 0.0 && w.is_finite());
        usable.then(|| {
            ndc.scale = widest.map(|w| 1.0 / (NDC_MARGIN * w));
            let reference = Reference { pose: reference, ndc };
            Self { kind: SpaceKind::Ndc, centre: reference.pose.c, radius: 1.0, extent: 1.0, near: 0.0, reference }
        })
    }

    /// The kind.
    #[must_use]
    pub fn kind(&self) -> SpaceKind {
        self.kind
    }

    /// The same map, for gradients.
    #[must_use]
    pub fn map(&self) -> SpaceMap {
        let (centre, radius) = (self.centre, self.radius);
        match self.kind {
            SpaceKind::Box => SpaceMap::Box { centre, radius },
            SpaceKind::Contracted => SpaceMap::Contracted { norm: Norm::Max, centre, radius },
            SpaceKind::Ndc => SpaceMap::Ndc { pose: self.reference.pose, ndc: self.reference.ndc },
        }
    }

    /// Where the outermost cascade ends, internal units.
    #[must_use]
    pub fn extent(&self) -> f64 {
        self.extent
    }

    /// A ray of the scene's frame in internal coordinates.
    #[must_use]
    pub fn internal_ray(&self, ray: &Ray) -> InternalRay {
        self.internal_cone(ray, 0.0)
    }

    /// A pixel's cone of the scene's frame in internal coordinates; `radius` at distance 1.
    ///
    /// In NDC all pixels of a camera run parallel: the radius is that of the pixel where space ends, which depends on the
    /// direction alone, and is exact for cameras that look as the reference does. (The paper's code takes the distance of
    /// neighbouring rays on the near plane, which is 0 for a camera that stands there.)
    #[must_use]
    pub fn internal_cone(&self, ray: &Ray, radius: f64) -> InternalRay {
        let view = ray.d.as_vec3().to_array();
        let nowhere = InternalRay { o: [0.0; 3], d: [0.0, 0.0, 1.0], start: 0.0, end: 0.0, view, radius: 0.0 };
        let mut wide = radius;
        let (o, d, near, far) = match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => {
                ((ray.o - self.centre) / self.radius, ray.d, self.near, f64::from(f32::MAX))
            }
            SpaceKind::Ndc => {
                let r = &self.reference;
                let Some(q) = r.ndc.ray(gl(r.pose.to_camera(ray.o)), gl(r.pose.r.transpose() * ray.d)) else {
                    return nowhere;
                };
                let (o, d) = (DVec3::from(q.o), DVec3::from(q.d));
                // On the image plane a pixel is 1 / cos times as large as across its ray.
                wide *= 0.5 * (r.ndc.scale[0] + r.ndc.scale[1]) / (r.pose.r.transpose() * ray.d).z.abs();
                // The far plane is infinity: Z stays below 1.
                (o, d.normalize(), 0.0, d.length())
            }
        };
        let (min, max) = ([-self.extent; 3], [self.extent; 3]);
        match intersect_box(o.to_array(), d.to_array(), min, max, near, far) {
            Some([start, end]) => InternalRay {
                o: o.as_vec3().to_array(),
                d: d.as_vec3().to_array(),
                start: start as f32,
                end: end as f32,
                view,
                radius: wide as f32,
            },
            None => nowhere,
        }
    }

    /// What lies evenly along a ray: where space has no end, the inverse of the distance.
    #[must_use]
    pub fn spacing(&self) -> Spacing {
        match self.kind {
            SpaceKind::Contracted => Spacing::Disparity,
            SpaceKind::Box | SpaceKind::Ndc => Spacing::Linear,
        }
    }

    /// World distance along `ray` of the internal distance `t`.
    #[must_use]
    pub fn world_distance(&self, ray: &Ray, t: f32) -> f64 {
        match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => f64::from(t) * self.radius,
            SpaceKind::Ndc => {
                let r = &self.reference;
                let (o, d) = (gl(r.pose.to_camera(ray.o)), gl(r.pose.r.transpose() * ray.d));
                let Some(q) = r.ndc.ray(o, d) else { return f64::INFINITY };
                let s = (f64::from(t) / DVec3::from(q.d).length()).min(1.0 - 1e-6);
                // Depth -z = near / (1 - s).
                (-r.ndc.near / (1.0 - s) - o[2]) / d[2]
            }
        }
    }

    /// Internal distance along `ray` of the world distance `t`: the inverse of [`Space::world_distance`]; 0 where the space
    /// does not reach.
    #[must_use]
    pub fn internal_distance(&self, ray: &Ray, t: f64) -> f32 {
        let Some(p) = self.internal_point(ray.o + ray.d * t) else { return 0.0 };
        let inner = self.internal_ray(ray);
        (0..3).map(|a| (p[a] - inner.o[a]) * inner.d[a]).sum::<f32>().max(0.0)
    }

    /// Internal coordinates of a point of the scene's frame; `None` where the space does not reach.
    #[must_use]
    pub fn internal_point(&self, x: DVec3) -> Option<[f32; 3]> {
        let p = match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => (x - self.centre) / self.radius,
            SpaceKind::Ndc => {
                let local = gl(self.reference.pose.to_camera(x));
                if local[2] > -self.reference.ndc.near {
                    return None;
                }
                DVec3::from(self.reference.ndc.point(local))
            }
        };
        (p.abs().max_element() <= self.extent).then(|| p.as_vec3().to_array())
    }

    /// The point of the scene's frame at internal coordinates.
    #[must_use]
    pub fn world_point(&self, p: [f32; 3]) -> DVec3 {
        let p = p.map(f64::from);
        match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => self.centre + self.radius * DVec3::from(p),
            SpaceKind::Ndc => {
                let [x, y, z] = self.reference.ndc.inv_point(p, 1e-3);
                self.reference.pose.to_world(DVec3::new(x, -y, -z))
            }
        }
    }

    /// Densities per internal unit to densities per world unit, at a point of the scene's frame. For NDC an internal
    /// length is that along the reference camera's axis.
    #[must_use]
    pub fn per_world_unit(&self, x: DVec3) -> f64 {
        match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => 1.0 / self.radius,
            SpaceKind::Ndc => {
                let z = -self.reference.pose.to_camera(x).z;
                // dZ/dz = 2 near / z^2.
                2.0 * self.reference.ndc.near / (z * z)
            }
        }
    }

    /// Internal positions `x` `[3][n]` to grid positions `out` `[3][n]` in `[0, 1]`.
    ///
    /// # Panics
    /// When `x` and `out` differ in length.
    pub fn grid_positions(&self, simd: Simd, x: &[f32], out: &mut [f32]) {
        let (scale, shift) = match self.kind {
            SpaceKind::Box | SpaceKind::Ndc => {
                out.copy_from_slice(x);
                (0.5, 0.5)
            }
            SpaceKind::Contracted => {
                contract_batch(simd, Norm::Max, x, out).expect("both hold three rows of one length");
                (0.25, 0.5)
            }
        };
        for v in out {
            *v = *v * scale + shift;
        }
    }

    /// Internal coordinates of a grid position.
    #[must_use]
    pub fn internal_of_grid(&self, u: [f32; 3]) -> [f32; 3] {
        match self.kind {
            SpaceKind::Box | SpaceKind::Ndc => u.map(|u| 2.0 * u - 1.0),
            SpaceKind::Contracted => inv_contract(Norm::Max, u.map(|u| 4.0 * u - 2.0)),
        }
    }

    /// Gradient with respect to a point of the scene's frame, up to a positive factor, from that with respect to its grid
    /// position; `p` are its internal coordinates.
    #[must_use]
    pub fn world_gradient(&self, p: [f32; 3], grid_bar: [f32; 3]) -> DVec3 {
        let (p, grid_bar) = (p.map(f64::from), grid_bar.map(f64::from));
        match self.kind {
            SpaceKind::Box => DVec3::from(grid_bar),
            SpaceKind::Contracted => {
                let mut bar = [0.0; 3];
                contract_backward(Norm::Max, p, grid_bar, &mut bar);
                DVec3::from(bar)
            }
            SpaceKind::Ndc => {
                let ndc = &self.reference.ndc;
                let mut bar = [0.0; 3];
                ndc.point_backward(ndc.inv_point(p, 1e-3), grid_bar, &mut bar);
                self.reference.pose.r * DVec3::new(bar[0], -bar[1], -bar[2])
            }
        }
    }

    /// The part of the scene's frame worth exporting: the box, the inner cube of an unbounded scene, or what lies between
    /// the near plane of NDC and ten times its depth.
    #[must_use]
    pub fn world_bounds(&self) -> [[f64; 3]; 2] {
        match self.kind {
            SpaceKind::Box | SpaceKind::Contracted => self.world_box([[-1.0; 3], [1.0; 3]]),
            SpaceKind::Ndc => self.world_box([[-1.0; 3], [1.0, 1.0, (1.0 - 2.0 / NDC_EXPORT_DEPTH) as f32]]),
        }
    }

    /// A box of the scene's frame around a box of internal coordinates.
    #[must_use]
    pub fn world_box(&self, inner: [[f32; 3]; 2]) -> [[f64; 3]; 2] {
        let [low, high] = inner;
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in 0..8 {
            let p = [0, 1, 2].map(|a| if corner >> a & 1 == 1 { high[a] } else { low[a] });
            let x = self.world_point(p);
            (min, max) = (min.min(x), max.max(x));
        }
        [min.to_array(), max.to_array()]
    }
}

impl Reference {
    fn none() -> Self {
        Self {
            pose: Pose { r: DMat3::IDENTITY, c: DVec3::ZERO },
            ndc: Ndc { scale: [1.0; 2], shift: [0.0; 2], near: 1.0 },
        }
    }
}
