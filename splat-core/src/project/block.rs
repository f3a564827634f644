//! Projects one SIMD vector of Gaussians. The forward and the backward pass share this.
//!
//! Letters: `p` camera-space point; `T = J R`, the Jacobian of the projection times the world-to-camera rotation; `M = R(q) diag(s)`;
//! `A = T M` (2 x 3), so that the 2D covariance without blur is `A A^T`.
//!
//! The determinant of `A A^T` is computed as the squared length of the cross product of the rows of `A` (Lagrange's identity). For
//! elongated Gaussians the usual `a c - b^2` cancels and loses all digits.

use float_core::{Vector, vecmath};

use crate::{RasterSettings, View, Widening};

/// Raw parameters of one vector of Gaussians.
pub(crate) struct Raw<V> {
    pub(crate) mean: [V; 3],
    pub(crate) log_scale: [V; 3],
    pub(crate) wxyz: [V; 4],
    pub(crate) logit: V,
}

/// The camera and the settings, broadcast to vectors.
pub(crate) struct Camera<V> {
    pub(crate) r: [[V; 3]; 3],
    t: [V; 3],
    pub(crate) f: [V; 2],
    c: [V; 2],
    /// Per axis: lower and upper limit of `x / z` in the Jacobian.
    tan_limits: [[V; 2]; 2],
    size: [V; 2],
    /// Longer side of the picture.
    longest: V,
    near: V,
    pub(crate) blur: V,
    alpha_min: V,
    pub(crate) dims: bool,
}

/// Smallest squared factor by which the blur reduces an opacity. Where it is reached, the gradient through the factor is 0.
pub(super) const RHO2_MIN: f32 = 0.005 * 0.005;
/// Gaussians with a smaller determinant of the 2D covariance are not visible, px^4.
const DET_MIN: f32 = 1e-12;
/// Quaternions with a smaller squared norm count as the identity.
const NORM2_MIN: f32 = 1e-16;
/// Quaternions with a larger squared norm are scaled by [`SHORTEN`] first: their squares would overflow. The factor is a power of two
/// (exact) that brings all of them into the range where squares neither overflow nor underflow.
const NORM2_LONG: f32 = 1e36;
const SHORTEN: f32 = 1.0 / (1_u128 << 80) as f32;

impl<V: Vector> Camera<V> {
    #[inline(always)]
    pub(crate) fn new(view: &View, settings: &RasterSettings) -> Self {
        let s = V::splat;
        Self {
            r: view.r.map(|row| row.map(s)),
            t: view.t.map(s),
            f: view.f.map(s),
            c: view.c.map(s),
            tan_limits: [0, 1].map(|axis| view.tan_limits(axis).map(s)),
            size: view.size.map(|n| s(n as f32)),
            longest: s(view.size[0].max(view.size[1]) as f32),
            near: s(settings.near),
            blur: s(settings.blur),
            alpha_min: s(settings.alpha_min),
            dims: settings.widening == Widening::Dims,
        }
    }
}

/// One vector of projected Gaussians with the intermediate values that the backward pass needs. Lanes that are not visible hold arbitrary
/// values.
pub(crate) struct Block<V> {
    /// Centre in camera axes.
    pub(crate) p: [V; 3],
    pub(crate) inv_z: V,
    /// `x / z, y / z` clamped to the limits, where the Jacobian is taken; and 1 where they were not clamped, 0 where they were.
    pub(crate) tan: [V; 2],
    pub(crate) free: [V; 2],
    /// `T = J R`.
    pub(crate) t: [[V; 3]; 2],
    /// Unit quaternion, 1 / norm of the raw one (0 if it was too short), rotation matrix row by row, standard deviations.
    pub(crate) q: [V; 4],
    pub(crate) inv_norm: V,
    pub(crate) rot: [[V; 3]; 3],
    pub(crate) s: [V; 3],
    /// `A = J R M`, and the cross product of its rows.
    pub(crate) a: [[V; 3]; 2],
    pub(crate) normal: [V; 3],
    /// 2D covariance `a, b, c` with blur; its determinant without blur; 1 / determinant with blur.
    pub(crate) cov: [V; 3],
    pub(crate) det0: V,
    pub(crate) inv_det: V,
    /// Opacity; the factor by which the blur reduces it; their product.
    pub(crate) o: V,
    pub(crate) rho: V,
    pub(crate) o_eff: V,
    /// As in [`ProjectedGaussian`](crate::ProjectedGaussian).
    pub(crate) uv: [V; 2],
    pub(crate) conic: [V; 3],
    pub(crate) q_max: V,
    pub(crate) half: [V; 2],
    /// Above 0 for visible lanes.
    pub(crate) visible: V,
}

