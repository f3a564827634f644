use super::*;
use crate::rng::Rng;
use alloc::vec;
use testkit::gradient::{Tolerance, central_difference, compare};

fn config() -> TimeHashConfig {
    TimeHashConfig { levels: 4, features: 2, log2_table: 9, space: [2, 24], time: [1, 7] }
}

fn random(len: usize, stream: u64) -> Vec<f32> {
    let mut out = vec![0.0; len];
    Rng::new(5, stream).fill_uniform(0, &mut out);
    out
}

fn params(grid: &TimeHash) -> Vec<f32> {
    random(grid.params_len(), 1).iter().map(|u| 2.0 * u - 1.0).collect()
}

/// The definition, one sample of a level: from the lowest corner of the cell along the axes, the one on which the sample is farthest first.
fn twin(grid: &TimeHash, params: &[f64], level: usize, at: [f64; 4]) -> Vec<f64> {
    let (of, features) = (grid.levels()[level], grid.config().features);
    let table = &params[grid.level_range(level)];
    let p: [f64; 4] = core::array::from_fn(|a| at[a].clamp(0.0, 1.0) * f64::from(of.cells[a / 3]));
    let mut vertex: [u32; 4] = core::array::from_fn(|a| (p[a] as u32).min(of.cells[a / 3] - 1));
    let mut axes: Vec<(f64, usize)> = (0..4).map(|a| (p[a] - f64::from(vertex[a]), a)).collect();
    axes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut out = vec![0.0; features];
    let mut add = |vertex: [u32; 4], weight: f64| {
        let entry = of.entry(vertex) as usize * features;
        (0..features).for_each(|f| out[f] += weight * table[entry + f]);
    };
    add(vertex, 1.0 - axes[0].0);
    for k in 0..4 {
        vertex[axes[k].1] += 1;
        add(vertex, axes[k].0 - axes.get(k + 1).map_or(0.0, |next| next.0));
    }
    out
}

