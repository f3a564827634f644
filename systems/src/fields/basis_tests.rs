//! Linear maps on a learnt basis against their definition in `f64`, and their gradients against its differences.

use super::{ColourDecoder, Columns, Decoder, DensityDecoder, ExplicitConfig, NetworkPrecision};
use field_core::mlp::Packed;
use field_core::rng::Rng;
use float_core::Simd;
use testkit::gradient::{Tolerance, central_difference, compare};
use testkit::reference::network::{Bias, Network};

const FEATURES: usize = 5;
const SEEN: usize = 4 + 2;
const WIDTH: usize = 7;
const ROWS: usize = 1 + FEATURES + SEEN;
/// Rays of some columns each, one of none.
const FIRSTS: [u32; 5] = [0, 3, 3, 4, 9];
const N: usize = 9;

fn uniform(n: usize, stream: u64) -> Vec<f32> {
    let mut out = vec![0.0; n];
    Rng::new(4, stream).fill_uniform(0, &mut out);
    out.iter().map(|u| 2.0 * u - 1.0).collect()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

fn made() -> (DensityDecoder, ColourDecoder) {
    let config = ExplicitConfig { basis_width: WIDTH, basis_layers: 1, sh_degree: 2, ..ExplicitConfig::PAPER };
    Decoder::Explicit(&config).made(FEATURES, 2).unwrap()
}

/// Inputs whose rows behind the features are the same along a ray.
fn inputs() -> Vec<f32> {
    let mut x = uniform(ROWS * N, 1);
    for row in x.chunks_exact_mut(N).skip(1 + FEATURES) {
        FIRSTS.windows(2).for_each(|ray| {
            let (first, last) = (ray[0] as usize, ray[1] as usize);
            (first..last).for_each(|i| row[i] = row[first]);
        });
    }
    x
}

/// `sigmoid(f . b_c)` of every column, `[3][N]`.
fn twin(params: &[f64], x: &[f64]) -> Vec<f64> {
    let network = Network { widths: &[SEEN, WIDTH, 3 * FEATURES], skips: &[], bias: Bias::Omit };
    let mut out = vec![0.0; 3 * N];
    for i in 0..N {
        let column: Vec<f64> = (0..ROWS).map(|k| x[k * N + i]).collect();
        let b = network.forward(params, &column[1 + FEATURES..]);
        for c in 0..3 {
            let raw: f64 = (0..FEATURES).map(|k| column[1 + k] * b[c * FEATURES + k]).sum();
            out[c * N + i] = 1.0 / (1.0 + (-raw).exp());
        }
    }
    out
}

#[test]
fn colours_on_a_basis_are_their_definition_and_so_are_their_gradients() {
    let (_, colour) = made();
    let (params, x, y_bar) = (uniform(colour.mlp().param_count(), 2), inputs(), uniform(3 * N, 3));
    let simd = Simd::best();
    let mut packed = Packed::default();
    colour.mlp().pack(&params, &mut packed);
    assert_eq!(colour.inputs(), ROWS);
    let columns = Columns::Rays(&FIRSTS);
    let mut y = vec![f32::NAN; 3 * N];
    let mut acts = vec![0.0; colour.activations_len(N)];
    colour.forward(simd, &packed, &x, N, columns, &mut y, &mut acts);
    let (params64, x64, y_bar64) = (wide(&params), wide(&x), wide(&y_bar));
    compare("colours", &y, &twin(&params64, &x64), Tolerance::new(1e-5, 1e-6)).unwrap();
    // The same without a way back, along rays and column by column.
    let mut scratch = vec![0.0; colour.infer_scratch_len()];
    for columns in [columns, Columns::Each] {
        let mut other = vec![f32::NAN; 3 * N];
        colour.infer(simd, &packed, &x, N, columns, &mut other, &mut scratch);
        compare("inferred", &other, &wide(&y), Tolerance::new(1e-6, 1e-6)).unwrap();
    }

    let functional =
        |params: &[f64], x: &[f64]| -> f64 { twin(params, x).iter().zip(&y_bar64).map(|(y, bar)| y * bar).sum() };
    let mut x_bar = vec![0.0; ROWS * N];
    let mut grad = vec![0.0; colour.packed_grad_len()];
    let mut scratch = vec![0.0; colour.backward_scratch_len()];
    colour.backward(simd, &packed, &acts, &y_bar, N, columns, Some(&mut x_bar), &mut grad, &mut scratch);
    let mut params_bar = vec![0.0; params.len()];
    colour.mlp().unpack_grad(&grad, &mut params_bar);
    let want = central_difference(&params64, |params| functional(params, &x64));
    compare("network", &params_bar, &want, Tolerance::SINGLE).unwrap();
    let want = central_difference(&x64, |x| functional(&params64, x));
    let features = N..(1 + FEATURES) * N;
    compare("features", &x_bar[features.clone()], &want[features], Tolerance::SINGLE).unwrap();
    assert!(x_bar[..N].iter().all(|bar| *bar == 0.0), "colours do not depend on the density");
    // Of directions and codes: those of a ray, together.
    for k in 1 + FEATURES..ROWS {
        for ray in FIRSTS.windows(2) {
            let span = k * N + ray[0] as usize..k * N + ray[1] as usize;
            let (got, want): (f32, f64) = (x_bar[span.clone()].iter().sum(), want[span].iter().sum());
            assert!((f64::from(got) - want).abs() < 1e-4 * want.abs().max(0.1), "row {k}, ray {ray:?}: {got} {want}");
        }
    }
    // What nobody asks for is left out, and nothing else.
    let mut alone = vec![0.0; grad.len()];
    colour.backward(simd, &packed, &acts, &y_bar, N, columns, None, &mut alone, &mut scratch);
    assert_eq!(alone, grad);
}

#[test]
fn a_linear_density_passes_its_features_on_and_takes_their_gradients_back() {
    let (density, _) = made();
    let simd = Simd::best();
    let (params, x) = (uniform(FEATURES, 5), uniform(FEATURES * N, 6));
    let mut packed = Packed::default();
    density.mlp().pack(&params, &mut packed);
    assert_eq!((density.inputs(), density.outputs()), (FEATURES, 1 + FEATURES));
    // Columns 2 to 6 of the inputs, into an output of its own width.
    let (from, n) = (2, 5);
    let (mut y, mut same) = (vec![f32::NAN; (1 + FEATURES) * n], vec![f32::NAN; (1 + FEATURES) * n]);
    let mut acts = vec![0.0; density.activations_len(n)];
    density.forward(simd, &packed, &x[from..], N, n, &mut y, n, &mut acts);
    density.infer(simd, &packed, &x[from..], N, n, &mut same, n, &mut vec![0.0; density.infer_scratch_len()]);
    assert_eq!(y, same);
    for i in 0..n {
        let raw: f64 = (0..FEATURES).map(|k| f64::from(params[k]) * f64::from(x[k * N + from + i])).sum();
        assert!((f64::from(y[i]) - raw).abs() < 1e-6);
        (0..FEATURES).for_each(|k| assert_eq!(y[(1 + k) * n + i], x[k * N + from + i]));
    }
    let y_bar = uniform((1 + FEATURES) * n, 7);
    let mut x_bar = [0.0; FEATURES * N];
    let mut grad = vec![0.0; density.packed_grad_len()];
    let mut scratch = vec![0.0; density.backward_scratch_len()];
    density.backward(simd, &packed, &acts, &y_bar, n, &mut x_bar[from..], N, &mut grad, &mut scratch);
    let mut params_bar = vec![0.0; FEATURES];
    density.mlp().unpack_grad(&grad, &mut params_bar);
    for k in 0..FEATURES {
        let want: f64 = (0..n).map(|i| f64::from(y_bar[i]) * f64::from(x[k * N + from + i])).sum();
        assert!((f64::from(params_bar[k]) - want).abs() < 1e-5, "{} {want}", params_bar[k]);
        for i in 0..N {
            let want = match (from..from + n).contains(&i) {
                true => params[k] * y_bar[i - from] + y_bar[(1 + k) * n + i - from],
                false => 0.0,
            };
            assert!((x_bar[k * N + i] - want).abs() < 1e-6, "{k} {i}: {} {want}", x_bar[k * N + i]);
        }
    }
}

#[test]
fn networks_of_linear_maps_that_cannot_be_are_refused() {
    for bad in [
        ExplicitConfig { basis_width: 1 << 20, ..ExplicitConfig::PAPER },
        ExplicitConfig { basis_layers: 1 << 10, ..ExplicitConfig::PAPER },
        ExplicitConfig { sh_degree: 5, ..ExplicitConfig::PAPER },
        ExplicitConfig { density_bias: f32::NAN, ..ExplicitConfig::PAPER },
    ] {
        assert!(bad.check().is_err(), "{bad:?}");
    }
    let rounded = ExplicitConfig { precision: NetworkPrecision::Bf16, ..ExplicitConfig::PAPER };
    rounded.check().unwrap();
    let none = ExplicitConfig { basis_width: 0, ..ExplicitConfig::PAPER };
    assert!(Decoder::Explicit(&none).made(FEATURES, 0).is_err());
}
