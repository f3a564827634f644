//! Gaussians of any size, depth, opacity and rotation among ordinary ones, in pictures of any size; density control of such
//! clouds.

use field_core::rng::Rng;
use float_core::Simd;
use splat_core::density::{
    Adc, Mcmc, ViewSpaceGradients, keep_in_range, keep_strongest, relocation, without_non_finite,
};
use splat_core::{Gaussians, ProjectedGaussian, Projection, Raster, RasterSettings, SplatError, View, Widening};
use stress::{MAGNITUDES, Tally, Verdict, close, ensure, finite};

/// Three ordinary Gaussians about a point three units ahead; the one to change is in the middle of the rows.
fn cloud() -> Gaussians {
    let mut g = Gaussians::new(3, 1).expect("a degree that exists");
    for (k, (_, rows)) in g.fields_mut().into_iter().enumerate() {
        Rng::new(2, k as u64).fill_uniform(0, rows);
    }
    g.mean[6..].fill(3.0);
    g.log_scale.iter_mut().for_each(|x| *x -= 2.0);
    g
}

fn view(size: [usize; 2], focal: f32) -> View {
    let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    View { r, t: [0.0; 3], f: [focal; 2], c: size.map(|n| 0.5 * n as f32), size }
}

fn text(e: SplatError) -> String {
    e.to_string()
}

/// Shares and what is left make one, everything is finite, and so are gradients of colours of order 1.
fn sound(simd: Simd, g: &Gaussians, view: &View, rules: &RasterSettings) -> Verdict {
    let mut p = Projection::default();
    p.project(simd, g, view, rules, 1).map_err(text)?;
    // One, and a colour.
    let features: Vec<[f32; 4]> = p.rgb.iter().map(|c| [c[0], c[1], c[2], 1.0]).collect();
    let pixels = view.size[0] * view.size[1];
    let (mut raster, mut planes) = (Raster::<4>::default(), vec![f32::NAN; 5 * pixels]);
    raster.draw(simd, &p.gaussians, &features, view.size, rules).map_err(text)?;
    raster.planes(&mut planes).map_err(text)?;
    finite("planes", &planes)?;
    for i in 0..pixels {
        let (taken, left) = (planes[3 * pixels + i], planes[4 * pixels + i]);
        close("taken and left", f64::from(taken + left), 1.0, 1e-6)?;
        ensure((0.0..=1.0).contains(&left), || format!("light left {left}"))?;
        let brightest = p.rgb.iter().flatten().fold(0.0_f32, |m, &x| m.max(x));
        ensure((0..3).all(|c| (0.0..=brightest * 1.000_01).contains(&planes[c * pixels + i])), || {
            "a colour of no one".into()
        })?;
    }
    let bar: Vec<f32> = (0..5 * pixels).map(|i| (i as f32 * 0.7).sin()).collect();
    let (mut records, mut grad) = (Vec::new(), g.clone());
    raster.backward(simd, &p.gaussians, &features, rules, &bar, &mut records).map_err(text)?;
    p.backward(simd, g, view, rules, 1, &records, None, &mut grad).map_err(text)?;
    grad.fields().into_iter().try_for_each(|(field, x)| finite(field.name(), x))
}

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    let promise = "shares and the light that is left make one; picture and gradients are finite";
    for (name, widening) in [("keeps", Widening::Keeps), ("dims", Widening::Dims)] {
        let (rules, usual) = (RasterSettings::DEFAULT.with_widening(widening), view([19, 13], 15.0));
        let mut single = |what: &str, x: f32, change: &dyn Fn(&mut Gaussians)| {
            tally.case(format!("{what} {x:e}, {name}"), promise, || {
                let mut g = cloud();
                change(&mut g);
                sound(simd, &g, &usual, &rules)
            });
        };
        for x in MAGNITUDES {
            // Beyond, products of gradients overflow: `density::keep_in_range` is for that.
            if x <= 1e10 {
                single("a scale of", x, &|g| (0..3).for_each(|k| g.log_scale[3 * k + 1] = x.ln()));
                single("a needle of length", x, &|g| g.log_scale[1] = x.ln());
                single("a needle of breadth", x, &|g| (1..3).for_each(|k| g.log_scale[3 * k + 1] = x.ln()));
            }
            if x <= 1e18 {
                for sign in [-1.0, 1.0] {
                    single("a depth of", sign * x, &|g| g.mean[7] = sign * x);
                    single("a place beside the axis,", sign * x, &|g| g.mean[1] = sign * x);
                    single("a coefficient of", sign * x, &|g| g.rest[4] = sign * x.min(1e10));
                }
            }
            single("a logit of", x, &|g| g.logit[1] = x);
            single("a logit of", -x, &|g| g.logit[1] = -x);
            single("a quaternion of", x, &|g| (0..4).for_each(|k| g.wxyz[3 * k + 1] = x));
        }
        for focal in MAGNITUDES.into_iter().filter(|x| (1e-3..=1e10).contains(x)) {
            tally.case(format!("a focal length of {focal:e}, {name}"), promise, || {
                sound(simd, &cloud(), &view([19, 13], focal), &rules)
            });
        }
        for size in [[1, 1], [1, 40], [16, 16], [17, 1], [33, 31], [4000, 1], [1, 4000]] {
            tally.case(format!("a picture of {size:?}, {name}"), promise, || {
                sound(simd, &cloud(), &view(size, 20.0), &rules)
            });
        }
    }
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0, -1.0] {
        tally.case(format!("a focal length of {bad}"), "one error that names it", || {
            let refused = sound(simd, &cloud(), &view([9, 9], bad), &RasterSettings::DEFAULT);
            ensure(refused.as_ref().is_err_and(|e| e.contains("`view.f`")), || format!("said: {refused:?}"))
        });
    }
}

