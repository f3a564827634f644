//! Derivatives of projection and of undistortion.
//!
//! The inverse is differentiated through the implicit function theorem, never through the Newton steps.

use float_core::m64;
use glam::{DMat2, DMat3, DVec2, DVec3};

use super::lens::Lens;
use super::prepared::{Model, Prepared};
use super::{distortion::Distortion, fov, polynomial::evaluate};
use crate::pose::Pose;
use crate::ray::{RayBar, normalise_backward};
use core::ops::AddAssign;

/// Gradient with respect to the intrinsics and the lens of a camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraBar {
    /// Of `(fx, fy)`.
    pub f: DVec2,
    /// Of `(cx, cy)`.
    pub c: DVec2,
    /// Of the coefficients of the lens, in the order of [`Lens::parameters`]; unused places stay 0.
    pub lens: [f64; 8],
}

impl AddAssign for CameraBar {
    fn add_assign(&mut self, other: Self) {
        self.f += other.f;
        self.c += other.c;
        for (lens, other) in self.lens.iter_mut().zip(other.lens) {
            *lens += other;
        }
    }
}

/// Gradient with respect to a camera-to-world [`Pose`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseBar {
    /// Of the nine entries of the rotation, as if they were free; see [`PoseBar::twist`].
    pub r: DMat3,
    /// Of the camera centre, loss / world unit.
    pub c: DVec3,
}

impl PoseBar {
    /// Nothing yet.
    pub const ZERO: Self = Self { r: DMat3::ZERO, c: DVec3::ZERO };

    /// Gradient with respect to a twist `xi = (omega, v)`, rotation first, at `xi = 0`, where the twist moves the camera in the
    /// world: `pose' = exp(xi) pose`, that is `r' = exp(omega) r`, `c' = exp(omega) c + V(omega) v`.
    ///
    /// For a twist that is not 0 take the entries of the matrix, `r` and `c`, to the twin of the exponential map.
    #[must_use]
    pub fn twist(&self, pose: &Pose) -> [f64; 6] {
        let turned = |v: DVec3, v_bar: DVec3| v.cross(v_bar);
        let omega = turned(pose.r.x_axis, self.r.x_axis)
            + turned(pose.r.y_axis, self.r.y_axis)
            + turned(pose.r.z_axis, self.r.z_axis)
            + turned(pose.c, self.c);
        [omega.x, omega.y, omega.z, self.c.x, self.c.y, self.c.z]
    }
}

impl Default for PoseBar {
    /// [`PoseBar::ZERO`]; the default of a matrix alone is the identity.
    fn default() -> Self {
        Self::ZERO
    }
}

impl AddAssign for PoseBar {
    fn add_assign(&mut self, other: Self) {
        self.r += other.r;
        self.c += other.c;
    }
}

/// Rays of one fixed part of [`Prepared::rays_backward`]'s sum.
const RAYS: usize = 256;

impl Prepared {
    /// Pixel of a point in camera axes, and the columns `d pixel / d X, Y, Z` of its Jacobian.
    ///
    /// `None` where [`Prepared::project_from_camera`] gives none.
    #[must_use]
    pub fn projection_jacobian(&self, x_camera: DVec3) -> Option<(DVec2, [DVec2; 3])> {
        let pixel = self.project_from_camera(x_camera)?;
        let q = self.plane(x_camera)?;
        let f = DVec2::new(self.camera.fx, self.camera.fy);
        let lens = self.lens_jacobian(q);
        Some((pixel, self.plane_jacobian(x_camera, q).map(|column| f * (lens * column))))
    }

    /// Gradients of [`Prepared::project_from_camera`]: adds `pixel_bar` times its derivatives to `x_camera_bar` and
    /// `camera_bar`. A point without a pixel adds nothing.
    pub fn project_backward(
        &self,
        x_camera: DVec3,
        pixel_bar: DVec2,
        x_camera_bar: &mut DVec3,
        camera_bar: &mut CameraBar,
    ) {
        let Some((_, jacobian)) = self.projection_jacobian(x_camera) else { return };
        let Some(q) = self.plane(x_camera) else { return };
        *x_camera_bar += DVec3::from_array(jacobian.map(|column| column.dot(pixel_bar)));
        camera_bar.f += self.distort(q) * pixel_bar;
        camera_bar.c += pixel_bar;
        let d_bar = DVec2::new(self.camera.fx, self.camera.fy) * pixel_bar;
        self.lens_backward(q, d_bar, &mut camera_bar.lens);
    }