fn encode(grid: &TimeHash, simd: Simd, params: &[f32], x: &[f32], t: &[f32]) -> Vec<f32> {
    let mut out = vec![f32::NAN; grid.out_rows() * t.len()];
    for (level, out) in out.chunks_exact_mut((grid.config().features * t.len()).max(1)).enumerate() {
        grid.encode_level(simd, params, level, x, t, out).unwrap();
    }
    out
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

#[test]
fn features_are_those_of_the_definition() {
    // An interpreter takes its time.
    let all: &[usize] = if cfg!(miri) { &[2] } else { &[1, 2, 4, 8] };
    for &features in all {
        let grid = TimeHash::new(TimeHashConfig { features, ..config() }).unwrap();
        assert!(grid.levels().iter().any(|l| l.dense) && grid.levels().iter().any(|l| !l.dense), "{:?}", grid.levels());
        let (params, n) = (params(&grid), 21);
        let (x, t) = (random(3 * n, 2), random(n, 3));
        let out = encode(&grid, Simd::best(), &params, &x, &t);
        let (mut want, exact) = (vec![0.0; out.len()], wide(&params));
        for level in 0..grid.levels().len() {
            for i in 0..n {
                let at = [x[i], x[n + i], x[2 * n + i], t[i]].map(f64::from);
                let value = twin(&grid, &exact, level, at);
                (0..features).for_each(|f| want[(level * features + f) * n + i] = value[f]);
            }
        }
        compare("features", &out, &want, Tolerance::new(2e-5, 2e-5)).unwrap();
    }
}

/// A function that is linear over all of space and time is met exactly: weights add up to one, and their vertices to the place.
#[test]
fn what_is_linear_is_met_exactly() {
    let config = TimeHashConfig { levels: 1, features: 1, log2_table: 20, space: [5, 5], time: [3, 3] };
    let grid = TimeHash::new(config).unwrap();
    let (mut params, of) = (vec![0.0; grid.params_len()], grid.levels()[0]);
    let linear = |p: [f64; 4]| 0.3 + 1.7 * p[0] - 0.9 * p[1] + 0.4 * p[2] + 2.1 * p[3];
    for (x, y, z, t) in
        (0..6).flat_map(|x| (0..6).flat_map(move |y| (0..6).flat_map(move |z| (0..4).map(move |t| (x, y, z, t)))))
    {
        let place = [x, y, z].map(|v| f64::from(v) / 5.0);
        params[of.entry([x, y, z, t]) as usize] = linear([place[0], place[1], place[2], f64::from(t) / 3.0]) as f32;
    }
    let n = 50;
    let (x, t) = (random(3 * n, 2), random(n, 3));
    let want: Vec<f64> = (0..n).map(|i| linear([x[i], x[n + i], x[2 * n + i], t[i]].map(f64::from))).collect();
    compare("a linear function", &encode(&grid, Simd::best(), &params, &x, &t), &want, Tolerance::new(1e-5, 1e-5))
        .unwrap();
}

#[test]
fn gradients_are_those_of_differences() {
    // Few numbers: all of them are changed, one after the other.
    let few = TimeHashConfig { levels: 2, log2_table: 4, space: [1, 12], time: [1, 5], ..config() };
    let grid = TimeHash::new(few).unwrap();
    assert!(grid.levels()[0].dense && !grid.levels()[1].dense);
    // An interpreter takes its time; nineteen are more than a block.
    let (params, n) = (params(&grid), if cfg!(miri) { 3 } else { 19 });
    let (x, t, bars) = (random(3 * n, 2), random(n, 3), random(grid.out_rows() * n, 4));
    let rows = grid.config().features * n;
    let (mut grad, mut x_bar) = (vec![0.0; params.len()], vec![0.0; x.len()]);
    for (level, bars) in bars.chunks_exact(rows).enumerate() {
        let range = grid.level_range(level);
        let mut touched = vec![0; range.len().div_ceil(BLOCK_FLOATS).div_ceil(64)];
        let grad = &mut grad[range];
        grid.encode_level_backward(Simd::best(), level, &x, &t, bars, grad, &mut touched).unwrap();
        grid.encode_level_backward_x(Simd::best(), &params, level, &x, &t, bars, &mut x_bar).unwrap();
        for (i, block) in grad.chunks(BLOCK_FLOATS).enumerate() {
            let marked = touched[i / 64] >> (i % 64) & 1 == 1;
            assert!(marked || block.iter().all(|g| *g == 0.0), "level {level}, block {i} has a gradient and no mark");
        }
    }
    let functional = |params: &[f64], x: &[f64]| {
        let mut sum = 0.0;
        for level in 0..grid.levels().len() {
            for i in 0..n {
                let value = twin(&grid, params, level, [x[i], x[n + i], x[2 * n + i], f64::from(t[i])]);
                let bar = |f: usize| f64::from(bars[level * rows + f * n + i]);
                sum += value.iter().enumerate().map(|(f, v)| v * bar(f)).sum::<f64>();
            }
        }
        sum
    };
    let want = central_difference(&wide(&params), |params| functional(params, &wide(&x)));
    compare("table", &grad, &want, Tolerance::SINGLE).unwrap();
    let want = central_difference(&wide(&x), |x| functional(&wide(&params), x));
    compare("positions", &x_bar, &want, Tolerance::SINGLE).unwrap();
}

#[test]
fn every_simd_level_gives_the_same_bits() {
    let grid = TimeHash::new(config()).unwrap();
    let (params, n) = (params(&grid), 45);
    let (x, t) = (random(3 * n, 2), random(n, 3));
    let bars = random(grid.config().features * n, 4);
    let all = |simd| {
        let level = grid.levels().len() - 1;
        let (mut x_bar, mut grad) = (vec![0.0; 3 * n], vec![0.0; grid.level_range(level).len()]);
        let mut touched = vec![0; grad.len().div_ceil(BLOCK_FLOATS).div_ceil(64)];
        grid.encode_level_backward(simd, level, &x, &t, &bars, &mut grad, &mut touched).unwrap();
        grid.encode_level_backward_x(simd, &params, level, &x, &t, &bars, &mut x_bar).unwrap();
        (encode(&grid, simd, &params, &x, &t), grad, touched, x_bar)
    };
    for simd in Simd::available() {
        assert!(all(simd) == all(Simd::SCALAR), "{simd:?}");
    }
}

#[test]
fn dense_levels_share_nothing_and_hashes_stay_inside() {
    let grid = TimeHash::new(TimeHashConfig { space: [2, 12], time: [1, 4], ..config() }).unwrap();
    for level in grid.levels() {
        let [side, steps] = level.cells.map(|cells| cells + 1);
        let mut seen = vec![0; level.entries as usize];
        for t in 0..steps {
            for z in 0..side {
                for y in 0..side {
                    (0..side).for_each(|x| seen[level.entry([x, y, z, t]) as usize] += 1);
                }
            }
        }
        assert!(!level.dense || seen.iter().all(|count| *count == 1), "{level:?}");
    }
}

#[test]
fn what_is_learned_of_a_moment_leaves_others_alone() {
    let grid =
        TimeHash::new(TimeHashConfig { levels: 1, log2_table: 20, space: [4, 4], time: [8, 8], ..config() }).unwrap();
    let (mut params, n) = (vec![0.0; grid.params_len()], 9);
    let (x, t) = ([0.3; 27], core::array::from_fn::<f32, 9, _>(|i| i as f32 / 8.0));
    let mut touched = vec![0; params.len().div_ceil(BLOCK_FLOATS).div_ceil(64)];
    let at = |v: f32| [v; 3];
    grid.encode_level_backward(Simd::best(), 0, &at(0.3), &[0.5], &[1.0, 1.0], &mut params, &mut touched).unwrap();
    let out = encode(&grid, Simd::best(), &params, &x, &t);
    for (i, value) in out[..n].iter().enumerate() {
        assert_eq!(*value > 0.0, i == 4, "time {i} of 8: {value}");
    }
}

#[test]
fn extremes_are_clamped_and_no_points_are_no_work() {
    let grid = TimeHash::new(config()).unwrap();
    let params = params(&grid);
    let odd = [f32::NAN, -3.0, 5.0, f32::INFINITY, f32::NEG_INFINITY, 1.0, 0.0];
    let clamped = [0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0];
    let n = odd.len();
    let all = |row: &[f32]| encode(&grid, Simd::best(), &params, &[row, row, row].concat(), row);
    assert_eq!(all(&odd), all(&clamped));
    // Neither has a gradient outside.
    let (x, bars) = ([odd; 3].concat(), vec![1.0; grid.config().features * n]);
    let mut x_bar = vec![0.0; 3 * n];
    grid.encode_level_backward_x(Simd::best(), &params, 0, &x, &odd, &bars, &mut x_bar).unwrap();
    assert!(x_bar.chunks_exact(n).all(|row| row[..5].iter().all(|bar| *bar == 0.0) && row[6] != 0.0), "{x_bar:?}");

    let mut touched = vec![0; grid.level_range(0).len().div_ceil(BLOCK_FLOATS).div_ceil(64)];
    let mut grad = vec![0.0; grid.level_range(0).len()];
    grid.encode_level(Simd::best(), &params, 0, &[], &[], &mut []).unwrap();
    grid.encode_level_backward(Simd::best(), 0, &[], &[], &[], &mut grad, &mut touched).unwrap();
    grid.encode_level_backward_x(Simd::best(), &params, 0, &[], &[], &[], &mut []).unwrap();
    assert!(grad.iter().all(|g| *g == 0.0) && touched.iter().all(|t| *t == 0));
}

#[test]
fn the_most_cells_there_may_be_are_no_problem() {
    let most = TimeHashConfig { log2_table: 3, space: [1, 1 << 14], time: [1, 1 << 14], ..config() };
    let grid = TimeHash::new(most).unwrap();
    let (x, t) = (random(60, 2), random(20, 3));
    let out = encode(&grid, Simd::best(), &params(&grid), &x, &t);
    assert!(out.iter().all(|out| out.abs() <= 1.0), "{out:?}");
}

#[test]
fn what_cannot_be_is_refused() {
    for bad in [
        TimeHashConfig { levels: 0, ..config() },
        TimeHashConfig { features: 3, ..config() },
        TimeHashConfig { log2_table: 40, ..config() },
        TimeHashConfig { space: [8, 4], ..config() },
        TimeHashConfig { space: [0, 4], ..config() },
        TimeHashConfig { time: [1, 1 << 20], ..config() },
        TimeHashConfig { log2_table: 28, levels: 4, ..config() },
    ] {
        assert!(matches!(TimeHash::new(bad), Err(FieldError::Config { .. })), "{bad:?}");
    }
    let grid = TimeHash::new(config()).unwrap();
    let params = params(&grid);
    let encode = |params: &[f32], level, x: &[f32], out: usize| {
        grid.encode_level(Simd::best(), params, level, x, &[0.5], &mut vec![0.0; out])
    };
    assert!(encode(&params, 0, &[0.5; 3], 2).is_ok());
    assert!(matches!(encode(&params, 9, &[0.5; 3], 2), Err(FieldError::Index { .. })));
    assert!(matches!(encode(&params, 0, &[0.5; 4], 2), Err(FieldError::Shape { .. })));
    assert!(matches!(encode(&params, 0, &[0.5; 3], 3), Err(FieldError::Shape { .. })));
    assert!(matches!(encode(&params[1..], 0, &[0.5; 3], 2), Err(FieldError::Shape { .. })));
}
