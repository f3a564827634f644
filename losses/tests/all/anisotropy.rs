//! Anisotropy: against its definition, its gradient, sizes at the edge, nothing at all.

use losses::LossError;
use losses::anisotropy::{anisotropy, anisotropy_backward};
use proptest::prelude::*;
use testkit::gradient::central_difference;

fn twin(log_scales: &[f64], free: f64) -> f64 {
    let n = log_scales.len() / 3;
    let ratio = |i: usize| {
        let sizes = [0, 1, 2].map(|r| log_scales[r * n + i].exp());
        sizes.into_iter().fold(0.0, f64::max) / sizes.into_iter().fold(f64::INFINITY, f64::min)
    };
    (0..n).map(|i| ratio(i).max(free) - free).sum::<f64>() / n as f64
}

proptest! {
    #![proptest_config(testkit::property::cases(96))]

    #[test]
    fn it_is_its_definition(
        log_scales in (1_usize..9).prop_flat_map(|n| prop::collection::vec(-3.0_f32..3.0, 3 * n)),
        free in 1.0_f64..6.0, loss_bar in -2.0_f64..2.0,
    ) {
        let n = log_scales.len() / 3;
        let wide: Vec<f64> = log_scales.iter().map(|&x| f64::from(x)).collect();
        let (want, got) = (twin(&wide, free), anisotropy(&log_scales, free).unwrap());
        prop_assert!((got - want).abs() <= 1e-12 * (1.0 + want.abs()), "{got} {want}");
        // Corners have no derivative: where two sizes are the same, and where a ratio begins to cost something.
        let corner = (0..n).any(|i| {
            let [a, b, c] = [0, 1, 2].map(|r| wide[r * n + i]);
            let most = a.max(b).max(c) - a.min(b).min(c);
            [a - b, b - c, c - a, most - free.ln()].into_iter().any(|gap| gap.abs() < 1e-3)
        });
        let mut bar = vec![0.5; 3 * n];
        prop_assert_eq!(anisotropy_backward(&log_scales, free, loss_bar, &mut bar).unwrap(), got);
        if !corner {
            let want = central_difference(&wide, |x| loss_bar * twin(x, free));
            for (bar, want) in bar.iter().zip(want) {
                prop_assert!((f64::from(*bar) - 0.5 - want).abs() < 1e-4 * (1.0 + want.abs()), "{bar} {want}");
            }
        }
    }
}

#[test]
fn sizes_at_the_edge_and_nothing_at_all() {
    assert_eq!(anisotropy(&[], 5.0), Ok(0.0));
    // Round Gaussians cost nothing, however large.
    for x in [-80.0, 0.0, 80.0] {
        let mut bar = [0.0; 3];
        assert_eq!(anisotropy_backward(&[x; 3], 1.0, 1.0, &mut bar), Ok(0.0));
        assert_eq!(bar, [0.0; 3]);
    }
    // Needles: the gradient is finite, and makes the longest size smaller.
    let mut bar = [0.0; 3];
    assert!(anisotropy_backward(&[300.0, 0.0, -300.0], 5.0, 1.0, &mut bar).unwrap() > 1e200);
    assert_eq!(bar, [1e30, 0.0, -1e30]);
    assert!(anisotropy(&[f32::NAN, 0.0, 0.0], 5.0).unwrap().is_nan());
    assert!(anisotropy(&[0.0, 0.0, f32::NEG_INFINITY], 5.0).unwrap().is_infinite());
}

#[test]
fn what_cannot_be_is_refused() {
    assert_eq!(anisotropy(&[0.0; 4], 5.0), Err(LossError::Shape { what: "log_scales", want: 3, got: 4 }));
    for free in [0.9, f64::NAN, f64::INFINITY] {
        assert!(matches!(anisotropy(&[0.0; 3], free), Err(LossError::Parameter { what: "free", .. })), "{free}");
    }
    let short = anisotropy_backward(&[0.0; 3], 5.0, 1.0, &mut [0.0; 2]);
    assert_eq!(short, Err(LossError::Shape { what: "log_scales_bar", want: 3, got: 2 }));
}
