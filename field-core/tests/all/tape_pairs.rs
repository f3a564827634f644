//! The ready-made operations: encodings and fused networks on the tape.

use crate::tape_twin::{close, narrow, numbers};
use field_core::encoding::dense_grid::DenseGrid;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::{Growth, HashGrid, HashGridConfig, Interpolation, Rule};
use field_core::encoding::multi_distance::MultiDistance;
use field_core::encoding::planes::{Combine, KPlanes, Planes};
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Packed};
use field_core::tape::{
    Arena, CustomOp, Encoder, EncodingOp, HashGridTable, MlpOp, Shape, Tape, TapeError, Windowed, layers,
};
use float_core::Simd;

const N: usize = 21;

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x.into()).collect()
}

/// What a tape says about `<c, op(x, table)>` and about `<c, its derivative along v>`.
struct Answers {
    value: Vec<f32>,
    tangent: Vec<f32>,
    /// Of the value: with respect to `x` and the parameters.
    first: [Vec<f32>; 2],
    /// Of the tangent: with respect to `x`, the parameters and `v`.
    second: [Vec<f32>; 3],
}

/// What is recorded.
#[derive(Clone, Copy)]
enum Recipe<'o> {
    Fused(&'o dyn CustomOp),
    Layers(&'o Mlp),
}

fn answers(recipe: Recipe<'_>, rows: usize, x: &[f32], v: &[f32], params: &[f32]) -> Answers {
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, params);
    let n = x.len() / rows;
    let (node, v) = (tape.input(rows, n, x).unwrap(), tape.input(rows, n, v).unwrap());
    let mut inputs = vec![node];
    if !params.is_empty() {
        inputs.push(tape.param(0, params.len(), 1).unwrap());
    }
    let y = match recipe {
        Recipe::Fused(op) => tape.custom(op, &inputs),
        Recipe::Layers(mlp) => layers(&mut tape, mlp, node, inputs[1]),
    }
    .unwrap();
    let [y_dot] = tape.jvp([y], &[(node, v)]).unwrap();
    let c = narrow(&numbers(5, tape.shape(y).unwrap().len(), -1.0, 1.0));
    let (mut grad, mut grad_dot) = (vec![0.0; params.len()], vec![0.0; params.len()]);
    tape.backward(&[(y, &c)], &mut grad).unwrap();
    let x_bar = tape.gradient(node).unwrap().to_vec();
    tape.backward(&[(y_dot, &c)], &mut grad_dot).unwrap();
    Answers {
        value: tape.value(y).unwrap().data.to_vec(),
        tangent: tape.value(y_dot).unwrap().data.to_vec(),
        first: [x_bar, grad],
        second: [tape.gradient(node).unwrap().to_vec(), grad_dot, tape.gradient(v).unwrap().to_vec()],
    }
}

/// Differences of the operation's own first-order answers along `v`: tangent of the value, and of the gradients, which
/// by symmetry are the gradients of the tangent. A step of `h` misses a third derivative times `h^2`, and rounding over `h`.
#[track_caller]
fn check_encoder<E: Encoder + Clone>(encoder: E, x: &[f32], h: f32, tolerance: f64) {
    let op = EncodingOp::new(encoder.clone(), Simd::best());
    let rows = encoder.in_rows();
    let table = narrow(&numbers(3, encoder.params_len(), -0.5, 0.5));
    let v = narrow(&numbers(4, x.len(), -1.0, 1.0));
    let at = |t: f32| {
        let x: Vec<f32> = x.iter().zip(&v).map(|(x, v)| x + t * v).collect();
        answers(Recipe::Fused(&op), rows, &x, &v, &table)
    };
    let (here, above, below) = (at(0.0), at(h), at(-h));
    let slope = |f: &dyn Fn(&Answers) -> &[f32]| -> Vec<f64> {
        f(&above).iter().zip(f(&below)).map(|(a, b)| (f64::from(*a) - f64::from(*b)) / (2.0 * f64::from(h))).collect()
    };
    let mut direct = vec![0.0; here.value.len()];
    encoder.encode(Simd::best(), &table, x, &mut direct).unwrap();
    assert_eq!(direct, here.value);
    close("tangent", &here.tangent, &slope(&|a| &a.value), tolerance);
    close("gradient of the tangent, x", &here.second[0], &slope(&|a| &a.first[0]), tolerance);
    close("gradient of the tangent, table", &here.second[1], &slope(&|a| &a.first[1]), tolerance);
    // Linear in the direction.
    close("gradient of the tangent, v", &here.second[2], &wide(&here.first[0]), 1e-6);
}

