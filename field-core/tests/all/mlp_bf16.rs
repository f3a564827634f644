//! Networks whose products take bf16: every SIMD level against the scalar one, and both precisions against f64.

use crate::mlp_twin::{distances, noise, run, twin, weights, wide};
use field_core::mlp::{Activation, Mlp, MlpConfig, PANEL, Packed, Precision};
use float_core::{Bf16, Simd};
use proptest::prelude::*;

fn config(inputs: usize, hidden: &[usize], outputs: usize, act: Activation, skips: &[usize]) -> MlpConfig {
    MlpConfig::new(inputs, hidden.to_vec(), outputs).with_hidden_activation(act).with_skips(skips.to_vec())
}

/// Relative errors of outputs, input gradients and parameter gradients against f64, of the networks of ngp and the
/// benchmark. f32: at most 2e-6. bf16: each rounding is off by up to 2^-9 = 0.2 %, and a network of three layers chains
/// six of them: at most 1e-2, for gradients too where nothing is switched. With ReLUs, of every thousand units one or
/// two lie so near to zero that they switch the other way, and a gradient that a thousandth of its terms enter or leave is
/// off by the root of that, layer after layer: at most 0.1.
#[test]
fn errors_against_f64_stay_in_their_bounds() {
    for (hidden, outputs) in [(vec![64], 16), (vec![64, 64], 3), (vec![64, 64], 16)] {
        for act in [Activation::Relu, Activation::None] {
            let base = Mlp::new(&config(32, &hidden, outputs, act, &[])).unwrap();
            let n = 480;
            let (params, x, y_bar) = (weights(&base, 1), noise(2, 32 * n, 1.0), noise(3, outputs * n, 1.0));
            let want = twin(&base, &wide(&params), &wide(&x), &wide(&y_bar), n);
            for simd in Simd::available() {
                for precision in [Precision::F32, Precision::Bf16] {
                    let mlp = base.clone().with_precision(precision);
                    let errors = distances(&run(&mlp, simd, &params, &x, &y_bar, n, &[0]), &want);
                    let what = format!("32-{hidden:?}-{outputs} {act:?} {precision:?} {:?}", simd.level());
                    println!("{what}: y {:.1e}, x_bar {:.1e}, params_bar {:.1e}", errors[0], errors[1], errors[2]);
                    let bounds = match (precision, act) {
                        (Precision::F32, _) => [2e-6; 3],
                        (Precision::Bf16, Activation::None) => [1e-2; 3],
                        (Precision::Bf16, _) => [1e-2, 0.1, 0.1],
                    };
                    assert!(errors.iter().zip(bounds).all(|(e, b)| *e <= b), "{what} {errors:?}");
                    // A rounding that did not happen would be seen, too.
                    assert!(precision == Precision::F32 || errors.iter().all(|e| *e >= 1e-4), "{what} {errors:?}");
                }
            }
        }
    }
}

#[test]
fn the_twin_matches_its_central_differences() {
    let mlp = Mlp::new(&config(4, &[7, 5, 6], 3, Activation::Relu, &[2])).unwrap();
    let n = 6;
    let (mut params, mut x, y_bar) =
        (wide(&weights(&mlp, 4)), wide(&noise(5, 4 * n, 1.0)), wide(&noise(6, 3 * n, 1.0)));
    let got = twin(&mlp, &params, &x, &y_bar, n);
    let value = |params: &[f64], x: &[f64]| {
        twin(&mlp, params, x, &y_bar, n).y.iter().zip(&y_bar).map(|(y, b)| y * b).sum::<f64>()
    };
    let h = 1e-6;
    for k in 0..params.len() {
        let p = params[k];
        params[k] = p + h;
        let up = value(&params, &x);
        params[k] = p - h;
        let want = (up - value(&params, &x)) / (2.0 * h);
        params[k] = p;
        assert!((got.params_bar[k] - want).abs() <= 1e-7 * (1.0 + want.abs()), "{k} {} {want}", got.params_bar[k]);
    }
    for k in 0..x.len() {
        let v = x[k];
        x[k] = v + h;
        let up = value(&params, &x);
        x[k] = v - h;
        let want = (up - value(&params, &x)) / (2.0 * h);
        x[k] = v;
        assert!((got.x_bar[k] - want).abs() <= 1e-7 * (1.0 + want.abs()), "{k} {} {want}", got.x_bar[k]);
    }
}

/// Without hidden layers nothing is rounded but what goes in, so that back ends differ by the rounding of f32 sums alone.
#[test]
fn one_layer_agrees_between_back_ends_to_the_rounding_of_sums() {
    if Bf16::of(Simd::best()).is_none() {
        println!("SKIPPED: no AVX512_BF16 here, all levels run the same kernels");
    }
    for (inputs, outputs, n) in [(32, 16, 96), (33, 17, 50), (1, 1, 1), (7, 64, 48), (64, 3, 49), (256, 256, 48)] {
        let mlp =
            Mlp::new(&config(inputs, &[], outputs, Activation::Relu, &[])).unwrap().with_precision(Precision::Bf16);
        let (params, x) = (noise(7, mlp.param_count(), 1.0), noise(8, inputs * n, 1.0));
        let y_bar = noise(9, outputs * n, 1.0);
        let want = run(&mlp, Simd::SCALAR, &params, &x, &y_bar, n, &[0]);
        for simd in Simd::available() {
            let got = run(&mlp, simd, &params, &x, &y_bar, n, &[0]);
            for (got, want, terms) in
                [(&got.y, &want.y, inputs), (&got.x_bar, &want.x_bar, outputs), (&got.params_bar, &want.params_bar, n)]
            {
                for (i, (a, b)) in got.iter().zip(want).enumerate() {
                    // Every term is below 1; each sum of m terms is off by m roundings of partial sums below m, seldom by 1 / 8 of it.
                    let bound = f32::EPSILON * (terms * terms) as f32 / 8.0 + 1e-6;
                    assert!((a - b).abs() <= bound, "{:?} {inputs}-{outputs} [{i}] {a} {b}", simd.level());
                }
            }
        }
    }
}

