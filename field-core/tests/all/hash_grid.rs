//! The hash grid against a naive twin in `f64`, written from the definition.

use field_core::FieldError;
use field_core::encoding::hash_grid::{Addressing, Growth, HashGrid, HashGridConfig, Interpolation, Rule, Touched};
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;

/// One corner: entry in the whole table, weight, and the weight's derivatives.
struct Corner {
    entry: usize,
    w: f64,
    d: [f64; 3],
    /// Second derivatives.
    dd: [[f64; 3]; 3],
}

fn corners(grid: &HashGrid, level: usize, x: [f64; 3]) -> Vec<Corner> {
    let l = grid.levels()[level];
    let mut base = [0_u32; 3];
    let (mut up, mut slope, mut second) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let scale = if (0.0..=1.0).contains(&x[a]) { f64::from(l.scale) } else { 0.0 };
        let p = x[a].clamp(0.0, 1.0) * f64::from(l.scale) + f64::from(l.shift);
        let mut cell = p.floor();
        if grid.config().rule == Rule::Paper {
            cell = cell.min(f64::from(l.resolution) - 2.0);
        }
        base[a] = cell as u32;
        let f = p - cell;
        (up[a], slope[a], second[a]) = match grid.config().interpolation {
            Interpolation::Linear => (f, scale, 0.0),
            Interpolation::Smoothstep => {
                (f * f * (3.0 - 2.0 * f), scale * 6.0 * f * (1.0 - f), scale * scale * (6.0 - 12.0 * f))
            }
        };
    }
    (0..8_u32)
        .map(|c| {
            let bit = [c & 1, c >> 1 & 1, c >> 2];
            let w: Vec<f64> = (0..3).map(|a| if bit[a] == 1 { up[a] } else { 1.0 - up[a] }).collect();
            let s: Vec<f64> = (0..3).map(|a| if bit[a] == 1 { slope[a] } else { -slope[a] }).collect();
            let b: Vec<f64> = (0..3).map(|a| if bit[a] == 1 { second[a] } else { -second[a] }).collect();
            // Derivative orders along each axis to a product.
            let product = |order: [usize; 3]| (0..3).map(|a| [w[a], s[a], b[a]][order[a]]).product::<f64>();
            let order = |axes: &[usize]| {
                let mut o = [0; 3];
                axes.iter().for_each(|&a| o[a] += 1);
                o
            };
            Corner {
                entry: l.offset + l.entry([base[0] + bit[0], base[1] + bit[1], base[2] + bit[2]]) as usize,
                w: product([0; 3]),
                d: [0, 1, 2].map(|a| product(order(&[a]))),
                dd: [0, 1, 2].map(|a| [0, 1, 2].map(|b| product(order(&[a, b])))),
            }
        })
        .collect()
}

/// Everything a grid can compute, in `f64`, for one point: features, tangent, and the gradients of
/// `<out_bar, features>` and of `<out_bar, tangent>` with respect to table and position.
struct Naive {
    out: Vec<f64>,
    tangent: Vec<f64>,
    grad: Vec<(usize, f64)>,
    tangent_grad: Vec<(usize, f64)>,
    x_bar: [f64; 3],
    tangent_x_bar: [f64; 3],
}

fn naive(grid: &HashGrid, params: &[f32], x: [f64; 3], x_dot: [f64; 3], out_bar: &[f64]) -> Naive {
    let features = grid.config().features;
    let mut n = Naive {
        out: vec![0.0; grid.out_rows()],
        tangent: vec![0.0; grid.out_rows()],
        grad: Vec::new(),
        tangent_grad: Vec::new(),
        x_bar: [0.0; 3],
        tangent_x_bar: [0.0; 3],
    };
    for level in 0..grid.levels().len() {
        for c in corners(grid, level, x) {
            let along: f64 = (0..3).map(|a| c.d[a] * x_dot[a]).sum();
            for f in 0..features {
                let (row, at) = (level * features + f, c.entry * features + f);
                let e = f64::from(params[at]);
                n.out[row] += c.w * e;
                n.tangent[row] += along * e;
                n.grad.push((at, c.w * out_bar[row]));
                n.tangent_grad.push((at, along * out_bar[row]));
                for a in 0..3 {
                    n.x_bar[a] += c.d[a] * e * out_bar[row];
                    n.tangent_x_bar[a] += (0..3).map(|b| c.dd[a][b] * x_dot[b]).sum::<f64>() * e * out_bar[row];
                }
            }
        }
    }
    n
}