fn hash_grid(interpolation: Interpolation) -> HashGrid {
    HashGrid::new(
        HashGridConfig::default()
            .with_levels(3)
            .with_features(2)
            .with_log2_table(6)
            .with_n_min(3)
            .with_growth(Growth::Factor(1.5))
            .with_rule(Rule::Ngp)
            .with_interpolation(interpolation),
    )
    .unwrap()
}

/// Random points of which no level has one within `margin` of a cell face, where derivatives jump.
fn inside_cells(places: &[(f32, f32)], margin: f32) -> Vec<f32> {
    let candidates = narrow(&numbers(9, 3000, 0.02, 0.98));
    let fits = |p: &&[f32]| {
        p.iter().all(|x| {
            places.iter().all(|(scale, shift)| {
                let cell = (x * scale + shift).fract();
                cell > margin && cell < 1.0 - margin
            })
        })
    };
    let points: Vec<&[f32]> = candidates.chunks(3).filter(fits).take(N).collect();
    assert_eq!(points.len(), N);
    (0..3).flat_map(|axis| points.iter().map(move |p| p[axis])).collect()
}

#[test]
fn frequency_encodings_differentiate_twice() {
    let x = narrow(&numbers(1, 3 * N, -1.0, 1.0));
    let encoding = Frequency::new(3, 3, Base::One, Identity::Include).unwrap();
    check_encoder(encoding, &x, 4e-3, 1e-3);
    check_encoder(Windowed { encoding, window: Some([1.0, 0.5, 0.0]) }, &x, 4e-3, 1e-3);
}

#[test]
fn frequency_encodings_match_sines_and_cosines_on_the_tape() {
    let x = narrow(&numbers(1, 2 * N, -1.0, 1.0));
    let op = EncodingOp::new(Frequency::new(2, 2, Base::One, Identity::Include).unwrap(), Simd::best());
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let node = tape.input(2, N, &x).unwrap();
    let fused = tape.custom(&op, &[node]).unwrap();
    let double = tape.scale(node, 2.0).unwrap();
    let parts =
        [node, tape.sin(node).unwrap(), tape.cos(node).unwrap(), tape.sin(double).unwrap(), tape.cos(double).unwrap()];
    let apart = tape.concat(&parts).unwrap();
    let want = wide(tape.value(apart).unwrap().data);
    close("value", tape.value(fused).unwrap().data, &want, 1e-6);
    let (a, b) = (tape.jacobian(fused, node).unwrap(), tape.jacobian(apart, node).unwrap());
    let want = wide(tape.value(b).unwrap().data);
    close("jacobian", tape.value(a).unwrap().data, &want, 1e-6);
    let c = narrow(&numbers(2, want.len(), -1.0, 1.0));
    tape.backward(&[(b, &c)], &mut []).unwrap();
    let want = wide(tape.gradient(node).unwrap());
    tape.backward(&[(a, &c)], &mut []).unwrap();
    close("second order", tape.gradient(node).unwrap(), &want, 1e-5);
}

#[test]
fn spherical_harmonics_differentiate_twice() {
    for degree in 1..=5 {
        // Away from zero, in all octants.
        let d: Vec<f32> = numbers(7, 3 * N, -1.0, 1.0).iter().map(|&x| (x + 0.4 * x.signum()) as f32).collect();
        check_encoder(SphericalHarmonics::new(degree, Directions::Any).unwrap(), &d, 4e-3, 3e-3);
    }
}

