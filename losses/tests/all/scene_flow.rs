//! Scene flow: against its definition, gradients, what costs nothing, and which samples take part.

use crate::SUMS;
use losses::LossError;
use losses::kernel::Kernel;
use losses::scene_flow::{
    CycleBar, Near, SPATIAL_SHARE, TEMPORAL_SHARE, cycle, cycle_backward, spatial, spatial_backward, temporal,
    temporal_backward,
};
use losses::variation::{acceleration, magnitude};
use proptest::prelude::*;
use testkit::gradient::check_f32_pair;

const KERNELS: [Kernel; 3] = [Kernel::L1, Kernel::Squared, Kernel::Charbonnier { c: 0.1 }];

/// Value and derivative of those kernels of one number.
fn twin(kernel: Kernel, x: f64) -> [f64; 2] {
    match kernel {
        Kernel::L1 => [x.abs(), x.signum()],
        Kernel::Squared => [x * x, 2.0 * x],
        Kernel::Charbonnier { c } => {
            let root = x.hypot(c.into());
            [root, x / root]
        }
        _ => unreachable!("no twin of {kernel:?}"),
    }
}

/// Numbers of which no two add up to 0 and no two neighbours are equal, by 1/32 or more: the corner of L1 is away from all of them.
fn apart(quarters: &[i32]) -> Vec<f32> {
    let one = |(i, &q): (usize, &i32)| 0.25 * q as f32 + 0.03125 * (1 + i % 3) as f32;
    quarters.iter().enumerate().map(one).collect()
}

/// Offsets of rays and three rows of flow to each side, with weights.
fn batches() -> impl Strategy<Value = (Vec<u32>, Vec<f32>, Vec<f32>, Vec<f32>)> {
    prop::collection::vec(0_u32..7, 0..5).prop_flat_map(|lengths| {
        let offsets: Vec<u32> = std::iter::once(0)
            .chain(lengths.iter().scan(0, |sum, n| {
                *sum += n;
                Some(*sum)
            }))
            .collect();
        let n = lengths.iter().sum::<u32>() as usize;
        let rows = || prop::collection::vec(-8_i32..8, 3 * n);
        (Just(offsets), rows(), rows(), prop::collection::vec(0.0_f32..1.0, n))
            .prop_map(|(offsets, a, b, w)| (offsets, apart(&a), apart(&b), w))
    })
}

