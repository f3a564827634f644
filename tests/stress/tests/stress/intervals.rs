//! Intervals along rays: normalised distances, frusta, and the losses on their weights.

use losses::distortion::{distortion, distortion_backward};
use losses::interlevel::{EPS, Levels, Scratch, interlevel, interlevel_backward};
use losses::{Edges, RayIntervals, Reduction};
use render_core::frustum::{Frustum, Moments};
use render_core::ray_distance::{RayDistance, RaySpacing};
use stress::{MAGNITUDES, Tally, close, ensure, finite};

/// Normalised distances between near and far planes of any size.
pub(crate) fn distances(tally: &mut Tally) {
    let ends = [f64::NAN, -1.0, 0.0, 1e-38, 1e-6, 0.5, 1.0, 2.0, 1e6, 1e20, 3e38, f64::INFINITY];
    for spacing in [RaySpacing::Linear, RaySpacing::Reciprocal, RaySpacing::Log, RaySpacing::Piecewise] {
        for near in ends {
            for far in ends {
                let promise = "one error, or a map that meets its ends, is sorted, and inverts itself to 1e-9";
                tally.case(format!("{spacing:?} from {near:e} to {far:e}"), promise, || {
                    let map = match RayDistance::new(spacing, near, far) {
                        Ok(map) => map,
                        Err(e) => {
                            let said = e.to_string();
                            return ensure(said.contains("expected") && !said.contains('\n'), || said);
                        }
                    };
                    ensure(near < far && near >= 0.0, || "taken".into())?;
                    ensure(map.t_of(0.0) == near && map.t_of(1.0) == far, || "the ends are not met".into())?;
                    let s: Vec<f32> = (0..=256).map(|i| i as f32 / 256.0).collect();
                    let (mut t, mut back) = (vec![f32::NAN; s.len()], vec![f32::NAN; s.len()]);
                    map.distances(&s, &mut t);
                    map.normalise(&t, &mut back);
                    finite("t", &t)?;
                    finite("s", &back)?;
                    ensure(t.is_sorted() && back.is_sorted(), || "not sorted".into())?;
                    s[..256].iter().try_for_each(|&s| {
                        let s = f64::from(s);
                        close("s", map.s_of(map.t_of(s)), s, 1e-9)
                    })
                });
            }
        }
    }
}