/// Neither opacities nor scales of a cloud are out of their ranges.
fn in_range(g: &Gaussians) -> Verdict {
    g.fields().into_iter().try_for_each(|(field, x)| finite(field.name(), x))
}

pub(crate) fn density(tally: &mut Tally) {
    for o in [1e-300, 1e-20, 1e-6, 0.005, 0.3, 0.5, 0.9, 0.999_999, 1.0 - 1e-15, 1.0] {
        for n in [0, 1, 2, 3, 7, 50, 1000] {
            tally.case(
                format!("{n} share an opacity of {o:e}"),
                "what gets through stays the same; scales shrink",
                || {
                    let (each, factor) = relocation(o, n);
                    let through = f64::from(n.max(1)) * (-each).ln_1p();
                    close("ln of what gets through", through, (-o).ln_1p(), 1e-9 * (-o).ln_1p().abs().max(1e-15))?;
                    // Faint ones add up: their places need not change.
                    ensure((0.1..=1.0 + 1e-12).contains(&factor), || format!("factor {factor}"))
                },
            );
        }
    }
    for x in MAGNITUDES {
        for sign in [-1.0, 1.0] {
            let x = sign * x;
            tally.case(
                format!("density control of logits and logarithms of {x:e}"),
                "finite clouds of the sizes promised",
                || {
                    let mut g = cloud();
                    g.logit[1] = x;
                    g.log_scale[4] = x;
                    keep_in_range(&mut g, 2.0).map_err(text)?;
                    let rng = Rng::new(1, 1);
                    let grown = Adc::DEFAULT.grow(&g, &[0.0, x, 0.0], 2.0, 9, rng).map_err(text)?;
                    ensure(grown.cloud.len() == 3 + usize::from(x >= 2e-4), || format!("{} grown", grown.cloud.len()))?;
                    in_range(&grown.cloud)?;
                    let mcmc = Mcmc::DEFAULT;
                    in_range(&mcmc.relocate(&g, rng).map_err(text)?.cloud)?;
                    let added = mcmc.add(&g, 4, rng).map_err(text)?.cloud;
                    ensure(added.len() == 4, || format!("{} after adding", added.len()))?;
                    in_range(&added)?;
                    let mut grad = g.clone();
                    let loss = mcmc.regularise(&g, &mut grad).map_err(text)?;
                    ensure(loss.is_finite(), || format!("loss {loss}"))?;
                    in_range(&grad)?;
                    mcmc.add_noise(&mut g, 1e-4, rng).map_err(text)?;
                    in_range(&g)?;
                    Adc::DEFAULT.reset_opacity(&mut g, |_| true).map_err(text)?;
                    ensure(without_non_finite(&g).map_err(text)?.is_none(), || "something is not finite".into())?;
                    let kept = keep_strongest(&g, 1, rng).map_err(text)?;
                    ensure(kept.len() == 1, || format!("{} kept", kept.len()))
                },
            );
            tally.case(format!("a pull of {x:e}"), "finite averages", || {
                let mut pull = ViewSpaceGradients::new(1);
                for _ in 0..3 {
                    pull.add(&[ProjectedGaussian::default()], [640, 480], |_| [x, -x]).map_err(text)?;
                }
                ensure(pull.mean()[0] >= 0.0, || format!("{:?}", pull.mean()))
            });
        }
    }
}
