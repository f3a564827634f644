//! A camera with the limits of its lens worked out once.

use float_core::m64;
use glam::{DVec2, DVec3};

use super::{distortion::Distortion, fov, lens::Lens, parameters::Camera};
use crate::ray::Ray;

/// Rays this close to the image plane (cosine to the optical axis) count as not seen by a perspective lens.
pub(super) const MIN_COS: f64 = 1e-6;
/// Radius on the tangent plane that belongs to [`MIN_COS`].
const MAX_TANGENT: f64 = 1e6;

/// The ideal plane on which a lens is described.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Model {
    /// `(X / Z, Y / Z)`.
    Tangent(Distortion),
    /// `theta` times the direction of `(X, Y)`.
    Equidistant(Distortion),
    /// Tangent plane, arctangent radial map.
    Fov(f64),
}

/// A camera with the fold radius of its lens: what to use for whole images.
///
/// Made by [`Camera::prepare`]; the answers are those of the camera itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prepared {
    pub(super) camera: Camera,
    pub(super) model: Model,
    pub(super) r_max: f64,
}

impl Camera {
    /// The camera with the limits of its lens worked out: faster for more than a few points.
    #[must_use]
    pub fn prepare(&self) -> Prepared {
        Prepared::new(*self)
    }

    /// Pixel coordinates of a world point; `None` behind the camera and beyond the fold of the lens.
    ///
    /// The pixel may lie outside of the image.
    #[must_use]
    pub fn project(&self, x_world: DVec3) -> Option<DVec2> {
        self.prepare().project(x_world)
    }

    /// The ray through a pixel, `None` where the lens has none.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        self.prepare().ray(pixel)
    }

    /// Unit direction of the ray through a pixel, in camera axes; `None` where the lens has none.
    #[must_use]
    pub fn direction_in_camera(&self, pixel: DVec2) -> Option<DVec3> {
        self.prepare().direction(pixel)
    }
}

impl Prepared {
    fn new(camera: Camera) -> Self {
        let model = match (camera.lens, camera.lens.distortion()) {
            (Lens::Fov { omega }, _) => Model::Fov(omega),
            (Lens::Perspective { .. }, Some(d)) => Model::Tangent(d),
            (_, Some(d)) => Model::Equidistant(d),
            (_, None) => unreachable!("every lens but Fov is a polynomial"),
        };
        let r_max = match model {
            Model::Fov(_) => MAX_TANGENT,
            Model::Tangent(d) => d.fold_radius(MAX_TANGENT),
            Model::Equidistant(d) => d.fold_radius(core::f64::consts::PI),
        };
        Self { camera, model, r_max }
    }

    /// The camera this was made from.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Largest radius on the ideal plane that the lens maps one to one: `tan(angle)` for perspective lenses, the angle
    /// itself (radians) for fisheyes.
    #[must_use]
    pub fn fold_radius(&self) -> f64 {
        self.r_max
    }

    /// Pixel of a world point; see [`Camera::project`].
    #[must_use]
    pub fn project(&self, x_world: DVec3) -> Option<DVec2> {
        self.project_from_camera(self.camera.pose.to_camera(x_world))
    }

    /// Pixel of a point in camera axes.
    #[must_use]
    pub fn project_from_camera(&self, x_camera: DVec3) -> Option<DVec2> {
        let q = self.plane(x_camera)?;
        let d = self.distort(q);
        let c = &self.camera;
        let pixel = DVec2::new(c.fx * d.x + c.cx, c.fy * d.y + c.cy);
        pixel.is_finite().then_some(pixel)
    }

    /// The ray through a pixel; see [`Camera::ray`].
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<Ray> {
        let pose = &self.camera.pose;
        self.direction(pixel).map(|d| Ray { o: pose.c, d: (pose.r * d).normalize() })
    }

