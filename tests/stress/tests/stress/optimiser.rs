//! Gradients that no training should have: NaN, infinity, the ends of the numbers; and 10^5 steps of them.

use float_core::Simd;
use optim::clip::{clip_by_global_norm, clip_by_value, sanitise};
use optim::{Adam, AdamConfig, Decay, Ema, NonFiniteGuard};
use stress::{MAGNITUDES, Tally, close, ensure, finite};

const CONFIGS: [(&str, AdamConfig); 4] = [
    ("default", AdamConfig::DEFAULT),
    ("nerf", AdamConfig::NERF),
    ("ngp", AdamConfig::NGP),
    ("decay", AdamConfig::NGP.with_decay(Decay::L2(1e-6))),
];

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    gradients(tally, simd);
    learning_rates(tally, simd);
    clipping(tally, simd);
    guard(tally);
}

fn gradients(tally: &mut Tally, simd: Simd) {
    for (name, config) in CONFIGS {
        for g in MAGNITUDES.iter().flat_map(|&m| [m, -m]) {
            tally.case(
                format!("Adam {name}, gradient {g:e}, 50 times"),
                "steps of at most lr each, and finite",
                || {
                    let (mut adam, mut p) = (Adam::new(33, config), vec![0.25_f32; 33]);
                    for step in 0..50 {
                        let before = p[7];
                        let bad = adam.step(simd, 0.01, &mut p, &[g; 33]);
                        ensure(bad == 0, || format!("{bad} finite gradients were called non-finite"))?;
                        // With equal gradients |m| = sqrt(v), so the step is lr, less where eps or the decay count.
                        ensure((p[7] - before).abs() <= 0.0101, || format!("step {step} went {:e}", p[7] - before))?;
                    }
                    finite("p", &p)?;
                    finite("m", adam.first_moment())?;
                    finite("v", adam.second_moment())
                },
            );
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            tally.case(format!("Adam {name}, gradient {bad}"), "entry and moments left alone, and counted", || {
                let (mut adam, mut p) = (Adam::new(33, config), vec![0.25_f32; 33]);
                let mut grad = vec![1.0; 33];
                let _ = adam.step(simd, 0.01, &mut p, &grad);
                let kept = (p[20], adam.first_moment()[20], adam.second_moment()[20]);
                grad[20] = bad;
                let mut touched = vec![u64::MAX; optim::touched_len(33)];
                let counts = [
                    adam.step(simd, 0.01, &mut p, &grad),
                    adam.step_nonzero(simd, 0.01, &mut p, &grad),
                    adam.step_touched(simd, 0.01, &mut p, &mut grad, &mut touched),
                ];
                ensure(counts == [1; 3], || format!("counted {counts:?}"))?;
                let now = (p[20], adam.first_moment()[20], adam.second_moment()[20]);
                ensure(now == kept, || format!("{kept:?} became {now:?}"))?;
                ensure(grad[20] == 0.0, || "the taken gradient keeps it for the next step".into())
            });
        }
        tally.case(format!("Adam {name}, 10^5 wild steps"), "no parameter and no moment is ever non-finite", || {
            let (mut adam, mut p, mut grad) = (Adam::new(16, config), vec![0.1_f32; 16], vec![0.0_f32; 16]);
            let mut bits = 1_u32;
            for step in 0..100_000 {
                for g in &mut grad {
                    // All bit patterns, NaN and infinities among them.
                    bits = bits.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    *g = f32::from_bits(bits);
                }
                let _ = adam.step(simd, 10.0, &mut p, &grad);
                if step % 1000 == 999 {
                    finite("p", &p)?;
                    finite("m", adam.first_moment())?;
                    finite("v", adam.second_moment())?;
                }
            }
            Ok(())
        });
    }
}

fn learning_rates(tally: &mut Tally, simd: Simd) {
    for lr in [0.0, 1e-45, 1e4, 1e30, 1e38, 1e300] {
        for (name, config) in CONFIGS {
            tally.case(format!("Adam {name}, learning rate {lr:e}"), "no parameter is ever non-finite", || {
                let (mut adam, mut p) = (Adam::new(40, config), vec![0.1_f32; 40]);
                for step in 0..200 {
                    let grad: Vec<f32> = (0..40).map(|i| MAGNITUDES[(i + step) % 20]).collect();
                    let _ = adam.step(simd, lr, &mut p, &grad);
                    finite("p", &p)?;
                }
                finite("m", adam.first_moment())?;
                finite("v", adam.second_moment())
            });
        }
    }
}

fn clipping(tally: &mut Tally, simd: Simd) {
    for scale in MAGNITUDES {
        tally.case(format!("gradients of {scale:e}, norm clipped to 1"), "the norm is at most 1 afterwards", || {
            let mut grad = vec![scale; 1000];
            let clipped = clip_by_global_norm(simd, 1.0, &mut [&mut grad]);
            finite("grad", &grad)?;
            let want = f64::from(scale) * 1000.0_f64.sqrt();
            close("norm before", clipped.norm, want, 1e-6 * want)?;
            let after = grad.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
            ensure(after <= 1.000_01 && (want > 0.99 || grad[0] == scale), || format!("norm {after}"))?;
            clip_by_value(simd, 1e-3, &mut grad);
            ensure(grad.iter().all(|g| g.abs() <= 1e-3), || "not clipped by value".into())
        });
        tally.case(format!("average of {scale:e}"), "the average of a constant is the constant", || {
            let mut ema = Ema::new(17, 0.95);
            for _ in 0..100 {
                ema.update(simd, &[scale; 17]);
            }
            ema.average().iter().try_for_each(|&a| close("average", a.into(), scale.into(), 1e-6 * f64::from(scale)))
        });
    }
    tally.case("sanitise", "every NaN and infinity becomes 0 and is counted, nothing else changes", || {
        let mut grad: Vec<f32> = (0..100_000_u32).map(|i| f32::from_bits(i.wrapping_mul(2_654_435_761))).collect();
        let before = grad.clone();
        let count = sanitise(simd, &mut grad);
        let bad = before.iter().filter(|g| !g.is_finite()).count();
        ensure(bad > 0 && count == bad, || format!("counted {count} of {bad}"))?;
        finite("grad", &grad)?;
        ensure(before.iter().zip(&grad).all(|(a, b)| !a.is_finite() || a == b), || "a finite entry changed".into())
    });
}

fn guard(tally: &mut Tally) {
    tally.case(
        "guard",
        "one bad step of a young run is forgiven, the second is one line that tells the counts",
        || {
            let mut guard = NonFiniteGuard::default();
            let _ = guard.record(0);
            guard.record(3).map_err(|e| e.to_string())?;
            match guard.record(1) {
                Err(e) => ensure(e.to_string().contains("2 of 3 steps"), || format!("said: {e}")),
                Ok(()) => Err("let through".into()),
            }
        },
    );
}