#[test]
fn grids_differentiate_twice() {
    for interpolation in [Interpolation::Linear, Interpolation::Smoothstep] {
        let grid = hash_grid(interpolation);
        let places: Vec<(f32, f32)> = grid.levels().iter().map(|level| (level.scale, level.shift)).collect();
        let x = inside_cells(&places, 0.06);
        check_encoder(HashGridTable { grid: &grid }, &x, 1e-3, 1e-3);
        let dense = DenseGrid::new([4, 5, 6], 3, interpolation).unwrap();
        let x = inside_cells(&[(3.0, 0.0), (4.0, 0.0), (5.0, 0.0)], 0.06);
        check_encoder(dense, &x, 1e-3, 1e-3);
    }
    let grid = MultiDistance::new([4, 5, 6], 3).unwrap();
    // The faces of the wide cells are among those of the narrow ones.
    let x = inside_cells(&[(3.0, 0.0), (4.0, 0.0), (5.0, 0.0)], 0.06);
    check_encoder(grid, &x, 1e-3, 1e-3);
}

/// The same in `[-1, 1]`, axis after axis of any number of them.
fn inside_plane_cells(resolution: &[u32], margin: f32) -> Vec<f32> {
    let candidates = narrow(&numbers(9, 1000 * resolution.len(), -0.98, 0.98));
    let clear = |(x, r): (&f32, &u32)| {
        let cell = ((x + 1.0) * 0.5 * (r - 1) as f32).fract();
        cell > margin && cell < 1.0 - margin
    };
    let points = candidates.chunks(resolution.len()).filter(|p| p.iter().zip(resolution).all(clear));
    let points: Vec<&[f32]> = points.take(N).collect();
    assert_eq!(points.len(), N);
    (0..resolution.len()).flat_map(|axis| points.iter().map(move |p| p[axis])).collect()
}

#[test]
fn planes_differentiate_twice() {
    for planes in [
        Planes::tri_plane([4, 5, 6], 3, Combine::Sum).unwrap(),
        Planes::tri_plane([4, 5, 6], 3, Combine::Product).unwrap(),
        Planes::k_planes([4, 5, 6, 3], 2).unwrap(),
        Planes::hex_plane([4, 5, 6, 3], 6).unwrap(),
    ] {
        let x = inside_plane_cells(planes.resolution(), 0.06);
        check_encoder(planes, &x, 2e-3, 1e-3);
    }
    // The faces of the wide cells are among those of the narrow ones.
    let scales = KPlanes::moving([3, 3, 3], 3, &[1, 3], 2).unwrap();
    check_encoder(scales, &inside_plane_cells(&[9, 9, 9, 3], 0.06), 2e-3, 1e-3);
}

#[test]
fn products_of_planes_have_no_tangent_along_the_table_and_sums_have() {
    for combine in [Combine::Sum, Combine::Product] {
        let planes = Planes::tri_plane([3, 4, 5], 2, combine).unwrap();
        let op = EncodingOp::new(planes, Simd::best());
        let len = planes.params_len();
        let (table, table_dot) = (narrow(&numbers(1, len, -1.0, 1.0)), narrow(&numbers(2, len, -1.0, 1.0)));
        let x = narrow(&numbers(3, 3 * N, -1.0, 1.0));
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &table);
        let node = tape.constant(3, N, &x).unwrap();
        let params = tape.param(0, len, 1).unwrap();
        let y = tape.custom(&op, &[node, params]).unwrap();
        let seeds = [(params, tape.constant(len, 1, &table_dot).unwrap())];
        if combine == Combine::Product {
            assert_eq!(tape.jvp([y], &seeds), Err(TapeError::NoTangent { op: "planes" }));
            continue;
        }
        let [y_dot] = tape.jvp([y], &seeds).unwrap();
        let mut want = vec![0.0; 2 * N];
        planes.encode(Simd::best(), &table_dot, &x, &mut want).unwrap();
        assert_eq!(tape.value(y_dot).unwrap().data, want);
    }
}

