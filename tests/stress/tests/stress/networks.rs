//! Networks with inputs and weights at the ends of the numbers.

use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
use float_core::Simd;
use stress::{MAGNITUDES, Tally, close, ensure, finite};

const N: usize = 50; // a panel and two samples

fn mlp(output: Activation) -> Mlp {
    Mlp::new(&MlpConfig::new(3, vec![17, 16], 2).with_output_activation(output)).unwrap()
}

/// Outputs, input gradient and weight gradient.
fn run(simd: Simd, mlp: &Mlp, params: &[f32], x: &[f32], bar: f32) -> [Vec<f32>; 3] {
    let mut packed = Packed::default();
    mlp.pack(params, &mut packed);
    let (mut y, mut acts) = (vec![f32::NAN; 2 * N], vec![0.0; mlp.activations_len(N)]);
    mlp.forward(simd, &packed, x, N, N, &mut y, N, &mut acts);
    let (mut x_bar, mut grad) = (vec![0.0; 3 * N], vec![0.0; mlp.packed_grad_len()]);
    let (bars, mut scratch) = (vec![bar; 2 * N], vec![0.0; mlp.backward_scratch_len()]);
    mlp.backward(simd, &packed, &acts, &bars, N, N, Some((&mut x_bar, N)), &mut grad, &mut scratch);
    let mut params_bar = vec![0.0; mlp.param_count()];
    mlp.unpack_grad(&grad, &mut params_bar);
    [y, x_bar, params_bar]
}

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    let outputs = [Activation::LOGISTIC, Activation::TruncExp, Activation::SOFTPLUS, Activation::Tanh];
    for output in outputs {
        let mlp = mlp(output);
        for x in MAGNITUDES.iter().flat_map(|&m| [m, -m]) {
            for weight in [1e-38, 1e-10, 0.1, 1e5] {
                let name = format!("{output:?} of x = {x:e}, weights {weight:e}");
                tally.case(name, "finite while the sums fit an f32; saturated outputs else", || {
                    let params: Vec<f32> = (0..mlp.param_count()).map(|i| (i as f32 * 2.3).sin() * weight).collect();
                    let [y, x_bar, params_bar] = run(simd, &mlp, &params, &[x; 3 * N], 1.0);
                    // Three products and their sums, with room.
                    let largest = f64::from(x.abs()) * (20.0 * f64::from(weight)).powi(3).max(20.0 * f64::from(weight));
                    if largest < 1e37 {
                        finite("y", &y)?;
                        if largest < 1e20 {
                            finite("x_bar", &x_bar)?;
                            finite("params_bar", &params_bar)?;
                        }
                        if output == Activation::LOGISTIC {
                            ensure(y.iter().all(|y| (0.0..=1.0).contains(y)), || format!("{:?}", &y[..2]))?;
                        }
                    }
                    // Past that: infinite or NaN, which the optimiser counts, or a saturated number.
                    Ok(())
                });
            }
        }
        for bad in [f32::NAN, f32::INFINITY] {
            tally.case(
                format!("{output:?}, one sample with {bad}"),
                "the others are as without it, its own not right-looking",
                || {
                    let params: Vec<f32> = (0..mlp.param_count()).map(|i| (i as f32 * 2.3).sin() * 0.3).collect();
                    let mut x: Vec<f32> = (0..3 * N).map(|i| (i as f32).cos()).collect();
                    let [clean, clean_bar, _] = run(simd, &mlp, &params, &x, 1.0);
                    x[7] = bad;
                    let [y, x_bar, params_bar] = run(simd, &mlp, &params, &x, 1.0);
                    let differ = (0..2 * N).find(|i| i % N != 7 && clean[*i].to_bits() != y[*i].to_bits());
                    ensure(differ.is_none(), || format!("output {differ:?} changed"))?;
                    let differ = (0..3 * N).find(|i| i % N != 7 && clean_bar[*i].to_bits() != x_bar[*i].to_bits());
                    ensure(differ.is_none(), || format!("input gradient {differ:?} changed"))?;
                    // The first layer's gradient holds the input itself: the optimiser must see it.
                    ensure(params_bar.iter().any(|g| !g.is_finite()), || "the gradient hides it".into())
                },
            );
        }
    }
    for bar in MAGNITUDES {
        tally.case(
            format!("gradient {bar:e}"),
            "gradients scale with it, to 1e-5 while they are normal numbers",
            || {
                let mlp = mlp(Activation::None);
                let params: Vec<f32> = (0..mlp.param_count()).map(|i| (i as f32 * 2.3).sin() * 0.3).collect();
                let x: Vec<f32> = (0..3 * N).map(|i| (i as f32).cos()).collect();
                let [_, _, one] = run(simd, &mlp, &params, &x, 1.0);
                let [_, _, scaled] = run(simd, &mlp, &params, &x, bar);
                if (1e-30..1e30).contains(&bar) {
                    let largest = one.iter().fold(0.0, |m: f32, g| m.max(g.abs()));
                    for (a, b) in one.iter().zip(&scaled) {
                        let (want, unit) = (f64::from(*a) * f64::from(bar), f64::from(largest) * f64::from(bar));
                        close("gradient", (*b).into(), want, 1e-5 * unit)?;
                    }
                }
                if bar < 1e30 { finite("gradient", &scaled) } else { Ok(()) }
            },
        );
    }
}
