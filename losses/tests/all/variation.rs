//! Variation in time and on lattices: against its definition, gradients, what costs nothing.

use crate::SUMS;
use losses::LossError;
use losses::kernel::Kernel;
use losses::variation::{
    acceleration, acceleration_backward, difference, difference_backward, magnitude, magnitude_backward,
    total_variation, total_variation_backward,
};
use proptest::prelude::*;
use testkit::gradient::check_f32_pair;

const KERNELS: [Kernel; 3] = [Kernel::Squared, Kernel::Charbonnier { c: 0.1 }, Kernel::GemanMcClure { c: 0.5 }];

/// Value and derivative of those kernels of one number.
fn twin(kernel: Kernel, x: f64) -> (f64, f64) {
    match kernel {
        Kernel::Squared => (x * x, 2.0 * x),
        Kernel::Charbonnier { c } => {
            let root = x.hypot(c.into());
            (root, x / root)
        }
        Kernel::GemanMcClure { c } => {
            let c2 = f64::from(c).powi(2);
            let z = x * x / c2;
            (2.0 * z / (z + 4.0), 16.0 * x / (z + 4.0).powi(2) / c2)
        }
        _ => unreachable!("no twin of {kernel:?}"),
    }
}

/// Pairs of neighbours along `axis`, lower first, by multi-index.
fn neighbours(dims: &[usize], axis: usize) -> Vec<(usize, usize)> {
    let total: usize = dims.iter().product();
    let stride: usize = dims[axis + 1..].iter().product();
    (0..total).filter(|i| i / stride % dims[axis] + 1 < dims[axis]).map(|i| (i, i + stride)).collect()
}

fn naive(x: &[f64], dims: &[usize], axes: &[usize], kernel: Kernel) -> f64 {
    axes.iter()
        .map(|&axis| {
            let pairs = neighbours(dims, axis);
            pairs.iter().map(|&(a, b)| twin(kernel, x[b] - x[a]).0).sum::<f64>() / pairs.len().max(1) as f64
        })
        .sum()
}

fn naive_backward(x: &[f64], dims: &[usize], axes: &[usize], kernel: Kernel, bar: f64, x_bar: &mut [f64]) {
    for &axis in axes {
        let pairs = neighbours(dims, axis);
        for &(a, b) in &pairs {
            let slope = bar * twin(kernel, x[b] - x[a]).1 / pairs.len() as f64;
            x_bar[b] += slope;
            x_bar[a] -= slope;
        }
    }
}