fn configs() -> Vec<HashGridConfig> {
    let mut all = Vec::new();
    for rule in [Rule::Ngp, Rule::Paper] {
        for (levels, features, log2_table) in [(1, 1, 9), (4, 2, 9), (3, 4, 8), (2, 8, 7)] {
            for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
                let growth = Growth::Factor(1.7);
                all.push(
                    HashGridConfig::default()
                        .with_levels(levels)
                        .with_features(features)
                        .with_log2_table(log2_table)
                        .with_n_min(5)
                        .with_growth(growth)
                        .with_rule(rule)
                        .with_interpolation(interpolation),
                );
            }
        }
    }
    all
}

fn uniform(rng: Rng, len: usize, low: f32, high: f32) -> Vec<f32> {
    (0..len).map(|i| low + (high - low) * rng.uniform_at(i as u64)).collect()
}

#[track_caller]
fn close(what: &str, got: &[f32], want: &[f64], rel: f64) {
    assert_eq!(got.len(), want.len());
    let scale = want.iter().fold(0.0_f64, |m, w| m.max(w.abs()));
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        let d = (f64::from(*g) - w).abs();
        assert!(d <= 1e-6 + rel * scale, "{what}[{i}]: {g} against {w}, off by {d:e}, bound {:e}", 1e-6 + rel * scale);
    }
}

struct Batch {
    x: Vec<f32>,
    x_dot: Vec<f32>,
    params: Vec<f32>,
    out_bar: Vec<f32>,
}

fn batch(grid: &HashGrid, n: usize, seed: u64) -> Batch {
    let rng = Rng::new(seed, 0);
    Batch {
        // A few points outside.
        x: uniform(rng.substream(0), 3 * n, -0.05, 1.05),
        x_dot: uniform(rng.substream(1), 3 * n, -1.0, 1.0),
        params: uniform(rng.substream(2), grid.params_len(), -1.0, 1.0),
        out_bar: uniform(rng.substream(3), grid.out_rows() * n, -1.0, 1.0),
    }
}

/// All results of a grid: features, tangent, and the four gradients.
fn everything(grid: &HashGrid, simd: Simd, b: &Batch) -> [Vec<f32>; 6] {
    let mut out = vec![0.0; b.out_bar.len()];
    let mut tangent = out.clone();
    let (mut grad, mut x_bar) = (vec![0.0; b.params.len()], vec![0.0; b.x.len()]);
    let (mut tangent_grad, mut tangent_x_bar) = (grad.clone(), x_bar.clone());
    grid.encode(simd, &b.params, &b.x, &mut out).unwrap();
    grid.tangent(simd, &b.params, &b.x, &b.x_dot, &mut tangent).unwrap();
    grid.encode_backward(simd, &b.x, &b.out_bar, &mut grad, None).unwrap();
    grid.tangent_backward(simd, &b.x, &b.x_dot, &b.out_bar, &mut tangent_grad, None).unwrap();
    grid.encode_backward_x(simd, &b.params, &b.x, &b.out_bar, &mut x_bar).unwrap();
    grid.tangent_backward_x(simd, &b.params, &b.x, &b.x_dot, &b.out_bar, &mut tangent_x_bar).unwrap();
    [out, tangent, grad, tangent_grad, x_bar, tangent_x_bar]
}

fn bits(all: &[Vec<f32>; 6]) -> Vec<u32> {
    all.iter().flatten().map(|x| x.to_bits()).collect()
}