/// The near samples of each ray, written out.
fn spans(offsets: &[u32], share: f64) -> Vec<Vec<usize>> {
    let ray = |ends: &[u32]| {
        let taken = (share * f64::from(ends[1] - ends[0])).floor() as u32;
        (ends[0]..ends[0] + taken).map(|i| i as usize).collect()
    };
    offsets.windows(2).map(ray).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn the_cycle_is_its_definition((_, a, b, w) in batches(), loss_bar in -2.0_f32..2.0) {
        let (m, n) = (a.len(), w.len());
        let x: Vec<f32> = a.iter().chain(&b).chain(&w).copied().collect();
        for kernel in KERNELS {
            let single = |x: &[f32], out: &mut [f32]| {
                out[0] = cycle(&x[..m], &x[m..2 * m], &x[2 * m..], kernel).unwrap() as f32;
            };
            let single_backward = |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                let (there, rest) = x_bar.split_at_mut(m);
                let (back, w) = rest.split_at_mut(m);
                let bars = CycleBar { there, back, w };
                cycle_backward(&x[..m], &x[m..2 * m], &x[2 * m..], kernel, bar[0].into(), bars).unwrap();
            };
            let double = |x: &[f64], out: &mut [f64]| {
                out[0] = (0..m).map(|at| x[2 * m + at % n] * twin(kernel, x[at] + x[m + at])[0]).sum();
            };
            let double_backward = |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                for at in 0..m {
                    let [value, derivative] = twin(kernel, x[at] + x[m + at]);
                    x_bar[at] += bar[0] * x[2 * m + at % n] * derivative;
                    x_bar[m + at] += bar[0] * x[2 * m + at % n] * derivative;
                    x_bar[2 * m + at % n] += bar[0] * value;
                }
            };
            check_f32_pair(&x, &[loss_bar], (single, single_backward), (double, double_backward), SUMS).unwrap();
        }
    }

    #[test]
    fn the_temporal_term_is_its_definition((offsets, a, b, _) in batches(), share in 0.0_f64..1.0, loss_bar in -2.0_f32..2.0) {
        let (m, n) = (a.len(), a.len() / 3);
        let near = Near { offsets: &offsets, share };
        let taken: Vec<usize> = spans(&offsets, share).concat();
        prop_assert_eq!(near.samples(), taken.len());
        let all: Vec<usize> = (0..3).flat_map(|row| taken.iter().map(move |i| row * n + i)).collect();
        let x: Vec<f32> = a.iter().chain(&b).copied().collect();
        for kernel in KERNELS {
            let single = |x: &[f32], out: &mut [f32]| out[0] = temporal(&x[..m], &x[m..], near, kernel).unwrap() as f32;
            let single_backward = |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                let (next_bar, previous_bar) = x_bar.split_at_mut(m);
                temporal_backward(&x[..m], &x[m..], near, kernel, bar[0].into(), next_bar, previous_bar).unwrap();
            };
            let double = |x: &[f64], out: &mut [f64]| out[0] = all.iter().map(|&at| twin(kernel, x[at] + x[m + at])[0]).sum();
            let double_backward = |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                for &at in &all {
                    let derivative = bar[0] * twin(kernel, x[at] + x[m + at])[1];
                    x_bar[at] += derivative;
                    x_bar[m + at] += derivative;
                }
            };
            check_f32_pair(&x, &[loss_bar], (single, single_backward), (double, double_backward), SUMS).unwrap();
        }
    }

    #[test]
    fn the_spatial_term_is_its_definition((offsets, a, _, _) in batches(), share in 0.0_f64..1.0, loss_bar in -2.0_f32..2.0) {
        let n = a.len() / 3;
        let near = Near { offsets: &offsets, share };
        let mut pairs = Vec::new();
        for ray in spans(&offsets, share) {
            pairs.extend(ray.windows(2).map(|two| [two[0], two[1]]));
        }
        prop_assert_eq!(near.pairs(), pairs.len());
        let all: Vec<[usize; 2]> = (0..3).flat_map(|row| pairs.iter().map(move |pair| pair.map(|i| row * n + i))).collect();
        for kernel in KERNELS {
            let single = |x: &[f32], out: &mut [f32]| out[0] = spatial(x, near, kernel).unwrap() as f32;
            let single_backward = |x: &[f32], bar: &[f32], x_bar: &mut [f32]| {
                spatial_backward(x, near, kernel, bar[0].into(), x_bar).unwrap();
            };
            let double = |x: &[f64], out: &mut [f64]| out[0] = all.iter().map(|&[i, k]| twin(kernel, x[i] - x[k])[0]).sum();
            let double_backward = |x: &[f64], bar: &[f64], x_bar: &mut [f64]| {
                for &[i, k] in &all {
                    let derivative = bar[0] * twin(kernel, x[i] - x[k])[1];
                    x_bar[i] += derivative;
                    x_bar[k] -= derivative;
                }
            };
            check_f32_pair(&a, &[loss_bar], (single, single_backward), (double, double_backward), SUMS).unwrap();
        }
    }

    #[test]
    fn weights_of_one_make_the_cycle_an_acceleration((_, a, b, w) in batches()) {
        let ones = vec![1.0; w.len()];
        for kernel in KERNELS {
            let (got, want) = (cycle(&a, &b, &ones, kernel).unwrap(), acceleration(&a, &b, kernel).unwrap());
            prop_assert_eq!(got, want);
            prop_assert_eq!(cycle(&a, &b, &vec![0.0; w.len()], kernel).unwrap(), 0.0);
        }
    }
}

#[test]
fn there_and_back_steady_and_alike_cost_nothing() {
    let (there, back) = ([0.5, 0.5, -1.0, -1.0, 2.0, 2.0], [-0.5, -0.5, 1.0, 1.0, -2.0, -2.0]);
    let near = Near { offsets: &[0, 2], share: 1.0 };
    for kernel in [Kernel::L1, Kernel::Squared] {
        assert_eq!(cycle(&there, &back, &[1.0, 0.5], kernel), Ok(0.0));
        assert_eq!(temporal(&there, &back, near, kernel), Ok(0.0));
        assert_eq!(spatial(&there, near, kernel), Ok(0.0));
        let (mut a, mut b, mut w) = ([0.0; 6], [0.0; 6], [0.0; 2]);
        let bars = CycleBar { there: &mut a, back: &mut b, w: &mut w };
        cycle_backward(&there, &back, &[1.0, 0.5], kernel, 1.0, bars).unwrap();
        temporal_backward(&there, &back, near, kernel, 1.0, &mut a, &mut b).unwrap();
        spatial_backward(&there, near, kernel, 1.0, &mut a).unwrap();
        assert_eq!((a, b, w), ([0.0; 6], [0.0; 6], [0.0; 2]));
    }
    // What moves is not minimal, however steady.
    assert_eq!(magnitude(&there, Kernel::L1), Ok(7.0));
}

