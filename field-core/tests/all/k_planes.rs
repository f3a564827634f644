//! K-Planes at several scales against the twin of one scale, and the properties of the model.

use crate::planes::{Kind, f32s, f64s, twin, twin_backward, twin_tangent, uniform};
use field_core::FieldError;
use field_core::encoding::EncodingBars;
use field_core::encoding::planes::{KPlanes, SPACE_INIT};
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, compare, cotangent};

const SCALES: [u32; 3] = [1, 2, 3];

fn models() -> [KPlanes; 3] {
    [
        KPlanes::still([3, 4, 5], &SCALES, 2).unwrap(),
        KPlanes::moving([3, 4, 5], 4, &SCALES, 3).unwrap(),
        KPlanes::moving([2, 3, 2], 1, &[2], 8).unwrap(),
    ]
}

/// Kind of the scales, for the twin.
fn kind(model: &KPlanes) -> Kind {
    if model.in_rows() == 3 { Kind::Product } else { Kind::K }
}

/// Points on no face of a cell of any scale.
fn inside_cells(model: &KPlanes, n: usize) -> Vec<f32> {
    let axes = model.in_rows();
    let candidates = uniform(5, 60 * axes * n, -1.0, 1.0);
    let clear = |p: &&[f32]| {
        model.scales().iter().all(|planes| {
            p.iter().zip(planes.resolution()).all(|(x, &r)| {
                let at = (x + 1.0) * 0.5 * (r - 1) as f32;
                r == 1 || (at - at.round()).abs() > 1e-3
            })
        })
    };
    let points: Vec<_> = candidates.chunks(axes).filter(clear).take(n).collect();
    assert_eq!(points.len(), n);
    (0..axes).flat_map(|a| points.iter().map(move |p| p[a])).collect()
}

/// Table and points of one scale, as the twin takes them.
fn both_of(scale: usize, model: &KPlanes, both: &[f64]) -> (std::ops::Range<usize>, Vec<f64>) {
    let start: usize = model.scales()[..scale].iter().map(|planes| planes.params_len()).sum();
    let range = start..start + model.scales()[scale].params_len();
    let part = both[range.clone()].iter().chain(&both[model.params_len()..]).copied().collect();
    (range, part)
}

#[test]
fn values_and_gradients_match_the_twin() {
    const N: usize = 7;
    for model in models() {
        let (len, rows) = (model.params_len(), model.out_rows() / model.scales().len() * N);
        let mut both = [uniform(1, len, -1.0, 1.0), inside_cells(&model, N)].concat();
        // Products with a factor of 0 have gradients, too.
        both[..len].iter_mut().step_by(5).for_each(|v| *v = 0.0);
        let out_bar = f32s(&cotangent(model.out_rows() * N, 3));
        for simd in Simd::available() {
            let single = (
                |both: &[f32], out: &mut [f32]| model.encode(simd, &both[..len], &both[len..], out).unwrap(),
                |both: &[f32], out_bar: &[f32], bars: &mut [f32]| {
                    let (table_bar, x_bar) = bars.split_at_mut(len);
                    let bars = EncodingBars::both(table_bar, x_bar);
                    model.encode_backward(simd, &both[..len], &both[len..], out_bar, bars).unwrap();
                },
            );
            let double = (
                |both: &[f64], out: &mut [f64]| {
                    for (scale, planes) in model.scales().iter().enumerate() {
                        let out = &mut out[scale * rows..(scale + 1) * rows];
                        twin(kind(&model), planes, &both_of(scale, &model, both).1, out);
                    }
                },
                |both: &[f64], out_bar: &[f64], bars: &mut [f64]| {
                    for (scale, planes) in model.scales().iter().enumerate() {
                        let (range, part) = both_of(scale, &model, both);
                        let mut own = vec![0.0; part.len()];
                        let out_bar = &out_bar[scale * rows..(scale + 1) * rows];
                        twin_backward(kind(&model), planes, &part, out_bar, &mut own);
                        let (of_table, of_x) = own.split_at(range.len());
                        bars[range].iter_mut().zip(of_table).for_each(|(b, o)| *b += o);
                        bars[len..].iter_mut().zip(of_x).for_each(|(b, o)| *b += o);
                    }
                },
            );
            check_f32_pair(&both, &out_bar, single, double, PairTolerances::default()).unwrap();
        }
    }
}

