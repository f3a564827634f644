//! From Gaussians in the world to ellipses on the picture.

use super::composite::EllipseBar;
use super::ellipse::{Camera, Ellipse, Rules, front_to_back};

/// Numbers of one Gaussian.
const fn numbers(degree: usize) -> usize {
    11 + 3 * (degree + 1) * (degree + 1)
}

fn real_sh(d: [f64; 3]) -> [f64; 16] {
    let [x, y, z] = d;
    let pi = std::f64::consts::PI;
    let s = |a: f64| (a / pi).sqrt();
    [
        0.5 * s(1.0),
        -0.5 * s(3.0) * y,
        0.5 * s(3.0) * z,
        -0.5 * s(3.0) * x,
        0.5 * s(15.0) * x * y,
        -0.5 * s(15.0) * y * z,
        0.25 * s(5.0) * (3.0 * z * z - 1.0),
        -0.5 * s(15.0) * x * z,
        0.25 * s(15.0) * (x * x - y * y),
        -0.125 * s(70.0) * y * (3.0 * x * x - y * y),
        0.5 * s(105.0) * x * y * z,
        -0.125 * s(42.0) * y * (5.0 * z * z - 1.0),
        0.25 * s(7.0) * z * (5.0 * z * z - 3.0),
        -0.125 * s(42.0) * x * (5.0 * z * z - 1.0),
        0.25 * s(105.0) * z * (x * x - y * y),
        -0.125 * s(70.0) * x * (x * x - 3.0 * y * y),
    ]
}

/// Gaussian `index`; `p` its own numbers, in the order of the rows. `None` where no pixel can see it for what it is; it may lie
/// outside of the picture.
#[must_use]
pub fn project_one(p: &[f64], index: usize, degree: usize, camera: &Camera, rules: &Rules) -> Option<Ellipse> {
    let Camera { r, t, .. } = *camera;
    let o: [f64; 3] = core::array::from_fn(|k| -(0..3).map(|i| r[i][k] * t[i]).sum::<f64>());
    let mean = [p[0], p[1], p[2]];
    let x: [f64; 3] = core::array::from_fn(|a| (0..3).map(|k| r[a][k] * mean[k]).sum::<f64>() + t[a]);
    if x[2] <= rules.near || !x.iter().all(|x| x.is_finite()) {
        return None;
    }
    let s: [f64; 3] = core::array::from_fn(|k| p[3 + k].exp());
    let sigma = covariance([p[6], p[7], p[8], p[9]], s);
    let mut j = [[0.0; 3]; 2];
    let mut uv = [0.0; 2];
    for a in 0..2 {
        let (f, c, size) = (camera.f[a], camera.c[a], camera.size[a] as f64);
        let margin = 0.15 * size / f;
        let slope = (x[a] / x[2]).clamp(-c / f - margin, (size - c) / f + margin);
        j[a][a] = f / x[2];
        j[a][2] = -f * slope / x[2];
        uv[a] = f * x[a] / x[2] + c;
    }
    let jr: [[f64; 3]; 2] = core::array::from_fn(|a| core::array::from_fn(|k| (0..3).map(|m| j[a][m] * r[m][k]).sum()));
    let entry = |a: usize, b: usize| {
        (0..3).flat_map(|k| (0..3).map(move |m| (k, m))).map(|(k, m)| jr[a][k] * sigma[k][m] * jr[b][m]).sum::<f64>()
    };
    let (a0, b, c0) = (entry(0, 0), entry(0, 1), entry(1, 1));
    let blur = rules.blur;
    let cov = [a0 + blur, b, c0 + blur];
    let det0 = (a0 * c0 - b * b).max(0.0);
    let det = det0 + blur * (a0 + c0) + blur * blur;
    if !(det.is_finite() && det >= 1e-12) {
        return None;
    }
    let gained = if rules.dims { (det0 / det).max(0.005 * 0.005).sqrt() } else { 1.0 };
    let opacity = gained / (1.0 + (-p[10]).exp());
    if opacity <= rules.alpha_min || opacity.is_nan() {
        return None;
    }
    let way: [f64; 3] = core::array::from_fn(|k| mean[k] - o[k]);
    let far = way.iter().map(|w| w * w).sum::<f64>().sqrt();
    let y = real_sh(if far > 0.0 { way.map(|w| w / far) } else { [0.0, 0.0, 1.0] });
    let rgb = core::array::from_fn(|c| {
        let terms = (0..(degree + 1) * (degree + 1)).map(|k| y[k] * p[11 + 3 * k + c]);
        (0.5 + terms.sum::<f64>()).max(0.0)
    });
    let conic = [cov[2] / det, -b / det, cov[0] / det];
    let q_max = 2.0 * (opacity / rules.alpha_min).ln();
    Some(Ellipse { index, uv, cov, conic, opacity, q_max, z: x[2], rgb })
}

/// `R diag(s)^2 R^T`; a rotation without length is none.
fn covariance(wxyz: [f64; 4], s: [f64; 3]) -> [[f64; 3]; 3] {
    let norm = wxyz.iter().map(|q| q * q).sum::<f64>().sqrt();
    let [w, x, y, z] = if norm > 1e-8 { wxyz.map(|q| q / norm) } else { [1.0, 0.0, 0.0, 0.0] };
    let rot = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    core::array::from_fn(|a| core::array::from_fn(|b| (0..3).map(|k| rot[a][k] * s[k] * s[k] * rot[b][k]).sum::<f64>()))
}

/// All ellipses of `n` Gaussians, front to back.
///
/// # Panics
/// Where `p` has fewer numbers than `n` Gaussians of this degree.
#[must_use]
pub fn project(p: &[f64], n: usize, degree: usize, camera: &Camera, rules: &Rules) -> Vec<Ellipse> {
    let own = |i: usize| (0..numbers(degree)).map(|k| p[k * n + i]).collect::<Vec<f64>>();
    let mut out: Vec<Ellipse> = (0..n).filter_map(|i| project_one(&own(i), i, degree, camera, rules)).collect();
    front_to_back(&mut out);
    out
}

/// Gradient of one Gaussian's numbers from that of its ellipse: central differences, good to about 1e-9. 0 where it is not seen.
///
/// # Panics
/// Where `p` has fewer numbers than a Gaussian of this degree.
#[must_use]
pub fn parameters_bar(p: &[f64], degree: usize, camera: &Camera, rules: &Rules, bar: &EllipseBar) -> Vec<f64> {
    let mut at = p.to_vec();
    let mut moved = |k: usize, by: f64| {
        at[k] = p[k] + by;
        let ellipse = project_one(&at, 0, degree, camera, rules);
        at[k] = p[k];
        ellipse
    };
    (0..numbers(degree))
        .map(|k| {
            let h = 1e-6 * p[k].abs().max(1.0);
            match (moved(k, h), moved(k, -h)) {
                (Some(more), Some(less)) => (bar.along(&more, &less)) / (2.0 * h),
                _ => 0.0,
            }
        })
        .collect()
}
