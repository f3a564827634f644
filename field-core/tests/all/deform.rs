//! Deformations on the tape and without: against matrices in f64, their derivatives to second order, rest and pi.

use field_core::FieldError;
use field_core::deform::{RigidBars, rigid, rigid_about, rigid_points, rigid_points_backward, translate};
use field_core::lie::{se3_exp, se3_exp_derivative};
use field_core::rng::Rng;
use field_core::tape::{Arena, Node, Tape, TapeError};
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair};

/// `[9][n]` rows: point, rotation vector, translation.
fn twin(at: &[f64], out: &mut [f64]) {
    let n = at.len() / 9;
    for s in 0..n {
        let get = |r: usize| at[r * n + s];
        let t = se3_exp([get(3), get(4), get(5), get(6), get(7), get(8)]);
        for i in 0..3 {
            out[i * n + s] = (0..3).map(|j| t[i][j] * get(j)).sum::<f64>() + t[i][3];
        }
    }
}

fn twin_backward(at: &[f64], out_bar: &[f64], at_bar: &mut [f64]) {
    let n = at.len() / 9;
    for s in 0..n {
        let get = |r: usize| at[r * n + s];
        let xi = [get(3), get(4), get(5), get(6), get(7), get(8)];
        let (t, d) = (se3_exp(xi), se3_exp_derivative(xi));
        for i in 0..3 {
            let g = out_bar[i * n + s];
            for j in 0..3 {
                at_bar[j * n + s] += g * t[i][j];
            }
            for k in 0..6 {
                let along = (0..3).map(|j| d[i][j][k] * get(j)).sum::<f64>() + d[i][3][k];
                at_bar[(3 + k) * n + s] += g * along;
            }
        }
    }
}

fn split(at: &[f32]) -> [&[f32]; 3] {
    let n = at.len() / 3;
    [&at[..n], &at[n..2 * n], &at[2 * n..]]
}

/// Numbers in `[-1, 1)` with rotations of length about `angle`.
fn points(seed: u64, n: usize, angle: f32) -> Vec<f32> {
    let rng = Rng::new(seed, 3);
    let mut at: Vec<f32> = (0..9 * n as u64).map(|i| 2.0 * rng.uniform_at(i) - 1.0).collect();
    for s in 0..n {
        let length = (3..6).map(|r| at[r * n + s].powi(2)).sum::<f32>().sqrt().max(1e-3);
        (3..6).for_each(|r| at[r * n + s] *= angle / length);
    }
    at
}

const ANGLES: [f32; 9] = [0.0, 1e-12, 1e-4, 0.03, 0.7, 2.0, core::f32::consts::PI, 3.3, 7.0];

#[test]
fn rigid_points_match_matrices_and_their_derivatives() {
    for simd in Simd::available() {
        for (n, angle) in [1, 2, 7, 8, 16, 19].into_iter().flat_map(|n| ANGLES.map(|a| (n, a))) {
            let at = points(n as u64, n, angle);
            let out_bar: Vec<f32> = points(99, n, 1.0)[..3 * n].to_vec();
            let result = check_f32_pair(
                &at,
                &out_bar,
                (
                    |at: &[f32], out: &mut [f32]| {
                        let [x, w, v] = split(at);
                        rigid_points(simd, x, w, v, out).unwrap();
                    },
                    |at: &[f32], bar: &[f32], at_bar: &mut [f32]| {
                        let [x, w, v] = split(at);
                        let (x_bar, rest) = at_bar.split_at_mut(3 * n);
                        let (w_bar, v_bar) = rest.split_at_mut(3 * n);
                        let bars = RigidBars { x: x_bar, omega: w_bar, v: v_bar };
                        rigid_points_backward(simd, x, w, v, bar, bars).unwrap();
                    },
                ),
                (twin, twin_backward),
                PairTolerances {
                    values: Tolerance::new(1e-6, 1e-6),
                    twin: Tolerance::TWIN,
                    gradients: Tolerance::new(3e-6, 1e-6),
                },
            );
            assert!(result.is_ok(), "{n} points, angle {angle}: {}", result.unwrap_err());
        }
    }
}

/// Record a rigid motion of all points.
fn record(tape: &mut Tape, at: &[f32]) -> ([Node; 3], Node) {
    let n = at.len() / 9;
    let [x, w, v] = split(at).map(|rows| tape.input(3, n, rows).unwrap());
    ([x, w, v], rigid(tape, x, w, v).unwrap())
}