#[inline(always)]
pub(crate) fn dot<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[inline(always)]
pub(crate) fn cross<V: Vector>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Rotation matrix of a unit quaternion.
#[inline(always)]
fn rotation<V: Vector>([w, x, y, z]: [V; 4]) -> [[V; 3]; 3] {
    let (one, two) = (V::splat(1.0), V::splat(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

impl<V: Vector> Block<V> {
    #[inline(always)]
    pub(crate) fn new(camera: &Camera<V>, raw: &Raw<V>) -> Self {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let p: [V; 3] = each!(3, |i| dot(camera.r[i], raw.mean) + camera.t[i]);
        let before = p[2] - camera.near;
        let inv_z = one / before.select_positive(p[2], one);
        let at = [p[0] * inv_z, p[1] * inv_z];
        let uv = [camera.f[0].mul_add(at[0], camera.c[0]), camera.f[1].mul_add(at[1], camera.c[1])];
        let tan: [V; 2] = each!(2, |i| camera.tan_limits[i][0].max(at[i]).min(camera.tan_limits[i][1]));
        let free = each!(2, |i| {
            let [low, high] = camera.tan_limits[i];
            (at[i] - low).select_positive((high - at[i]).select_positive(one, zero), zero)
        });
        let t: [[V; 3]; 2] = each!(2, |i| {
            let j = camera.f[i] * inv_z;
            each!(3, |k| j * (camera.r[i][k] - tan[i] * camera.r[2][k]))
        });

        let squared = |[w, x, y, z]: [V; 4]| dot([x, y, z], [x, y, z]) + w * w;
        let shorten = (squared(raw.wxyz) - V::splat(NORM2_LONG)).select_positive(V::splat(SHORTEN), one);
        let wxyz = each!(4, |k| raw.wxyz[k] * shorten);
        let norm2 = squared(wxyz);
        let long = norm2 - V::splat(NORM2_MIN);
        let inv_norm = long.select_positive(one / long.select_positive(norm2, one).sqrt(), zero);
        let identity = [one, zero, zero, zero];
        let q = each!(4, |k| long.select_positive(wxyz[k] * inv_norm, identity[k]));
        // 1, or NaN where a component of the quaternion is not finite.
        let finite_rotation = raw.wxyz.into_iter().fold(one, |sum, x| x.mul_add(zero, sum));
        let rot = rotation(q);
        let s = each!(3, |k| vecmath::exp(raw.log_scale[k]));
        // Row i of T times column k of R(q), times s_k.
        let a: [[V; 3]; 2] = each!(2, |i| each!(3, |k| dot(t[i], [rot[0][k], rot[1][k], rot[2][k]]) * s[k]));
        let (a0, b, c0) = (dot(a[0], a[0]), dot(a[0], a[1]), dot(a[1], a[1]));
        let normal = cross(a[0], a[1]);
        let det0 = dot(normal, normal);
        let det = camera.blur.mul_add(a0 + c0 + camera.blur, det0);
        let inv_det = one / det;
        let cov = [a0 + camera.blur, b, c0 + camera.blur];
        let conic = [cov[2] * inv_det, -b * inv_det, cov[0] * inv_det];

        let o = vecmath::logistic(raw.logit);
        let rho = if camera.dims { (det0 * inv_det).max(V::splat(RHO2_MIN)).sqrt() } else { one };
        let o_eff = o * rho;
        let seen = o_eff - camera.alpha_min;
        let q_max = V::splat(2.0) * vecmath::ln(seen.select_positive(o_eff / camera.alpha_min, one));
        // Clamp the extent to what covers the whole picture from this centre: the rest is outside.
        let half = each!(2, |i| {
            let far = V::splat(2.0) * (camera.longest + uv[i].max(-uv[i]));
            (q_max * cov[2 * i]).sqrt().min(far)
        });
        let inside = |i: usize| (uv[i] + half[i]).min(camera.size[i] - (uv[i] - half[i]));
        let sound = (det - V::splat(DET_MIN)).min(V::splat(f32::MAX) - det);
        // `min` returns the second operand where either is NaN. So each condition, which may be NaN, goes first and is tested again.
        let visible = [seen, inside(0), inside(1), sound, finite_rotation]
            .into_iter()
            .fold(before, |all, x| all.select_positive(x.select_positive(one, zero), zero));
        Self {
            p,
            inv_z,
            tan,
            free,
            t,
            q,
            inv_norm: inv_norm * shorten,
            rot,
            s,
            a,
            normal,
            cov,
            det0,
            inv_det,
            o,
            rho,
            o_eff,
            uv,
            conic,
            q_max,
            half,
            visible,
        }
    }
}
