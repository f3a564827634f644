//! The specification: every pixel looks at every Gaussian, in f64, written from the definitions.
#![allow(dead_code, reason = "each test takes what it needs")]

use splat_core::{Footprint, Gaussians, Projection, Rules, View, Widening, rest_len};

/// One Gaussian on the picture.
#[derive(Clone, Debug)]
pub(crate) struct Ellipse {
    pub(crate) index: usize,
    pub(crate) uv: [f64; 2],
    /// `[[a, b], [b, c]]` with blur, and its inverse.
    pub(crate) cov: [f64; 3],
    pub(crate) conic: [f64; 3],
    pub(crate) opacity: f64,
    pub(crate) q_max: f64,
    pub(crate) z: f64,
    pub(crate) rgb: [f64; 3],
}

/// Parameters as one long vector, in the order of `Gaussians::fields`.
pub(crate) fn flat(cloud: &Gaussians) -> Vec<f64> {
    cloud.fields().into_iter().flat_map(|(_, x)| x.iter().map(|&x| f64::from(x))).collect()
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

pub(crate) fn project(p: &[f64], n: usize, degree: usize, view: &View, rules: &Rules) -> Vec<Ellipse> {
    let row = |k: usize, i: usize| p[k * n + i];
    let r = view.r.map(|row| row.map(f64::from));
    let t = view.t.map(f64::from);
    let o: [f64; 3] = core::array::from_fn(|k| -(0..3).map(|i| r[i][k] * t[i]).sum::<f64>());
    let mut out = Vec::new();
    for i in 0..n {
        let mean: [f64; 3] = core::array::from_fn(|k| row(k, i));
        let x: [f64; 3] = core::array::from_fn(|a| (0..3).map(|k| r[a][k] * mean[k]).sum::<f64>() + t[a]);
        if x[2] <= f64::from(rules.near) || !x.iter().all(|x| x.is_finite()) {
            continue;
        }
        let s: [f64; 3] = core::array::from_fn(|k| row(3 + k, i).exp());
        let mut q: [f64; 4] = core::array::from_fn(|k| row(6 + k, i));
        let norm = q.iter().map(|q| q * q).sum::<f64>().sqrt();
        q = if norm > 1e-8 { q.map(|q| q / norm) } else { [1.0, 0.0, 0.0, 0.0] };
        let [qw, qx, qy, qz] = q;
        let rot = [
            [1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)],
            [2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qw * qx)],
            [2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)],
        ];
        let mut sigma = [[0.0; 3]; 3];
        for a in 0..3 {
            for b in 0..3 {
                sigma[a][b] = (0..3).map(|k| rot[a][k] * s[k] * s[k] * rot[b][k]).sum();
            }
        }
        let mut j = [[0.0; 3]; 2];
        let mut uv = [0.0; 2];
        for a in 0..2 {
            let (f, c, size) = (f64::from(view.f[a]), f64::from(view.c[a]), view.size[a] as f64);
            let margin = 0.15 * size / f;
            let slope = (x[a] / x[2]).clamp(-c / f - margin, (size - c) / f + margin);
            j[a][a] = f / x[2];
            j[a][2] = -f * slope / x[2];
            uv[a] = f * x[a] / x[2] + c;
        }
        let jr: [[f64; 3]; 2] =
            core::array::from_fn(|a| core::array::from_fn(|k| (0..3).map(|m| j[a][m] * r[m][k]).sum()));
        let entry = |a: usize, b: usize| {
            (0..3)
                .flat_map(|k| (0..3).map(move |m| (k, m)))
                .map(|(k, m)| jr[a][k] * sigma[k][m] * jr[b][m])
                .sum::<f64>()
        };
        let (a0, b, c0) = (entry(0, 0), entry(0, 1), entry(1, 1));
        let blur = f64::from(rules.blur);
        let cov = [a0 + blur, b, c0 + blur];
        let det0 = (a0 * c0 - b * b).max(0.0);
        let det = det0 + blur * (a0 + c0) + blur * blur;
        if !(det.is_finite() && det >= 1e-12) {
            continue;
        }
        let o_raw = 1.0 / (1.0 + (-row(10, i)).exp());
        let rho = match rules.widening {
            Widening::Keeps => 1.0,
            Widening::Dims => (det0 / det).max(0.005 * 0.005).sqrt(),
        };
        let opacity = o_raw * rho;
        let alpha_min = f64::from(rules.alpha_min);
        if opacity <= alpha_min || opacity.is_nan() {
            continue;
        }
        let way: [f64; 3] = core::array::from_fn(|k| mean[k] - o[k]);
        let far = way.iter().map(|w| w * w).sum::<f64>().sqrt();
        let d = if far > 0.0 { way.map(|w| w / far) } else { [0.0, 0.0, 1.0] };
        let y = real_sh(d);
        let rgb = core::array::from_fn(|c| {
            let mut sum = 0.5 + y[0] * row(11 + c, i);
            for k in 0..rest_len(degree) {
                sum += y[k + 1] * row(14 + 3 * k + c, i);
            }
            sum.max(0.0)
        });
        out.push(Ellipse {
            index: i,
            uv,
            cov,
            conic: [cov[2] / det, -b / det, cov[0] / det],
            opacity,
            q_max: 2.0 * (opacity / alpha_min).ln(),
            z: x[2],
            rgb,
        });
    }
    out.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.index.cmp(&b.index)));
    out
}

