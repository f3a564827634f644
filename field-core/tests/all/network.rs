//! The network that owns its buffers against the functions on slices, bit for bit.

use field_core::FieldError;
use field_core::init::Init;
use field_core::mlp::{Activation, Bias, Mlp, MlpConfig, Network, Packed, Precision};
use field_core::rng::Rng;
use float_core::Simd;
use proptest::prelude::*;

fn noise(stream: u64, n: usize) -> Vec<f32> {
    let mut x = vec![0.0; n];
    Rng::new(11, stream).fill_normal(0, &mut x);
    x
}

/// Values, gradient of the inputs, gradient of the parameters, by the functions on slices.
fn raw(mlp: &Mlp, simd: Simd, params: &[f32], x: &[f32], y_bar: &[f32]) -> [Vec<f32>; 3] {
    let n = x.len() / mlp.inputs();
    let mut packed = Packed::default();
    mlp.pack(params, &mut packed);
    let (mut y, mut acts) = (vec![0.0; n * mlp.outputs()], vec![0.0; mlp.activations_len(n)]);
    mlp.forward(simd, &packed, x, n, n, &mut y, n, &mut acts);
    let (mut x_bar, mut grad) = (vec![0.0; x.len()], vec![0.0; mlp.packed_grad_len()]);
    let mut scratch = vec![0.0; mlp.backward_scratch_len()];
    mlp.backward(simd, &packed, &acts, y_bar, n, n, Some((&mut x_bar, n)), &mut grad, &mut scratch);
    let mut params_bar = vec![0.0; mlp.param_count()];
    mlp.unpack_grad(&grad, &mut params_bar);
    [y, x_bar, params_bar]
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]
    #[test]
    fn gives_the_bits_of_the_functions_on_slices(
        inputs in 1..9_usize, hidden in prop::collection::vec(1..40_usize, 0..3), outputs in 1..5_usize,
        first in 0..70_usize, second in 0..70_usize, seed in any::<u64>(), bf16 in any::<bool>(), skip in any::<bool>(),
    ) {
        let skips = if skip && !hidden.is_empty() { vec![1] } else { vec![] };
        let config = MlpConfig::new(inputs, hidden, outputs)
            .with_hidden_activation(Activation::SOFTPLUS)
            .with_output_activation(Activation::LOGISTIC)
            .with_skips(skips);
        let precision = if bf16 { Precision::Bf16 } else { Precision::F32 };
        let mlp = Mlp::new(&config).unwrap().with_precision(precision);
        for simd in Simd::available() {
            let mut network = Network::with_init(mlp.clone(), Init::HeUniform, seed).with_simd(simd);
            // The same network again, with other batches and other parameters: buffers that were used.
            for (round, n) in (0..).zip([first, second, first]) {
                let (x, y_bar) = (noise(round, inputs * n), noise(round + 9, outputs * n));
                let [want, want_x, want_params] = raw(&mlp, simd, network.parameters(), &x, &y_bar);
                let (mut y, mut x_bar) = (vec![f32::NAN; outputs * n], vec![0.0; inputs * n]);
                network.forward(&x, &mut y).unwrap();
                prop_assert_eq!(&y, &want);
                // In between does no harm.
                network.infer(&x, &mut y).unwrap();
                prop_assert_eq!(&y, &want);
                network.clear_gradient();
                network.backward(&y_bar, Some(&mut x_bar)).unwrap();
                prop_assert_eq!(network.gradient(), &want_params[..]);
                prop_assert_eq!(&x_bar, &want_x);
                // Added to; without the inputs' gradient the same.
                network.backward(&y_bar, None).unwrap();
                let twice: Vec<f32> = want_params.iter().map(|g| g + g).collect();
                prop_assert_eq!(network.gradient(), &twice[..]);
                let (parameters, gradient) = network.parameters_and_gradient();
                parameters.iter_mut().zip(gradient).for_each(|(p, g)| *p -= 0.01 * g);
            }
        }
    }
}

#[test]
fn seeds_and_checkpoints_give_the_same_network() {
    let config = MlpConfig::new(3, vec![16, 8], 2);
    let network = Network::new(&config, 5).unwrap();
    assert_eq!(network.parameters(), Network::new(&config, 5).unwrap().parameters());
    assert_ne!(network.parameters(), Network::new(&config, 6).unwrap().parameters());
    for layer in network.mlp().layers() {
        let bound = (6.0 / layer.inputs as f32).sqrt();
        let weights = &network.parameters()[layer.weights.clone()];
        assert!(weights.iter().all(|w| w.abs() <= bound) && weights.iter().any(|w| w.abs() > 0.5 * bound));
        assert!(network.parameters()[layer.biases.clone()].iter().all(|b| *b == 0.0));
    }
    let mut other = Network::from_parameters(network.mlp().clone(), network.parameters().to_vec()).unwrap();
    let mut network = network;
    let (x, mut a, mut b) = (noise(1, 3 * 7), vec![0.0; 14], vec![0.0; 14]);
    network.infer(&x, &mut a).unwrap();
    other.infer(&x, &mut b).unwrap();
    assert_eq!(a, b);
    // Changed parameters count, however they are changed.
    other.set_parameters(&vec![0.0; network.parameters().len()]).unwrap();
    other.infer(&x, &mut b).unwrap();
    assert!(b.iter().all(|b| *b == 0.0));
    other.parameters_mut().copy_from_slice(network.parameters());
    other.infer(&x, &mut b).unwrap();
    assert_eq!(a, b);
}

#[test]
fn wrong_lengths_are_named_and_change_nothing() {
    let config = MlpConfig::new(2, vec![4], 3).with_bias(Bias::None);
    let mut network = Network::new(&config, 1).unwrap();
    let shape = |what, want, got| Err(FieldError::Shape { what, want, got });
    assert_eq!(network.forward(&[0.0; 5], &mut [0.0; 6]), shape("x", 4, 5));
    assert_eq!(network.infer(&[0.0; 4], &mut [0.0; 5]), shape("y", 6, 5));
    // No batch yet.
    assert_eq!(network.backward(&[0.0; 3], None), shape("y_bar", 0, 3));
    assert_eq!(network.backward(&[], None), Ok(()));
    network.forward(&[1.0; 4], &mut [0.0; 6]).unwrap();
    assert_eq!(network.backward(&[0.0; 3], None), shape("y_bar", 6, 3));
    assert_eq!(network.backward(&[1.0; 6], Some(&mut [0.0; 3])), shape("x_bar", 4, 3));
    assert!(network.gradient().iter().all(|g| *g == 0.0));
    // The activations belong to other parameters.
    network.parameters_mut()[0] += 1.0;
    assert_eq!(network.backward(&[1.0; 6], None), shape("y_bar", 0, 6));
    assert_eq!(network.set_parameters(&[0.0]), shape("parameters", 20, 1));
    assert_eq!(Network::from_parameters(network.mlp().clone(), vec![]).map(|_| ()), shape("parameters", 20, 0));
    assert_eq!(network.forward(&[], &mut []), Ok(()));
    assert_eq!(network.backward(&[], Some(&mut [])), Ok(()));
}
