//! Gradient with respect to the camera.
//!
//! The world-to-camera transform is perturbed on the left, `x' = exp(omega) x_camera + v`. A Gaussian contributes through its centre in
//! camera axes, through the rotation in `T = J R`, and through the direction of its colour: the camera's centre moves by `-R^T v`.

use float_core::Vector;

use super::block::{Block, Camera, cross, dot};
use super::block_backward::{ProjectedBar, RawBar};

/// Components of a [`CameraGradient`]: `omega` 3, `v` 3, `f` 2, `c` 2.
pub(super) const COMPONENTS: usize = 10;

/// Gradient of the loss with respect to the camera of a [`View`](crate::View).
///
/// The pose's gradient is that with respect to a twist `xi = (omega, v)` at 0, rotation first, which moves the world-to-camera transform
/// from the left: `x_camera' = exp(xi) x_camera`, to first order `x_camera + omega x x_camera + v`. `omega` is in radians about the
/// camera's axes, `v` in world units along them. To take a step, multiply: `r' = exp(omega) r`,
/// `t' = exp(omega) t + V(omega) v`, where `exp` and `V` are those of SE(3).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct CameraGradient {
    /// With respect to the twist `(omega, v)`: per radian and per world unit.
    pub xi: [f64; 6],
    /// With respect to the focal lengths `fx, fy`, per pixel.
    pub f: [f64; 2],
    /// With respect to the principal point `cx, cy`, per pixel.
    pub c: [f64; 2],
}

impl CameraGradient {
    /// The sum of two: of several clouds on one picture, or of pictures that share a camera.
    #[must_use]
    pub fn plus(&self, more: &Self) -> Self {
        let mut sum = self.components();
        sum.iter_mut().zip(more.components()).for_each(|(sum, x)| *sum += x);
        Self::from_components(sum)
    }

    fn components(&self) -> [f64; COMPONENTS] {
        let ([a, b, c, d, e, f], [fx, fy], [cx, cy]) = (self.xi, self.f, self.c);
        [a, b, c, d, e, f, fx, fy, cx, cy]
    }

    pub(super) fn from_components(components: [f64; COMPONENTS]) -> Self {
        let [a, b, c, d, e, f, fx, fy, cx, cy] = components;
        Self { xi: [a, b, c, d, e, f], f: [fx, fy], c: [cx, cy] }
    }
}

impl<V: Vector> Block<V> {
    /// Contribution of each lane to the camera's gradient. `through_direction` is the gradient with respect to the centres through the
    /// direction of their colours.
    #[inline(always)]
    pub(super) fn camera_backward(
        &self,
        camera: &Camera<V>,
        bar: &ProjectedBar<V>,
        raw_bar: &RawBar<V>,
        through_direction: [V; 3],
    ) -> [V; COMPONENTS] {
        let one = V::splat(1.0);
        // Row i of T_bar R^T.
        let s: [[V; 3]; 2] = each!(2, |i| each!(3, |k| dot(raw_bar.t[i], camera.r[k])));
        // B = J^T T_bar R^T, with row i of J equal to f_i / z (e_i - tan_i e_z).
        let [b0, b1]: [[V; 3]; 2] = each!(2, |i| each!(3, |k| camera.f[i] * self.inv_z * s[i][k]));
        let b2: [V; 3] = each!(3, |k| -(self.tan[0] * b0[k] + self.tan[1] * b1[k]));
        // The centre turns by omega x p. T becomes J [omega]x R: the antisymmetric part of B.
        let turned = cross(self.p, raw_bar.p);
        let omega = [turned[0] + (b2[1] - b1[2]), turned[1] + (b0[2] - b2[0]), turned[2] + (b1[0] - b0[1])];
        let v: [V; 3] = each!(3, |i| raw_bar.p[i] + dot(camera.r[i], through_direction));
        // uv = f p / z + c and T = f / z (..). Where tan is clamped, to (k - c) / f, it depends on f and c, too.
        let tan_bar: [V; 2] = each!(2, |i| -(camera.f[i] * self.inv_z) * s[i][2] * (one - self.free[i]) / camera.f[i]);
        let f: [V; 2] = each!(2, |i| {
            let centre = bar.uv[i] * self.p[i] * self.inv_z;
            centre + self.inv_z * (s[i][i] - self.tan[i] * s[i][2]) - tan_bar[i] * self.tan[i]
        });
        let c: [V; 2] = each!(2, |i| bar.uv[i] - tan_bar[i]);
        [omega[0], omega[1], omega[2], v[0], v[1], v[2], f[0], f[1], c[0], c[1]]
    }
}
