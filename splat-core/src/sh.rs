//! View-dependent colour: spherical harmonics up to degree 3, for one SIMD vector of directions.
//!
//! Order, signs and constants are those of 3DGS, and of `field_core::encoding::SphericalHarmonics`, which is the same basis for
//! whole batches; here it is evaluated in registers between two other steps.

use float_core::Vector;

pub(crate) const SH_1: f32 = 0.488_602_51;
const SH_2: [f32; 5] = [1.092_548_4, -1.092_548_4, 0.315_391_57, -1.092_548_4, 0.546_274_2];
const SH_3: [f32; 7] = [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_33, -0.457_045_8, 1.445_305_7, -0.590_043_6];

/// Basis functions 1 to 15 (all but the constant one) at unit directions; 0 above `degree`.
#[inline(always)]
pub(crate) fn basis<V: Vector>(degree: usize, [x, y, z]: [V; 3]) -> [V; 15] {
    let s = V::splat;
    let mut b = [s(0.0); 15];
    if degree < 1 {
        return b;
    }
    b[0] = s(-SH_1) * y;
    b[1] = s(SH_1) * z;
    b[2] = s(-SH_1) * x;
    if degree < 2 {
        return b;
    }
    let (xx, yy, zz, xy) = (x * x, y * y, z * z, x * y);
    b[3] = s(SH_2[0]) * xy;
    b[4] = s(SH_2[1]) * y * z;
    b[5] = s(SH_2[2]) * (s(2.0) * zz - xx - yy);
    b[6] = s(SH_2[3]) * x * z;
    b[7] = s(SH_2[4]) * (xx - yy);
    if degree < 3 {
        return b;
    }
    let around = s(4.0) * zz - xx - yy;
    b[8] = s(SH_3[0]) * y * (s(3.0) * xx - yy);
    b[9] = s(SH_3[1]) * xy * z;
    b[10] = s(SH_3[2]) * y * around;
    b[11] = s(SH_3[3]) * z * (s(2.0) * zz - s(3.0) * (xx + yy));
    b[12] = s(SH_3[4]) * x * around;
    b[13] = s(SH_3[5]) * z * (xx - yy);
    b[14] = s(SH_3[6]) * x * (xx - s(3.0) * yy);
    b
}

/// `sum_k w[k] grad basis[k]` with respect to `x, y, z` as independent variables (not restricted to the sphere).
#[inline(always)]
pub(crate) fn gradient<V: Vector>(degree: usize, [x, y, z]: [V; 3], w: &[V; 15]) -> [V; 3] {
    let s = V::splat;
    let mut g = [s(0.0); 3];
    if degree < 1 {
        return g;
    }
    g[1] = s(-SH_1) * w[0];
    g[2] = s(SH_1) * w[1];
    g[0] = s(-SH_1) * w[2];
    if degree < 2 {
        return g;
    }
    let [a, b, c, d, e] = each!(5, |k| s(SH_2[k]) * w[3 + k]);
    let two = s(2.0);
    g[0] = g[0] + a * y - two * c * x + d * z + two * e * x;
    g[1] = g[1] + a * x + b * z - two * c * y - two * e * y;
    g[2] = g[2] + b * y + s(4.0) * c * z + d * x;
    if degree < 3 {
        return g;
    }
    let [a, b, c, d, e, f, h] = each!(7, |k| s(SH_3[k]) * w[8 + k]);
    let (xx, yy, zz, six) = (x * x, y * y, z * z, s(6.0));
    let around = s(4.0) * zz - xx - yy;
    let (three, eight) = (s(3.0), s(8.0));
    g[0] = g[0] + six * a * x * y + b * y * z - two * c * x * y - six * d * x * z
        + e * (around - two * xx)
        + two * f * x * z
        + three * h * (xx - yy);
    g[1] = g[1] + three * a * (xx - yy) + b * x * z + c * (around - two * yy)
        - six * d * y * z
        - two * e * x * y
        - two * f * y * z
        - six * h * x * y;
    g[2] =
        g[2] + b * x * y + eight * c * y * z + d * (six * zz - three * (xx + yy)) + eight * e * x * z + f * (xx - yy);
    g
}
