//! Batches of rays: against a plain loop, gradients, weights, edges.

use losses::{LossError, kernel::Kernel, photometric};
use proptest::{collection::vec, prelude::*};

const SMOOTH: [Kernel; 4] =
    [Kernel::Squared, Kernel::Charbonnier { c: 0.1 }, Kernel::Huber { delta: 3.0 }, Kernel::LogSquared { eps: 0.1 }];

#[derive(Clone, Debug)]
struct Batch {
    prediction: Vec<[f32; 3]>,
    target: Vec<[f32; 3]>,
    w: Vec<f32>,
}

fn any_batch() -> impl Strategy<Value = Batch> {
    let colour = || prop::array::uniform3(prop_oneof![8 => 0.0_f32..1.0, 1 => Just(0.0), 1 => Just(1.0)]);
    vec((colour(), colour(), prop_oneof![4 => 0.0_f32..2.0, 1 => Just(0.0), 1 => Just(1.0)]), 0..40).prop_map(|rays| {
        Batch {
            prediction: rays.iter().map(|r| r.0).collect(),
            target: rays.iter().map(|r| r.1).collect(),
            w: rays.iter().map(|r| r.2).collect(),
        }
    })
}

/// The definition, with predictions in `f64`.
fn naive_mean(kernel: Kernel, prediction: &[[f64; 3]], batch: &Batch) -> f64 {
    let value = |p: f64, t: f32| {
        let x = p - f64::from(t);
        match kernel {
            Kernel::Squared => x * x,
            Kernel::Charbonnier { c } => x.hypot(c.into()),
            Kernel::Huber { delta } => {
                let d = f64::from(delta);
                if x.abs() <= d { x * x / 2.0 } else { d * (x.abs() - d / 2.0) }
            }
            Kernel::LogSquared { eps } => ((p + f64::from(eps)) / (f64::from(t) + f64::from(eps))).ln().powi(2),
            other => panic!("no definition of {other:?}"),
        }
    };
    let mut total = 0.0;
    for (i, p) in prediction.iter().enumerate() {
        let ray: f64 = (0..3).map(|c| value(p[c], batch.target[i][c])).sum();
        total += f64::from(batch.w[i]) * ray / 3.0;
    }
    if prediction.is_empty() { 0.0 } else { total / prediction.len() as f64 }
}

fn wide(x: &[[f32; 3]]) -> Vec<[f64; 3]> {
    x.iter().map(|x| x.map(f64::from)).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn mean_matches_naive(batch in any_batch()) {
        for kernel in SMOOTH {
            let got = photometric::mean(kernel, &batch.prediction, &batch.target, Some(&batch.w)).unwrap();
            let want = naive_mean(kernel, &wide(&batch.prediction), &batch);
            prop_assert!((got - want).abs() <= 1e-9 + 1e-6 * want, "{kernel:?}: {got}, {want}");
        }
    }

    #[test]
    fn mean_backward_matches_central_difference(batch in any_batch(), loss_bar in -2.0_f64..2.0) {
        for kernel in SMOOTH {
            let mut bar = vec![[0.25_f32; 3]; batch.prediction.len()];
            photometric::mean_backward(
                kernel, &batch.prediction, &batch.target, Some(&batch.w), loss_bar, &mut bar).unwrap();
            for i in 0..bar.len() {
                for c in 0..3 {
                    let at = |h: f64| {
                        let mut p = wide(&batch.prediction);
                        p[i][c] += h;
                        naive_mean(kernel, &p, &batch)
                    };
                    let want = 0.25 + loss_bar * (at(1e-6) - at(-1e-6)) / 2e-6;
                    let got = f64::from(bar[i][c]);
                    prop_assert!((got - want).abs() <= 1e-6 + 1e-4 * want.abs(), "{kernel:?} [{i}][{c}]: {got}, {want}");
                }
            }
        }
    }

    #[test]
    fn tiles_add_up_to_the_batch(batch in any_batch(), cut in 0.0_f64..1.0) {
        let n = batch.prediction.len();
        let cut = (cut * n as f64) as usize;
        let (kernel, share) = (Kernel::HuberNgp, 1.0 / n.max(1) as f64);
        let (mut whole, mut tiled) = (vec![[0.0_f32; 3]; n], vec![[0.0_f32; 3]; n]);
        photometric::mean_backward(kernel, &batch.prediction, &batch.target, Some(&batch.w), 1.0, &mut whole).unwrap();
        let mut sum = 0.0;
        for tile in [0..cut, cut..n] {
            let (p, t, w) = (&batch.prediction[tile.clone()], &batch.target[tile.clone()], Some(&batch.w[tile.clone()]));
            sum += photometric::sum(kernel, p, t, w).unwrap();
            photometric::sum_backward(kernel, p, t, w, share, &mut tiled[tile]).unwrap();
        }
        prop_assert_eq!(whole, tiled);
        let mean = photometric::mean(kernel, &batch.prediction, &batch.target, Some(&batch.w)).unwrap();
        prop_assert!((mean - sum * share).abs() <= 1e-15);
    }

    #[test]
    fn per_ray_is_the_mean_of_single_rays(batch in any_batch()) {
        let n = batch.prediction.len();
        let mut loss = vec![f32::NAN; n];
        photometric::per_ray(Kernel::Squared, &batch.prediction, &batch.target, &mut loss).unwrap();
        for (i, &loss) in loss.iter().enumerate() {
            let one = photometric::mean(Kernel::Squared, &batch.prediction[i..=i], &batch.target[i..=i], None).unwrap();
            prop_assert_eq!(loss, one as f32);
        }
        // Its backward pass with weights as cotangents is that of the weighted sum.
        let (mut a, mut b) = (vec![[0.0_f32; 3]; n], vec![[0.0_f32; 3]; n]);
        photometric::per_ray_backward(Kernel::Squared, &batch.prediction, &batch.target, &batch.w, &mut a).unwrap();
        photometric::sum_backward(Kernel::Squared, &batch.prediction, &batch.target, Some(&batch.w), 1.0, &mut b).unwrap();
        prop_assert_eq!(a, b);
    }
}