fn lattices() -> impl Strategy<Value = (Vec<usize>, Vec<usize>, Vec<f32>)> {
    let shape = prop_oneof![
        (prop::collection::vec(1_usize..5, 3), Just(vec![1, 2])),
        (prop::collection::vec(1_usize..5, 3), Just(vec![0, 1])),
        (prop::collection::vec(1_usize..4, 4), Just(vec![0, 1, 2])),
        (prop::collection::vec(1_usize..4, 4), Just(vec![1, 2, 3])),
        (prop::collection::vec(1_usize..9, 1), Just(vec![0])),
    ];
    shape.prop_flat_map(|(dims, axes)| {
        let total = dims.iter().product::<usize>();
        (Just(dims), Just(axes), prop::collection::vec(-1.0_f32..1.0, total))
    })
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn lattices_match_the_definition((dims, axes, x) in lattices(), loss_bar in -2.0_f32..2.0) {
        for kernel in KERNELS {
            check_f32_pair(
                &x, &[loss_bar],
                (
                    |x: &[f32], out: &mut [f32]| out[0] = total_variation(x, &dims, &axes, kernel).unwrap() as f32,
                    |x: &[f32], bar: &[f32], x_bar: &mut [f32]| total_variation_backward(x, &dims, &axes, kernel, bar[0].into(), x_bar).unwrap(),
                ),
                (
                    |x: &[f64], out: &mut [f64]| out[0] = naive(x, &dims, &axes, kernel),
                    |x: &[f64], bar: &[f64], x_bar: &mut [f64]| naive_backward(x, &dims, &axes, kernel, bar[0], x_bar),
                ),
                SUMS,
            ).unwrap();
        }
    }

    #[test]
    fn constant_lattices_cost_nothing((dims, axes, x) in lattices(), level in -5.0_f32..5.0) {
        let flat = vec![level; x.len()];
        let mut bar = vec![0.0; x.len()];
        prop_assert_eq!(total_variation(&flat, &dims, &axes, Kernel::L1).unwrap(), 0.0);
        total_variation_backward(&flat, &dims, &axes, Kernel::L1, 1.0, &mut bar).unwrap();
        prop_assert!(bar.iter().all(|&b| b == 0.0));
        // A level added changes nothing but rounding; gradients sum to zero for the same reason.
        let raised: Vec<f32> = x.iter().map(|x| x + level).collect();
        let (a, b) = (total_variation(&x, &dims, &axes, Kernel::Squared).unwrap(), total_variation(&raised, &dims, &axes, Kernel::Squared).unwrap());
        prop_assert!((a - b).abs() < 2e-5, "{a} {b}");
        total_variation_backward(&x, &dims, &axes, Kernel::Squared, 1.0, &mut bar).unwrap();
        prop_assert!(bar.iter().map(|&b| f64::from(b)).sum::<f64>().abs() < 1e-5);
    }

    #[test]
    fn terms_in_time_match_the_definition(ab in prop::collection::vec(-1.0_f32..1.0, 1..9).prop_flat_map(|a| (prop::collection::vec(-1.0_f32..1.0, a.len()), Just(a))), loss_bar in -2.0_f32..2.0) {
        let (b, a) = ab;
        let n = a.len();
        let both: Vec<f32> = a.iter().chain(&b).copied().collect();
        for kernel in KERNELS {
            for sign in [-1.0, 1.0] {
                let side = if sign < 0.0 { Side::Between } else { Side::Opposed };
                check_f32_pair(
                    &both, &[loss_bar],
                    (
                        |x: &[f32], out: &mut [f32]| {
                            let value = match side {
                                Side::Between => difference(&x[..n], &x[n..], kernel),
                                Side::Opposed => acceleration(&x[..n], &x[n..], kernel),
                            };
                            out[0] = value.unwrap() as f32;
                        },
                        |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                            let (a_bar, b_bar) = x_bar.split_at_mut(n);
                            let (a, b) = x.split_at(n);
                            match side {
                                Side::Between => difference_backward(a, b, kernel, bar[0].into(), a_bar, b_bar).unwrap(),
                                Side::Opposed => acceleration_backward(a, b, kernel, bar[0].into(), a_bar, b_bar).unwrap(),
                            }
                        },
                    ),
                    (
                        |x: &[f64], out: &mut [f64]| out[0] = (0..n).map(|i| twin(kernel, x[i] + sign * x[n + i]).0).sum(),
                        |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                            for i in 0..n {
                                let slope = bar[0] * twin(kernel, x[i] + sign * x[n + i]).1;
                                x_bar[i] += slope;
                                x_bar[n + i] += sign * slope;
                            }
                        },
                    ),
                    SUMS,
                ).unwrap();
            }
            check_f32_pair(
                &a, &[loss_bar],
                (
                    |a: &[f32], out: &mut [f32]| out[0] = magnitude(a, kernel).unwrap() as f32,
                    |a: &[f32], bar: &[f32], a_bar: &mut [f32]| magnitude_backward(a, kernel, bar[0].into(), a_bar).unwrap(),
                ),
                (
                    |a: &[f64], out: &mut [f64]| out[0] = a.iter().map(|&a| twin(kernel, a).0).sum(),
                    |a: &[f64], bar: &[f64], a_bar: &mut [f64]| {
                        a_bar.iter_mut().zip(a).for_each(|(b, &a)| *b += bar[0] * twin(kernel, a).1);
                    },
                ),
                SUMS,
            ).unwrap();
        }
    }
}