/// Gaussians of frusta, `f32` against `f64`.
pub(crate) fn frusta(tally: &mut Tally) {
    for shape in [Frustum::Cone, Frustum::Cylinder] {
        for t0 in [0.0_f32, 1e-45, 1e-38, 1e-6, 1.0, 1e6, 1e18] {
            for length in [0.0_f32, 1e-45, 1e-38, 1e-7, 1e-3, 1.0, 1e3, 1e18] {
                for radius in [0.0_f32, 1e-38, 1e-6, 1e-3, 1.0] {
                    let name = format!("{shape:?} from {t0:e}, length {length:e}, radius {radius:e}");
                    tally.case(name, "moments within 1e-6 of f64; variances in space finite and not negative", || {
                        let t1 = t0 + length;
                        let got = Moments::new(shape, t0, t1, radius);
                        let want = Moments::new(shape, f64::from(t0), f64::from(t1), f64::from(radius));
                        let tiny = 1e-44;
                        close("mean", got.mean_t.into(), want.mean_t, 1e-6 * want.mean_t + tiny)?;
                        close("variance along", got.var_t.into(), want.var_t, 1e-6 * want.var_t + tiny)?;
                        close("variance across", got.var_r.into(), want.var_r, 1e-6 * want.var_r + tiny)?;
                        for d in [[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [1.0, 1e-20, 1e-45], [0.0; 3]] {
                            let (mean, var) = got.diagonal([1.0, -2.0, 0.5], d);
                            finite("mean", &mean)?;
                            finite("variance", &var)?;
                            ensure(var.iter().all(|&v| v >= 0.0), || format!("variances {var:?}"))?;
                        }
                        Ok(())
                    });
                }
            }
        }
    }
}

/// Distortion and interlevel loss of equal weights on equal intervals, against their closed forms.
pub(crate) fn losses(tally: &mut Tally) {
    for n in [1_usize, 2, 64, 1000, 100_000] {
        let offsets = [0, n as u32];
        for span in [0.0_f32, 1e-45, 1e-38, 1e-20, 1e-3, 1.0, 1e6, 3e38] {
            let s: Vec<f32> = (0..=n).map(|i| (f64::from(span) * i as f64 / n as f64) as f32).collect();
            let intervals = RayIntervals { offsets: &offsets, edges: Edges::Joined(&s) };
            for w in MAGNITUDES {
                let name = format!("distortion of {n} weights of {w:e} on [0, {span:e}]");
                tally.case(name, "mass squared times a third of the length; gradients of that degree", || {
                    let (l, m) = (f64::from(s[n]), n as f64 * f64::from(w));
                    let (want, w) = (m * m * l / 3.0, vec![w; n]);
                    // Edges are rounded: a share of the whole, and where they are denormal by a fixed amount.
                    let off = 1e-6 + if l > 0.0 { 1e-45 / l * 4.0 } else { 0.0 };
                    let got = distortion(intervals, &w, Reduction::Sum).map_err(|e| e.to_string())?;
                    close("loss", got, want, off * want)?;
                    let mut w_bar = vec![0.0; n];
                    distortion_backward(intervals, &w, Reduction::Sum, 1.0, &mut w_bar).map_err(|e| e.to_string())?;
                    ensure(w_bar.iter().all(|g| *g >= 0.0), || "a gradient is negative or NaN".into())?;
                    let mean = 2.0 * m * l / 3.0;
                    if !(1e-30..1e38).contains(&mean) {
                        return Ok(());
                    }
                    let sum = w_bar.iter().map(|&g| f64::from(g)).sum::<f64>() / n as f64;
                    close("mean gradient", sum, mean, 2.0 * off * mean)
                });
            }
        }
        for w in MAGNITUDES {
            tally.case(
                format!("interlevel loss of {n} weights of {w:e}"),
                "0 against itself; against nothing that of the weights; gradients between -6 and 0",
                || {
                    let s: Vec<f32> = (0..=n).map(|i| i as f32 / n as f32).collect();
                    let intervals = RayIntervals { offsets: &offsets, edges: Edges::Joined(&s) };
                    let (fine, nothing, mut scratch) = (vec![w; n], vec![0.0; n], Scratch::default());
                    let w = f64::from(w);
                    let all = n as f64 * w * w / (w + EPS);
                    for (w_proposal, want) in [(&fine, 0.0), (&nothing, all)] {
                        let levels = Levels { fine: intervals, w: &fine, proposal: intervals, w_proposal };
                        let got = interlevel(levels, Reduction::Sum, &mut scratch).map_err(|e| e.to_string())?;
                        close("loss", got, want, 1e-9 * all)?;
                        let mut bar = vec![0.0; n];
                        interlevel_backward(levels, Reduction::Sum, 1.0, &mut bar, &mut scratch)
                            .map_err(|e| e.to_string())?;
                        let out = bar.iter().find(|g| !(-6.000_1..=0.0).contains(*g));
                        ensure(out.is_none(), || format!("a gradient of {out:?}"))?;
                    }
                    Ok(())
                },
            );
        }
    }
    for bad in [f32::NAN, f32::INFINITY] {
        tally.case(format!("distortion of a weight of {bad}"), "not finite, as it is said: nothing is hidden", || {
            let intervals = RayIntervals { offsets: &[0, 2], edges: Edges::Joined(&[0.0, 0.5, 1.0]) };
            let loss = distortion(intervals, &[bad, 0.5], Reduction::Sum).map_err(|e| e.to_string())?;
            ensure(!loss.is_finite(), || format!("loss {loss}"))
        });
    }
}