#[test]
fn tangents_match_the_twin() {
    const N: usize = 6;
    for model in models() {
        let (table, x) = (uniform(1, model.params_len(), -1.0, 1.0), inside_cells(&model, N));
        let x_dot = cotangent(x.len(), 2);
        let rows = model.out_rows() / model.scales().len() * N;
        let (mut got, mut want) = (vec![f32::NAN; model.out_rows() * N], vec![0.0; model.out_rows() * N]);
        model.tangent(Simd::best(), &table, &x, &f32s(&x_dot), &mut got).unwrap();
        let both = f64s(&[table, x].concat());
        for (scale, planes) in model.scales().iter().enumerate() {
            let (part, out) = (both_of(scale, &model, &both).1, &mut want[scale * rows..(scale + 1) * rows]);
            twin_tangent(kind(&model), planes, &part, &x_dot, out);
        }
        compare("tangent", &got, &want, Tolerance::new(3e-6, 1e-6)).unwrap();
    }
}

#[test]
fn planes_are_listed_as_they_lie_in_the_table() {
    let model = KPlanes::moving([3, 4, 5], 6, &[1, 2], 2).unwrap();
    let planes: Vec<_> = model.planes().collect();
    assert_eq!(planes.len(), 12);
    let mut end = 0;
    for plane in &planes {
        assert_eq!(plane.range.start, end);
        assert_eq!(plane.range.len(), plane.rows * plane.columns * 2);
        assert_eq!(plane.has_time(), plane.axes[1] == 3);
        end = plane.range.end;
    }
    assert_eq!(end, model.params_len());
    // Space is multiplied by the scale, time is not.
    let last = &planes[11];
    assert_eq!((last.scale, last.axes, last.rows, last.columns), (1, [2, 3], 6, 10));
    assert_eq!((model.in_rows(), model.out_rows()), (4, 4));
    assert!(KPlanes::still([3, 4, 5], &[1], 2).unwrap().planes().all(|plane| !plane.has_time()));
}

#[test]
fn the_start_stands_still() {
    let model = KPlanes::moving([8, 8, 8], 5, &[1, 2], 4).unwrap();
    let mut table = vec![f32::NAN; model.params_len()];
    model.init(Rng::new(3, 0), SPACE_INIT, &mut table);
    for plane in model.planes() {
        let values = &table[plane.range.clone()];
        if plane.has_time() {
            assert!(values.iter().all(|v| *v == 1.0));
        } else {
            assert!(values.iter().all(|v| (0.1..0.5).contains(v)));
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            // Five standard errors.
            assert!((mean - 0.3).abs() < 5.0 * 0.116 / (values.len() as f32).sqrt(), "{mean}");
        }
    }
    assert_eq!(model.time_deviation(&table), 0.0);
    // No two planes alike.
    let space: Vec<_> = model.planes().filter(|plane| !plane.has_time()).collect();
    assert_ne!(table[space[0].range.clone()], table[space[1].range.clone()]);
    table[model.planes().find(|plane| plane.has_time()).unwrap().range.start] = f32::NAN;
    assert_eq!(model.time_deviation(&table), f32::INFINITY);
}

#[test]
fn empty_batches_are_legal_and_wrong_sizes_are_named() {
    let model = KPlanes::moving([3, 3, 3], 2, &[1, 2], 2).unwrap();
    let (len, s, table) = (model.params_len(), Simd::SCALAR, vec![0.5; model.params_len()]);
    assert_eq!(model.encode(s, &table, &[], &mut []), Ok(()));
    assert_eq!(model.tangent(s, &table, &[], &[], &mut []), Ok(()));
    let bars = EncodingBars::both(&mut [], &mut []);
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(model.encode_backward(s, &table, &[], &[], bars), shape("table_bar", len, 0));
    assert_eq!(model.encode_backward(s, &table, &[], &[], EncodingBars::x(&mut [])), Ok(()));
    assert_eq!(model.tangent_backward(s, &table, &[], &[], &[], EncodingBars::default()), Ok(()));
    assert_eq!(model.encode(s, &table[1..], &[], &mut []), shape("table", len, len - 1));
    assert_eq!(model.encode(s, &table, &[0.0; 6], &mut [0.0; 4]), shape("x", 4, 6));
    assert_eq!(model.encode(s, &table, &[0.0; 4], &mut [0.0; 3]), shape("out", 4, 3));
    assert_eq!(model.tangent(s, &table, &[0.0; 4], &[], &mut [0.0; 4]), shape("x_dot", 4, 0));
    let mut short = [0.0; 3];
    let bars = EncodingBars::x(&mut short);
    assert_eq!(model.encode_backward(s, &table, &[0.0; 4], &[0.0; 4], bars), shape("x_bar", 4, 3));
    for (resolution, time_steps, scales, features, what) in [
        ([2; 3], 2, &[][..], 1, "scales"),
        ([2; 3], 2, &[1, 0], 1, "resolution"),
        ([2; 3], 0, &[1], 1, "resolution"),
        ([1 << 20; 3], 2, &[u32::MAX], 1, "resolution"),
        ([2; 3], 2, &[1], 0, "features"),
    ] {
        let error = KPlanes::moving(resolution, time_steps, scales, features).unwrap_err();
        assert!(matches!(error, FieldError::Config { what: w, .. } if w == what), "{error}");
    }
}

