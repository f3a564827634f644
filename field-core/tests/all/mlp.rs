//! The MLP kernels against a naive f64 twin, at every SIMD level, for odd shapes and batch sizes.
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, MlpError, Packed};
use float_core::Simd;
use proptest::prelude::*;

/// Definition of an activation in f64.
fn act64(a: Activation, x: f64) -> f64 {
    match a {
        Activation::None => x,
        Activation::Relu => x.max(0.0),
        Activation::LeakyRelu { slope } => {
            if x > 0.0 {
                x
            } else {
                slope as f64 * x
            }
        }
        Activation::Softplus { shift } => (x + shift as f64).exp().ln_1p(),
        Activation::Logistic { pad } => (1.0 + 2.0 * pad as f64) / (1.0 + (-x).exp()) - pad as f64,
        Activation::Tanh => x.tanh(),
        Activation::TruncExp => x.exp(),
    }
}

/// One sample through the network, straight from the definition.
fn twin(config: &MlpConfig, params: &[f64], x: &[f64]) -> Vec<f64> {
    let mut h = x.to_vec();
    let mut at = 0;
    let layers = config.hidden.len() + 1;
    for l in 0..layers {
        if config.skips.contains(&l) {
            h = x.iter().chain(&h).copied().collect();
        }
        let n_in = h.len();
        let (out, act) = if l + 1 == layers {
            (config.outputs, config.output_activation)
        } else {
            (config.hidden[l], config.hidden_activation)
        };
        let w = &params[at..at + out * n_in];
        at += out * n_in;
        let b = if config.bias == Bias::Zero { &params[at..at + out] } else { &[] };
        at += b.len();
        h = (0..out)
            .map(|o| {
                let bias = b.get(o).copied().unwrap_or(0.0);
                act64(act, bias + (0..n_in).map(|i| w[o * n_in + i] * h[i]).sum::<f64>())
            })
            .collect();
    }
    h
}

fn noise(seed: u64, n: usize, scale: f32) -> Vec<f32> {
    let rng = field_core::rng::Rng::new(seed, 7);
    (0..n).map(|i| (rng.uniform_at(i as u64) * 2.0 - 1.0) * scale).collect()
}

/// `<cotangent, y>` of the twin as a function of everything, for differences.
fn scalar(config: &MlpConfig, params: &[f64], x: &[f64], n: usize, bar: &[f64]) -> f64 {
    (0..n)
        .map(|s| {
            let xs: Vec<f64> = (0..config.inputs).map(|i| x[i * n + s]).collect();
            twin(config, params, &xs).iter().enumerate().map(|(o, y)| y * bar[o * n + s]).sum::<f64>()
        })
        .sum()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x as f64).collect()
}

