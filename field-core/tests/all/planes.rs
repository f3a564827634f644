//! Tri-planes, k-planes and hex-planes against a naive twin in `f64`, and what one expects of them.

use field_core::FieldError;
use field_core::encoding::EncodingBars;
use field_core::encoding::planes::{Combine, Planes};
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, central_difference, check_f32_pair, compare, cotangent};
use testkit::reference::planes;

pub(crate) fn uniform(seed: u64, len: usize, low: f32, high: f32) -> Vec<f32> {
    let rng = Rng::new(seed, 0);
    (0..len).map(|i| low + (high - low) * rng.uniform_at(i as u64)).collect()
}

pub(crate) fn f32s(x: &[f64]) -> Vec<f32> {
    x.iter().map(|&x| x as f32).collect()
}

pub(crate) fn f64s(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x.into()).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

/// The kinds, for the twin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    Sum,
    Product,
    K,
    Hex,
}

const KINDS: [Kind; 4] = [Kind::Sum, Kind::Product, Kind::K, Kind::Hex];

impl Kind {
    fn planes(self, resolution: [u32; 4], features: usize) -> Planes {
        let [x, y, z, _] = resolution;
        match self {
            Self::Sum => Planes::tri_plane([x, y, z], features, Combine::Sum),
            Self::Product => Planes::tri_plane([x, y, z], features, Combine::Product),
            Self::K => Planes::k_planes(resolution, features),
            Self::Hex => Planes::hex_plane(resolution, features),
        }
        .unwrap()
    }

    /// What the twin combines the planes with.
    fn combine(self) -> planes::Combine {
        match self {
            Self::Sum => planes::Combine::Sum,
            Self::Product | Self::K => planes::Combine::Product,
            Self::Hex => planes::Combine::Hex,
        }
    }
}

/// What the twin knows about one point and one feature.
fn point(kind: Kind, planes: &Planes, table: &[f64], x: &[f64], feature: usize) -> planes::Point {
    let pairs: Vec<_> = planes.pairs().collect();
    let (resolution, features) = (planes.resolution(), planes.features());
    planes::Planes { resolution, features, pairs: &pairs, combine: kind.combine() }.point(table, x, feature)
}

fn column(x: &[f64], axes: usize, i: usize) -> Vec<f64> {
    let n = x.len() / axes;
    (0..axes).map(|a| x[a * n + i]).collect()
}

pub(crate) fn twin(kind: Kind, planes: &Planes, both: &[f64], out: &mut [f64]) {
    let (table, x) = both.split_at(planes.params_len());
    let n = x.len() / planes.in_rows();
    for i in 0..n {
        for f in 0..planes.features() {
            out[f * n + i] = point(kind, planes, table, &column(x, planes.in_rows(), i), f).value;
        }
    }
}

pub(crate) fn twin_backward(kind: Kind, planes: &Planes, both: &[f64], out_bar: &[f64], bars: &mut [f64]) {
    let (table, x) = both.split_at(planes.params_len());
    let n = x.len() / planes.in_rows();
    for i in 0..n {
        for f in 0..planes.features() {
            let point = point(kind, planes, table, &column(x, planes.in_rows(), i), f);
            let bar = out_bar[f * n + i];
            point.by_table.iter().for_each(|(at, d)| bars[*at] += d * bar);
            (0..planes.in_rows()).for_each(|a| bars[table.len() + a * n + i] += point.by_x[a] * bar);
        }
    }
}

pub(crate) fn twin_tangent(kind: Kind, planes: &Planes, both: &[f64], x_dot: &[f64], out_dot: &mut [f64]) {
    let (table, x) = both.split_at(planes.params_len());
    let (axes, n) = (planes.in_rows(), x.len() / planes.in_rows());
    for i in 0..n {
        for f in 0..planes.features() {
            let by_x = point(kind, planes, table, &column(x, axes, i), f).by_x;
            out_dot[f * n + i] = column(x_dot, axes, i).iter().zip(by_x).map(|(x, d)| x * d).sum();
        }
    }
}