    /// Ideal plane coordinates of a pixel, as [`Prepared::undistort`], and their Jacobian `d q / d pixel`.
    ///
    /// `None` where the lens has no preimage, or its map is singular.
    #[must_use]
    pub fn undistort_jacobian(&self, pixel: DVec2) -> Option<(DVec2, DMat2)> {
        let q = self.undistort(pixel)?;
        let lens = self.lens_jacobian(q);
        if lens.determinant().abs() < 1e-12 {
            return None;
        }
        let inverse = lens.inverse();
        Some((q, DMat2::from_cols(inverse.x_axis / self.camera.fx, inverse.y_axis / self.camera.fy)))
    }

    /// Unit direction of a pixel in camera axes, and the columns `d direction / d pixel`.
    #[must_use]
    pub fn direction_jacobian(&self, pixel: DVec2) -> Option<(DVec3, [DVec3; 2])> {
        let (q, dq) = self.undistort_jacobian(pixel)?;
        let d = self.direction_of(q);
        let lift = |e: DVec2| match self.model {
            Model::Tangent(_) | Model::Fov(_) => {
                // d = v / |v| with v = (q, 1).
                let tangent = e.extend(0.0);
                (tangent - d * d.dot(tangent)) * d.z
            }
            Model::Equidistant(_) => {
                // d = (sinc(theta) q, cos theta), theta = |q|.
                let theta2 = q.length_squared();
                let (sinc, derivative) = sinc_and_derivative(theta2);
                let along = q.dot(e);
                (e * sinc + q * (2.0 * derivative * along)).extend(-sinc * along)
            }
        };
        Some((d, [lift(dq.x_axis), lift(dq.y_axis)]))
    }

    /// Gradients of [`Prepared::direction`]: adds those of intrinsics and lens, for a given pixel, to `camera_bar`, and
    /// returns that of the pixel.
    ///
    /// A pixel without a ray, and one where the lens map is singular, gives nothing.
    pub fn direction_backward(&self, pixel: DVec2, d_bar: DVec3, camera_bar: &mut CameraBar) -> DVec2 {
        let Some((_, columns)) = self.direction_jacobian(pixel) else { return DVec2::ZERO };
        let Some(q) = self.undistort(pixel) else { return DVec2::ZERO };
        let c = &self.camera;
        let f = DVec2::new(c.fx, c.fy);
        let pixel_bar = DVec2::new(columns[0].dot(d_bar), columns[1].dot(d_bar));
        // The lens map takes q to (pixel - c) / f: the gradient of that quotient is f times the pixel's.
        let quotient = (pixel - DVec2::new(c.cx, c.cy)) / f;
        camera_bar.c += -pixel_bar;
        camera_bar.f += -pixel_bar * quotient;
        // Coefficients move the quotient of a fixed q, so they move q the other way (implicit function theorem).
        self.lens_backward(q, -pixel_bar * f, &mut camera_bar.lens);
        pixel_bar
    }

    /// Gradients of [`Prepared::ray`]: adds those of the pose to `pose_bar` and those of intrinsics and lens to `camera_bar`,
    /// and returns that of the pixel.
    ///
    /// The view direction of a pixel is the direction of its ray: add its gradient to [`RayBar::d`]. A pixel without a ray gives
    /// nothing.
    pub fn ray_backward(
        &self,
        pixel: DVec2,
        ray_bar: &RayBar,
        pose_bar: &mut PoseBar,
        camera_bar: &mut CameraBar,
    ) -> DVec2 {
        let Some(d) = self.direction(pixel) else { return DVec2::ZERO };
        let r = self.camera.pose.r;
        let turned_bar = normalise_backward(r * d, ray_bar.d);
        pose_bar.c += ray_bar.o;
        pose_bar.r += DMat3::from_cols(turned_bar * d.x, turned_bar * d.y, turned_bar * d.z);
        self.direction_backward(pixel, r.transpose() * turned_bar, camera_bar)
    }

    /// [`Prepared::ray_backward`] of many rays of this camera, summed.
    ///
    /// # Shapes and units
    /// * `pixels`, `ray_bars` `[n]`
    ///
    /// # Numerics
    /// Sums of each 256 rays in index order, and these in index order: the same bits with any number of threads,
    /// with the feature `rayon` and without.
    ///
    /// # Panics
    /// When the lengths differ.
    pub fn rays_backward(
        &self,
        pixels: &[DVec2],
        ray_bars: &[RayBar],
        pose_bar: &mut PoseBar,
        camera_bar: &mut CameraBar,
    ) {
        assert_eq!(pixels.len(), ray_bars.len(), "one gradient a pixel");
        let part = |pixels: &[DVec2], bars: &[RayBar]| {
            let (mut pose_bar, mut camera_bar) = (PoseBar::ZERO, CameraBar::default());
            for (&pixel, bar) in pixels.iter().zip(bars) {
                self.ray_backward(pixel, bar, &mut pose_bar, &mut camera_bar);
            }
            (pose_bar, camera_bar)
        };
        let mut add = |(pose, camera): (PoseBar, CameraBar)| {
            *pose_bar += pose;
            *camera_bar += camera;
        };
        #[cfg(feature = "rayon")]
        {
            use alloc::vec::Vec;
            use rayon::prelude::*;
            let parts = pixels.par_chunks(RAYS).zip(ray_bars.par_chunks(RAYS));
            let parts: Vec<_> = parts.map(|(pixels, bars)| part(pixels, bars)).collect();
            parts.into_iter().for_each(&mut add);
        }
        #[cfg(not(feature = "rayon"))]
        for (pixels, bars) in pixels.chunks(RAYS).zip(ray_bars.chunks(RAYS)) {
            add(part(pixels, bars));
        }
    }