    /// Unit direction in camera axes; see [`Camera::direction_in_camera`].
    #[must_use]
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        self.undistort(pixel).map(|q| self.direction_of(q))
    }

    /// Radius of the cone of a pixel at unit distance from the camera, for unit directions.
    ///
    /// Mean distance to the rays of the neighbours at `+1` column and `+1` row, times `2 / sqrt(12)`: a disc with the
    /// variance of the square pixel (Barron et al., "Mip-NeRF", 2021, section 3.1). Neighbours outside of the image
    /// count like any other; where the lens has no ray for one, the other alone is used.
    #[must_use]
    pub fn cone_radius(&self, pixel: DVec2) -> Option<f64> {
        let q = self.undistort(pixel)?;
        // On the tangent plane v = (q, 1), so that a pinhole's pixels are equally large; a radius at distance 1 then
        // is the one at v over |v|.
        let lift = |q: DVec2| match self.model {
            Model::Fov(_) | Model::Tangent(_) => q.extend(1.0),
            Model::Equidistant(_) => self.direction_of(q),
        };
        let v = lift(q);
        let to = |step: DVec2| self.undistort(pixel + step).map(|n| (lift(n) - v).length() / v.length());
        let mean = match (to(DVec2::X), to(DVec2::Y)) {
            (Some(a), Some(b)) => 0.5 * (a + b),
            (a, b) => a.or(b)?,
        };
        Some(mean * (2.0 / m64::sqrt(12.0)))
    }

    /// Unit direction, camera axes, of a point of the ideal plane.
    pub(super) fn direction_of(&self, q: DVec2) -> DVec3 {
        match self.model {
            Model::Fov(_) | Model::Tangent(_) => q.extend(1.0).normalize(),
            Model::Equidistant(_) => {
                let theta = q.length();
                let (sin, cos) = m64::sin_cos(theta);
                // sin(theta) / theta is 1 to the last bit below 1e-8.
                let k = if theta < 1e-8 { 1.0 } else { sin / theta };
                DVec3::new(k * q.x, k * q.y, cos).normalize()
            }
        }
    }

    /// The lens map: distorted plane coordinates of ideal ones.
    pub(super) fn distort(&self, q: DVec2) -> DVec2 {
        match self.model {
            Model::Fov(omega) => q * fov::factor(omega, q.length_squared()).0,
            Model::Tangent(d) | Model::Equidistant(d) => d.apply(q),
        }
    }

    /// Ideal plane coordinates of a pixel: `(X/Z, Y/Z)` for perspective lenses, `theta` times the direction of
    /// `(X, Y)` for fisheyes. `None` where the lens has no preimage.
    #[must_use]
    pub fn undistort(&self, pixel: DVec2) -> Option<DVec2> {
        let c = &self.camera;
        let d = DVec2::new((pixel.x - c.cx) / c.fx, (pixel.y - c.cy) / c.fy);
        match self.model {
            Model::Fov(omega) => {
                let q = d * fov::inverse_factor(omega, d.length())?;
                (q.length() <= self.r_max).then_some(q)
            }
            Model::Tangent(m) | Model::Equidistant(m) => m.invert(d, self.r_max),
        }
    }

    /// Ideal plane coordinates of a point in camera axes.
    pub(super) fn plane(&self, x: DVec3) -> Option<DVec2> {
        let q = match self.model {
            Model::Fov(_) | Model::Tangent(_) => {
                // Also false for NaN.
                let before = x.z > MIN_COS * x.abs().max_element() && x.z.is_finite();
                before.then(|| DVec2::new(x.x / x.z, x.y / x.z))?
            }
            Model::Equidistant(_) => {
                if !x.is_finite() || x == DVec3::ZERO {
                    return None;
                }
                let rho = m64::hypot(x.x, x.y);
                let theta = m64::atan2(rho, x.z);
                if rho == 0.0 {
                    // Exactly behind the lens every direction of the plane would do.
                    return (x.z > 0.0).then_some(DVec2::ZERO);
                }
                DVec2::new(x.x / rho * theta, x.y / rho * theta)
            }
        };
        (q.length_squared() <= self.r_max * self.r_max).then_some(q)
    }
}
