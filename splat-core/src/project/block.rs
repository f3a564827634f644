//! One vector of Gaussians, from raw parameters to the ellipse on the picture: what forward and backward share.
//!
//! Letters: `p` camera-space point; `T = J R`, the Jacobian of the projection times the world-to-camera rotation; `M = R(q) diag(s)`;
//! `A = T M` (2 x 3), so that the screen covariance is `A A^T`: `[[a, b], [b, c]]`.
//!
//! The determinant of `A A^T` is the squared length of the cross product of its rows (Lagrange's identity): nothing cancels for
//! needles, where `a c - b^2` loses all digits.

use float_core::{Vector, vecmath};

use crate::{Rules, View, Widening};

/// Raw parameters of a vector of Gaussians.
pub(crate) struct Raw<V> {
    pub(crate) mean: [V; 3],
    pub(crate) log_scale: [V; 3],
    pub(crate) wxyz: [V; 4],
    pub(crate) logit: V,
}

/// A camera and the rules, as vectors.
pub(crate) struct Lens<V> {
    pub(crate) r: [[V; 3]; 3],
    t: [V; 3],
    pub(crate) f: [V; 2],
    c: [V; 2],
    slopes: [[V; 2]; 2],
    size: [V; 2],
    /// Its longer side.
    longest: V,
    near: V,
    pub(crate) blur: V,
    alpha_min: V,
    pub(crate) dims: bool,
}

/// Smallest factor that widening dims an opacity with, squared: the gradient stops there.
pub(super) const RHO2_MIN: f32 = 0.005 * 0.005;
/// Smallest determinant of a covariance on the picture, px^4.
const DET_MIN: f32 = 1e-12;
/// Shortest quaternion that is a direction, squared.
const NORM2_MIN: f32 = 1e-16;
/// Quaternions longer than this, squared, are shortened first: their squares would overflow. The factor, a power of two, takes
/// the longest and the shortest of them to where squares are ordinary numbers.
const NORM2_LONG: f32 = 1e36;
const SHORTEN: f32 = 1.0 / (1_u128 << 80) as f32;

impl<V: Vector> Lens<V> {
    #[inline(always)]
    pub(crate) fn new(view: &View, rules: &Rules) -> Self {
        let s = V::splat;
        Self {
            r: view.r.map(|row| row.map(s)),
            t: view.t.map(s),
            f: view.f.map(s),
            c: view.c.map(s),
            slopes: [0, 1].map(|axis| view.slopes(axis).map(s)),
            size: view.size.map(|n| s(n as f32)),
            longest: s(view.size[0].max(view.size[1]) as f32),
            near: s(rules.near),
            blur: s(rules.blur),
            alpha_min: s(rules.alpha_min),
            dims: rules.widening == Widening::Dims,
        }
    }
}

