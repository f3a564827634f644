//! Dense grids.

use super::{bits, f32s, uniform};
use field_core::encoding::dense_grid::DenseGrid;
use field_core::encoding::hash_grid::Interpolation;
use float_core::Simd;
use testkit::gradient::{Tolerance, compare, cotangent};

/// Twin: features, and gradients of `<bar, features>` with respect to table and position.
fn dense_twin(grid: &DenseGrid, params: &[f64], x: &[f64], out: &mut [f64]) {
    let [rx, ry, rz] = grid.resolution().map(|r| r as usize);
    let mut cell = [0; 3];
    let mut f = [0.0; 3];
    for (a, r) in [rx, ry, rz].into_iter().enumerate() {
        let p = x[a].clamp(0.0, 1.0) * (r - 1) as f64;
        cell[a] = (p as usize).min(r.saturating_sub(2));
        f[a] = p - cell[a] as f64;
    }
    out.fill(0.0);
    for c in 0..8 {
        let bit = [c & 1, c >> 1 & 1, c >> 2];
        let w: f64 = (0..3).map(|a| if bit[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
        if w == 0.0 {
            continue;
        }
        let vertex = cell[0] + bit[0] + rx * (cell[1] + bit[1] + ry * (cell[2] + bit[2]));
        for (k, out) in out.iter_mut().enumerate() {
            *out += w * params[vertex * grid.features() + k];
        }
    }
}

#[test]
fn dense_grid_matches_its_twin_for_any_number_of_features() {
    for (resolution, features) in [([4, 5, 3], 1), ([2, 2, 2], 3), ([7, 1, 3], 5), ([3, 4, 5], 15), ([1, 1, 1], 2)] {
        let grid = DenseGrid::new(resolution, features, Interpolation::Linear).unwrap();
        let params = uniform(1, grid.params_len(), -1.0, 1.0);
        let params64: Vec<f64> = params.iter().map(|&p| f64::from(p)).collect();
        const N: usize = 23;
        let x = uniform(2, 3 * N, -0.1, 1.1);
        let bar = cotangent(features * N, 4);
        let point = |i: usize| [0, 1, 2].map(|a| f64::from(x[a * N + i]));
        let bar_of = |i: usize| (0..features).map(|k| bar[k * N + i]).collect::<Vec<_>>();
        let mut want = vec![0.0; features * N];
        let (mut want_grad, mut want_x) = (vec![0.0; params.len()], vec![0.0; 3 * N]);
        for i in 0..N {
            let mut out = vec![0.0; features];
            dense_twin(&grid, &params64, &point(i), &mut out);
            (0..features).for_each(|k| want[k * N + i] = out[k]);
            // Linear in the table: a unit vector gives its derivative exactly.
            for (p, grad) in want_grad.iter_mut().enumerate() {
                let mut one = vec![0.0; params.len()];
                one[p] = 1.0;
                dense_twin(&grid, &one, &point(i), &mut out);
                *grad += out.iter().zip(bar_of(i)).map(|(o, b)| o * b).sum::<f64>();
            }
            let gradient = testkit::gradient::central_difference(&point(i), |x| {
                dense_twin(&grid, &params64, x, &mut out);
                out.iter().zip(bar_of(i)).map(|(o, b)| o * b).sum()
            });
            (0..3).for_each(|a| want_x[a * N + i] = gradient[a]);
        }
        let mut bits_of_all = Vec::new();
        for simd in Simd::available() {
            let (mut out, mut grad, mut x_bar) =
                (vec![f32::NAN; features * N], vec![0.0; params.len()], vec![0.0; 3 * N]);
            grid.encode(simd, &params, &x, &mut out).unwrap();
            grid.encode_backward(simd, &x, &f32s(&bar), &mut grad).unwrap();
            grid.encode_backward_x(simd, &params, &x, &f32s(&bar), &mut x_bar).unwrap();
            compare("features", &out, &want, Tolerance::new(2e-6, 1e-6)).unwrap();
            compare("table gradient", &grad, &want_grad, Tolerance::SINGLE).unwrap();
            compare("position gradient", &x_bar, &want_x, Tolerance::SINGLE).unwrap();
            // The tangent is the adjoint of the position gradient, and linear in the table.
            let x_dot = uniform(6, 3 * N, -1.0, 1.0);
            let (mut tangent, mut tangent_grad) = (vec![0.0; features * N], vec![0.0; params.len()]);
            grid.tangent(simd, &params, &x, &x_dot, &mut tangent).unwrap();
            grid.tangent_backward(simd, &x, &x_dot, &f32s(&bar), &mut tangent_grad).unwrap();
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
            let bar = f32s(&bar);
            let three = [dot(&tangent, &bar), dot(&x_bar, &x_dot), dot(&tangent_grad, &params)];
            assert!((three[0] - three[1]).abs() < 1e-4 * (1.0 + three[0].abs()), "{three:?}");
            assert!((three[0] - three[2]).abs() < 1e-4 * (1.0 + three[0].abs()), "{three:?}");
            bits_of_all.push([bits(&out), bits(&grad), bits(&x_bar), bits(&tangent)]);
        }
        assert!(bits_of_all.windows(2).all(|pair| pair[0] == pair[1]));
    }
}

#[test]
fn dense_grid_interpolates_its_vertices_and_refuses_bad_sizes() {
    let grid = DenseGrid::new([3, 2, 4], 1, Interpolation::Smoothstep).unwrap();
    let params = uniform(1, 24, -1.0, 1.0);
    for v in 0..24 {
        let x = [(v % 3) as f32 / 2.0, (v / 3 % 2) as f32, (v / 6) as f32 / 3.0];
        let mut out = [0.0];
        grid.encode(Simd::best(), &params, &x, &mut out).unwrap();
        assert!((out[0] - params[v]).abs() < 1e-6);
    }
    assert!(DenseGrid::new([0, 2, 2], 1, Interpolation::Linear).is_err());
    assert!(DenseGrid::new([2, 2, 2], 0, Interpolation::Linear).is_err());
    assert!(DenseGrid::new([1 << 20, 1 << 20, 1 << 20], usize::MAX, Interpolation::Linear).is_err());
    assert!(grid.encode(Simd::best(), &params[1..], &[], &mut []).is_err());
    assert_eq!(grid.encode(Simd::best(), &params, &[], &mut []), Ok(()));
    let mut x_bar = [0.0; 3];
    grid.encode_backward_x(Simd::best(), &params, &[f32::NAN, -1.0, 2.0], &[1.0], &mut x_bar).unwrap();
    assert_eq!(x_bar, [0.0; 3]);
}

#[test]
fn dense_grid_second_derivative_matches_differences() {
    for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
        let grid = DenseGrid::new([4, 3, 5], 3, interpolation).unwrap();
        let params = uniform(1, grid.params_len(), -1.0, 1.0);
        let (x, x_dot, bar) = ([0.41, 0.23, 0.68], [0.3, -0.8, 0.5], [1.0, -0.5, 0.25]);
        let mut x_bar = [0.0; 3];
        grid.tangent_backward_x(Simd::best(), &params, &x, &x_dot, &bar, &mut x_bar).unwrap();
        for a in 0..3 {
            let at = |s: f32| {
                let mut x = x;
                x[a] += s;
                let mut out = [0.0; 3];
                grid.tangent(Simd::best(), &params, &x, &x_dot, &mut out).unwrap();
                out.iter().zip(&bar).map(|(o, b)| f64::from(*o) * f64::from(*b)).sum::<f64>()
            };
            // Quadratic at most inside the cell, so a wide step is exact to rounding.
            let want = (at(0.01) - at(-0.01)) / 0.02;
            assert!((f64::from(x_bar[a]) - want).abs() < 2e-3 * (1.0 + want.abs()), "{} {want}", x_bar[a]);
        }
    }
}
