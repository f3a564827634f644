//! Normalised device coordinates: a forward-facing scene as the cube `[-1, 1]^3`.
//!
//! Points are in the axes of a reference camera, **GL** (x right, y up, z backward: what is seen has `z < 0`), and in
//! front of its near plane `z = -near`. NDC depth `Z` is affine in disparity: `-1` at the near plane, `1` at infinity.
//!
//! Source: Mildenhall et al., "NeRF", 2020, appendix C, with one focal length an axis and any principal point.
//!
//! ```
//! use render_core::ndc::Ndc;
//!
//! let ndc = Ndc::centred(64, 48, 60.0, 1.0_f64);
//! let p = ndc.point([0.3, -0.2, -4.0]);
//! assert_eq!(p[2], 1.0 - 2.0 / 4.0);
//! let back = ndc.inv_point(p, 1e-6);
//! assert!((back[0] - 0.3).abs() < 1e-12 && (back[2] + 4.0).abs() < 1e-12);
//! ```

use crate::{camera::Camera, real::Real};

/// Steepest ray, cosine to the viewing direction, that NDC still takes: those closer to the image plane, or facing
/// backward, have no NDC ray.
pub const MIN_COS: f64 = 1e-3;

/// The map of one reference camera and near plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ndc<T> {
    /// `2 fx / width`, `2 fy / height`.
    pub scale: [T; 2],
    /// `2 cx / width - 1`, `1 - 2 cy / height`: 0 for a centred principal point.
    pub shift: [T; 2],
    /// Distance of the near plane, world units, `> 0`.
    pub near: T,
}

/// A ray in NDC: points are `o + s d` with `s` in `[0, 1)`; `s = 0` at the near plane, `s -> 1` at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NdcRay<T> {
    /// Origin, on `Z = -1`.
    pub o: [T; 3],
    /// Direction, **not** of unit length: `d[2] = 2`.
    pub d: [T; 3],
}

impl<T: Real> Ndc<T> {
    /// One focal length (pixels), principal point in the centre.
    #[must_use]
    pub fn centred(width: u32, height: u32, focal: T, near: T) -> Self {
        let scale = [width, height].map(|size| T::TWO * focal / T::of(f64::from(size)));
        Self { scale, shift: [T::ZERO; 2], near }
    }

    /// The frustum of a camera; its lens and pose don't matter.
    #[must_use]
    pub fn of_camera(camera: &Camera, near: f64) -> Self {
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        Self {
            scale: [T::of(2.0 * camera.fx / w), T::of(2.0 * camera.fy / h)],
            shift: [T::of(2.0 * camera.cx / w - 1.0), T::of(1.0 - 2.0 * camera.cy / h)],
            near: T::of(near),
        }
    }

    /// A point (GL axes, `z < 0`) in NDC. Not finite at `z = 0`; mirrored behind the camera: test `z < 0` before.
    #[must_use]
    pub fn point(&self, x: [T; 3]) -> [T; 3] {
        [
            -self.scale[0] * x[0] / x[2] + self.shift[0],
            -self.scale[1] * x[1] / x[2] + self.shift[1],
            T::ONE + T::TWO * self.near / x[2],
        ]
    }

    /// Jacobian of [`Ndc::point`], `[i][j] = d p[i] / d x[j]`.
    #[must_use]
    pub fn point_jacobian(&self, x: [T; 3]) -> [[T; 3]; 3] {
        let (o, iz) = (T::ZERO, T::ONE / x[2]);
        let [a, b] = [-self.scale[0] * iz, -self.scale[1] * iz];
        [[a, o, -a * x[0] * iz], [o, b, -b * x[1] * iz], [o, o, -T::TWO * self.near * iz * iz]]
    }

    /// Gradient of [`Ndc::point`]: adds `J^T p_bar` to `x_bar`.
    pub fn point_backward(&self, x: [T; 3], p_bar: [T; 3], x_bar: &mut [T; 3]) {
        let add = crate::real::mat_t_vec(&self.point_jacobian(x), p_bar);
        for (x_bar, add) in x_bar.iter_mut().zip(add) {
            *x_bar += add;
        }
    }

    /// The point (GL axes) of NDC coordinates.
    ///
    /// `Z` above `1 - gap` counts as that, which caps the depth at `2 near / gap`: 1e-3 suits `f32` losses.
    #[must_use]
    pub fn inv_point(&self, p: [T; 3], gap: T) -> [T; 3] {
        let z = T::TWO * self.near / (p[2].min(T::ONE - gap) - T::ONE);
        [-(p[0] - self.shift[0]) * z / self.scale[0], -(p[1] - self.shift[1]) * z / self.scale[1], z]
    }