/// What a vector of Gaussians looks like. Lanes that are not visible hold anything.
pub(crate) struct Block<V> {
    /// In the camera's axes.
    pub(crate) p: [V; 3],
    pub(crate) inv_z: V,
    /// Slopes that the Jacobian is taken at, and 1 where they are those of the point, 0 where they were clamped.
    pub(crate) slope: [V; 2],
    pub(crate) free: [V; 2],
    /// `J R`.
    pub(crate) t: [[V; 3]; 2],
    /// Unit quaternion, inverse of its length before (0 for none), rotation row by row, scales.
    pub(crate) q: [V; 4],
    pub(crate) inv_norm: V,
    pub(crate) rot: [[V; 3]; 3],
    pub(crate) s: [V; 3],
    /// `J R M`, and the cross product of its rows: entry `k` is that of the columns `k + 1` and `k + 2`.
    pub(crate) a: [[V; 3]; 2],
    pub(crate) normal: [V; 3],
    /// `a, b, c` with blur; determinants without and with it.
    pub(crate) cov: [V; 3],
    pub(crate) det0: V,
    pub(crate) inv_det: V,
    /// Opacity; what widening leaves of it; the product.
    pub(crate) o: V,
    pub(crate) rho: V,
    pub(crate) o_eff: V,
    /// Centre, conic, squared radius and half extents of the ellipse.
    pub(crate) uv: [V; 2],
    pub(crate) conic: [V; 3],
    pub(crate) q_max: V,
    pub(crate) half: [V; 2],
    /// Above 0 where visible.
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

/// Rotation of a unit quaternion.
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
    pub(crate) fn new(lens: &Lens<V>, raw: &Raw<V>) -> Self {
        let (zero, one) = (V::splat(0.0), V::splat(1.0));
        let p: [V; 3] = each!(3, |i| dot(lens.r[i], raw.mean) + lens.t[i]);
        let before = p[2] - lens.near;
        let inv_z = one / before.select_positive(p[2], one);
        let at = [p[0] * inv_z, p[1] * inv_z];
        let uv = [lens.f[0].mul_add(at[0], lens.c[0]), lens.f[1].mul_add(at[1], lens.c[1])];
        let slope: [V; 2] = each!(2, |i| lens.slopes[i][0].max(at[i]).min(lens.slopes[i][1]));
        let free = each!(2, |i| {
            let [low, high] = lens.slopes[i];
            (at[i] - low).select_positive((high - at[i]).select_positive(one, zero), zero)
        });
        let t: [[V; 3]; 2] = each!(2, |i| {
            let j = lens.f[i] * inv_z;
            each!(3, |k| j * (lens.r[i][k] - slope[i] * lens.r[2][k]))
        });

        let squared = |[w, x, y, z]: [V; 4]| dot([x, y, z], [x, y, z]) + w * w;
        let shorten = (squared(raw.wxyz) - V::splat(NORM2_LONG)).select_positive(V::splat(SHORTEN), one);
        let wxyz = each!(4, |k| raw.wxyz[k] * shorten);
        let norm2 = squared(wxyz);
        let long = norm2 - V::splat(NORM2_MIN);
        let inv_norm = long.select_positive(one / long.select_positive(norm2, one).sqrt(), zero);
        let identity = [one, zero, zero, zero];
        let q = each!(4, |k| long.select_positive(wxyz[k] * inv_norm, identity[k]));
        // 1, or NaN where a number of the quaternion is not finite.
        let turned = raw.wxyz.into_iter().fold(one, |sum, x| x.mul_add(zero, sum));
        let rot = rotation(q);
        let s = each!(3, |k| vecmath::exp(raw.log_scale[k]));
        // Row i of T times column k of R(q), times s_k.
        let a: [[V; 3]; 2] = each!(2, |i| each!(3, |k| dot(t[i], [rot[0][k], rot[1][k], rot[2][k]]) * s[k]));
        let (a0, b, c0) = (dot(a[0], a[0]), dot(a[0], a[1]), dot(a[1], a[1]));
        let normal = cross(a[0], a[1]);
        let det0 = dot(normal, normal);
        let det = lens.blur.mul_add(a0 + c0 + lens.blur, det0);
        let inv_det = one / det;
        let cov = [a0 + lens.blur, b, c0 + lens.blur];
        let conic = [cov[2] * inv_det, -b * inv_det, cov[0] * inv_det];

        let o = vecmath::logistic(raw.logit);
        let rho = if lens.dims { (det0 * inv_det).max(V::splat(RHO2_MIN)).sqrt() } else { one };
        let o_eff = o * rho;
        let seen = o_eff - lens.alpha_min;
        let q_max = V::splat(2.0) * vecmath::ln(seen.select_positive(o_eff / lens.alpha_min, one));
        // No ellipse reaches farther than it has to: all over the picture, from wherever its centre is.
        let half = each!(2, |i| {
            let far = V::splat(2.0) * (lens.longest + uv[i].max(-uv[i]));
            (q_max * cov[2 * i]).sqrt().min(far)
        });
        let inside = |i: usize| (uv[i] + half[i]).min(lens.size[i] - (uv[i] - half[i]));
        let sound = (det - V::splat(DET_MIN)).min(V::splat(f32::MAX) - det);
        // `min` gives the second operand where either is NaN: put each suspect first and ask again.
        let visible = [seen, inside(0), inside(1), sound, turned]
            .into_iter()
            .fold(before, |all, x| all.select_positive(x.select_positive(one, zero), zero));
        Self {
            p,
            inv_z,
            slope,
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