/// All results of the twin, in the order of [`everything`]; table gradients by a plain scatter.
fn everything_naive(grid: &HashGrid, b: &Batch) -> [Vec<f64>; 6] {
    let (n, rows) = (b.x.len() / 3, grid.out_rows());
    let (mut out, mut tangent) = (vec![0.0; rows * n], vec![0.0; rows * n]);
    let (mut grad, mut tangent_grad) = (vec![0.0; b.params.len()], vec![0.0; b.params.len()]);
    let (mut x_bar, mut tangent_x_bar) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
    for i in 0..n {
        let point = |x: &[f32]| [0, 1, 2].map(|a| f64::from(x[a * n + i]));
        let out_bar: Vec<f64> = (0..rows).map(|r| f64::from(b.out_bar[r * n + i])).collect();
        let one = naive(grid, &b.params, point(&b.x), point(&b.x_dot), &out_bar);
        for r in 0..rows {
            out[r * n + i] = one.out[r];
            tangent[r * n + i] = one.tangent[r];
        }
        one.grad.iter().for_each(|&(at, g)| grad[at] += g);
        one.tangent_grad.iter().for_each(|&(at, g)| tangent_grad[at] += g);
        for a in 0..3 {
            x_bar[a * n + i] = one.x_bar[a];
            tangent_x_bar[a * n + i] = one.tangent_x_bar[a];
        }
    }
    [out, tangent, grad, tangent_grad, x_bar, tangent_x_bar]
}

/// Every result at every SIMD level: within rounding of the twin, and the same bits.
fn check_everything(grid: &HashGrid, b: &Batch) {
    let want = everything_naive(grid, b);
    let scalar = everything(grid, Simd::SCALAR, b);
    // Cells are located in f64; weights and sums round in f32.
    let names = ["features", "tangent", "grad", "tangent grad", "x_bar", "tangent x_bar"];
    for ((name, got), want) in names.into_iter().zip(&scalar).zip(&want) {
        close(name, got, want, 3e-6);
    }
    for simd in Simd::available() {
        let got = everything(grid, simd, b);
        assert_eq!(bits(&got), bits(&scalar), "{:?} {:?}", grid.config(), simd.level());
    }
}

#[test]
fn everything_matches_the_naive_twin_at_every_simd_level() {
    const N: usize = 53;
    for (seed, config) in configs().into_iter().enumerate() {
        let grid = HashGrid::new(config).unwrap();
        check_everything(&grid, &batch(&grid, N, seed as u64));
    }
}

/// Whether a point lies within `distance` cells of a face of some level's cells, where derivatives jump.
fn near_face(grid: &HashGrid, x: [f64; 3], distance: f64) -> bool {
    grid.levels().iter().any(|l| {
        x.iter().any(|x| {
            let p = x * f64::from(l.scale) + f64::from(l.shift);
            (p - p.round()).abs() < distance
        })
    })
}