#[test]
fn one_point_reaches_eight_entries_of_each_level() {
    let grid = hash_grid(Interpolation::Linear);
    let op = EncodingOp::new(HashGridTable { grid: &grid }, Simd::best());
    let table = vec![0.1; grid.params_len()];
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &table);
    let x = tape.constant(3, 1, &[0.3, 0.4, 0.5]).unwrap();
    let params = tape.param(0, table.len(), 1).unwrap();
    let y = tape.custom(&op, &[x, params]).unwrap();
    let mut grad = vec![0.0; table.len()];
    tape.backward(&[(y, &[1.0; 6])], &mut grad).unwrap();
    let features = grid.config().features;
    for level in 0..grid.levels().len() {
        let entries = grad[grid.level_range(level)].chunks(features);
        let reached = entries.filter(|e| e.iter().any(|g| *g != 0.0)).count();
        assert!((1..=8).contains(&reached), "level {level}: {reached}");
    }
}

#[test]
fn the_tangent_of_a_table_is_the_encoding_of_the_tangent() {
    let grid = hash_grid(Interpolation::Linear);
    let op = EncodingOp::new(HashGridTable { grid: &grid }, Simd::best());
    let len = grid.params_len();
    let (table, table_dot) = (narrow(&numbers(1, len, -1.0, 1.0)), narrow(&numbers(2, len, -1.0, 1.0)));
    let (x, x_dot) = (narrow(&numbers(3, 3 * N, 0.1, 0.9)), narrow(&numbers(4, 3 * N, -1.0, 1.0)));
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &table);
    let node = tape.input(3, N, &x).unwrap();
    let params = tape.param(0, len, 1).unwrap();
    let y = tape.custom(&op, &[node, params]).unwrap();
    let seeds = [(node, tape.constant(3, N, &x_dot).unwrap()), (params, tape.constant(len, 1, &table_dot).unwrap())];
    let [y_dot] = tape.jvp([y], &seeds).unwrap();
    let (mut a, mut b) = (vec![0.0; 6 * N], vec![0.0; 6 * N]);
    grid.encode(Simd::best(), &table_dot, &x, &mut a).unwrap();
    grid.tangent(Simd::best(), &table, &x, &x_dot, &mut b).unwrap();
    let want: Vec<f64> = a.iter().zip(&b).map(|(a, b)| f64::from(*a) + f64::from(*b)).collect();
    close("tangent", tape.value(y_dot).unwrap().data, &want, 1e-6);
    // No third derivative of positions: said, not guessed.
    assert_eq!(tape.jvp([y_dot], &seeds[..1]), Err(TapeError::NoTangent { op: "hash_grid" }));
}

#[test]
fn encodings_name_wrong_inputs() {
    let op = EncodingOp::new(Frequency::new(3, 2, Base::Pi, Identity::Omit).unwrap(), Simd::best());
    let dense = EncodingOp::new(DenseGrid::new([2, 2, 2], 1, Interpolation::Linear).unwrap(), Simd::best());
    let harmonics = EncodingOp::new(SphericalHarmonics::new(2, Directions::Any).unwrap(), Simd::best());
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let flat = tape.fill(2, 5, 0.0);
    let (want, got) = (Shape::new(3, 5), Shape::new(2, 5));
    assert_eq!(tape.custom(&op, &[flat]), Err(TapeError::Shape { op: "frequency", what: "x", want, got }));
    let x = tape.fill(3, 5, 0.0);
    let length = |op, what, want, got| Err(TapeError::Length { op, what, want, got });
    assert_eq!(tape.custom(&op, &[x, x]), length("frequency", "inputs", 1, 2));
    assert_eq!(tape.custom(&dense, &[x]), length("dense_grid", "inputs", 2, 1));
    assert_eq!(tape.custom(&dense, &[x, x]), length("dense_grid", "table", 8, 15));
    // Zero has no direction.
    assert!(matches!(tape.custom(&harmonics, &[x]), Err(TapeError::Field(_))));
}

