//! Multi-distance interpolation against a naive twin in `f64`, and what the method asks of it.

use field_core::FieldError;
use field_core::encoding::hash_grid::BLOCK_FLOATS;
use field_core::encoding::multi_distance::{MultiDistance, STRIDES};
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, compare, cotangent};

fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    let rng = Rng::new(seed, 0);
    (0..len).map(|i| low + (high - low) * rng.uniform_at(i as u64)).collect()
}

fn f32s(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

fn grid(resolution: [u32; 3], features: usize) -> MultiDistance {
    MultiDistance::new(resolution, features).unwrap()
}

/// The vertices around `x` at one stride: number in the full grid, weight, and the weight's derivatives.
fn corners(grid: &MultiDistance, stride: usize, x: [f64; 3]) -> [(usize, f64, [f64; 3]); 8] {
    let [vx, vy, _] = grid.vertices().map(|v| v as usize);
    let (mut cell, mut f, mut slope) = ([0; 3], [0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let cells = f64::from(grid.resolution()[a] - 1) / stride as f64;
        let p = x[a].clamp(0.0, 1.0) * cells;
        cell[a] = (p.floor() as usize).min((grid.vertices()[a] as usize - 1) / stride - 1);
        f[a] = p - cell[a] as f64;
        slope[a] = if (0.0..=1.0).contains(&x[a]) { cells } else { 0.0 };
    }
    core::array::from_fn(|c| {
        let up = [c & 1, c >> 1 & 1, c >> 2];
        let [x, y, z] = core::array::from_fn(|a| stride * (cell[a] + up[a]));
        let w: [f64; 3] = core::array::from_fn(|a| if up[a] == 1 { f[a] } else { 1.0 - f[a] });
        let s: [f64; 3] = core::array::from_fn(|a| if up[a] == 1 { slope[a] } else { -slope[a] });
        let derivative = [s[0] * w[1] * w[2], w[0] * s[1] * w[2], w[0] * w[1] * s[2]];
        (x + vx * (y + vy * z), w[0] * w[1] * w[2], derivative)
    })
}

/// Call `body` with row and column of an output, index into the table, weight, and the weight's derivatives.
fn for_each_term(grid: &MultiDistance, x: &[f64], mut body: impl FnMut(usize, usize, usize, f64, [f64; 3])) {
    let n = x.len() / 3;
    for i in 0..n {
        for (k, stride) in STRIDES.into_iter().enumerate() {
            for (entry, w, d) in corners(grid, stride, [x[i], x[n + i], x[2 * n + i]]) {
                for f in 0..grid.features() {
                    body(k * grid.features() + f, i, entry * grid.features() + f, w, d);
                }
            }
        }
    }
}

fn twin(grid: &MultiDistance, table: &[f64], x: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    let n = x.len() / 3;
    for_each_term(grid, x, |row, i, at, w, _| out[row * n + i] += w * table[at]);
}

fn twin_backward(grid: &MultiDistance, both: &[f64], out_bar: &[f64], bars: &mut [f64]) {
    let len = grid.params_len();
    let (table, x) = both.split_at(len);
    let n = x.len() / 3;
    for_each_term(grid, x, |row, i, at, w, d| {
        let bar = out_bar[row * n + i];
        bars[at] += w * bar;
        (0..3).for_each(|a| bars[len + a * n + i] += d[a] * table[at] * bar);
    });
}

/// Points that lie in the box and on no face of a narrow cell (those of the wide ones are among them).
fn inside_cells(grid: &MultiDistance, n: usize) -> Vec<f32> {
    let candidates = uniform(5, 60 * n, 0.0, 1.0);
    let clear = |p: &&[f32]| {
        (0..3).all(|a| {
            let at = p[a] * (grid.resolution()[a] - 1) as f32;
            (at - at.round()).abs() > 1e-3
        })
    };
    let points: Vec<_> = candidates.chunks(3).filter(clear).take(n).collect();
    assert_eq!(points.len(), n);
    (0..3).flat_map(|a| points.iter().map(move |p| p[a])).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn axes_are_padded_to_end_together() {
    for (s, v) in [(2, 5), (4, 5), (5, 5), (6, 9), (9, 9), (10, 13), (80, 81), (160, 161), (161, 161)] {
        let grid = grid([s, 5, s], 2);
        assert_eq!(grid.vertices(), [v, 5, v]);
        assert_eq!(grid.params_len(), (v * v * 5 * 2) as usize);
        assert_eq!(grid.out_rows(), 6);
    }
}

#[test]
fn values_and_gradients_match_the_twin() {
    // Every group of features, cubes and boxes, padded and not.
    for (resolution, features) in [
        ([5, 5, 5], 1),
        ([4, 6, 2], 2),
        ([9, 3, 4], 3),
        ([6, 5, 4], 4),
        ([6, 5, 3], 6),
        ([3, 3, 3], 8),
        ([2, 4, 3], 15),
    ] {
        let grid = grid(resolution, features);
        let len = grid.params_len();
        const N: usize = 11;
        let both = [uniform(1, len, -1.0, 1.0), inside_cells(&grid, N)].concat();
        let out_bar = f32s(&cotangent(grid.out_rows() * N, 3));
        let simd = Simd::best();
        let single = (
            |both: &[f32], out: &mut [f32]| grid.encode(simd, &both[..len], &both[len..], out).unwrap(),
            |both: &[f32], out_bar: &[f32], bars: &mut [f32]| {
                let (table_bar, x_bar) = bars.split_at_mut(len);
                grid.encode_backward(simd, &both[len..], out_bar, table_bar).unwrap();
                grid.encode_backward_x(simd, &both[..len], &both[len..], out_bar, x_bar).unwrap();
            },
        );
        let twin = (
            |both: &[f64], out: &mut [f64]| twin(&grid, &both[..len], &both[len..], out),
            |both: &[f64], out_bar: &[f64], bars: &mut [f64]| twin_backward(&grid, both, out_bar, bars),
        );
        let tolerances = PairTolerances { values: Tolerance::new(1e-6, 1e-6), ..PairTolerances::default() };
        check_f32_pair(&both, &out_bar, single, twin, tolerances).unwrap();
    }
}

#[test]
fn tangents_match_the_twin_and_are_adjoint_to_their_gradients() {
    let grid = grid([6, 4, 7], 6);
    const N: usize = 21;
    let (table, x) = (uniform(1, grid.params_len(), -1.0, 1.0), uniform(2, 3 * N, -0.1, 1.1));
    let x_dot = uniform(3, 3 * N, -1.0, 1.0);
    let bar = f32s(&cotangent(grid.out_rows() * N, 3));
    let x64: Vec<f64> = x.iter().map(|&x| x.into()).collect();
    let mut want = vec![0.0; bar.len()];
    for_each_term(&grid, &x64, |row, i, at, _, d| {
        let along: f64 = (0..3).map(|a| d[a] * f64::from(x_dot[a * N + i])).sum();
        want[row * N + i] += along * f64::from(table[at]);
    });
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    for simd in Simd::available() {
        let mut out_dot = vec![f32::NAN; bar.len()];
        grid.tangent(simd, &table, &x, &x_dot, &mut out_dot).unwrap();
        compare("tangent", &out_dot, &want, Tolerance::new(2e-6, 1e-6)).unwrap();
        let (mut table_bar, mut x_bar) = (vec![0.0; table.len()], vec![0.0; x.len()]);
        grid.tangent_backward(simd, &x, &x_dot, &bar, &mut table_bar).unwrap();
        grid.encode_backward_x(simd, &table, &x, &bar, &mut x_bar).unwrap();
        let three = [dot(&out_dot, &bar), dot(&table_bar, &table), dot(&x_bar, &x_dot)];
        assert!(three.iter().all(|t| (t - three[0]).abs() < 1e-5 * (1.0 + three[0].abs())), "{three:?}");
    }
}

#[test]
fn all_strides_together_are_the_strides_one_by_one() {
    let grid = grid([6, 7, 4], 6);
    const N: usize = 37;
    let (table, x) = (uniform(1, grid.params_len(), -1.0, 1.0), uniform(2, 3 * N, -0.2, 1.2));
    let bar = uniform(3, grid.out_rows() * N, -1.0, 1.0);
    let part = grid.features() * N;
    let mut of_one_level = Vec::new();
    for simd in Simd::available() {
        let mut out = vec![f32::NAN; bar.len()];
        let (mut table_bar, mut x_bar) = (vec![0.0; table.len()], vec![0.0; x.len()]);
        grid.encode(simd, &table, &x, &mut out).unwrap();
        grid.encode_backward(simd, &x, &bar, &mut table_bar).unwrap();
        grid.encode_backward_x(simd, &table, &x, &bar, &mut x_bar).unwrap();
        let (mut table_bars, mut x_bars) = (vec![0.0; table.len()], vec![0.0; x.len()]);
        let (mut marked, mut touched) = (vec![0.0; table.len()], vec![0; grid.touched_words()]);
        for s in 0..STRIDES.len() {
            let bar = &bar[s * part..][..part];
            let mut one = vec![f32::NAN; part];
            grid.encode_stride(simd, s, &table, &x, &mut one).unwrap();
            assert_eq!(bits(&one), bits(&out[s * part..][..part]));
            grid.encode_stride_backward(simd, s, &x, bar, &mut table_bars).unwrap();
            grid.encode_stride_backward_x(simd, s, &table, &x, bar, &mut x_bars).unwrap();
            grid.encode_stride_backward_touched(simd, s, &x, bar, &mut marked, &mut touched).unwrap();
        }
        assert_eq!(bits(&table_bars), bits(&table_bar));
        assert_eq!(bits(&marked), bits(&table_bar));
        assert_eq!(bits(&x_bars), bits(&x_bar));
        of_one_level.push([bits(&out), bits(&table_bar), bits(&x_bar)]);
    }
    assert!(of_one_level.windows(2).all(|pair| pair[0] == pair[1]), "the levels agree");
}

#[test]
fn what_is_added_to_is_marked_and_little_else() {
    // Entries of 6, 9 and 15 floats straddle blocks of 16; those of 4 do not.
    for features in [1, 4, 6, 9, 15] {
        let grid = grid([9, 9, 9], features);
        for (point, x) in uniform(7, 60, 0.0, 1.0).chunks(3).enumerate() {
            for s in 0..STRIDES.len() {
                let (mut bar, mut touched) = (vec![0.0; grid.params_len()], vec![0; grid.touched_words()]);
                let ones = vec![1.0; features];
                grid.encode_stride_backward_touched(Simd::best(), s, x, &ones, &mut bar, &mut touched).unwrap();
                let marked = |block: usize| touched[block / 64] >> (block % 64) & 1 == 1;
                for (block, bars) in bar.chunks(BLOCK_FLOATS).enumerate() {
                    let added = bars.iter().any(|b| *b != 0.0);
                    assert_eq!(marked(block), added, "point {point}, {features} features, stride {s}, block {block}");
                }
            }
        }
    }
}

#[test]
fn linear_fields_are_read_exactly_at_every_distance() {
    // Not stretched: the padded vertices lie where the others' spacing puts them.
    let grid = grid([6, 8, 11], 1);
    let [vx, vy, vz] = grid.vertices();
    let spacing = grid.resolution().map(|r| 1.0 / (r - 1) as f32);
    let field = |p: [f32; 3]| 0.5 + p[0] - 2.0 * p[1] + 0.25 * p[2];
    let at = |x: u32, y: u32, z: u32| field([x as f32 * spacing[0], y as f32 * spacing[1], z as f32 * spacing[2]]);
    let table: Vec<f32> = (0..vz).flat_map(|z| (0..vy).flat_map(move |y| (0..vx).map(move |x| at(x, y, z)))).collect();
    const N: usize = 50;
    let x = uniform(1, 3 * N, 0.0, 1.0);
    let mut out = vec![f32::NAN; 3 * N];
    grid.encode(Simd::best(), &table, &x, &mut out).unwrap();
    for (r, got) in out.iter().enumerate() {
        let i = r % N;
        let want = field([x[i], x[N + i], x[2 * N + i]]);
        assert!((got - want).abs() < 3e-6, "{got} {want}");
    }
}

#[test]
fn outside_the_box_the_border_counts_and_positions_have_no_gradient() {
    let grid = grid([6, 5, 7], 3);
    let table = uniform(1, grid.params_len(), -1.0, 1.0);
    let (nan, inf, max) = (f32::NAN, f32::INFINITY, f32::MAX);
    let cases = [[nan; 3], [-inf, inf, nan], [-max, max, -1e-45], [1.0 + f32::EPSILON, -0.1, 2.0], [1e30, -1e30, 0.5]];
    for simd in Simd::available() {
        for x in cases {
            // NaN lies below.
            let border = x.map(|x| if x > 0.0 { x.min(1.0) } else { 0.0 });
            let [mut got, mut want] = [vec![nan; grid.out_rows()], vec![nan; grid.out_rows()]];
            grid.encode(simd, &table, &x, &mut got).unwrap();
            grid.encode(simd, &table, &border, &mut want).unwrap();
            assert_eq!(bits(&got), bits(&want), "{x:?}");
            let bar = vec![1.0; grid.out_rows()];
            let (mut x_bar, mut inside, mut table_bar) = ([0.0; 3], [0.0; 3], vec![0.0; table.len()]);
            grid.encode_backward_x(simd, &table, &x, &bar, &mut x_bar).unwrap();
            grid.encode_backward_x(simd, &table, &border, &bar, &mut inside).unwrap();
            for a in 0..3 {
                let outside = !(0.0..=1.0).contains(&x[a]);
                assert_eq!(x_bar[a], if outside { 0.0 } else { inside[a] }, "{x:?}");
            }
            grid.encode_backward(simd, &x, &bar, &mut table_bar).unwrap();
            let sum: f32 = table_bar.iter().sum();
            assert!((sum - 9.0).abs() < 1e-5, "the weights of each stride sum to one: {sum}");
        }
    }
}

#[test]
fn empty_batches_are_legal_and_wrong_sizes_are_named() {
    let grid = grid([3, 4, 5], 2);
    let len = grid.params_len();
    let (table, s) = (vec![0.0; len], Simd::SCALAR);
    assert_eq!(grid.encode(s, &table, &[], &mut []), Ok(()));
    assert_eq!(grid.tangent(s, &table, &[], &[], &mut []), Ok(()));
    assert_eq!(grid.encode_backward(s, &[], &[], &mut vec![0.0; len]), Ok(()));
    assert_eq!(grid.encode_backward_x(s, &table, &[], &[], &mut []), Ok(()));
    assert_eq!(grid.encode_stride(s, 2, &table, &[], &mut []), Ok(()));
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(grid.encode(s, &table[1..], &[], &mut []), shape("table", len, len - 1));
    assert_eq!(grid.encode(s, &table, &[0.0; 4], &mut [0.0; 6]), shape("x", 3, 4));
    assert_eq!(grid.encode(s, &table, &[0.0; 3], &mut [0.0; 2]), shape("out", 6, 2));
    assert_eq!(grid.encode_stride(s, 0, &table, &[0.0; 3], &mut [0.0; 6]), shape("out", 2, 6));
    assert_eq!(grid.tangent(s, &table, &[0.0; 3], &[], &mut [0.0; 6]), shape("x_dot", 3, 0));
    assert_eq!(grid.encode_backward(s, &[], &[], &mut [0.0]), shape("table_bar", len, 1));
    assert_eq!(grid.encode_backward_x(s, &table, &[0.0; 3], &[0.0; 6], &mut [0.0]), shape("x_bar", 3, 1));
    let error = grid.encode_stride(s, 3, &table, &[], &mut []).unwrap_err();
    assert_eq!(error, FieldError::Index { what: "stride", index: 0, got: 3, limit: 3 });
    let touched = grid.encode_stride_backward_touched(s, 0, &[], &[], &mut vec![0.0; len], &mut []);
    assert_eq!(touched, shape("touched", grid.touched_words(), 0));
    for (resolution, features, what) in [
        ([1, 4, 4], 1, "resolution"),
        ([4, 4, (1 << 20) + 1], 1, "resolution"),
        ([4, 4, 4], 0, "features"),
        ([1 << 11; 3], 4, "parameters"),
        ([4; 3], usize::MAX, "parameters"),
    ] {
        let error = MultiDistance::new(resolution, features).unwrap_err();
        assert!(matches!(error, FieldError::Config { what: w, .. } if w == what), "{error}");
    }
}

#[test]
fn a_grid_grows_step_by_step_as_the_method_does() {
    // 160 vertices, halved three times; nothing coincides, yet every new vertex holds the old field's value there.
    let mut coarse = grid([20; 3], 2);
    let mut table = uniform(1, coarse.params_len(), -1.0, 1.0);
    for s in [25, 31, 40] {
        let finer = grid([s; 3], 2);
        let grown = coarse.upsampled(&table, &finer);
        let x: Vec<f32> = uniform(u64::from(s), 30, 0.0, s as f32 - 0.01).iter().map(|v| v.floor()).collect();
        let unit: Vec<f32> = x.iter().map(|v| v / (s - 1) as f32).collect();
        let mut want = vec![f32::NAN; 20];
        coarse.encode_stride(Simd::best(), 0, &table, &unit, &mut want).unwrap();
        let v = finer.vertices()[0] as usize;
        for i in 0..10 {
            let [x, y, z] = [0, 1, 2].map(|a| x[a * 10 + i] as usize);
            for f in 0..2 {
                let got = grown[(x + v * (y + v * z)) * 2 + f];
                assert!((got - want[f * 10 + i]).abs() < 1e-5, "{got} {}", want[f * 10 + i]);
            }
        }
        (coarse, table) = (finer, grown);
    }
}

fn any_resolution() -> impl Strategy<Value = [u32; 3]> {
    [2..12_u32, 2..12_u32, 2..12_u32]
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    /// Whatever the deformation does to the position, a constant grid gives constant features, the same at all strides.
    #[test]
    fn a_constant_grid_gives_constant_features_at_every_stride(
        resolution in any_resolution(), value in -10.0..10.0_f32, seed in 0..1000_u64,
    ) {
        let grid = grid(resolution, 2);
        let table = vec![value; grid.params_len()];
        let x = uniform(seed, 30, -0.5, 1.5);
        let mut out = vec![f32::NAN; grid.out_rows() * 10];
        grid.encode(Simd::best(), &table, &x, &mut out).unwrap();
        for y in out {
            prop_assert!((y - value).abs() <= 4.0 * f32::EPSILON * value.abs(), "{} {}", y, value);
        }
    }

    /// Where the old vertices are among the new ones, they keep their values to the bit; the field between them stays.
    #[test]
    fn upsampling_preserves_values_at_old_vertices(
        resolution in any_resolution(), factor in [1..4_u32, 1..4_u32, 1..4_u32], seed in 0..1000_u64,
    ) {
        let old = grid(resolution, 3);
        let new = grid([0, 1, 2].map(|a| (resolution[a] - 1) * factor[a] + 1), 3);
        let table = uniform(seed, old.params_len(), -1.0, 1.0);
        let grown = old.upsampled(&table, &new);
        prop_assert_eq!(grown.len(), new.params_len());
        let at = |grid: &MultiDistance, v: [u32; 3]| {
            let [vx, vy, _] = grid.vertices();
            ((v[0] + vx * (v[1] + vy * v[2])) * 3) as usize
        };
        let [sx, sy, sz] = resolution;
        for v in (0..sx * sy * sz).map(|i| [i % sx, i / sx % sy, i / (sx * sy)]) {
            let w = [0, 1, 2].map(|a| v[a] * factor[a]);
            prop_assert_eq!(&grown[at(&new, w)..][..3], &table[at(&old, v)..][..3]);
        }
        let x = uniform(seed + 1, 30, 0.0, 1.0);
        let (mut before, mut after) = (vec![f32::NAN; 30], vec![f32::NAN; 30]);
        old.encode_stride(Simd::best(), 0, &table, &x, &mut before).unwrap();
        new.encode_stride(Simd::best(), 0, &grown, &x, &mut after).unwrap();
        for (a, b) in before.iter().zip(&after) {
            prop_assert!((a - b).abs() < 1e-5, "{} {}", a, b);
        }
    }

    /// To any resolution, a constant stays that constant, in the padding too.
    #[test]
    fn upsampling_keeps_constants(from in any_resolution(), to in any_resolution(), value in -10.0..10.0_f32) {
        let (from, to) = (grid(from, 1), grid(to, 1));
        let table = from.upsampled(&vec![value; from.params_len()], &to);
        prop_assert!(table.iter().all(|v| *v == value));
    }

    /// A batch is its samples one by one.
    #[test]
    fn batches_equal_single_samples(n in 0..40_usize, seed in 0..1000_u64) {
        let grid = grid([5, 7, 4], 6);
        let table = uniform(seed, grid.params_len(), -1.0, 1.0);
        let x = uniform(seed + 1, 3 * n, -0.2, 1.2);
        let rows = grid.out_rows();
        let mut out = vec![f32::NAN; rows * n];
        grid.encode(Simd::best(), &table, &x, &mut out).unwrap();
        for i in 0..n {
            let mut one = vec![f32::NAN; rows];
            grid.encode(Simd::best(), &table, &[x[i], x[n + i], x[2 * n + i]], &mut one).unwrap();
            for (r, y) in one.iter().enumerate() {
                prop_assert_eq!(y.to_bits(), out[r * n + i].to_bits());
            }
        }
    }
}