/// What the rasteriser was given, in f64: no difference is left but that of compositing.
pub(crate) fn of_footprints(p: &Projection) -> Vec<Ellipse> {
    let ellipse = |f: &Footprint, rgb: &[f32; 3]| {
        let conic = f.conic.map(f64::from);
        let det = conic[0] * conic[2] - conic[1] * conic[1];
        Ellipse {
            index: f.index as usize,
            uv: f.uv.map(f64::from),
            cov: [conic[2] / det, -conic[1] / det, conic[0] / det],
            conic,
            opacity: f64::from(f.opacity),
            q_max: f64::from(f.q_max),
            z: f64::from(f.z),
            rgb: rgb.map(f64::from),
        }
    };
    let mut out: Vec<Ellipse> = p.footprints.iter().zip(&p.rgb).map(|(f, rgb)| ellipse(f, rgb)).collect();
    out.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.index.cmp(&b.index)));
    out
}

/// A picture.
pub(crate) struct Picture {
    /// `[5][rows][columns]`: colour, depth, what is left of the light.
    pub(crate) planes: Vec<f64>,
    /// `[rows][columns]` how far the nearest decision was from falling otherwise, in units of the numbers it was made of.
    pub(crate) margins: Vec<f64>,
    /// `[rows][columns]` what a relative error of 1 of all those numbers would do to the values.
    pub(crate) slack: Vec<f64>,
}

impl Picture {
    /// The nearest of all decisions.
    pub(crate) fn margin(&self) -> f64 {
        self.margins.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Largest difference of a pixel whose decisions are clear, in units of its bound; and the share of those that are not.
    pub(crate) fn worst(&self, got: &[f32]) -> (f64, f64) {
        let pixels = self.margins.len();
        let (mut worst, mut unclear) = (0.0_f64, 0);
        for i in 0..pixels {
            if self.margins[i] < UNCLEAR {
                unclear += 1;
                continue;
            }
            for k in 0..5 {
                let (got, want) = (f64::from(got[k * pixels + i]), self.planes[k * pixels + i]);
                let error = (got - want).abs() / (2e-6 * (1.0 + want.abs()) + ROUNDING * self.slack[i]);
                worst = if error <= worst { worst } else { error };
            }
        }
        (worst, f64::from(unclear) / pixels as f64)
    }
}

/// Margins of decisions that rounding may turn; what an `f32` of a few operations is off by.
const UNCLEAR: f64 = 3e-6;
const ROUNDING: f64 = 2e-7;

/// Composite ellipses that are in order.
pub(crate) fn draw(ellipses: &[Ellipse], size: [usize; 2], rules: &Rules) -> Picture {
    let [w, h] = size;
    let mut out =
        Picture { planes: vec![0.0; 5 * w * h], margins: vec![f64::INFINITY; w * h], slack: vec![0.0; w * h] };
    let (alpha_max, stop) = (f64::from(rules.alpha_max), f64::from(rules.stop));
    for y in 0..h {
        for x in 0..w {
            let (mut t, mut sums) = (1.0, [0.0; 4]);
            // Of the light that is left, relative.
            let mut loose = 1.0;
            let i = y * w + x;
            for e in ellipses {
                let d = [e.uv[0] - (x as f64 + 0.5), e.uv[1] - (y as f64 + 0.5)];
                let terms = [e.conic[0] * d[0] * d[0], 2.0 * e.conic[1] * d[0] * d[1], e.conic[2] * d[1] * d[1]];
                let q = terms.iter().sum::<f64>().max(0.0);
                let sure = 1.0 + terms.iter().map(|t| t.abs()).sum::<f64>();
                let mut decide = |by: f64| out.margins[i] = out.margins[i].min(by.abs());
                decide((q - e.q_max) / sure);
                if q >= e.q_max {
                    continue;
                }
                let full = e.opacity * (-0.5 * q).exp();
                decide((full / alpha_max - 1.0) / sure);
                let alpha = full.min(alpha_max);
                let next = t * (1.0 - alpha);
                loose += sure * alpha / (1.0 - alpha);
                decide((next / stop - 1.0) / loose);
                if next <= stop {
                    break;
                }
                let values = [e.rgb[0], e.rgb[1], e.rgb[2], e.z];
                for (sum, c) in sums.iter_mut().zip(values) {
                    *sum += alpha * t * c;
                }
                out.slack[i] += alpha * t * (sure + loose) * values.into_iter().fold(1.0, f64::max);
                t = next;
            }
            out.slack[i] += t * loose;
            for (k, v) in sums.into_iter().chain([t]).enumerate() {
                out.planes[k * w * h + i] = v;
            }
        }
    }
    out
}
