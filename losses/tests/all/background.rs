//! Background loss: against its definition, gradients, rest, saturation.

use losses::LossError;
use losses::background::{Form, SCALE, background, background_backward};
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair};

fn lengths(d: &[f64]) -> Vec<f64> {
    let n = d.len() / 3;
    (0..n).map(|s| (0..3).map(|r| d[r * n + s] * d[r * n + s]).sum::<f64>().sqrt()).collect()
}

fn twin(d: &[f64], form: Form) -> f64 {
    let one = |length: f64| match form {
        Form::Robust { c } => {
            let z = (length / f64::from(c)).powi(2);
            2.0 * z / (z + 4.0)
        }
        Form::Length => length,
    };
    lengths(d).into_iter().map(one).sum()
}

fn twin_backward(d: &[f64], form: Form, loss_bar: f64, d_bar: &mut [f64]) {
    let lengths = lengths(d);
    let n = lengths.len();
    for (i, bar) in d_bar.iter_mut().enumerate() {
        let length = lengths[i % n];
        *bar += loss_bar
            * match form {
                Form::Robust { c } => {
                    let c = f64::from(c);
                    let z = (length / c).powi(2);
                    16.0 / (z + 4.0).powi(2) / (c * c) * d[i]
                }
                Form::Length => d[i] / length,
            };
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn pair_matches_its_twin(n in 1_usize..9, seed in prop::collection::vec(-1.0_f32..1.0, 27), c in 0.2_f32..3.0, loss_bar in -2.0_f32..2.0) {
        let d: Vec<f32> = seed[..3 * n].iter().map(|x| x + 0.01_f32.copysign(*x)).collect();
        for form in [Form::Robust { c }, Form::Length] {
            check_f32_pair(
                &d, &[loss_bar],
                (
                    |d: &[f32], out: &mut [f32]| out[0] = background(d, form).unwrap() as f32,
                    |d: &[f32], bar: &[f32], d_bar: &mut [f32]| background_backward(d, form, bar[0].into(), d_bar).unwrap(),
                ),
                (
                    |d: &[f64], out: &mut [f64]| out[0] = twin(d, form),
                    |d: &[f64], bar: &[f64], d_bar: &mut [f64]| twin_backward(d, form, bar[0], d_bar),
                ),
                // Lengths down to 0.017: their differences lose two digits to curvature.
                PairTolerances { values: Tolerance::new(1e-6, 1e-7), twin: Tolerance::new(1e-5, 1e-7), gradients: Tolerance::new(1e-6, 1e-7) },
            ).unwrap();
        }
    }

    #[test]
    fn every_displacement_costs_a_finite_number(d in prop::array::uniform3(prop::sample::select(vec![0.0_f32, -0.0, 1e-45, 1e-20, 1e-3, 1.0, 1e20, f32::MAX, f32::MIN]))) {
        for form in [Form::NERFIES, Form::Length] {
            let loss = background(&d, form).unwrap();
            let mut bar = [0.0; 3];
            background_backward(&d, form, 1.0, &mut bar).unwrap();
            prop_assert!(loss.is_finite() && loss >= 0.0 && bar.iter().all(|b| b.is_finite()), "{d:?}: {loss} {bar:?}");
            if form == Form::NERFIES {
                prop_assert!(loss <= 2.0);
            }
        }
    }
}

#[test]
fn rest_costs_nothing_and_pulls_nowhere() {
    for form in [Form::NERFIES, Form::Length] {
        let mut bar = [0.0; 6];
        assert_eq!(background(&[0.0; 6], form).unwrap(), 0.0);
        background_backward(&[0.0; 6], form, 1.0, &mut bar).unwrap();
        assert_eq!(bar, [0.0; 6]);
    }
}

#[test]
fn the_released_form_has_its_scale_and_saturates_at_two() {
    // At |d| = 2 c: z = 4, half of the most.
    let at = |x: f32| background(&[x, 0.0, 0.0], Form::NERFIES).unwrap();
    assert!((at(2.0 * SCALE) - 1.0).abs() < 1e-6);
    assert!((at(1e3 * SCALE) - 2.0).abs() < 1e-5);
    // Near rest half the squared ratio.
    assert!((at(1e-3 * SCALE) / 5e-7 - 1.0).abs() < 1e-5);
}

#[test]
fn no_points_and_wrong_shapes() {
    assert_eq!(background(&[], Form::NERFIES).unwrap(), 0.0);
    let shape = |what, want, got| LossError::Shape { what, want, got };
    assert_eq!(background(&[0.0; 4], Form::NERFIES), Err(shape("d", 6, 4)));
    assert_eq!(background_backward(&[0.0; 3], Form::NERFIES, 1.0, &mut [0.0; 2]), Err(shape("d_bar", 3, 2)));
    for c in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(matches!(background(&[0.0; 3], Form::Robust { c }), Err(LossError::Parameter { .. })));
    }
}