#[test]
fn the_tape_gives_the_points_and_gradients_of_the_pair() {
    for angle in ANGLES {
        let n = 19;
        let at = points(5, n, angle);
        let out_bar = points(6, n, 1.0)[..3 * n].to_vec();
        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &[]);
        let (leaves, out) = record(&mut tape, &at);
        let [x, w, v] = split(&at);
        let mut want = vec![0.0; 3 * n];
        rigid_points(Simd::best(), x, w, v, &mut want).unwrap();
        let close =
            |got: &[f32], want: &[f32]| got.iter().zip(want).all(|(g, w)| (g - w).abs() < 2e-6 * w.abs().max(1.0));
        assert!(close(tape.value(out).unwrap().data, &want), "angle {angle}");
        let mut bars = [vec![0.0; 3 * n], vec![0.0; 3 * n], vec![0.0; 3 * n]];
        let [x_bar, w_bar, v_bar] = &mut bars;
        let rigid_bars = RigidBars { x: x_bar, omega: w_bar, v: v_bar };
        rigid_points_backward(Simd::best(), x, w, v, &out_bar, rigid_bars).unwrap();
        tape.backward(&[(out, &out_bar)], &mut []).unwrap();
        for (leaf, bar) in leaves.into_iter().zip(&bars) {
            assert!(close(tape.gradient(leaf).unwrap(), bar), "angle {angle}");
        }
    }
}

#[test]
fn a_loss_on_the_jacobian_of_a_warp_has_the_gradient_of_differences() {
    // Twist from the point through a smooth layer, so that the Jacobian holds every derivative of the motion.
    // Loss: sum over samples of |J|^2 weighted, differenced in f64 over the layer's weights.
    let (n, h) = (3, 6);
    for scale in [0.0, 1e-6, 0.3, 2.5] {
        let params: Vec<f32> = points(11, h, 1.0)[..6 * h].to_vec();
        let params: Vec<f32> = params.iter().map(|p| p * scale).chain(points(12, h, 1.0)[..3 * h].to_vec()).collect();
        let x0: Vec<f32> = points(13, n, 1.0)[..3 * n].to_vec();
        let c: Vec<f32> = points(14, 3 * n, 1.0)[..9 * n].to_vec();
        let wide = |x: &[f32]| x.iter().map(|&x| f64::from(x)).collect::<Vec<f64>>();

        let warp = |p: &[f64], x: [f64; 3]| -> [f64; 3] {
            let hidden: Vec<f64> =
                (0..h).map(|k| (0..3).map(|j| p[6 * h + 3 * k + j] * x[j]).sum::<f64>().tanh() + 0.5).collect();
            let xi: [f64; 6] = std::array::from_fn(|i| (0..h).map(|k| p[i * h + k] * hidden[k]).sum());
            let t = se3_exp(xi);
            std::array::from_fn(|i| (0..3).map(|j| t[i][j] * x[j]).sum::<f64>() + t[i][3])
        };
        let jacobian = |p: &[f64]| -> Vec<f64> {
            let mut rows = vec![0.0; 9 * n];
            for s in 0..n {
                for k in 0..3 {
                    let at = |d: f64| {
                        let mut x: [f64; 3] = std::array::from_fn(|j| f64::from(x0[j * n + s]));
                        x[k] += d;
                        warp(p, x)
                    };
                    // Fourth order: differences of differences below have to keep digits.
                    let h = 2e-3;
                    let (a, b, c, d) = (at(2.0 * h), at(h), at(-h), at(-2.0 * h));
                    for i in 0..3 {
                        rows[(3 * i + k) * n + s] = (8.0 * (b[i] - c[i]) - (a[i] - d[i])) / (12.0 * h);
                    }
                }
            }
            rows
        };
        let loss = |p: &[f64]| jacobian(p).iter().zip(wide(&c)).map(|(j, c)| c * j * j).sum::<f64>();

        let mut arena = Arena::new();
        let mut tape = Tape::new(&mut arena, &params);
        let x = tape.input(3, n, &x0).unwrap();
        let (heads, layer) = (tape.param(0, 6, h).unwrap(), tape.param(6 * h, h, 3).unwrap());
        let hidden = tape.linear(layer, None, x).unwrap();
        let hidden = tape.tanh(hidden).unwrap();
        let hidden = tape.affine(hidden, 1.0, 0.5).unwrap();
        let twist = tape.linear(heads, None, hidden).unwrap();
        let (omega, v) = (tape.slice(twist, 0..3).unwrap(), tape.slice(twist, 3..6).unwrap());
        let out = rigid(&mut tape, x, omega, v).unwrap();
        let j = tape.jacobian(out, x).unwrap();
        let p = wide(&params);
        for (got, want) in tape.value(j).unwrap().data.iter().zip(jacobian(&p)) {
            assert!((f64::from(*got) - want).abs() < 3e-6, "scale {scale}: {got} {want}");
        }
        let value = tape.value(j).unwrap().data.to_vec();
        let seed: Vec<f32> = value.iter().zip(&c).map(|(j, c)| 2.0 * c * j).collect();
        let mut grad = vec![0.0; params.len()];
        tape.backward(&[(j, &seed)], &mut grad).unwrap();
        let mut at = p.clone();
        let mut largest = 1.0_f64;
        let want: Vec<f64> = (0..p.len())
            .map(|i| {
                let h = 1e-4;
                at[i] = p[i] + h;
                let above = loss(&at);
                at[i] = p[i] - h;
                let below = loss(&at);
                at[i] = p[i];
                let slope = (above - below) / (2.0 * h);
                largest = largest.max(slope.abs());
                slope
            })
            .collect();
        for (i, (got, want)) in grad.iter().zip(&want).enumerate() {
            assert!((f64::from(*got) - want).abs() < 1e-5 * largest, "scale {scale}, parameter {i}: {got} {want}");
        }
    }
}

