//! The chain rule of one vector of Gaussians: from what the picture says of ellipses back to raw parameters.

use float_core::Vector;

use super::block::{Block, Lens, RHO2_MIN, dot};

/// Gradient of the loss with respect to what the rasteriser sees.
pub(crate) struct FootprintBar<V> {
    pub(crate) uv: [V; 2],
    pub(crate) conic: [V; 3],
    pub(crate) o_eff: V,
    /// Of the depth `z`.
    pub(crate) z: V,
}

/// Gradient with respect to raw parameters, and to the camera-space point for poses.
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
        let [aa, bb, cc] = self.conic;
        // V = -Q G Q, Q the conic and G its gradient, both symmetric.
        let (g00, g01, g11) = (bar.conic[0], half * bar.conic[1], bar.conic[2]);
        let (m00, m01) = (g00 * aa + g01 * bb, g00 * bb + g01 * cc);
        let (m10, m11) = (g01 * aa + g11 * bb, g01 * bb + g11 * cc);
        let mut v00 = -(aa * m00 + bb * m10);
        let mut v01 = -(aa * m01 + bb * m11);
        let mut v11 = -(bb * m01 + cc * m11);
        let mut o_bar = bar.o_eff;
        if lens.dims {
            o_bar = self.rho * bar.o_eff;
            // rho^2 = det0 / det; 0 slope at its floor.
            let rho2 = self.rho * self.rho;
            let free = (self.det0 * self.inv_det - V::splat(RHO2_MIN)).select_positive(V::splat(1.0), V::splat(0.0));
            let k = free * self.o * bar.o_eff * self.inv_det / (two * self.rho);
            let (a0, c0) = (self.cov[0] - lens.blur, self.cov[2] - lens.blur);
            v00 = v00 + k * (c0 - rho2 * self.cov[2]);
            v11 = v11 + k * (a0 - rho2 * self.cov[0]);
            v01 = v01 + k * self.cov[1] * (rho2 - V::splat(1.0));
        }
        let logit = self.o * (V::splat(1.0) - self.o) * o_bar;

        // A A^T: A_bar = 2 V A.
        let a_bar: [[V; 3]; 2] = [
            core::array::from_fn(|k| two * (v00 * self.a[0][k] + v01 * self.a[1][k])),
            core::array::from_fn(|k| two * (v01 * self.a[0][k] + v11 * self.a[1][k])),
        ];
        // A = T R diag(s).
        let rot = &self.rot;
        let t_bar: [[V; 3]; 2] = core::array::from_fn(|i| {
            let scaled: [V; 3] = core::array::from_fn(|k| a_bar[i][k] * self.s[k]);
            core::array::from_fn(|row| dot(rot[row], scaled))
        });
        // Before scales: (T^T A_bar)[row][k].
        let m_bar: [[V; 3]; 3] = core::array::from_fn(|row| {
            core::array::from_fn(|k| self.t[0][row].mul_add(a_bar[0][k], self.t[1][row] * a_bar[1][k]))
        });
        let log_scale = core::array::from_fn(|k| {
            self.s[k] * dot([rot[0][k], rot[1][k], rot[2][k]], [m_bar[0][k], m_bar[1][k], m_bar[2][k]])
        });
        let r: [[V; 3]; 3] = core::array::from_fn(|row| core::array::from_fn(|k| m_bar[row][k] * self.s[k]));
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
        let mean = core::array::from_fn(|k| dot([lens.r[0][k], lens.r[1][k], lens.r[2][k]], p_bar));
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
        core::array::from_fn(|k| (unit[k] - self.q[k] * along) * self.inv_norm)
    }
}
