//! Gradients of gaussians a thousand times as long as broad, against the chain rule of the specification in f64.

use float_core::Simd;
use splat_core::{Gaussians, ProjectedGradient, Projection, RasterSettings, View, Widening};

/// One of length 1, as broad as `thin`, turned in the picture and out of it; straight ahead, four units away.
fn needle(thin: f32, turn: f32, tilt: f32) -> (Gaussians, View) {
    let mut g = Gaussians::new(1, 0).unwrap();
    g.mean[2] = 4.0;
    g.log_scale.copy_from_slice(&[0.0, thin.ln(), thin.ln()]);
    // About z after about y.
    let ((sz, cz), (sy, cy)) = ((0.5 * turn).sin_cos(), (0.5 * tilt).sin_cos());
    g.wxyz.copy_from_slice(&[cz * cy, -sz * sy, cz * sy, sz * cy]);
    let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (g, View { r, t: [0.0; 3], f: [2000.0; 2], c: [256.0; 2], size: [512, 512] })
}

/// Gradients of `log_scale` and of the opacity's logit, through `V = -Q G Q` and what widening adds: spec and paper, word by word.
fn specification(g: &Gaussians, view: &View, settings: &RasterSettings, bar: &ProjectedGradient<3>) -> [f64; 4] {
    let [w, x, y, z] = [0, 1, 2, 3].map(|k| f64::from(g.wxyz[k]));
    let norm = w * w + x * x + y * y + z * z;
    let rot =
        [[norm - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z)], [2.0 * (x * y + w * z), norm - 2.0 * (x * x + z * z)]];
    let third = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x)];
    // The camera looks along z at a point on its axis: J is diagonal.
    let f = f64::from(view.f[0]) / 4.0;
    let s: [f64; 3] = core::array::from_fn(|k| f64::from(g.log_scale[k]).exp());
    let a: [[f64; 3]; 2] = core::array::from_fn(|i| [rot[i][0], rot[i][1], third[i]].map(|r| f * r / norm))
        .map(|row: [f64; 3]| core::array::from_fn(|k| row[k] * s[k]));
    let sum = |i: usize, j: usize| (0..3).map(|k| a[i][k] * a[j][k]).sum::<f64>();
    let (a0, b, c0) = (sum(0, 0), sum(0, 1), sum(1, 1));
    let blur = f64::from(settings.blur);
    let minors = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| a[0][i] * a[1][j] - a[0][j] * a[1][i]);
    let det0 = minors.iter().map(|m| m * m).sum::<f64>();
    let det = det0 + blur * (a0 + c0 + blur);
    let q = [[(c0 + blur) / det, -b / det], [-b / det, (a0 + blur) / det]];
    let conic = bar.conic.map(f64::from);
    let gq = [[conic[0], 0.5 * conic[1]], [0.5 * conic[1], conic[2]]];
    let product = |m: [[f64; 2]; 2], n: [[f64; 2]; 2]| -> [[f64; 2]; 2] {
        core::array::from_fn(|i| core::array::from_fn(|j| m[i][0] * n[0][j] + m[i][1] * n[1][j]))
    };
    let mut v = product(q, product(gq, q)).map(|row| row.map(|x| -x));
    let o = 1.0 / (1.0 + (-f64::from(g.logit[0])).exp());
    let mut o_bar = f64::from(bar.opacity);
    if settings.widening == Widening::Dims {
        let rho = (det0 / det).sqrt();
        assert!(rho > 0.005, "at the floor there is nothing to compare");
        let k = o * o_bar / (2.0 * rho * det);
        v[0][0] += k * (c0 - rho * rho * (c0 + blur));
        v[1][1] += k * (a0 - rho * rho * (a0 + blur));
        v[0][1] += k * b * (rho * rho - 1.0);
        v[1][0] = v[0][1];
        o_bar *= rho;
    }
    let scale = |k: usize| -> f64 {
        (0..2).flat_map(|i| (0..2).map(move |j| (i, j))).map(|(i, j)| 2.0 * a[i][k] * v[i][j] * a[j][k]).sum()
    };
    [scale(0), scale(1), scale(2), o * (1.0 - o) * o_bar]
}

#[test]
fn the_length_of_a_needle_keeps_its_digits() {
    for widening in [Widening::Keeps, Widening::Dims] {
        let settings = RasterSettings::DEFAULT.with_widening(widening);
        for thin in [1e-4, 3e-4, 1e-3, 1e-2] {
            for turn in [0.0, 0.3, 0.8, 1.5, 2.4, 3.0] {
                for tilt in [0.0, 0.4, -1.0] {
                    let (g, view) = needle(thin, turn, tilt);
                    // Pixels along it want it shorter; they know nothing of its breadth.
                    let (s, c) = (500.0 * turn.sin(), 500.0 * turn.cos());
                    let bar = ProjectedGradient {
                        conic: [c * c, 2.0 * c * s, s * s],
                        opacity: 3.0,
                        ..ProjectedGradient::default()
                    };
                    let want = specification(&g, &view, &settings, &bar);
                    for simd in Simd::available() {
                        let mut p = Projection::default();
                        p.project(simd, &g, &view, &settings, 0).unwrap();
                        let mut grad = g.clone();
                        p.backward(simd, &g, &view, &settings, 0, &[bar], None, &mut grad).unwrap();
                        let got = [grad.log_scale[0], grad.log_scale[1], grad.log_scale[2], grad.logit[0]];
                        let largest = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                        for (k, (got, want)) in got.into_iter().zip(want).enumerate() {
                            let error = (f64::from(got) - want).abs();
                            // Of its breadth a rounded gradient of the conic says little: that much is left open.
                            let broad = 500.0 * f64::from(thin);
                            let open = 500.0 * broad / (broad * broad + f64::from(settings.blur));
                            let bound = if k == 0 { 1e-4 * want.abs() } else { 1e-5 * largest + 3e-7 * open * open };
                            assert!(
                                error < bound,
                                "{widening:?} {:?}, {thin}, {turn}, {tilt}: number {k} is {got}, expected {want}",
                                simd.level()
                            );
                        }
                    }
                }
            }
        }
    }
}