fn any_config() -> impl Strategy<Value = HashGridConfig> {
    let growth = prop_oneof![(1.0..3.0).prop_map(Growth::Factor), (32..200_u32).prop_map(Growth::UpTo)];
    let features = prop::sample::select(vec![1_usize, 2, 4, 8]);
    let rule = prop::sample::select(vec![Rule::Ngp, Rule::Paper]);
    let interpolation = prop::sample::select(vec![Interpolation::Linear, Interpolation::Smoothstep]);
    (1..=6_usize, features, 3..=12_u32, 1..=32_u32, growth, rule, interpolation).prop_map(
        |(levels, features, log2_table, n_min, growth, rule, interpolation)| {
            HashGridConfig::default()
                .with_levels(levels)
                .with_features(features)
                .with_log2_table(log2_table)
                .with_n_min(n_min)
                .with_growth(growth)
                .with_rule(rule)
                .with_interpolation(interpolation)
        },
    )
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn every_grid_matches_the_naive_twin(config in any_config(), n in 0..40_usize, seed in any::<u64>()) {
        let grid = HashGrid::new(config).unwrap();
        check_everything(&grid, &batch(&grid, n, seed));
    }

    #[test]
    fn gradients_of_every_grid_are_those_of_differences(config in any_config(), n in 1..6_usize, seed in any::<u64>()) {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, n, seed);
        let [_, _, grad, _, x_bar, _] = everything(&grid, Simd::best(), &b);
        // <out_bar, features> of point `i` at `x`, in f64.
        let loss = |params: &[f32], i: usize, x: [f64; 3]| {
            let out_bar: Vec<f64> = (0..grid.out_rows()).map(|r| f64::from(b.out_bar[r * n + i])).collect();
            let one = naive(&grid, params, x, [0.0; 3], &out_bar);
            one.out.iter().zip(&out_bar).map(|(o, g)| o * g).sum::<f64>()
        };
        let point = |i: usize| [0, 1, 2].map(|a| f64::from(b.x[a * n + i]));
        let slopes = f64::from(grid.levels().iter().map(|l| l.scale).fold(1.0, f32::max));
        let h = 1e-6;
        for i in (0..n).filter(|&i| !near_face(&grid, point(i), 1e-3)) {
            for a in 0..3 {
                let moved = |step: f64| {
                    let mut x = point(i);
                    x[a] += step;
                    loss(&b.params, i, x)
                };
                // Outside of the box the value holds, as the position is clamped.
                if point(i).iter().any(|x| x.abs() < 2.0 * h || (x - 1.0).abs() < 2.0 * h) {
                    continue;
                }
                let (want, got) = ((moved(h) - moved(-h)) / (2.0 * h), f64::from(x_bar[a * n + i]));
                let bound = 1e-5 * slopes * (grid.out_rows() as f64);
                prop_assert!((got - want).abs() <= bound, "x_bar[{a}][{i}] {got} {want}");
            }
        }
        // Of a function linear in the table differences are exact, whatever the step. Some entries that were touched.
        let touched: Vec<usize> = (0..grad.len()).filter(|&at| grad[at] != 0.0).collect();
        for &at in touched.iter().step_by(touched.len() / 8 + 1) {
            let total = |value: f32| {
                let mut params = b.params.clone();
                params[at] = value;
                (0..n).map(|i| loss(&params, i, point(i))).sum::<f64>()
            };
            let (want, got) = ((total(4.0) - total(-4.0)) / 8.0, f64::from(grad[at]));
            prop_assert!((got - want).abs() <= 1e-5 * (1.0 + want.abs()), "grad[{at}] {got} {want}");
        }
    }
}

#[test]
fn naive_twin_matches_central_differences() {
    let h = 1e-6;
    for config in configs() {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, 1, 77);
        let params = &b.params;
        let out_bar: Vec<f64> = b.out_bar.iter().map(|&g| f64::from(g)).collect();
        let dot = |a: &[f64]| a.iter().zip(&out_bar).map(|(a, b)| a * b).sum::<f64>();
        let mut checked = 0;
        for k in 0..40 {
            let rng = Rng::new(k, 5);
            let x = [0, 1, 2].map(|a| f64::from(rng.uniform_at(a)));
            let x_dot = [3, 4, 5].map(|a| f64::from(rng.uniform_at(a)) - 0.5);
            // Differences across a cell face measure the jump.
            if near_face(&grid, x, 1e-4) {
                continue;
            }
            checked += 1;
            let n = naive(&grid, params, x, x_dot, &out_bar);
            for a in 0..3 {
                let moved = |s: f64| {
                    let mut x = x;
                    x[a] += s;
                    naive(&grid, params, x, x_dot, &out_bar)
                };
                let (up, down) = (moved(h), moved(-h));
                let d = (dot(&up.out) - dot(&down.out)) / (2.0 * h);
                assert!((d - n.x_bar[a]).abs() < 1e-6 * (1.0 + d.abs()), "{config:?} x_bar {d} {}", n.x_bar[a]);
                let d = (dot(&up.tangent) - dot(&down.tangent)) / (2.0 * h);
                assert!((d - n.tangent_x_bar[a]).abs() < 1e-5 * (1.0 + d.abs()), "{d} {}", n.tangent_x_bar[a]);
            }
            // The tangent is the derivative along x_dot.
            let moved =
                |s: f64| dot(&naive(&grid, params, [0, 1, 2].map(|a| x[a] + s * x_dot[a]), x_dot, &out_bar).out);
            let d = (moved(h) - moved(-h)) / (2.0 * h);
            assert!((d - dot(&n.tangent)).abs() < 1e-6 * (1.0 + d.abs()));
        }
        assert!(checked > 10);
    }
}