/// Values and gradients of one network at every level; gradients of the twin by central differences on some entries.
fn check(config: &MlpConfig, n: usize, seed: u64) {
    let mlp = Mlp::new(config).unwrap();
    let params = noise(seed, mlp.param_count(), 0.6);
    let (x, bar) = (noise(seed + 1, config.inputs * n, 1.0), noise(seed + 2, config.outputs * n, 1.0));
    let (p64, x64, bar64) = (wide(&params), wide(&x), wide(&bar));
    let difference = |values: &[f64], k: usize, f: &dyn Fn(&[f64]) -> f64| {
        let h = 1e-6;
        let mut v = values.to_vec();
        v[k] += h;
        let up = f(&v);
        v[k] -= 2.0 * h;
        (up - f(&v)) / (2.0 * h)
    };
    let some = |len: usize| (0..len).step_by((len / 17).max(1));
    let want_p: Vec<(usize, f64)> =
        some(p64.len()).map(|k| (k, difference(&p64, k, &|p| scalar(config, p, &x64, n, &bar64)))).collect();
    let want_x: Vec<(usize, f64)> =
        some(x64.len()).map(|k| (k, difference(&x64, k, &|x| scalar(config, &p64, x, n, &bar64)))).collect();
    let mut packed = Packed::default();
    mlp.pack(&params, &mut packed);
    for simd in Simd::available() {
        let mut y = vec![f32::NAN; config.outputs * n];
        let mut acts = vec![f32::NAN; mlp.activations_len(n)];
        mlp.forward(simd, &packed, &x, n, n, &mut y, n, &mut acts);
        for s in 0..n {
            let xs: Vec<f64> = (0..config.inputs).map(|i| x64[i * n + s]).collect();
            for (o, want) in twin(config, &p64, &xs).iter().enumerate() {
                let got = y[o * n + s] as f64;
                assert!((got - want).abs() <= 2e-5 * (1.0 + want.abs()), "{:?} y[{o}][{s}] {got} {want}", simd.level());
            }
        }
        let mut y2 = vec![0.0; y.len()];
        let mut scratch = vec![f32::NAN; mlp.infer_scratch_len()];
        mlp.infer(simd, &packed, &x, n, n, &mut y2, n, &mut scratch);
        assert_eq!(y, y2, "infer and forward differ");

        let (mut x_bar, mut grad) = (vec![0.0; x.len()], vec![0.0; mlp.packed_grad_len()]);
        let mut scratch = vec![f32::NAN; mlp.backward_scratch_len()];
        mlp.backward(simd, &packed, &acts, &bar, n, n, Some((&mut x_bar, n)), &mut grad, &mut scratch);
        let mut p_bar = vec![0.0; mlp.param_count()];
        mlp.unpack_grad(&grad, &mut p_bar);
        let scale = (n as f64).sqrt();
        for &(k, want) in &want_p {
            let got = p_bar[k] as f64;
            assert!((got - want).abs() <= 1e-4 * scale * (1.0 + want.abs()), "{:?} p[{k}] {got} {want}", simd.level());
        }
        for &(k, want) in &want_x {
            let got = x_bar[k] as f64;
            assert!((got - want).abs() <= 1e-4 * (1.0 + want.abs()), "{:?} x[{k}] {got} {want}", simd.level());
        }
    }
}

fn config(
    inputs: usize,
    hidden: &[usize],
    outputs: usize,
    act: Activation,
    out: Activation,
    skips: &[usize],
) -> MlpConfig {
    MlpConfig::new(inputs, hidden.to_vec(), outputs)
        .with_hidden_activation(act)
        .with_output_activation(out)
        .with_skips(skips.to_vec())
}

#[test]
fn every_activation_matches_its_twin_forward_and_backward() {
    for act in [
        Activation::None,
        Activation::Softplus { shift: -1.0 },
        Activation::Logistic { pad: 0.001 },
        Activation::Tanh,
        Activation::Relu,
        Activation::LeakyRelu { slope: 0.1 },
    ] {
        check(&config(5, &[17, 20], 3, act, Activation::None, &[]), 50, 11);
    }
    check(&config(5, &[8], 3, Activation::Tanh, Activation::TruncExp, &[]), 7, 12);
    check(&config(5, &[8], 3, Activation::Tanh, Activation::LOGISTIC, &[]), 49, 13);
}

#[test]
fn skips_match_the_twin() {
    check(&config(9, &[24, 24, 24, 24], 4, Activation::SOFTPLUS, Activation::None, &[2]), 51, 21);
    check(&config(7, &[16, 5], 2, Activation::Tanh, Activation::None, &[1, 2]), 3, 22);
}

#[test]
fn the_published_nerf_trunk_has_its_parameters() {
    let trunk = Mlp::new(&config(63, &[256; 7], 256, Activation::Relu, Activation::Relu, &[5])).unwrap();
    assert_eq!(trunk.param_count(), 63 * 256 + 256 + 6 * (256 * 256 + 256) + (256 + 63) * 256 + 256);
}