#[test]
fn the_far_end_of_each_ray_is_left_out() {
    // 20 and 10 samples: int(20 * 0.95) = 19, int(10 * 0.95) = 9; int(20 * 0.9) = 18, int(10 * 0.9) = 9.
    let offsets = [0, 20, 30];
    let near = |share| Near { offsets: &offsets, share };
    assert_eq!((near(SPATIAL_SHARE).samples(), near(SPATIAL_SHARE).pairs()), (28, 26));
    assert_eq!(near(TEMPORAL_SHARE).samples(), 27);
    // Infinite where they do not look, and between rays.
    let mut flow = [0.0; 30];
    (flow[19], flow[29]) = (f32::INFINITY, f32::INFINITY);
    flow[20..29].fill(7.0);
    assert_eq!(spatial(&flow, near(SPATIAL_SHARE), Kernel::L1), Ok(0.0));
    let mut bar = [0.0; 30];
    spatial_backward(&flow, near(SPATIAL_SHARE), Kernel::Squared, 1.0, &mut bar).unwrap();
    assert_eq!(bar, [0.0; 30]);
    assert_eq!(temporal(&flow, &[0.0; 30], near(TEMPORAL_SHARE), Kernel::Squared), Ok(9.0 * 49.0));
}

#[test]
fn nothing_and_wrong_shapes() {
    let none = Near { offsets: &[], share: 1.0 };
    assert_eq!(cycle(&[], &[], &[], Kernel::L1), Ok(0.0));
    assert_eq!((temporal(&[], &[], none, Kernel::L1), spatial(&[], none, Kernel::L1)), (Ok(0.0), Ok(0.0)));
    assert_eq!((none.samples(), none.pairs()), (0, 0));
    let bare = Near { offsets: &[0, 0, 0], share: 1.0 };
    assert_eq!(spatial_backward(&[], bare, Kernel::L1, 1.0, &mut []), Ok(()));
    let shape = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(cycle(&[0.0; 5], &[0.0; 5], &[1.0; 2], Kernel::L1), Err(shape("there", 6, 5)));
    assert_eq!(cycle(&[0.0; 6], &[0.0; 4], &[1.0; 2], Kernel::L1), Err(shape("back", 6, 4)));
    assert_eq!(cycle(&[0.0], &[0.0], &[], Kernel::L1), Err(shape("there", 0, 1)));
    let two = Near { offsets: &[0, 2], share: 1.0 };
    assert_eq!(temporal(&[0.0; 3], &[0.0; 3], two, Kernel::L1), Err(shape("next", 4, 3)));
    assert_eq!(temporal(&[0.0; 2], &[0.0; 4], two, Kernel::L1), Err(shape("previous", 2, 4)));
    assert_eq!(spatial_backward(&[0.0; 2], two, Kernel::L1, 1.0, &mut [0.0]), Err(shape("flow_bar", 2, 1)));
    let back = Near { offsets: &[0, 2, 1], share: 1.0 };
    assert_eq!(spatial(&[0.0], back, Kernel::L1), Err(LossError::Order { what: "offsets" }));
    for share in [-0.1, 1.1, f64::NAN] {
        let wrong = Near { offsets: &[0, 2], share };
        assert!(matches!(spatial(&[0.0; 2], wrong, Kernel::L1), Err(LossError::Parameter { .. })), "{share}");
    }
    let log = Kernel::LogSquared { eps: 1e-3 };
    assert!(matches!(cycle(&[1.0], &[1.0], &[1.0], log), Err(LossError::Parameter { .. })));
}

#[test]
fn extremes_stay_finite_and_nan_is_seen() {
    let (a, b) = ([1e18, -1e-40, 0.0, -0.0, 1e18, 3.0], [1e18, 1e-40, -0.0, 0.0, -1e18, f32::MIN_POSITIVE]);
    let near = Near { offsets: &[0, 6], share: 1.0 };
    for kernel in [Kernel::L1, Kernel::Squared] {
        assert!(cycle(&a, &b, &[1.0; 6], kernel).unwrap().is_finite());
        assert!(temporal(&a, &b, near, kernel).unwrap().is_finite() && spatial(&a, near, kernel).unwrap().is_finite());
        let (mut a_bar, mut b_bar, mut w_bar) = ([0.0; 6], [0.0; 6], [0.0; 6]);
        let bars = CycleBar { there: &mut a_bar, back: &mut b_bar, w: &mut w_bar };
        cycle_backward(&a, &b, &[1.0; 6], kernel, 1.0, bars).unwrap();
        spatial_backward(&a, near, kernel, 1.0, &mut a_bar).unwrap();
        assert!(a_bar.iter().chain(&b_bar).chain(&w_bar).all(|x| x.is_finite()), "{a_bar:?} {b_bar:?} {w_bar:?}");
    }
    let lost = [f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert!(cycle(&lost, &b, &[1.0; 6], Kernel::L1).unwrap().is_nan());
    assert!(spatial(&lost, near, Kernel::L1).unwrap().is_nan());
}