#[test]
fn parameters_of_another_precision_are_refused() {
    let base = Mlp::new(&config(3, &[4], 2, Activation::Relu, &[])).unwrap();
    assert_eq!(base.precision(), Precision::F32);
    let mlp = base.clone().with_precision(Precision::Bf16);
    let mut packed = Packed::default();
    base.pack(&vec![0.5; base.param_count()], &mut packed);
    let mut acts = vec![0.0; mlp.activations_len(1)];
    let refused = std::panic::catch_unwind(move || {
        mlp.forward(Simd::best(), &packed, &[1.0; 3], 1, 1, &mut [0.0; 2], 1, &mut acts);
    });
    let message = *refused.unwrap_err().downcast::<&str>().unwrap();
    assert!(message.contains("precision"), "{message}");
}

#[test]
fn huge_tiny_and_broken_numbers_go_through_alike() {
    let mlp = Mlp::new(&config(1, &[1], 1, Activation::Relu, &[])).unwrap().with_precision(Precision::Bf16);
    let x = [1e30, -1e30, 1e-30, 1e-42, 0.0, f32::INFINITY, f32::NAN, 3.3e38];
    for simd in Simd::available() {
        let out = run(&mlp, simd, &[1.0, 0.0, 1.0, 0.0], &x, &[1e-3; 8], 8, &[0]);
        let near = |a: f32, b: f32| (a - b).abs() <= b.abs() / 200.0;
        assert!(near(out.y[0], 1e30) && near(out.y[2], 1e-30) && near(out.y[7], 3.3e38), "{:?}", out.y);
        assert_eq!([out.y[1], out.y[3], out.y[4], out.y[5]], [0.0, 0.0, 0.0, f32::INFINITY], "{:?}", simd.level());
        assert!(near(out.x_bar[0], 1e-3) && out.x_bar[1] == 0.0, "{:?}", out.x_bar);
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(24))]
    /// Back ends agree far below the error of the precision itself; a wrong index or a lost layer is an error of order 1. A ReLU or
    /// a rounding that tips over may move single numbers by 2^-8, so the distance is that of whole vectors.
    #[test]
    fn any_shape_agrees_between_back_ends(
        inputs in 1_usize..40, hidden in prop::collection::vec(1_usize..70, 0..4), outputs in 1_usize..20,
        n in 1_usize..101, seed in 0_u64..1000, skip in 0_usize..5, act in 0_usize..4, out in 0_usize..3,
    ) {
        let skips = if skip >= 1 && skip <= hidden.len() { vec![skip] } else { vec![] };
        let act = [Activation::Relu, Activation::None, Activation::Tanh, Activation::SOFTPLUS][act];
        let mut c = config(inputs, &hidden, outputs, act, &skips);
        c.output_activation = [Activation::None, Activation::LOGISTIC, Activation::Relu][out];
        let mlp = Mlp::new(&c).unwrap().with_precision(Precision::Bf16);
        let (params, x) = (weights(&mlp, seed), noise(seed + 1, inputs * n, 1.0));
        let y_bar = noise(seed + 2, outputs * n, 1.0);
        let want = run(&mlp, Simd::SCALAR, &params, &x, &y_bar, n, &[0]);
        for simd in Simd::available() {
            let got = run(&mlp, simd, &params, &x, &y_bar, n, &[0]);
            let far = distances(&got, &want);
            prop_assert!(far.iter().all(|d| *d <= 5e-3), "{:?} {:?}", simd.level(), far);
        }
    }

    /// Outputs and input gradients are the same bits however a batch is cut; parameter gradients, where it is cut between panels.
    #[test]
    fn cuts_do_not_change_a_bit(n in 1_usize..300, cut in 1_usize..300, panels in 1_usize..4, seed in 0_u64..1000) {
        let base = Mlp::new(&config(6, &[19, 33], 5, Activation::Relu, &[1])).unwrap();
        let (params, x, y_bar) = (weights(&base, seed), noise(seed + 1, 6 * n, 1.0), noise(seed + 2, 5 * n, 1.0));
        for simd in Simd::available() {
            for precision in [Precision::F32, Precision::Bf16] {
                let mlp = base.clone().with_precision(precision);
                let whole = run(&mlp, simd, &params, &x, &y_bar, n, &[0]);
                if cut < n {
                    let parts = run(&mlp, simd, &params, &x, &y_bar, n, &[0, cut]);
                    prop_assert_eq!((&parts.y, &parts.x_bar), (&whole.y, &whole.x_bar));
                }
                if panels * PANEL < n {
                    let parts = run(&mlp, simd, &params, &x, &y_bar, n, &[0, panels * PANEL]);
                    prop_assert_eq!(&parts, &whole);
                }
            }
        }
    }
}