#[test]
fn a_ray_of_weight_zero_is_left_out_and_the_others_stay() {
    let (p, t) = ([[1.0, 0.5, 0.0], [0.3; 3]], [[0.0; 3], [0.6; 3]]);
    let both = photometric::mean(Kernel::L1, &p, &t, None).unwrap();
    let one = photometric::mean(Kernel::L1, &p, &t, Some(&[1.0, 0.0])).unwrap();
    assert!((both - (0.5 + 0.3) / 2.0).abs() < 1e-7);
    assert!((one - 0.25).abs() < 1e-7, "divided by the rays, not by the weights");
    let mut bar = [[0.0; 3]; 2];
    photometric::mean_backward(Kernel::L1, &p, &t, Some(&[1.0, 0.0]), 1.0, &mut bar).unwrap();
    assert_eq!(bar[1], [0.0; 3]);
    assert!((bar[0][0] - 1.0 / 6.0).abs() < 1e-7);
    assert_eq!(bar[0][2], 0.0);
}

#[test]
fn no_rays_cost_nothing() {
    assert_eq!(photometric::mean(Kernel::Squared, &[], &[], None), Ok(0.0));
    assert_eq!(photometric::sum(Kernel::L1, &[], &[], Some(&[])), Ok(0.0));
    assert_eq!(photometric::mean_backward(Kernel::Squared, &[], &[], None, 1.0, &mut []), Ok(()));
    assert_eq!(photometric::per_ray(Kernel::Squared, &[], &[], &mut []), Ok(()));
}

#[test]
fn lengths_and_parameters_are_checked() {
    let rays = [[0.0; 3]; 3];
    let shape = |what, got| Err(LossError::Shape { what, want: 3, got });
    assert_eq!(photometric::mean(Kernel::L1, &rays, &rays[..2], None), shape("target", 2).map(|()| 0.0));
    assert_eq!(photometric::sum(Kernel::L1, &rays, &rays, Some(&[1.0])), shape("w", 1).map(|()| 0.0));
    let mut short = [[0.0; 3]; 1];
    assert_eq!(photometric::mean_backward(Kernel::L1, &rays, &rays, None, 1.0, &mut short), shape("prediction_bar", 1));
    assert_eq!(photometric::per_ray(Kernel::L1, &rays, &rays, &mut []), shape("loss", 0));
    let bad = photometric::mean(Kernel::Huber { delta: 0.0 }, &rays, &rays, None);
    assert!(matches!(bad, Err(LossError::Parameter { .. })));
    assert_eq!(
        photometric::mean(Kernel::L1, &rays, &rays[..2], None).unwrap_err().to_string(),
        "`target` holds 2 values, expected 3"
    );
}

#[test]
fn nan_stays_visible() {
    let (p, t) = ([[f32::NAN, 0.5, 0.5], [0.5; 3]], [[0.5; 3]; 2]);
    assert!(photometric::mean(Kernel::HuberNgp, &p, &t, None).unwrap().is_nan());
    let mut bar = [[0.0; 3]; 2];
    photometric::mean_backward(Kernel::HuberNgp, &p, &t, None, 1.0, &mut bar).unwrap();
    assert!(bar[0][0].is_nan() && bar[0][1] == 0.0 && bar[1] == [0.0; 3]);
}
