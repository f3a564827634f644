//! Adam against a naive f64 loop, sparse against dense, bits against bits.

use super::*;
use proptest::prelude::*;
use std::vec::Vec;
use testkit::gradient::{Tolerance, compare, cotangent};

/// The definition, in f64, one entry at a time.
struct Naive {
    config: AdamConfig,
    m: Vec<f64>,
    v: Vec<f64>,
    t: i32,
}

impl Naive {
    fn new(len: usize, config: AdamConfig) -> Self {
        Self { config, m: vec![0.0; len], v: vec![0.0; len], t: 0 }
    }

    fn step(&mut self, lr: f64, params: &mut [f64], grad: &[f64], skip_zero: bool) {
        self.t += 1;
        let AdamConfig { beta1, beta2, eps, decay } = self.config;
        for i in 0..params.len() {
            let mut g = grad[i];
            if !g.is_finite() || (skip_zero && g == 0.0) {
                continue;
            }
            match decay {
                Decay::None => {}
                Decay::L2(rate) => g += rate * params[i],
                Decay::Decoupled(rate) => params[i] *= 1.0 - lr * rate,
            }
            self.m[i] = beta1 * self.m[i] + (1.0 - beta1) * g;
            self.v[i] = beta2 * self.v[i] + (1.0 - beta2) * g * g;
            let m_hat = self.m[i] / (1.0 - beta1.powi(self.t));
            let v_hat = self.v[i] / (1.0 - beta2.powi(self.t));
            params[i] -= lr * m_hat / (v_hat.sqrt() + eps);
        }
    }
}