#[test]
fn empty_batches_do_nothing() {
    let mlp = Mlp::new(&config(3, &[4], 2, Activation::Relu, Activation::None, &[])).unwrap();
    let mut packed = Packed::default();
    mlp.pack(&vec![1.0; mlp.param_count()], &mut packed);
    mlp.forward(Simd::best(), &packed, &[], 0, 0, &mut [], 0, &mut []);
    let mut grad = vec![0.0; mlp.packed_grad_len()];
    mlp.backward(Simd::best(), &packed, &[], &[], 0, 0, None, &mut grad, &mut vec![0.0; mlp.backward_scratch_len()]);
    assert!(grad.iter().all(|g| *g == 0.0));
}

#[test]
fn impossible_shapes_are_refused_with_the_layer() {
    let bad = |c: MlpConfig| Mlp::new(&c).unwrap_err();
    assert_eq!(bad(config(0, &[4], 2, Activation::Relu, Activation::None, &[])), MlpError::EmptyLayer { layer: 0 });
    assert_eq!(bad(config(3, &[4, 0], 2, Activation::Relu, Activation::None, &[])), MlpError::EmptyLayer { layer: 2 });
    let skip = bad(config(3, &[4], 2, Activation::Relu, Activation::None, &[2]));
    assert_eq!(skip, MlpError::Skip { layer: 2, layers: 2 });
    assert!(skip.to_string().contains("layer 2"));
}

#[test]
fn networks_too_large_to_count_are_refused() {
    let (none, bit) = (Activation::None, usize::BITS);
    // Products of widths that wrap to small numbers: a network of no parameters, by such counting.
    let wraps = [
        (1 << (bit / 2), vec![], 1 << (bit / 2)),
        (15, vec![1 << (bit - 4)], 16),
        (1, vec![4, usize::MAX], 1),
        (usize::MAX, vec![4], 1),
        (3, vec![4, 4], usize::MAX - 7),
        (1 << (bit - 5), vec![8], 8),
    ];
    for (inputs, hidden, outputs) in wraps {
        let bad = Mlp::new(&config(inputs, &hidden, outputs, none, none, &[])).unwrap_err();
        assert!(matches!(bad, MlpError::TooLarge { .. }), "{inputs} {hidden:?} {outputs}: {bad}");
        assert!(bad.to_string().contains("too large"));
    }
    let mlp = Mlp::new(&config(3, &[100_000], 3, Activation::Relu, none, &[])).expect("wide, but it can be counted");
    assert_eq!(mlp.param_count(), 3 * 100_000 + 100_000 + 3 * 100_000 + 3);
}

/// With nine rows this stride times eight wraps to 0: rows that are nowhere near the buffer would pass a careless check.
const WILD: usize = 1 << (usize::BITS - 3);

#[test]
fn wild_strides_are_refused_and_nothing_is_touched() {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    let mlp = Mlp::new(&config(9, &[], 9, Activation::None, Activation::None, &[])).unwrap();
    let mut packed = Packed::default();
    mlp.pack(&vec![0.1; mlp.param_count()], &mut packed);
    for simd in Simd::available() {
        let x = vec![1.0; 9];
        let refuses = |what: &str, run: &mut dyn FnMut()| {
            let refused = catch_unwind(AssertUnwindSafe(run)).expect_err(what);
            let said = refused.downcast_ref::<&str>().map(ToString::to_string);
            let said = said.or_else(|| refused.downcast_ref::<String>().cloned()).unwrap_or_default();
            assert!(said.contains(what), "{what}: {said}");
        };
        let (mut y, mut acts) = (vec![0.0; 9], vec![0.0; mlp.activations_len(1)]);
        refuses("mlp: x", &mut || mlp.forward(simd, &packed, &x, WILD, 1, &mut y, 1, &mut acts));
        refuses("mlp: y", &mut || mlp.forward(simd, &packed, &x, 1, 1, &mut y, WILD, &mut acts));
        let mut scratch = vec![0.0; mlp.infer_scratch_len()];
        refuses("mlp: x", &mut || mlp.infer(simd, &packed, &x, WILD, 1, &mut y, 1, &mut scratch));
        mlp.forward(simd, &packed, &x, 1, 1, &mut y, 1, &mut acts);
        let (mut grad, mut scratch) = (vec![0.0; mlp.packed_grad_len()], vec![0.0; mlp.backward_scratch_len()]);
        refuses("mlp: y_bar", &mut || {
            mlp.backward(simd, &packed, &acts, &y, WILD, 1, None, &mut grad, &mut scratch);
        });
        let mut x_bar = vec![0.0; 9];
        refuses("mlp: x_bar", &mut || {
            mlp.backward(simd, &packed, &acts, &y, 1, 1, Some((&mut x_bar, WILD)), &mut grad, &mut scratch);
        });
        assert!(x_bar.iter().chain(&grad).all(|g| *g == 0.0));
    }
}