fn networks() -> Vec<Mlp> {
    let config = |hidden: &[usize], skips: &[usize], bias, hidden_activation, output_activation| {
        let (hidden, skips) = (hidden.to_vec(), skips.to_vec());
        let config = MlpConfig::new(5, hidden, 3)
            .with_bias(bias)
            .with_hidden_activation(hidden_activation)
            .with_output_activation(output_activation)
            .with_skips(skips);
        Mlp::new(&config).unwrap()
    };
    vec![
        config(&[], &[], Bias::Zero, Activation::None, Activation::None),
        config(&[16, 16], &[], Bias::None, Activation::Relu, Activation::LOGISTIC),
        config(&[9, 20, 7], &[2], Bias::Zero, Activation::Softplus { shift: 0.0 }, Activation::TruncExp),
        config(&[24], &[1], Bias::Zero, Activation::LeakyRelu { slope: 0.1 }, Activation::Logistic { pad: 0.001 }),
        config(&[12], &[], Bias::Zero, Activation::Tanh, Activation::Softplus { shift: -1.0 }),
    ]
}

#[test]
fn a_fused_network_is_its_layers() {
    for (i, mlp) in networks().iter().enumerate() {
        for n in [1, 5, 48, 61] {
            let params = narrow(&numbers(11 + i as u64, mlp.param_count(), -0.5, 0.5));
            let (x, v) = (narrow(&numbers(1, 5 * n, -1.0, 1.0)), narrow(&numbers(2, 5 * n, -1.0, 1.0)));
            let mut packed = Packed::default();
            mlp.pack(&params, &mut packed);
            let op = MlpOp { mlp, packed: &packed, simd: Simd::best() };
            let fused = answers(Recipe::Fused(&op), 5, &x, &v, &params);
            let apart = answers(Recipe::Layers(mlp), 5, &x, &v, &params);
            close(&format!("network {i}, {n} samples: value"), &fused.value, &wide(&apart.value), 1e-6);
            close("tangent", &fused.tangent, &wide(&apart.tangent), 1e-5);
            for k in 0..2 {
                close("gradient", &fused.first[k], &wide(&apart.first[k]), 1e-5);
            }
            for k in 0..3 {
                close("gradient of the tangent", &fused.second[k], &wide(&apart.second[k]), 1e-5);
            }
        }
    }
}

#[test]
fn fused_networks_take_empty_tiles_and_name_wrong_inputs() {
    let mlp = &networks()[1];
    let params = vec![0.1; mlp.param_count()];
    let mut packed = Packed::default();
    mlp.pack(&params, &mut packed);
    let op = MlpOp { mlp, packed: &packed, simd: Simd::best() };
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &params);
    let p = tape.param(0, params.len(), 1).unwrap();
    let x = tape.input(5, 0, &[]).unwrap();
    let y = tape.custom(&op, &[x, p]).unwrap();
    let slope = tape.jacobian(y, x).unwrap();
    assert_eq!(tape.shape(slope).unwrap(), Shape::new(15, 0));
    let mut grad = vec![0.0; params.len()];
    tape.backward(&[(y, &[]), (slope, &[])], &mut grad).unwrap();
    assert!(grad.iter().all(|&g| g == 0.0));
    let short = tape.param(0, 3, 1).unwrap();
    let want = TapeError::Length { op: "mlp", what: "params", want: params.len(), got: 3 };
    assert_eq!(tape.custom(&op, &[x, short]), Err(want));
    assert_eq!(layers(&mut tape, mlp, x, short), Err(want));
    let (want, got) = (Shape::new(5, 1), Shape::new(3, 1));
    assert_eq!(tape.custom(&op, &[short, p]), Err(TapeError::Shape { op: "mlp", what: "x", want, got }));
}
