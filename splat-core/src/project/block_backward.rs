//! Backward pass of one SIMD vector of Gaussians: from gradients of projected Gaussians to gradients of raw parameters.
//!
//! Letters as in `block`, with `Q` the conic and `a_k` the columns of `A`. For elongated Gaussians `Q a_k` cancels. The form
//! `(blur a_k + sum_j perp(a_j) (a_j x a_k)) / det`, with `perp(a) = (-a_y, a_x)`, avoids the cancellation: errors grow with the
//! ratio of the axes, not with its square.

use float_core::Vector;

use super::block::{Block, Camera, RHO2_MIN, cross, dot};

/// Gradient with respect to the projected Gaussians.
pub(crate) struct ProjectedBar<V> {
    pub(crate) uv: [V; 2],
    pub(crate) conic: [V; 3],
    pub(crate) o_eff: V,
    /// With respect to the depth `z`.
    pub(crate) z: V,
}

/// Gradient with respect to raw parameters.
pub(crate) struct RawBar<V> {
    pub(crate) mean: [V; 3],
    pub(crate) log_scale: [V; 3],
    pub(crate) wxyz: [V; 4],
    pub(crate) logit: V,
    /// With respect to the centre in camera axes, and to `T = J R`: the camera's gradient is made of them.
    pub(crate) p: [V; 3],
    pub(crate) t: [[V; 3]; 2],
}

impl<V: Vector> Block<V> {
    #[inline(always)]
    pub(crate) fn backward(&self, camera: &Camera<V>, bar: &ProjectedBar<V>) -> RawBar<V> {
        let (two, half) = (V::splat(2.0), V::splat(0.5));
        // G: gradient with respect to the conic Q; both are symmetric.
        let (g00, g01, g11) = (bar.conic[0], half * bar.conic[1], bar.conic[2]);
        // N / det and W = Q A = (blur A + N) / det, N the adjugate of A A^T times A.
        let thin = each!(3, |k| self.normal[k] * self.inv_det);
        let n = [cross(self.a[1], thin), cross(thin, self.a[0])];
        let round = camera.blur * self.inv_det;
        let w: [[V; 3]; 2] = each!(2, |i| each!(3, |k| round.mul_add(self.a[i][k], n[i][k])));
        // A_bar = Q U. The conic Q = (A A^T + blur)^-1 contributes U = -2 G Q A.
        let mut u: [[V; 3]; 2] = [
            each!(3, |k| -two * g00.mul_add(w[0][k], g01 * w[1][k])),
            each!(3, |k| -two * g01.mul_add(w[0][k], g11 * w[1][k])),
        ];
        let mut o_bar = bar.o_eff;
        if camera.dims {
            o_bar = self.rho * bar.o_eff;
            // rho^2 = det0 / det contributes rho_bar rho (N / det0 - Q A) = Q N blur rho_bar / (rho det); 0 where rho is clamped.
            let free = self.det0 * self.inv_det - V::splat(RHO2_MIN);
            let k = free.select_positive(self.o * bar.o_eff * camera.blur / self.rho, V::splat(0.0));
            u = each!(2, |i| each!(3, |j| k.mul_add(n[i][j], u[i][j])));
        }
        let logit = self.o * (V::splat(1.0) - self.o) * o_bar;

        // A = T R diag(s): a column times its gradient is the gradient with respect to log s.
        let log_scale = each!(3, |k| w[0][k].mul_add(u[0][k], w[1][k] * u[1][k]));
        // A_bar diag(s), with Q = (A A^T + blur)^-1 applied by a Cholesky decomposition.
        let inv_a = V::splat(1.0) / self.cov[0];
        let lower = self.cov[1] * inv_a;
        let scaled: [[V; 3]; 2] = {
            let second: [V; 3] = each!(3, |k| (u[1][k] - lower * u[0][k]) * self.conic[2]);
            [each!(3, |k| (u[0][k] * inv_a - lower * second[k]) * self.s[k]), each!(3, |k| second[k] * self.s[k])]
        };
        let rot = &self.rot;
        let t_bar: [[V; 3]; 2] = each!(2, |i| each!(3, |row| dot(rot[row], scaled[i])));
        let r: [[V; 3]; 3] =
            each!(3, |row| each!(3, |k| self.t[0][row].mul_add(scaled[0][k], self.t[1][row] * scaled[1][k])));
        let wxyz = self.quaternion(&r);

        // T = J R. Row i of J is f_i / z (e_i - tan_i e_z).
        let mut p_bar = [V::splat(0.0); 3];
        for i in 0..2 {
            let along = dot(t_bar[i], camera.r[i]);
            let deep = dot(t_bar[i], camera.r[2]);
            let j = camera.f[i] * self.inv_z;
            // d/dz of f / z and of -f tan / z at constant tan; tan itself depends on the point where it is not clamped.
            let tan_bar = -j * deep * self.free[i];
            p_bar[2] = p_bar[2] - j * self.inv_z * (along - self.tan[i] * deep);
            // uv = f p / z + c is never clamped.
            let at_bar = tan_bar + camera.f[i] * bar.uv[i];
            let at = self.p[i] * self.inv_z;
            p_bar[i] = p_bar[i] + at_bar * self.inv_z;
            p_bar[2] = p_bar[2] - at_bar * at * self.inv_z;
        }
        p_bar[2] = p_bar[2] + bar.z;
        let mean = each!(3, |k| dot([camera.r[0][k], camera.r[1][k], camera.r[2][k]], p_bar));
        RawBar { mean, log_scale, wxyz, logit, p: p_bar, t: t_bar }
    }

    /// Gradient with respect to the raw quaternion, given that with respect to the rotation matrix: through the normalisation, too.
    #[inline(always)]
    fn quaternion(&self, r: &[[V; 3]; 3]) -> [V; 4] {
        let two = V::splat(2.0);
        let [w, x, y, z] = self.q;
        let (vx, vy, vz) = (r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]);
        let (sxy, sxz, syz) = (r[0][1] + r[1][0], r[0][2] + r[2][0], r[1][2] + r[2][1]);
        let unit = [
            two * (x * vx + y * vy + z * vz),
            two * (w * vx + y * sxy + z * sxz - two * x * (r[1][1] + r[2][2])),
            two * (w * vy + x * sxy + z * syz - two * y * (r[0][0] + r[2][2])),
            two * (w * vz + x * sxz + y * syz - two * z * (r[0][0] + r[1][1])),
        ];
        let along = self.q.iter().zip(&unit).fold(V::splat(0.0), |sum, (q, u)| q.mul_add(*u, sum));
        each!(4, |k| (unit[k] - self.q[k] * along) * self.inv_norm)
    }
}
