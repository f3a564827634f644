//! Kernels at extreme errors, pictures without contrast.

use losses::kernel::Kernel;
use losses::metrics::{Image, SsimVariant, psnr, ssim};
use losses::photometric;
use stress::{MAGNITUDES, Tally, close, ensure};

pub(crate) fn cases(tally: &mut Tally) {
    kernels(tally);
    pictures(tally);
}

/// Cost and slope in `f64`, from the definitions.
fn twin(kernel: Kernel, p: f64, t: f64) -> (f64, f64) {
    let x = p - t;
    match kernel {
        Kernel::Squared => (x * x, 2.0 * x),
        Kernel::L1 => (x.abs(), if x == 0.0 { 0.0 } else { x.signum() }),
        Kernel::Charbonnier { c } => {
            let root = x.hypot(c.into());
            (root, if root == 0.0 { 0.0 } else { x / root })
        }
        Kernel::Huber { delta } => huber(x, delta.into()),
        Kernel::HuberNgp => {
            let delta = f64::from(0.1_f32);
            let (value, slope) = huber(x, delta);
            (value / (5.0 * delta), slope / (5.0 * delta))
        }
        Kernel::LogSquared { eps } => {
            let (eps, q, t) = (f64::from(eps), p.max(0.0), t.max(0.0));
            let relative = (q - t) / (t + eps);
            // Near equality one keeps the digits, far from it the other.
            let ratio = if relative.abs() < 0.5 { relative.ln_1p() } else { (q + eps).ln() - (t + eps).ln() };
            (ratio * ratio, if p < 0.0 { 0.0 } else { 2.0 * ratio / (q + eps) })
        }
        other => panic!("a kernel without a twin: {other:?}"),
    }
}

fn huber(x: f64, delta: f64) -> (f64, f64) {
    if x.abs() <= delta { (0.5 * x * x, x) } else { (delta * (x.abs() - 0.5 * delta), delta.copysign(x)) }
}

fn kernels(tally: &mut Tally) {
    let kernels = [
        Kernel::Squared,
        Kernel::L1,
        Kernel::CHARBONNIER_360,
        Kernel::Charbonnier { c: 1e-38 },
        Kernel::Charbonnier { c: 0.0 },
        Kernel::Huber { delta: 0.1 },
        Kernel::Huber { delta: 1e-38 },
        Kernel::Huber { delta: 1e30 },
        Kernel::HuberNgp,
        Kernel::LogSquared { eps: 1e-3 },
    ];
    for kernel in kernels {
        for p in MAGNITUDES.iter().flat_map(|&m| [m, -m]) {
            for t in [0.0, 0.5, 1.0, 3e38] {
                let name = format!("{kernel:?}, prediction {p:e}, target {t:e}");
                tally.case(name, "cost and slope within 1e-6 of f64, plus rounding of the error itself", || {
                    let (value, slope) = twin(kernel, f64::from(p), f64::from(t));
                    // The error p - t is rounded once; its relative slack passes through at most squared.
                    let slack = 3e-6;
                    let got = kernel.value(p, t);
                    let log = matches!(kernel, Kernel::LogSquared { .. });
                    let (most, error) = (f64::from(f32::MAX), (f64::from(p) - f64::from(t)).abs());
                    if value.abs() <= most && (log || error <= most) {
                        close("cost", got.into(), value, slack * value.abs() + 1e-44)?;
                        let slope_bound = slack * slope.abs() + 1e-44;
                        let got = kernel.derivative(p, t);
                        if slope.abs() <= most {
                            // A log near its zero: the rounding of the logarithms, over the slope's scale.
                            let extra = if log { 1e-5 / (f64::from(p).max(0.0) + 1e-3) } else { 0.0 };
                            close("slope", got.into(), slope, slope_bound + extra)?;
                        }
                    } else {
                        ensure(got == f32::INFINITY || got >= f32::MAX * 0.99, || format!("an overflow gave {got:e}"))?;
                    }
                    Ok(())
                });
            }
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            tally.case(format!("{kernel:?}, prediction {bad}"), "NaN stays NaN, infinity is not a cheap error", || {
                let (value, slope) = (kernel.value(bad, 0.5), kernel.derivative(bad, 0.5));
                let log_floor = matches!(kernel, Kernel::LogSquared { .. }) && bad == f32::NEG_INFINITY;
                if bad.is_nan() {
                    ensure(value.is_nan() && slope.is_nan(), || format!("cost {value}, slope {slope}"))
                } else {
                    ensure(log_floor || value == f32::INFINITY, || format!("cost {value}"))
                }
            });
        }
        tally.case(
            format!("{kernel:?}, a batch of 10^5 rays"),
            "the mean to 1e-6, and equal rays get equal gradients",
            || {
                let n = 100_000;
                let (p, t) = (vec![[0.7, 0.2, 0.1]; n], vec![[0.5, 0.2, 0.3]; n]);
                let got = photometric::mean(kernel, &p, &t, None).map_err(|e| e.to_string())?;
                let want: f64 =
                    (0..3).map(|c| twin(kernel, f64::from(p[0][c]), f64::from(t[0][c])).0).sum::<f64>() / 3.0;
                close("mean", got, want, 3e-6 * want + 1e-44)?;
                let mut bar = vec![[0.0; 3]; n];
                photometric::mean_backward(kernel, &p, &t, None, 1.0, &mut bar).map_err(|e| e.to_string())?;
                ensure(bar.iter().all(|b| *b == bar[0]), || "gradients of equal rays differ".into())
            },
        );
    }
}

fn pictures(tally: &mut Tally) {
    for a in [0.0_f32, 1e-45, 1e-10, 0.5, 1.0] {
        for b in [0.0_f32, 1e-20, 0.25, 0.999_999_9, 1.0] {
            tally.case(format!("constant pictures {a:e} and {b:e}"), "PSNR and SSIM of the closed form", || {
                let (pa, pb) = (vec![a; 32 * 16 * 3], vec![b; 32 * 16 * 3]);
                let x = Image::from_f32(32, 16, 3, &pa).map_err(|e| e.to_string())?;
                let y = Image::from_f32(32, 16, 3, &pb).map_err(|e| e.to_string())?;
                let (a, b) = (f64::from(a), f64::from(b));
                let want = -20.0 * (a - b).abs().log10();
                close("PSNR", psnr(&x, &y).map_err(|e| e.to_string())?, want, 1e-9 * want.abs() + 1e-9)?;
                let want = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
                close("SSIM", ssim(&x, &y, SsimVariant::REFERENCE).map_err(|e| e.to_string())?, want, 1e-9)
            });
        }
    }
    for bad in [f32::NAN, f32::INFINITY] {
        tally.case(format!("a picture with {bad}"), "refused, with the place", || {
            let mut pixels = vec![0.5; 300];
            pixels[123] = bad;
            match Image::from_f32(10, 10, 3, &pixels) {
                Err(e) => ensure(e.to_string().contains("123"), || format!("said: {e}")),
                Ok(_) => Err("taken".into()),
            }
        });
    }
}