fn grads(len: usize, step: u64) -> Vec<f32> {
    cotangent(len, step).into_iter().map(|g| g as f32).collect()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

const CONFIGS: [AdamConfig; 5] = [
    AdamConfig::DEFAULT,
    AdamConfig::NERF,
    AdamConfig::NGP,
    AdamConfig::DEFAULT.with_decay(Decay::L2(0.01)),
    AdamConfig::NGP.with_decay(Decay::Decoupled(0.1)),
];

#[test]
fn step_matches_naive() {
    for config in CONFIGS {
        for sparse in [false, true] {
            let mut params: Vec<f32> = grads(37, 99);
            let mut naive_params = wide(&params);
            let (mut adam, mut naive) = (Adam::new(37, config), Naive::new(37, config));
            for t in 0..60 {
                let mut grad = grads(37, t);
                grad[t as usize % 37] = 0.0;
                grad[5] = 0.0;
                let count = if sparse {
                    adam.step_nonzero(Simd::best(), 0.01, &mut params, &grad)
                } else {
                    adam.step(Simd::best(), 0.01, &mut params, &grad)
                };
                assert_eq!(count, 0);
                naive.step(0.01, &mut naive_params, &wide(&grad), sparse);
            }
            // 60 roundings of parameters near 2: 60 * 1.2e-7 at worst.
            compare("parameters", &params, &naive_params, Tolerance::new(5e-6, 0.0)).unwrap();
            compare("first moment", adam.first_moment(), &naive.m, Tolerance::new(2e-6, 0.0)).unwrap();
            compare("second moment", adam.second_moment(), &naive.v, Tolerance::new(5e-6, 0.0)).unwrap();
        }
    }
}

#[test]
fn levels_agree_bit_for_bit_for_every_length() {
    for n in (0..=70).chain([CHUNK + 19]) {
        let run = |simd| {
            let mut params = grads(n, 1000);
            let mut adam = Adam::new(n, AdamConfig::NGP.with_decay(Decay::L2(1e-3)));
            for t in 0..3 {
                let _ = adam.step(simd, 0.01, &mut params, &grads(n, t));
            }
            (params, adam)
        };
        let want = run(Simd::SCALAR);
        assert!(Simd::available().all(|simd| run(simd) == want), "length {n}");
    }
}

#[test]
fn the_first_step_is_the_learning_rate() {
    let mut params = [1.0_f32, 1.0, 1.0];
    let mut adam = Adam::new(3, AdamConfig::NGP);
    let _ = adam.step(Simd::best(), 0.25, &mut params, &[1e-6, -50.0, 3e18]);
    for (p, want) in params.iter().zip([0.75, 1.25, 0.75]) {
        assert!((p - want).abs() < 1e-6, "{p} is not {want}");
    }
}

#[test]
fn entries_with_zero_gradient_are_untouched_in_the_sparse_steps() {
    let config = AdamConfig::DEFAULT.with_decay(Decay::Decoupled(0.5));
    let mut params = [1.0_f32, 2.0, 3.0];
    let mut adam = Adam::new(3, config);
    let _ = adam.step_nonzero(Simd::best(), 0.1, &mut params, &[1.0, 1.0, 0.0]);
    assert_eq!((params[2], adam.first_moment()[2], adam.second_moment()[2]), (3.0, 0.0, 0.0));
    let (p, m, v) = (params[1], adam.first_moment()[1], adam.second_moment()[1]);
    // Minus zero is zero; a denormal is not.
    let _ = adam.step_nonzero(Simd::best(), 0.1, &mut params, &[1.0, -0.0, 1e-45]);
    assert_eq!((params[1], adam.first_moment()[1], adam.second_moment()[1]), (p, m, v));
    assert!(params[2] < 3.0);
    // The dense step moves on by its memory.
    let _ = adam.step(Simd::best(), 0.1, &mut params, &[1.0, 0.0, 0.0]);
    assert!(params[1] < p && adam.first_moment()[1] < m);
}

#[test]
fn non_finite_gradients_are_counted_and_leave_the_entry_alone() {
    for simd in Simd::available() {
        for n in [4, 16, 40] {
            let mut params = vec![1.0_f32; n];
            let mut adam = Adam::new(n, AdamConfig::DEFAULT.with_decay(Decay::L2(0.1)));
            let mut grad = vec![0.5_f32; n];
            (grad[0], grad[2], grad[n - 1]) = (f32::NAN, f32::INFINITY, f32::NEG_INFINITY);
            assert_eq!(adam.step(simd, 0.1, &mut params, &grad), 3);
            assert_eq!(adam.step_nonzero(simd, 0.1, &mut params, &grad), 3);
            let mut marks = vec![u64::MAX; touched_len(n)];
            assert_eq!(adam.step_touched(simd, 0.1, &mut params, &mut grad, &mut marks), 3);
            for i in [0, 2, n - 1] {
                assert_eq!((params[i], adam.first_moment()[i], adam.second_moment()[i]), (1.0, 0.0, 0.0));
            }
            assert!(params[1] < 0.75 && params.iter().all(|p| p.is_finite()));
        }
    }
}

#[test]
fn huge_and_tiny_gradients_stay_finite_and_do_not_freeze() {
    for g in [f32::MAX, 1e25, 1e15, 1e-15, 1e-30, 1e-45] {
        for config in CONFIGS {
            let mut params = [0.0_f32; 3];
            let mut adam = Adam::new(3, config);
            for _ in 0..20 {
                let _ = adam.step(Simd::best(), 0.01, &mut params, &[g, -g, g]);
            }
            assert!(params.iter().all(|p| p.is_finite() && p.abs() <= 0.21), "{g:e}: {params:?}");
            if g >= 1e-6 {
                assert!(params[0] < -0.1, "{g:e} {config:?}: {params:?}");
            }
        }
    }
}

#[test]
fn a_learning_rate_of_zero_changes_moments_only() {
    let before = [1.5_f32, -0.0, f32::MAX, 1e-45];
    for config in CONFIGS {
        let mut params = before;
        let mut adam = Adam::new(4, config);
        let _ = adam.step(Simd::best(), 0.0, &mut params, &[1.0, 2.0, 3.0, 4.0]);
        assert_eq!(params, before);
        assert!(adam.first_moment().iter().all(|m| *m > 0.0) && adam.steps() == 1);
    }
}

#[test]
fn no_parameters_are_legal() {
    let mut adam = Adam::new(0, AdamConfig::DEFAULT);
    assert_eq!(adam.step(Simd::best(), 0.1, &mut [], &[]), 0);
    assert_eq!(adam.step_nonzero(Simd::best(), 0.1, &mut [], &[]), 0);
    assert_eq!(adam.step_touched(Simd::best(), 0.1, &mut [], &mut [], &mut []), 0);
    assert!(adam.is_empty() && adam.steps() == 3);
}

#[test]
fn unmarked_blocks_are_not_looked_at() {
    // Gradients in an unmarked block are neither used nor taken.
    let mut params = [0.0_f32; 40];
    let mut grad = [1.0_f32; 40];
    let mut marks = [0b010];
    let mut adam = Adam::new(40, AdamConfig::NGP);
    let _ = adam.step_touched(Simd::best(), 0.1, &mut params, &mut grad, &mut marks);
    for i in 0..40 {
        let marked = (16..32).contains(&i);
        assert_eq!(params[i] != 0.0, marked, "entry {i}");
        assert_eq!(grad[i] == 0.0, marked, "entry {i}");
    }
    assert_eq!(marks, [0]);
}

#[test]
fn restored_state_continues_with_the_same_bits() {
    let mut params = grads(50, 7);
    let mut adam = Adam::new(50, AdamConfig::NGP);
    for t in 0..10 {
        let _ = adam.step(Simd::best(), 0.01, &mut params, &grads(50, t));
    }
    let (m, v) = (adam.first_moment().to_vec(), adam.second_moment().to_vec());
    let mut again = Adam::restore(adam.config(), m, v, adam.steps()).unwrap();
    let mut params_again = params.clone();
    for t in 10..20 {
        let _ = adam.step(Simd::best(), 0.01, &mut params, &grads(50, t));
        let _ = again.step(Simd::best(), 0.01, &mut params_again, &grads(50, t));
    }
    assert_eq!((params, adam), (params_again, again));
}

#[test]
fn broken_state_is_refused() {
    let restore = |m: &[f32], v: &[f32]| Adam::restore(AdamConfig::DEFAULT, m.to_vec(), v.to_vec(), 1);
    let (want, got) = (2, 1);
    assert_eq!(restore(&[0.0; 2], &[0.0]), Err(OptimError::Shape { what: "second moment", want, got }));
    assert!(matches!(
        restore(&[0.0, f32::NAN], &[0.0; 2]),
        Err(OptimError::Value { what: "first moment", index: 1, .. })
    ));
    let negative = restore(&[0.0; 2], &[-1.0, 0.0]).unwrap_err();
    assert_eq!(std::string::ToString::to_string(&negative), "`second moment[0]` is -1");
    assert!(restore(&[], &[]).is_ok());
}

#[test]
fn constants_out_of_range_are_refused() {
    for config in [
        AdamConfig::DEFAULT.with_betas(1.0, 0.999),
        AdamConfig::DEFAULT.with_betas(0.9, f64::NAN),
        AdamConfig::DEFAULT.with_eps(0.0),
        AdamConfig::DEFAULT.with_eps(1e-60),
        AdamConfig::DEFAULT.with_decay(Decay::L2(-1.0)),
    ] {
        assert!(std::panic::catch_unwind(|| Adam::new(1, config)).is_err(), "{config:?}");
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    /// Marks that cover every nonzero gradient (and some that cover nothing) give what the scan gives.
    #[test]
    fn touched_equals_nonzero(
        n in 0..400_usize,
        entries in proptest::collection::vec((0..400_usize, -2.0..2.0_f32), 0..60),
        extra in proptest::collection::vec(0..25_usize, 0..4),
    ) {
        for simd in Simd::available() {
            let (mut p1, mut p2) = (grads(n, 3), grads(n, 3));
            let (mut scan, mut marked) = (Adam::new(n, AdamConfig::NGP), Adam::new(n, AdamConfig::NGP));
            let mut marks = vec![0_u64; touched_len(n)];
            for t in 0..3 {
                let mut grad = vec![0.0; n];
                for (i, g) in entries.iter().filter(|(i, _)| *i < n && i % 3 != t) {
                    grad[*i] += g;
                    marks[i / BLOCK / 64] |= 1 << (i / BLOCK % 64);
                }
                for b in extra.iter().filter(|b| **b < n.div_ceil(BLOCK)) {
                    marks[b / 64] |= 1 << (b % 64);
                }
                prop_assert_eq!(scan.step_nonzero(simd, 0.01, &mut p1, &grad), 0);
                prop_assert_eq!(marked.step_touched(simd, 0.01, &mut p2, &mut grad, &mut marks), 0);
                prop_assert!(grad.iter().all(|g| *g == 0.0) && marks.iter().all(|m| *m == 0));
            }
            prop_assert_eq!(&p1, &p2);
            prop_assert_eq!(&scan, &marked);
        }
    }

    /// Steps are at most a few learning rates long, whatever the gradients.
    #[test]
    fn steps_are_bounded(history in proptest::collection::vec(prop_oneof![
        4 => -10.0..10.0_f32, 1 => Just(0.0), 1 => any::<f32>().prop_filter("finite", |g| g.is_finite())
    ], 1..40)) {
        let mut adam = Adam::new(1, AdamConfig::DEFAULT);
        let mut p = [0.0_f32];
        for g in history {
            let before = p[0];
            let _ = adam.step(Simd::best(), 0.01, &mut p, &[g]);
            // Kingma and Ba, section 2.1: (1 - beta1) / sqrt(1 - beta2) = 3.16 for a lonely spike, times the bias correction.
            prop_assert!((p[0] - before).abs() <= 0.01 * 7.3, "{} -> {}", before, p[0]);
        }
    }
}