#[test]
fn extreme_positions_are_those_of_the_edge() {
    let model = KPlanes::moving([3, 3, 3], 3, &[1, 2], 2).unwrap();
    let table = uniform(1, model.params_len(), 0.1, 1.0);
    for (x, edge) in [(f32::MAX, 1.0), (f32::NEG_INFINITY, -1.0), (f32::NAN, -1.0), (1.0 + 1e-6, 1.0)] {
        let (mut got, mut want, mut x_bar) = ([f32::NAN; 4], [f32::NAN; 4], [0.0; 4]);
        model.encode(Simd::best(), &table, &[x; 4], &mut got).unwrap();
        model.encode(Simd::best(), &table, &[edge; 4], &mut want).unwrap();
        assert_eq!(got, want, "at {x}");
        model.encode_backward(Simd::best(), &table, &[x; 4], &[1.0; 4], EncodingBars::x(&mut x_bar)).unwrap();
        assert_eq!(x_bar, [0.0; 4], "at {x}");
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    /// Planes of time near 1 change features by no more than is said, planes of exactly 1 by rounding.
    #[test]
    fn time_near_one_is_nearly_no_time(seed in 0..1000_u64, spread in prop::sample::select(vec![0.0_f32, 1e-3, 0.1])) {
        let model = KPlanes::moving([3, 4, 2], 3, &SCALES, 2).unwrap();
        let mut table = vec![0.0; model.params_len()];
        model.init(Rng::new(seed, 0), SPACE_INIT, &mut table);
        for plane in model.planes().filter(|plane| plane.has_time()) {
            let noise = uniform(seed + plane.range.start as u64, plane.range.len(), -spread, spread);
            table[plane.range].iter_mut().zip(noise).for_each(|(v, noise)| *v += noise);
        }
        let deviation = model.time_deviation(&table);
        prop_assert!(deviation <= spread * 1.001);
        let (still, still_table) = model.without_time(&table);
        prop_assert_eq!(&still, &KPlanes::still([3, 4, 2], &SCALES, 2).unwrap());
        let x = uniform(seed, 4 * 10, -1.1, 1.1);
        let (mut a, mut b) = (vec![f32::NAN; 60], vec![f32::NAN; 60]);
        model.encode(Simd::best(), &table, &x, &mut a).unwrap();
        still.encode(Simd::best(), &still_table, &x[..30], &mut b).unwrap();
        let bound = (1.0 + deviation).powi(3) - 1.0 + 1e-6;
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() <= bound * b.abs(), "{} {} {}", a, b, bound);
        }
    }

    /// Which axis is called x does not matter: x and y swapped, in planes and points, give the same features.
    #[test]
    fn axes_can_be_swapped(seed in 0..1000_u64) {
        let model = KPlanes::moving([3, 4, 2], 3, &[1, 2], 1).unwrap();
        let other = KPlanes::moving([4, 3, 2], 3, &[1, 2], 1).unwrap();
        let table = uniform(seed, model.params_len(), 0.1, 1.0);
        let mut swapped = vec![f32::NAN; other.params_len()];
        let rename = |axis: usize| [1, 0, 2, 3][axis];
        for to in other.planes() {
            let mut axes = to.axes.map(rename);
            let turned = axes[0] > axes[1];
            axes.sort_unstable();
            let from = model.planes().find(|from| from.scale == to.scale && from.axes == axes).unwrap();
            for row in 0..to.rows {
                for column in 0..to.columns {
                    let (r, c) = if turned { (column, row) } else { (row, column) };
                    swapped[to.range.start + row * to.columns + column] =
                        table[from.range.start + r * from.columns + c];
                }
            }
        }
        let x = uniform(seed + 1, 4 * 9, -1.1, 1.1);
        let x_swapped = [&x[9..18], &x[..9], &x[18..]].concat();
        let (mut a, mut b) = ([f32::NAN; 18], [f32::NAN; 18]);
        model.encode(Simd::best(), &table, &x, &mut a).unwrap();
        other.encode(Simd::best(), &swapped, &x_swapped, &mut b).unwrap();
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() <= 2e-6 * a.abs(), "{} {}", a, b);
        }
    }
}