#[test]
fn scatter_is_the_adjoint_of_gather() {
    // <out_bar, encode(params)> = <encode_backward(out_bar), params>: exact gradient of a function linear in the table.
    for (seed, config) in configs().into_iter().enumerate() {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, 31, 100 + seed as u64);
        let [out, tangent, grad, tangent_grad, ..] = everything(&grid, Simd::best(), &b);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        for (out, grad) in [(out, grad), (tangent, tangent_grad)] {
            let (left, right) = (dot(&out, &b.out_bar), dot(&grad, &b.params));
            let size = out.iter().zip(&b.out_bar).map(|(a, b)| f64::from(a * b).abs()).sum::<f64>();
            assert!((left - right).abs() < 1e-5 * size, "{left} {right}");
        }
    }
}

#[test]
fn hash_matches_reference_on_ten_thousand_triples() {
    let config = HashGridConfig::default().with_levels(1).with_n_min(1 << 20).with_growth(Growth::Factor(1.0));
    let level = HashGrid::new(config).unwrap().levels()[0];
    assert_eq!(level.addressing, Addressing::Hashed);
    let rng = Rng::new(11, 0);
    for i in 0..10_000 {
        let [x, y, z, _] = rng.block_at(i).map(|w| w >> 12);
        // In u128, where nothing wraps, then cut to 32 bits.
        let product = |v: u32, prime: u128| (u128::from(v) * prime) % (1 << 32);
        let want = (u128::from(x) ^ product(y, 2_654_435_761) ^ product(z, 805_459_861)) % (1 << 19);
        assert_eq!(u128::from(level.entry([x, y, z])), want);
    }
}

#[test]
fn dense_levels_reproduce_constants_and_linear_functions() {
    for rule in [Rule::Ngp, Rule::Paper] {
        let config = HashGridConfig::default()
            .with_levels(1)
            .with_features(2)
            .with_n_min(12)
            .with_growth(Growth::Factor(1.0))
            .with_rule(rule);
        let grid = HashGrid::new(config).unwrap();
        let level = grid.levels()[0];
        assert_eq!(level.addressing, Addressing::Dense);
        let mut params = vec![0.0; grid.params_len()];
        let r = level.resolution;
        let linear = |p: [f32; 3]| 0.3 * p[0] - 0.7 * p[1] + 0.2 * p[2] + 0.1;
        for v in (0..r * r * r).map(|i| [i % r, i / r % r, i / (r * r)]) {
            let e = level.entry(v) as usize;
            params[2 * e] = 4.25;
            params[2 * e + 1] = linear(v.map(|v| v as f32));
        }
        // Below the last staggered cell: beyond it the reference wraps.
        let top = if rule == Rule::Ngp { (level.scale - 0.51) / level.scale } else { 1.0 };
        const N: usize = 200;
        let x = uniform(Rng::new(1, 1), 3 * N, 0.0, top);
        let mut out = vec![0.0; 2 * N];
        grid.encode(Simd::best(), &params, &x, &mut out).unwrap();
        for i in 0..N {
            let want = linear([0, 1, 2].map(|a| x[a * N + i] * level.scale + level.shift));
            assert!((out[i] - 4.25).abs() < 2e-6);
            assert!((out[N + i] - want).abs() < 2e-5, "{} {want}", out[N + i]);
        }
    }
}

#[test]
fn features_are_continuous_across_cell_faces() {
    for config in configs() {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, 1, 5);
        let rng = Rng::new(9, 9);
        for (k, level) in grid.levels().iter().enumerate() {
            for i in 0..20 {
                let cell = rng.below_at(i, level.resolution - 1) as f32 + 1.0 - level.shift;
                let face = (cell / level.scale).min(1.0);
                let eps = 1e-5;
                let other = [rng.uniform_at(100 + i), rng.uniform_at(200 + i)];
                let mut out = vec![0.0; 2 * grid.config().features];
                let x = [face - eps, face + eps, other[0], other[0], other[1], other[1]];
                grid.encode_level(Simd::best(), &b.params, k, &x, &mut out).unwrap();
                for pair in out.chunks(2) {
                    // Slopes are at most 2 * 3/2 * scale in each direction.
                    assert!((pair[0] - pair[1]).abs() < 2.0 * eps * 3.0 * level.scale + 1e-5, "{pair:?}");
                }
            }
        }
    }
}