/// Points that lie in the box and on no face of a cell.
fn inside_cells(planes: &Planes, n: usize) -> Vec<f32> {
    let axes = planes.in_rows();
    let candidates = uniform(5, 20 * axes * n, -1.0, 1.0);
    let clear = |p: &&[f32]| {
        p.iter().zip(planes.resolution()).all(|(x, &r)| {
            let at = (x + 1.0) * 0.5 * (r - 1) as f32;
            r == 1 || (at - at.round()).abs() > 1e-3
        })
    };
    let points: Vec<_> = candidates.chunks(axes).filter(clear).take(n).collect();
    assert_eq!(points.len(), n);
    (0..axes).flat_map(|a| points.iter().map(move |p| p[a])).collect()
}

const SHAPES: [([u32; 4], usize); 6] =
    [([4, 5, 6, 3], 1), ([5, 3, 4, 2], 3), ([3, 4, 3, 1], 4), ([4, 3, 5, 3], 6), ([1, 3, 2, 2], 2), ([2, 3, 4, 3], 9)];

#[test]
fn planes_lie_in_the_table_one_after_the_other() {
    let planes = Planes::k_planes([3, 4, 5, 6], 2).unwrap();
    let pairs: Vec<_> = planes.pairs().collect();
    assert_eq!(pairs, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
    let ranges: Vec<_> = (0..6).map(|p| planes.plane_range(p)).collect();
    assert_eq!(ranges, [0..24, 24..54, 54..90, 90..130, 130..178, 178..238]);
    assert_eq!(planes.params_len(), 238);
    assert_eq!((planes.in_rows(), planes.features(), planes.resolution()), (4, 2, &[3, 4, 5, 6][..]));
    let tri = Planes::tri_plane([3, 4, 5], 1, Combine::Sum).unwrap();
    assert_eq!(tri.pairs().collect::<Vec<_>>(), [[0, 1], [0, 2], [1, 2]]);
    assert_eq!((tri.in_rows(), tri.params_len(), tri.plane_range(2)), (3, 47, 27..47));
}

#[test]
fn values_and_gradients_match_the_twin() {
    for kind in KINDS {
        for (resolution, features) in SHAPES {
            let planes = kind.planes(resolution, features);
            let len = planes.params_len();
            const N: usize = 9;
            let mut both = [uniform(1, len, -1.0, 1.0), inside_cells(&planes, N)].concat();
            // Products with 0 have gradients too.
            both[..len].iter_mut().step_by(5).for_each(|v| *v = 0.0);
            let out_bar = f32s(&cotangent(features * N, 3));
            let simd = Simd::best();
            let single = (
                |both: &[f32], out: &mut [f32]| planes.encode(simd, &both[..len], &both[len..], out).unwrap(),
                |both: &[f32], out_bar: &[f32], bars: &mut [f32]| {
                    let (table_bar, x_bar) = bars.split_at_mut(len);
                    let (table, x) = both.split_at(len);
                    planes.encode_backward(simd, table, x, out_bar, EncodingBars::both(table_bar, x_bar)).unwrap();
                },
            );
            let twin = (
                |both: &[f64], out: &mut [f64]| twin(kind, &planes, both, out),
                |both: &[f64], out_bar: &[f64], bars: &mut [f64]| {
                    twin_backward(kind, &planes, both, out_bar, bars);
                },
            );
            let tolerances = PairTolerances { values: Tolerance::new(2e-6, 1e-6), ..PairTolerances::default() };
            check_f32_pair(&both, &out_bar, single, twin, tolerances).unwrap();
        }
    }
}

#[test]
fn tangents_and_their_gradients_match_the_twin() {
    for kind in KINDS {
        for (resolution, features) in SHAPES {
            let planes = kind.planes(resolution, features);
            let len = planes.params_len();
            const N: usize = 7;
            let both = [uniform(1, len, -1.0, 1.0), inside_cells(&planes, N)].concat();
            let (table, x) = both.split_at(len);
            let x_dot = uniform(2, x.len(), -1.0, 1.0);
            let bar = cotangent(features * N, 3);
            let mut want = vec![f64::NAN; features * N];
            twin_tangent(kind, &planes, &f64s(&both), &f64s(&x_dot), &mut want);
            let want_bars = central_difference(&f64s(&both), |both| {
                let mut out = vec![f64::NAN; features * N];
                twin_tangent(kind, &planes, both, &f64s(&x_dot), &mut out);
                out.iter().zip(&bar).map(|(o, b)| o * b).sum()
            });
            for simd in Simd::available() {
                let mut out_dot = vec![f32::NAN; want.len()];
                planes.tangent(simd, table, x, &x_dot, &mut out_dot).unwrap();
                compare("tangent", &out_dot, &want, Tolerance::new(3e-6, 1e-6)).unwrap();
                let (mut table_bar, mut x_bar) = (vec![1.0; len], vec![1.0; x.len()]);
                let bars = (Some(&mut table_bar[..]), Some(&mut x_bar[..]));
                planes
                    .tangent_backward(simd, table, x, &x_dot, &f32s(&bar), EncodingBars { table: bars.0, x: bars.1 })
                    .unwrap();
                let got: Vec<f64> = table_bar.iter().chain(&x_bar).map(|g| f64::from(*g) - 1.0).collect();
                compare("gradient of the tangent", &got, &want_bars, Tolerance::SINGLE).unwrap();
            }
        }
    }
}

#[test]
fn the_levels_agree_and_gradients_may_be_left_out() {
    for kind in KINDS {
        let planes = kind.planes([6, 5, 7, 4], 9);
        const N: usize = 53;
        let (len, rows) = (planes.params_len(), planes.in_rows());
        let (table, x) = (uniform(1, len, -1.0, 1.0), uniform(2, rows * N, -1.2, 1.2));
        let (x_dot, bar) = (uniform(3, rows * N, -1.0, 1.0), uniform(4, 9 * N, -1.0, 1.0));
        let mut all = Vec::new();
        for simd in Simd::available() {
            let (mut out, mut out_dot) = (vec![f32::NAN; 9 * N], vec![f32::NAN; 9 * N]);
            planes.encode(simd, &table, &x, &mut out).unwrap();
            planes.tangent(simd, &table, &x, &x_dot, &mut out_dot).unwrap();
            let mut bars = [vec![0.0; len], vec![0.0; x.len()], vec![0.0; len], vec![0.0; x.len()]];
            let [a, b, c, d] = &mut bars;
            planes.encode_backward(simd, &table, &x, &bar, EncodingBars::both(a, b)).unwrap();
            planes.tangent_backward(simd, &table, &x, &x_dot, &bar, EncodingBars::both(c, d)).unwrap();
            let mut alone = [vec![0.0; len], vec![0.0; x.len()]];
            planes.encode_backward(simd, &table, &x, &bar, EncodingBars::table(&mut alone[0])).unwrap();
            planes.encode_backward(simd, &table, &x, &bar, EncodingBars::x(&mut alone[1])).unwrap();
            planes.encode_backward(simd, &table, &x, &bar, EncodingBars::default()).unwrap();
            assert_eq!((bits(&alone[0]), bits(&alone[1])), (bits(&bars[0]), bits(&bars[1])));
            all.push((bits(&out), bits(&out_dot), bars.map(|bar| bits(&bar))));
        }
        assert!(all.windows(2).all(|pair| pair[0] == pair[1]), "{kind:?}");
    }
}

#[test]
fn outside_the_box_the_border_counts_and_positions_have_no_gradient() {
    let (nan, inf, max) = (f32::NAN, f32::INFINITY, f32::MAX);
    for kind in KINDS {
        let planes = kind.planes([4, 3, 5, 6], 3);
        let rows = planes.in_rows();
        let table = uniform(1, planes.params_len(), -1.0, 1.0);
        for x in [[nan; 4], [-inf, inf, nan, 0.3], [-max, max, -1e-45, 7.0], [1.0 + f32::EPSILON, 0.2, -1.1, 1e30]] {
            let x = &x[..rows];
            let border: Vec<f32> = x.iter().map(|&x| if x > -1.0 { x.min(1.0) } else { -1.0 }).collect();
            for simd in Simd::available() {
                let (mut got, mut want) = ([nan; 3], [nan; 3]);
                planes.encode(simd, &table, x, &mut got).unwrap();
                planes.encode(simd, &table, &border, &mut want).unwrap();
                assert_eq!(bits(&got), bits(&want), "{kind:?} {x:?}");
                let (mut x_bar, mut inside) = (vec![0.0; rows], vec![0.0; rows]);
                planes.encode_backward(simd, &table, x, &[1.0; 3], EncodingBars::x(&mut x_bar)).unwrap();
                planes.encode_backward(simd, &table, &border, &[1.0; 3], EncodingBars::x(&mut inside)).unwrap();
                // Directions past the border do not count, whatever their size.
                let mut out_dot = [nan; 3];
                let x_dot: Vec<f32> = x.iter().map(|x| if (-1.0..=1.0).contains(x) { 0.0 } else { inf }).collect();
                planes.tangent(simd, &table, x, &x_dot, &mut out_dot).unwrap();
                assert_eq!(out_dot, [0.0; 3]);
                for a in 0..rows {
                    let outside = !(-1.0..=1.0).contains(&x[a]);
                    assert_eq!(x_bar[a], if outside { 0.0 } else { inside[a] }, "{kind:?} {x:?}");
                }
            }
        }
    }
}

#[test]
fn a_huge_table_neighbours_no_samples_that_do_not_exist() {
    // Blocks are filled up to sixteen; partial products of the filling overflow, and must reach no gradient.
    let planes = Planes::k_planes([2, 2, 2, 2], 2).unwrap();
    let mut table = vec![1e30; planes.params_len()];
    for plane in 0..6 {
        // The vertex at (1, 1): one point lies exactly there.
        let end = planes.plane_range(plane).end;
        table[end - 2..end].fill(1.0);
    }
    let mut table_bar = vec![0.0; table.len()];
    planes.encode_backward(Simd::best(), &table, &[1.0; 4], &[1.0; 2], EncodingBars::table(&mut table_bar)).unwrap();
    assert!(table_bar.iter().all(|g| g.is_finite()));
    assert_eq!(table_bar.iter().sum::<f32>(), 12.0);
}

#[test]
fn empty_batches_are_legal_and_wrong_sizes_are_named() {
    let planes = Planes::hex_plane([3, 4, 5, 2], 2).unwrap();
    let (len, s) = (planes.params_len(), Simd::SCALAR);
    let table = vec![0.0; len];
    assert_eq!(planes.encode(s, &table, &[], &mut []), Ok(()));
    assert_eq!(planes.tangent(s, &table, &[], &[], &mut []), Ok(()));
    assert_eq!(planes.encode_backward(s, &table, &[], &[], EncodingBars::both(&mut vec![0.0; len], &mut [])), Ok(()));
    assert_eq!(planes.tangent_backward(s, &table, &[], &[], &[], EncodingBars::default()), Ok(()));
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(planes.encode(s, &table[1..], &[], &mut []), shape("table", len, len - 1));
    assert_eq!(planes.encode(s, &table, &[0.0; 6], &mut [0.0; 2]), shape("x", 4, 6));
    assert_eq!(planes.encode(s, &table, &[0.0; 4], &mut [0.0; 3]), shape("out", 2, 3));
    assert_eq!(planes.tangent(s, &table, &[0.0; 4], &[], &mut [0.0; 2]), shape("x_dot", 4, 0));
    let (x, bar) = ([0.0; 4], [0.0; 2]);
    assert_eq!(
        planes.encode_backward(s, &table, &x, &bar, EncodingBars::table(&mut [0.0])),
        shape("table_bar", len, 1)
    );
    assert_eq!(planes.encode_backward(s, &table, &x, &bar, EncodingBars::x(&mut [0.0])), shape("x_bar", 4, 1));
    for (resolution, features, what) in [
        ([0, 2, 2, 2], 1, "resolution"),
        ([2, 2, 2, (1 << 22) + 1], 1, "resolution"),
        ([2; 4], 0, "features"),
        ([1 << 20; 4], 1, "parameters"),
        ([2; 4], usize::MAX, "parameters"),
    ] {
        let error = Planes::k_planes(resolution, features).unwrap_err();
        assert!(matches!(error, FieldError::Config { what: w, .. } if w == what), "{error}");
    }
}

fn any_resolution() -> impl Strategy<Value = [u32; 4]> {
    [1..8_u32, 1..8_u32, 1..8_u32, 1..8_u32]
}

fn any_kind() -> impl Strategy<Value = Kind> {
    prop_oneof![Just(Kind::Sum), Just(Kind::Product), Just(Kind::K), Just(Kind::Hex)]
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    /// Wherever the point, constant planes give one feature.
    #[test]
    fn constant_planes_give_constant_features(
        kind in any_kind(), resolution in any_resolution(), value in -2.0..2.0_f32, seed in 0..1000_u64,
    ) {
        let planes = kind.planes(resolution, 2);
        let table = vec![value; planes.params_len()];
        let x = uniform(seed, planes.in_rows() * 10, -1.5, 1.5);
        let mut out = vec![f32::NAN; 20];
        planes.encode(Simd::best(), &table, &x, &mut out).unwrap();
        let want = kind.combine().value(&vec![f64::from(value); planes.pairs().len()]);
        for y in out {
            prop_assert!((f64::from(y) - want).abs() <= 3e-6 * want.abs() + 1e-30, "{} {}", y, want);
        }
    }

    /// Where the old vertices are among the new ones, the planes keep their values to the bit; between them features stay.
    #[test]
    fn upsampling_preserves_values_at_old_vertices(
        kind in any_kind(), resolution in any_resolution(), factor in [1..4_u32, 1..4_u32, 1..4_u32, 1..4_u32],
        seed in 0..1000_u64,
    ) {
        let old = kind.planes(resolution, 3);
        let new = kind.planes([0, 1, 2, 3].map(|a| (resolution[a] - 1) * factor[a] + 1), 3);
        let table = uniform(seed, old.params_len(), -1.0, 1.0);
        let grown = old.upsampled(&table, &new);
        prop_assert_eq!(grown.len(), new.params_len());
        for (plane, [a, b]) in old.pairs().enumerate() {
            let (from, to) = (&table[old.plane_range(plane)], &grown[new.plane_range(plane)]);
            let (wide, high) = (resolution[a] as usize, resolution[b] as usize);
            let row = new.resolution()[a] as usize;
            for (i, want) in from.chunks(3).enumerate() {
                let (x, y) = (i % wide * factor[a] as usize, i / wide * factor[b] as usize);
                prop_assert_eq!(&to[(x + row * y) * 3..][..3], want);
            }
            prop_assert_eq!(from.len(), wide * high * 3);
        }
        let x = uniform(seed + 1, old.in_rows() * 10, -1.0, 1.0);
        let (mut before, mut after) = (vec![f32::NAN; 30], vec![f32::NAN; 30]);
        old.encode(Simd::best(), &table, &x, &mut before).unwrap();
        new.encode(Simd::best(), &grown, &x, &mut after).unwrap();
        for (a, b) in before.iter().zip(&after) {
            prop_assert!((a - b).abs() < 1e-5, "{} {}", a, b);
        }
    }

    /// Planes of time that hold 1 leave the product of the others, and no time.
    #[test]
    fn k_planes_without_time_are_a_tri_plane(resolution in any_resolution(), seed in 0..1000_u64) {
        let four = Planes::k_planes(resolution, 2).unwrap();
        let three = Kind::Product.planes(resolution, 2);
        let table = uniform(seed, three.params_len(), -1.0, 1.0);
        let mut of_four = vec![1.0; four.params_len()];
        for (from, to) in [(0, 0), (1, 1), (2, 3)] {
            of_four[four.plane_range(to)].copy_from_slice(&table[three.plane_range(from)]);
        }
        let x = uniform(seed, 40, -1.1, 1.1);
        let (mut a, mut b, mut x_bar) = ([f32::NAN; 20], [f32::NAN; 20], [0.0; 40]);
        four.encode(Simd::best(), &of_four, &x, &mut a).unwrap();
        three.encode(Simd::best(), &table, &x[..30], &mut b).unwrap();
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() < 1e-6);
        }
        four.encode_backward(Simd::best(), &of_four, &x, &[1.0; 20], EncodingBars::x(&mut x_bar)).unwrap();
        prop_assert!(x_bar[30..].iter().all(|g| g.abs() < 1e-5), "{:?}", &x_bar[30..]);
    }

    /// A batch is its samples one by one.
    #[test]
    fn batches_equal_single_samples(kind in any_kind(), n in 0..40_usize, seed in 0..1000_u64) {
        let planes = kind.planes([5, 3, 4, 6], 7);
        let table = uniform(seed, planes.params_len(), -1.0, 1.0);
        let axes = planes.in_rows();
        let x = uniform(seed + 1, axes * n, -1.2, 1.2);
        let mut out = vec![f32::NAN; 7 * n];
        planes.encode(Simd::best(), &table, &x, &mut out).unwrap();
        for i in 0..n {
            let mut one = vec![f32::NAN; 7];
            let point: Vec<f32> = (0..axes).map(|a| x[a * n + i]).collect();
            planes.encode(Simd::best(), &table, &point, &mut one).unwrap();
            for (r, y) in one.iter().enumerate() {
                prop_assert_eq!(y.to_bits(), out[r * n + i].to_bits());
            }
        }
    }
}