#[derive(Clone, Copy)]
enum Side {
    Between,
    Opposed,
}

#[test]
fn steady_motion_is_smooth_and_rest_is_slow() {
    let (forward, backward) = ([0.5, -1.0, 2.0], [-0.5, 1.0, -2.0]);
    for kernel in [Kernel::L1, Kernel::Squared, Kernel::Huber { delta: 1.0 }] {
        assert_eq!(acceleration(&forward, &backward, kernel).unwrap(), 0.0);
        assert_eq!(difference(&forward, &forward, kernel).unwrap(), 0.0);
        assert_eq!(magnitude(&[0.0; 6], kernel).unwrap(), 0.0);
    }
    assert_eq!(magnitude(&forward, Kernel::L1).unwrap(), 3.5);
}

#[test]
fn the_layout_decides_what_is_a_neighbour() {
    // Two features of a 1 x 3 plane: 0 1 2 and 5 5 9.
    let apart = [0.0, 1.0, 2.0, 5.0, 5.0, 9.0];
    let together = [0.0, 5.0, 1.0, 5.0, 2.0, 9.0];
    let want = (1.0 + 1.0 + 0.0 + 16.0) / 4.0;
    assert_eq!(total_variation(&apart, &[2, 1, 3], &[1, 2], Kernel::Squared).unwrap(), want);
    assert_eq!(total_variation(&together, &[1, 3, 2], &[0, 1], Kernel::Squared).unwrap(), want);
}

#[test]
fn nothing_and_wrong_shapes() {
    assert_eq!(magnitude(&[], Kernel::L1).unwrap(), 0.0);
    assert_eq!(difference(&[], &[], Kernel::L1).unwrap(), 0.0);
    assert_eq!(total_variation(&[], &[0, 4, 4], &[1, 2], Kernel::L1).unwrap(), 0.0);
    assert_eq!(total_variation(&[1.0], &[], &[], Kernel::L1).unwrap(), 0.0);
    total_variation_backward(&[], &[3, 0], &[0, 1], Kernel::L1, 1.0, &mut []).unwrap();
    let shape = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(total_variation(&[0.0; 5], &[2, 3], &[1], Kernel::L1), Err(shape("x", 6, 5)));
    // A product that wraps to 0 is not the length of an empty lattice.
    let wraps = [1 << (usize::BITS / 2), 1 << (usize::BITS / 2)];
    assert_eq!(total_variation(&[], &wraps, &[0], Kernel::L1), Err(shape("x", usize::MAX, 0)));
    assert_eq!(total_variation(&[0.0; 6], &[2, 3], &[2], Kernel::L1), Err(shape("dims", 3, 2)));
    assert_eq!(total_variation(&[1.0], &[], &[usize::MAX], Kernel::L1), Err(shape("dims", usize::MAX, 0)));
    assert_eq!(
        total_variation_backward(&[0.0; 6], &[2, 3], &[1], Kernel::L1, 1.0, &mut [0.0; 5]),
        Err(shape("x_bar", 6, 5))
    );
    assert_eq!(difference(&[0.0; 2], &[0.0], Kernel::L1), Err(shape("b", 2, 1)));
    assert_eq!(magnitude_backward(&[0.0; 2], Kernel::L1, 1.0, &mut [0.0]), Err(shape("a_bar", 2, 1)));
    for kernel in [Kernel::LogSquared { eps: 1e-3 }, Kernel::Huber { delta: 0.0 }] {
        assert!(matches!(magnitude(&[1.0], kernel), Err(LossError::Parameter { .. })));
        assert!(matches!(total_variation(&[1.0], &[1], &[0], kernel), Err(LossError::Parameter { .. })));
    }
}
