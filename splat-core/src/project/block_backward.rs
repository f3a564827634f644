//! The chain rule of one vector of Gaussians: from what the picture says of ellipses back to raw parameters.
//!
//! Letters as in `block`, with `Q` the conic and `a_k` the columns of `A`. Of a needle, `Q a_k` along its length is what two large
//! products leave; as `(blur a_k + sum_j perp(a_j) (a_j x a_k)) / det` it is a sum of what is left, `perp(a) = (-a_y, a_x)`. Errors
//! grow as the ratio of a footprint's axes, not as its square.

use float_core::Vector;

use super::block::{Block, Lens, RHO2_MIN, cross, dot};

/// Gradient of the loss with respect to what the rasteriser sees.
pub(crate) struct FootprintBar<V> {
    pub(crate) uv: [V; 2],
    pub(crate) conic: [V; 3],
    pub(crate) o_eff: V,
    /// Of the depth `z`.
    pub(crate) z: V,
}

/// Gradient with respect to raw parameters. There is none with respect to the camera: poses are given.
pub(crate) struct RawBar<V> {
    pub(crate) mean: [V; 3],
    pub(crate) log_scale: [V; 3],
    pub(crate) wxyz: [V; 4],
    pub(crate) logit: V,
}

impl<V: Vector> Block<V> {
    #[inline(always)]
    pub(crate) fn backward(&self, lens: &Lens<V>, bar: &FootprintBar<V>) -> RawBar<V> {
        let (two, half) = (V::splat(2.0), V::splat(0.5));
        // G: gradient of the conic Q, both symmetric.
        let (g00, g01, g11) = (bar.conic[0], half * bar.conic[1], bar.conic[2]);
        // N / det and W = Q A = (blur A + N) / det, N the adjugate of A A^T times A.
        let thin = each!(3, |k| self.normal[k] * self.inv_det);
        let n = [cross(self.a[1], thin), cross(thin, self.a[0])];
        let round = lens.blur * self.inv_det;
        let w: [[V; 3]; 2] = each!(2, |i| each!(3, |k| round.mul_add(self.a[i][k], n[i][k])));
        // A_bar = Q U. Of the conic Q = 1 / (A A^T + blur): U = -2 G Q A.
        let mut u: [[V; 3]; 2] = [
            each!(3, |k| -two * g00.mul_add(w[0][k], g01 * w[1][k])),
            each!(3, |k| -two * g01.mul_add(w[0][k], g11 * w[1][k])),
        ];
        let mut o_bar = bar.o_eff;
        if lens.dims {
            o_bar = self.rho * bar.o_eff;
            // Of rho^2 = det0 / det: rho_bar rho (N / det0 - Q A), which is Q N blur rho_bar / (rho det). No slope at its floor.
            let free = self.det0 * self.inv_det - V::splat(RHO2_MIN);
            let k = free.select_positive(self.o * bar.o_eff * lens.blur / self.rho, V::splat(0.0));
            u = each!(2, |i| each!(3, |j| k.mul_add(n[i][j], u[i][j])));
        }
        let logit = self.o * (V::splat(1.0) - self.o) * o_bar;

        // A = T R diag(s): a column times its gradient is that of the logarithm of its scale.
        let log_scale = each!(3, |k| w[0][k].mul_add(u[0][k], w[1][k] * u[1][k]));
        // A_bar diag(s), through a Cholesky decomposition of the covariance.
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

        // T = J R: rows i of J are f_i / z (e_i - slope_i e_z).
        let mut p_bar = [V::splat(0.0); 3];
        for i in 0..2 {
            let along = dot(t_bar[i], lens.r[i]);
            let deep = dot(t_bar[i], lens.r[2]);
            let j = lens.f[i] * self.inv_z;
            // d/dz of f / z, and of -f slope / z with the slope held; the slope itself moves with the point where it is free.
            let slope_bar = -j * deep * self.free[i];
            p_bar[2] = p_bar[2] - j * self.inv_z * (along - self.slope[i] * deep);
            // uv = f p / z + c, never clamped.
            let at_bar = slope_bar + lens.f[i] * bar.uv[i];
            let at = self.p[i] * self.inv_z;
            p_bar[i] = p_bar[i] + at_bar * self.inv_z;
            p_bar[2] = p_bar[2] - at_bar * at * self.inv_z;
        }
        p_bar[2] = p_bar[2] + bar.z;
        let mean = each!(3, |k| dot([lens.r[0][k], lens.r[1][k], lens.r[2][k]], p_bar));
        RawBar { mean, log_scale, wxyz, logit }
    }

    /// Through the rotation and the normalisation of its quaternion.
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