#[test]
fn two_points_in_one_cell_touch_the_same_eight_rows() {
    let config = HashGridConfig::default().with_levels(3).with_log2_table(10).with_growth(Growth::Factor(2.0));
    let grid = HashGrid::new(config).unwrap();
    for level in 0..3 {
        let scale = grid.levels()[level].scale;
        let at = |p: f32| (p - 0.5) / scale;
        let touched = |x: [f32; 3]| {
            let mut grad = vec![0.0; grid.level_range(level).len()];
            grid.encode_level_backward(Simd::best(), level, &x, &[1.0, 1.0], &mut grad, None).unwrap();
            (0..grad.len()).filter(|&i| grad[i] != 0.0).collect::<Vec<_>>()
        };
        let a = touched([at(3.2), at(5.4), at(7.9)]);
        assert_eq!(a, touched([at(3.7), at(5.1), at(7.3)]));
        assert_eq!(a.len(), 16);
    }
}

#[test]
fn touched_blocks_are_those_with_gradients() {
    for config in configs() {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, 7, 3);
        let mut touched = Touched::new(&grid);
        let mut grad = vec![0.0; grid.params_len()];
        grid.encode_backward(Simd::best(), &b.x, &b.out_bar, &mut grad, Some(&mut touched)).unwrap();
        let mut count = 0;
        touched.for_each(|range| {
            count += 1;
            grad[range].fill(0.0);
        });
        assert_eq!(count, touched.count());
        assert!(count > 0 && grad.iter().all(|&g| g == 0.0), "a gradient outside the touched blocks");
        touched.clear();
        assert_eq!(touched.count(), 0);
        grid.tangent_backward(Simd::best(), &b.x, &b.x_dot, &b.out_bar, &mut grad, Some(&mut touched)).unwrap();
        touched.for_each(|range| grad[range].fill(0.0));
        assert!(grad.iter().all(|&g| g == 0.0));
    }
}

#[cfg(feature = "rayon")]
#[test]
fn one_two_and_four_threads_give_the_same_bits() {
    let config = HashGridConfig::default().with_levels(5).with_log2_table(10);
    let grid = HashGrid::new(config).unwrap();
    let b = batch(&grid, 10_001, 42);
    let all: Vec<_> = [1, 2, 4]
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            bits(&pool.install(|| everything(&grid, Simd::best(), &b)))
        })
        .into();
    assert_eq!(all[0], all[1]);
    assert_eq!(all[0], all[2]);
}

#[test]
fn batch_equals_levels_one_by_one() {
    let grid = HashGrid::new(HashGridConfig::default().with_levels(4).with_features(4).with_log2_table(9)).unwrap();
    const N: usize = 5000;
    let b = batch(&grid, N, 8);
    let all = everything(&grid, Simd::best(), &b);
    let mut grad = vec![0.0; grid.params_len()];
    for level in 0..4 {
        let rows = level * 4 * N..(level + 1) * 4 * N;
        let mut out = vec![0.0; 4 * N];
        grid.encode_level(Simd::best(), &b.params, level, &b.x, &mut out).unwrap();
        assert_eq!(out, all[0][rows.clone()]);
        grid.tangent_level(Simd::best(), &b.params, level, &b.x, &b.x_dot, &mut out).unwrap();
        assert_eq!(out, all[1][rows.clone()]);
        let grad = &mut grad[grid.level_range(level)];
        grid.encode_level_backward(Simd::best(), level, &b.x, &b.out_bar[rows], grad, None).unwrap();
    }
    assert_eq!(grad, all[2]);
}

