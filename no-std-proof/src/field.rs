//! Proofs of `field-core`.

use crate::wrong::{Wrong, near};
use alloc::{vec, vec::Vec};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::{Growth, HashGrid, HashGridConfig, Touched};
use field_core::init::Init;
use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use field_core::tape::{Arena, Tape, TapeError};
use float_core::{Simd, m64};

/// `sin x`, `cos x`, and the slope of their sum.
pub(crate) fn frequency() -> Result<(), Wrong> {
    let encoding = Frequency::new(1, 1, Base::One, Identity::Omit).map_err(|_| refused("encoding"))?;
    let (x, mut out, mut x_bar) = ([0.5_f32], [0.0_f32; 2], [0.0_f32]);
    encoding.encode(Simd::best(), &x, None, &mut out).map_err(|_| refused("encode"))?;
    encoding.encode_backward(Simd::best(), &x, None, &[1.0, 1.0], &mut x_bar).map_err(|_| refused("backward"))?;
    let (sin, cos) = (m64::sin(0.5), m64::cos(0.5));
    near("sin 0.5", out[0], sin, 1e-6)?;
    near("cos 0.5", out[1], cos, 1e-6)?;
    near("d(sin + cos)", x_bar[0], cos - sin, 1e-6)
}

/// Features are linear in the table: `<features, bar> = <table, gradient of the table>`.
pub(crate) fn hash_grid() -> Result<(), Wrong> {
    const SAMPLES: usize = 40;
    let config = HashGridConfig::default().with_levels(4).with_log2_table(9).with_growth(Growth::UpTo(64));
    let grid = HashGrid::new(config).map_err(|_| refused("grid"))?;
    let table = uniform(1, grid.params_len());
    let x: Vec<f32> = uniform(2, 3 * SAMPLES).iter().map(|x| 0.5 + 0.5 * x).collect();
    let bar = uniform(3, grid.out_rows() * SAMPLES);
    let (mut out, mut grad) = (vec![0.0; bar.len()], vec![0.0; table.len()]);
    let mut touched = Touched::new(&grid);
    grid.encode(Simd::best(), &table, &x, &mut out).map_err(|_| refused("encode"))?;
    grid.encode_backward(Simd::best(), &x, &bar, &mut grad, Some(&mut touched)).map_err(|_| refused("backward"))?;
    let forward = dot(&out, &bar);
    if forward.abs() < 1e-3 || touched.count() == 0 {
        return Err(Wrong { what: "the product of features and gradient", got: forward, want: 1.0 });
    }
    near("the product of table and gradient", dot(&table, &grad), forward, 1e-5)
}

/// The slope of a network's output along a direction, against a difference.
pub(crate) fn network() -> Result<(), Wrong> {
    const STEP: f32 = 1.0 / 128.0;
    let config = MlpConfig::new(3, vec![16, 16], 1)
        .with_hidden_activation(Activation::SOFTPLUS)
        .with_output_activation(Activation::LOGISTIC)
        .with_skips(vec![2]);
    let mlp = Mlp::new(&config).map_err(|_| refused("network"))?;
    let mut params = vec![0.0; mlp.param_count()];
    Init::HeUniform.fill(Rng::new(7, 0), 16, 16, &mut params);
    let mut packed = Packed::default();
    mlp.pack(&params, &mut packed);

    let mut scratch = vec![0.0; mlp.infer_scratch_len()];
    let mut value = |x: [f32; 3]| {
        let mut y = [0.0];
        mlp.infer(Simd::best(), &packed, &x, 1, 1, &mut y, 1, &mut scratch);
        f64::from(y[0])
    };
    let difference = (value([0.3 + STEP, -0.2, 0.9]) - value([0.3 - STEP, -0.2, 0.9])) / f64::from(2.0 * STEP);

    let (x, mut y, mut x_bar) = ([0.3, -0.2, 0.9], [0.0], [0.0; 3]);
    let (mut acts, mut grad) = (vec![0.0; mlp.activations_len(1)], vec![0.0; mlp.packed_grad_len()]);
    let mut scratch = vec![0.0; mlp.backward_scratch_len()];
    mlp.forward(Simd::best(), &packed, &x, 1, 1, &mut y, 1, &mut acts);
    mlp.backward(Simd::best(), &packed, &acts, &[1.0], 1, 1, Some((&mut x_bar, 1)), &mut grad, &mut scratch);
    if difference.abs() < 1e-3 {
        return Err(Wrong { what: "the network's slope", got: difference, want: 1.0 });
    }
    // The difference is off by the square of the step and by rounding, 6e-8 / STEP.
    near("the network's slope", x_bar[0], difference, 1e-4)
}

/// `sigma = softplus(x²)`: its derivative, and the derivative of that, by reverse mode through a tangent.
pub(crate) fn tape() -> Result<(), Wrong> {
    let x = 0.8_f64;
    let logistic = 1.0 / (1.0 + m64::exp(-x * x));
    let first = 2.0 * x * logistic;
    let second = 2.0 * logistic + 4.0 * x * x * logistic * (1.0 - logistic);
    let (got_first, got_second) = slopes(x as f32).map_err(|_| refused("tape"))?;
    near("first derivative", got_first, first, 1e-5)?;
    near("second derivative", got_second, second, 1e-5)
}

fn slopes(at: f32) -> Result<(f32, f32), TapeError> {
    let mut arena = Arena::new();
    let mut tape = Tape::new(&mut arena, &[]);
    let x = tape.input(1, 1, &[at])?;
    let square = tape.dot(x, x)?;
    let sigma = tape.softplus(square, 0.0)?;
    let normal = tape.jacobian(sigma, x)?;
    let first = tape.value(normal)?.data[0];
    tape.backward_from(normal, &mut [])?;
    Ok((first, tape.gradient(x)?[0]))
}

/// Numbers in `[-1, 1)`.
fn uniform(stream: u64, len: usize) -> Vec<f32> {
    let mut out = vec![0.0; len];
    Init::Uniform(1.0).fill(Rng::new(7, stream), 1, 1, &mut out);
    out
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}

fn refused(what: &'static str) -> Wrong {
    Wrong { what, got: f64::NAN, want: 0.0 }
}