#[test]
fn deformations_of_nothing_keep_every_bit() {
    let x0: Vec<f32> = points(3, 5, 1.0)[..15].to_vec();
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let x = tape.input(3, 5, &x0).unwrap();
    let zero = tape.fill(3, 5, 0.0);
    for out in [translate(&mut tape, x, zero).unwrap(), rigid(&mut tape, x, zero, zero).unwrap()] {
        assert_eq!(tape.value(out).unwrap().data, x0);
    }
    let mut out = vec![f32::NAN; 15];
    rigid_points(Simd::best(), &x0, &[0.0; 15], &[0.0; 15], &mut out).unwrap();
    assert_eq!(out, x0);
    // The Jacobian of rest is the identity, to the bit too.
    let still = rigid(&mut tape, x, zero, zero).unwrap();
    let j = tape.jacobian(still, x).unwrap();
    let j = tape.value(j).unwrap();
    assert!((0..9).all(|r| j.row(r).iter().all(|&v| v == f32::from(u8::from(r % 4 == 0)))));
}

#[test]
fn rigid_about_turns_around_its_pivot() {
    let (n, at) = (4, points(8, 4, 1.3));
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let ([_, w, _], _) = record(&mut tape, &at);
    let pivot = tape.input(3, n, &points(9, n, 1.0)[..3 * n]).unwrap();
    let zero = tape.fill(3, n, 0.0);
    // The pivot itself stays.
    let out = rigid_about(&mut tape, pivot, w, zero, pivot).unwrap();
    assert_eq!(tape.value(out).unwrap().data, tape.value(pivot).unwrap().data);
}

#[test]
fn no_points_are_legal_and_wrong_shapes_are_refused() {
    rigid_points(Simd::best(), &[], &[], &[], &mut []).unwrap();
    let bars = RigidBars { x: &mut [], omega: &mut [], v: &mut [] };
    rigid_points_backward(Simd::best(), &[], &[], &[], &[], bars).unwrap();
    let mut out = [0.0; 3];
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(rigid_points(Simd::best(), &[0.0; 4], &[0.0; 4], &[0.0; 4], &mut out), shape("x", 6, 4));
    assert_eq!(rigid_points(Simd::best(), &[0.0; 3], &[0.0; 2], &[0.0; 3], &mut out), shape("omega", 3, 2));
    assert_eq!(rigid_points(Simd::best(), &[0.0; 3], &[0.0; 3], &[0.0; 6], &mut out), shape("v", 3, 6));
    assert_eq!(rigid_points(Simd::best(), &[0.0; 6], &[0.0; 6], &[0.0; 6], &mut out), shape("out", 6, 3));
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let (two, three) = (tape.fill(2, 5, 0.0), tape.fill(3, 5, 0.0));
    assert!(matches!(rigid(&mut tape, two, three, three), Err(TapeError::Shape { .. })));
    assert!(matches!(tape.cross(two, two), Err(TapeError::Shape { what: "a", .. })));
    let empty = tape.fill(3, 0, 0.0);
    let out = rigid(&mut tape, empty, empty, empty).unwrap();
    assert!(tape.value(out).unwrap().data.is_empty());
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn rigid_motions_keep_distances(seed in 0_u64..1000, angle in 0.0_f32..30.0) {
        // The same motion for both ends of every segment.
        let n = 8;
        let at = points(seed, n, angle);
        let other = points(seed + 5000, n, 1.0);
        let [x, w, v] = split(&at);
        let (mut a, mut b) = (vec![0.0; 3 * n], vec![0.0; 3 * n]);
        rigid_points(Simd::best(), x, w, v, &mut a).unwrap();
        rigid_points(Simd::best(), &other[..3 * n], w, v, &mut b).unwrap();
        let distance = |a: &[f32], b: &[f32], s: usize| (0..3).map(|r| f64::from(a[r * n + s] - b[r * n + s]).powi(2)).sum::<f64>().sqrt();
        for s in 0..n {
            prop_assert!((distance(&a, &b, s) - distance(x, &other[..3 * n], s)).abs() < 5e-6);
        }
    }

    #[test]
    fn finite_motions_stay_finite(w in prop::array::uniform3(prop::sample::select(vec![0.0_f32, -0.0, 1e-38, 1e-20, 1.0, 1e3, 1e9, -1e12])), x in -1e3_f32..1e3) {
        let (mut out, mut bars) = ([0.0; 3], [[0.0; 3]; 3]);
        rigid_points(Simd::best(), &[x, 1.0, -x], &w, &[0.0, x, 1.0], &mut out).unwrap();
        prop_assert!(out.iter().all(|x| x.is_finite()), "{w:?}: {out:?}");
        let [a, b, c] = &mut bars;
        let rigid_bars = RigidBars { x: a, omega: b, v: c };
        rigid_points_backward(Simd::best(), &[x, 1.0, -x], &w, &[0.0, x, 1.0], &[1.0, -1.0, 0.5], rigid_bars).unwrap();
        prop_assert!(bars.iter().flatten().all(|x| x.is_finite()), "{w:?}: {bars:?}");
    }
}