#[test]
fn extreme_positions_are_clamped_and_every_length_works() {
    for config in configs() {
        let grid = HashGrid::new(config).unwrap();
        let b = batch(&grid, 1, 4);
        let poison =
            [f32::NAN, f32::INFINITY, -f32::INFINITY, -0.0, 1e-42, f32::MAX, f32::MIN, 1.0, 0.999_999_94, 1.000_000_1];
        for x in poison {
            let n = poison.len();
            let x: Vec<f32> = poison.iter().copied().chain(poison).chain([x; 10]).collect();
            let mut out = vec![0.0; grid.out_rows() * n];
            grid.encode(Simd::best(), &b.params, &x, &mut out).unwrap();
            assert!(out.iter().all(|y| y.abs() <= 1.0 + 1e-5), "interpolation leaves the range of its values");
            let mut x_bar = vec![0.0; 3 * n];
            grid.encode_backward_x(Simd::best(), &b.params, &x, &out, &mut x_bar).unwrap();
            assert!(x_bar.iter().all(|g| g.is_finite()));
            for (i, x) in x.iter().enumerate().filter(|(_, x)| !(0.0..=1.0).contains(*x)) {
                assert_eq!(x_bar[i], 0.0, "gradient at {x}, outside the cube");
            }
            let mut grad = vec![0.0; grid.params_len()];
            grid.encode_backward(Simd::best(), &x, &out, &mut grad, None).unwrap();
            assert!(grad.iter().all(|g| g.is_finite()));
        }
        for n in 0..=40 {
            let b = batch(&grid, n, 6);
            let all = everything(&grid, Simd::best(), &b);
            assert_eq!(all[0].len(), n * grid.out_rows());
        }
    }
}

#[test]
fn levels_have_the_resolutions_of_the_paper() {
    let grid = HashGrid::new(HashGridConfig::default()).unwrap();
    assert_eq!(grid.levels()[0].resolution, 16);
    assert_eq!(grid.levels()[15].resolution, 2048);
    assert_eq!(grid.levels()[15].scale, 2047.0);
    let exact = HashGridConfig::default().with_levels(5).with_growth(Growth::Factor(1.5));
    let sizes: Vec<_> = HashGrid::new(exact).unwrap().levels().iter().map(|l| l.resolution).collect();
    assert_eq!(sizes, [16, 24, 36, 54, 81]);
}

#[test]
fn bad_configurations_and_shapes_are_named() {
    let base = HashGridConfig::default();
    for (config, what) in [
        (base.with_levels(0), "levels"),
        (base.with_levels(33), "levels"),
        (base.with_features(3), "features"),
        (base.with_log2_table(2), "log2_table"),
        (base.with_log2_table(29), "log2_table"),
        (base.with_n_min(0), "n_min"),
        (base.with_growth(Growth::Factor(0.5)), "growth"),
        (base.with_growth(Growth::Factor(f64::NAN)), "growth"),
        (base.with_growth(Growth::UpTo(8)), "growth"),
        (base.with_growth(Growth::Factor(1e9)), "n_min * growth^level"),
    ] {
        let error = HashGrid::new(config).unwrap_err();
        assert!(matches!(error, FieldError::Config { what: w, .. } if w == what), "{error}");
        assert!(error.to_string().contains(what));
    }
    let grid = HashGrid::new(base.with_levels(2).with_log2_table(6)).unwrap();
    let params = vec![0.0; grid.params_len()];
    let s = Simd::SCALAR;
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(grid.encode(s, &params[1..], &[], &mut []), shape("params", params.len(), params.len() - 1));
    assert_eq!(grid.encode(s, &params, &[0.0; 4], &mut [0.0; 4]), shape("x", 3, 4));
    assert_eq!(grid.encode(s, &params, &[0.0; 3], &mut [0.0; 3]), shape("out", 4, 3));
    assert_eq!(grid.tangent(s, &params, &[0.0; 3], &[0.0; 6], &mut [0.0; 4]), shape("x_dot", 3, 6));
    assert!(matches!(grid.encode_level(s, &params, 2, &[], &mut []), Err(FieldError::Index { .. })));
    assert!(grid.encode_level_backward(s, 0, &[], &[], &mut [0.0; 3], None).is_err());
    assert_eq!(grid.encode(s, &params, &[], &mut []), Ok(()));
}