    /// Gradient of [`Ndc::inv_point`]: adds `J^T x_bar` to `p_bar`. Where `Z` was held, it has no derivative.
    pub fn inv_point_backward(&self, p: [T; 3], gap: T, x_bar: [T; 3], p_bar: &mut [T; 3]) {
        let z = T::TWO * self.near / (p[2].min(T::ONE - gap) - T::ONE);
        let per_unit = |a: usize| -x_bar[a] / self.scale[a];
        p_bar[0] += per_unit(0) * z;
        p_bar[1] += per_unit(1) * z;
        let z_bar = x_bar[2] + per_unit(0) * (p[0] - self.shift[0]) + per_unit(1) * (p[1] - self.shift[1]);
        if p[2] < T::ONE - gap {
            // dz/dZ = -2 near / (Z - 1)^2
            p_bar[2] += -z_bar * z * z / (T::TWO * self.near);
        }
    }

    /// The ray `o + t d` (GL axes, any length of `d`) in NDC.
    ///
    /// Its origin is moved to the near plane first. `None` where `d` is within [`MIN_COS`] of the image plane or faces
    /// backward. View directions for colour must be taken before this.
    #[must_use]
    pub fn ray(&self, o: [T; 3], d: [T; 3]) -> Option<NdcRay<T>> {
        let length = crate::real::dot(d, d).sqrt();
        // False for NaN as well.
        let forward = d[2] < -T::of(MIN_COS) * length;
        if !forward {
            return None;
        }
        let n = self.near;
        let shift = -(n + o[2]) / d[2];
        let lateral = |a: usize| {
            let at_near = (o[a] + shift * d[a]) / n; // -o'_x / o'_z
            let origin = self.scale[a] * at_near + self.shift[a];
            (origin, -self.scale[a] * (d[a] / d[2] + at_near))
        };
        let ((ox, dx), (oy, dy)) = (lateral(0), lateral(1));
        Some(NdcRay { o: [ox, oy, -T::ONE], d: [dx, dy, T::TWO] })
    }

    /// Gradient of [`Ndc::ray`]: adds to `o_bar` and `d_bar`; nothing where there is no NDC ray.
    ///
    /// The third coordinates of the NDC ray are constants, so `ray_bar.o[2]` and `ray_bar.d[2]` don't matter.
    pub fn ray_backward(&self, o: [T; 3], d: [T; 3], ray_bar: &NdcRay<T>, o_bar: &mut [T; 3], d_bar: &mut [T; 3]) {
        if self.ray(o, d).is_none() {
            return;
        }
        let shift = -(self.near + o[2]) / d[2];
        let mut shift_bar = T::ZERO;
        for a in 0..2 {
            let at_near_bar = self.scale[a] * (ray_bar.o[a] - ray_bar.d[a]) / self.near;
            o_bar[a] += at_near_bar;
            shift_bar += at_near_bar * d[a];
            d_bar[a] += at_near_bar * shift - self.scale[a] * ray_bar.d[a] / d[2];
            d_bar[2] += self.scale[a] * ray_bar.d[a] * d[a] / (d[2] * d[2]);
        }
        o_bar[2] += -shift_bar / d[2];
        d_bar[2] += -shift_bar * shift / d[2];
    }

    /// NDC parameter `s` of the point at `t` along `o + t d`: `1 + near / z`.
    #[must_use]
    pub fn s_at(&self, o_z: T, d_z: T, t: T) -> T {
        T::ONE + self.near / (o_z + t * d_z)
    }

    /// Gradient of [`Ndc::s_at`]: adds to those of `o_z`, `d_z` and `t`.
    #[expect(clippy::too_many_arguments, reason = "three inputs, the gradient that comes and those that go")]
    pub fn s_at_backward(&self, o_z: T, d_z: T, t: T, s_bar: T, o_z_bar: &mut T, d_z_bar: &mut T, t_bar: &mut T) {
        let z = o_z + t * d_z;
        let z_bar = -self.near / (z * z) * s_bar;
        *o_z_bar += z_bar;
        *d_z_bar += t * z_bar;
        *t_bar += d_z * z_bar;
    }

    /// The `t` along `o + t d` of NDC parameter `s < 1`.
    #[must_use]
    pub fn t_at(&self, o_z: T, d_z: T, s: T) -> T {
        (-self.near / (T::ONE - s) - o_z) / d_z
    }

    /// Gradient of [`Ndc::t_at`]: adds to those of `o_z`, `d_z` and `s`.
    #[expect(clippy::too_many_arguments, reason = "three inputs, the gradient that comes and those that go")]
    pub fn t_at_backward(&self, o_z: T, d_z: T, s: T, t_bar: T, o_z_bar: &mut T, d_z_bar: &mut T, s_bar: &mut T) {
        let z_bar = t_bar / d_z;
        *o_z_bar += -z_bar;
        *d_z_bar += -z_bar * self.t_at(o_z, d_z, s);
        let left = T::ONE - s;
        *s_bar += -z_bar * self.near / (left * left);
    }
}