#[test]
fn saturated_activations_stay_finite() {
    for out in [Activation::TruncExp, Activation::LOGISTIC, Activation::SOFTPLUS, Activation::Tanh] {
        let mlp = Mlp::new(&config(1, &[], 1, Activation::None, out, &[])).unwrap();
        let mut packed = Packed::default();
        mlp.pack(&[1e4, 0.0], &mut packed);
        let x = [1e4, -1e4, 0.0, 1e30, -1e30];
        let (mut y, mut acts) = (vec![0.0; 5], vec![0.0; mlp.activations_len(5)]);
        mlp.forward(Simd::best(), &packed, &x, 5, 5, &mut y, 5, &mut acts);
        let (mut x_bar, mut grad) = (vec![0.0; 5], vec![0.0; mlp.packed_grad_len()]);
        let mut scratch = vec![0.0; mlp.backward_scratch_len()];
        mlp.backward(Simd::best(), &packed, &acts, &[1e-3; 5], 5, 5, Some((&mut x_bar, 5)), &mut grad, &mut scratch);
        assert!(y.iter().chain(&x_bar).all(|v| v.is_finite()), "{out:?} {y:?} {x_bar:?}");
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(24))]
    #[test]
    fn any_shape_and_batch_matches_the_twin(
        inputs in 1_usize..40, hidden in prop::collection::vec(1_usize..40, 0..4), outputs in 1_usize..20,
        n in 1_usize..101, seed in 0_u64..1000, bias in prop::bool::ANY, skip in 0_usize..5,
    ) {
        let skips = if skip >= 1 && skip <= hidden.len() { vec![skip] } else { vec![] };
        let mut c = config(inputs, &hidden, outputs, Activation::Tanh, Activation::None, &skips);
        if !bias {
            c.bias = Bias::None;
        }
        check(&c, n, seed);
    }

    #[test]
    fn a_batch_equals_its_samples_one_by_one(n in 1_usize..100, seed in 0_u64..1000) {
        let c = config(6, &[19], 5, Activation::Relu, Activation::None, &[1]);
        let mlp = Mlp::new(&c).unwrap();
        let mut packed = Packed::default();
        mlp.pack(&noise(seed, mlp.param_count(), 1.0), &mut packed);
        let x = noise(seed + 1, 6 * n, 1.0);
        for simd in Simd::available() {
            let (mut y, mut acts) = (vec![0.0; 5 * n], vec![0.0; mlp.activations_len(n)]);
            mlp.forward(simd, &packed, &x, n, n, &mut y, n, &mut acts);
            for s in 0..n {
                let mut one = vec![0.0; 5 * n];
                // The same rows, read from sample `s` on.
                mlp.forward(simd, &packed, &x[s..], n, 1, &mut one, n, &mut acts);
                for o in 0..5 {
                    prop_assert_eq!(one[o * n], y[o * n + s]);
                }
            }
        }
    }
}