    /// `d(distorted) / d(ideal)`.
    fn lens_jacobian(&self, q: DVec2) -> DMat2 {
        match self.model {
            Model::Tangent(d) | Model::Equidistant(d) => d.jacobian(q),
            Model::Fov(omega) => {
                let (g, dg) = fov::factor(omega, q.length_squared());
                let column = |e: DVec2| e * g + q * (2.0 * dg * q.dot(e));
                DMat2::from_cols(column(DVec2::X), column(DVec2::Y))
            }
        }
    }

    /// Adds the gradient of the lens coefficients, in the order of [`Lens::parameters`].
    fn lens_backward(&self, q: DVec2, d_bar: DVec2, lens_bar: &mut [f64; 8]) {
        let (Model::Tangent(d) | Model::Equidistant(d)) = self.model else {
            if let Lens::Fov { omega } = self.camera.lens {
                lens_bar[0] += q.dot(d_bar) * fov::factor_omega(omega, q.length_squared());
            }
            return;
        };
        let mut bar = Distortion { num: [0.0; 4], den: [0.0; 3], p: [0.0; 2], s: [0.0; 2] };
        d.parameters_backward(q, d_bar, &mut bar);
        let mut add = |at: usize, values: &[f64]| {
            for (to, value) in lens_bar[at..].iter_mut().zip(values) {
                *to += value;
            }
        };
        match self.camera.lens {
            Lens::Perspective { .. } => {
                add(0, &bar.num[..3]);
                add(3, &bar.den);
                add(6, &bar.p);
            }
            Lens::Fisheye { .. } => add(0, &bar.num),
            Lens::ThinPrismFisheye { .. } => {
                add(0, &bar.num);
                add(4, &bar.p);
                add(6, &bar.s);
            }
            Lens::Fov { .. } => {}
        }
    }

    /// Columns `d q / d X, Y, Z`.
    fn plane_jacobian(&self, x: DVec3, q: DVec2) -> [DVec2; 3] {
        match self.model {
            Model::Tangent(_) | Model::Fov(_) => {
                let inverse = 1.0 / x.z;
                [DVec2::new(inverse, 0.0), DVec2::new(0.0, inverse), -q * inverse]
            }
            Model::Equidistant(_) => {
                // q = k (X, Y), k = theta / rho; `derivative` is (dk/drho) / rho.
                let xy = x.truncate();
                let (rho2, r2) = (xy.length_squared(), x.length_squared());
                let s2 = rho2 / (x.z * x.z);
                let (k, derivative) = if x.z > 0.0 && s2 < 1e-3 {
                    // atan(s) / s = 1 - s^2/3 + s^4/5 - ...: the closed form cancels near the axis.
                    let k = evaluate(&[1.0, -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0], s2) / x.z;
                    let derivative = evaluate(&[-1.0 / 3.0, 2.0 / 5.0, -3.0 / 7.0, 4.0 / 9.0, -5.0 / 11.0], s2);
                    (k, 2.0 * derivative / (x.z * x.z * x.z))
                } else {
                    let rho = m64::sqrt(rho2);
                    let k = m64::atan2(rho, x.z) / rho;
                    (k, (x.z / r2 - k) / rho2)
                };
                [DVec2::new(k, 0.0) + xy * (derivative * x.x), DVec2::new(0.0, k) + xy * (derivative * x.y), -xy / r2]
            }
        }
    }
}

/// `sin(theta) / theta` and its derivative with respect to `theta^2`.
fn sinc_and_derivative(theta2: f64) -> (f64, f64) {
    if theta2 < 1e-3 {
        let sinc = evaluate(&[1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0], theta2);
        let derivative = evaluate(&[-1.0 / 6.0, 1.0 / 60.0, -1.0 / 1680.0, 1.0 / 90_720.0], theta2);
        return (sinc, derivative);
    }
    let theta = m64::sqrt(theta2);
    let (sin, cos) = m64::sin_cos(theta);
    (sin / theta, (cos - sin / theta) / (2.0 * theta2))
}
