//! Absolute view-space gradients against the specification.

use crate::common::{bars, cloud, shoot, view};
use crate::twin;
use float_core::Simd;
use splat_core::density::ViewSpaceGradients;
use splat_core::{ProjectedGradient, RasterSettings};

#[test]
fn absolute_gradients_are_sums_of_those_of_the_pixels_of_the_specification() {
    let (mut compared, mut cancelled) = (0, 0);
    for seed in 0..6 {
        let (g, view, settings) = (cloud(300 + seed, 40, 1), view([37, 34]), RasterSettings::DEFAULT);
        let bar = bars(seed, view.size);
        for simd in Simd::available() {
            let mut shot = shoot(simd, &g, &view, &settings);
            let (gradients, absolute) = shot.absolute_gradients(simd, &settings, &bar);
            let ellipses = twin::of_projected(&shot.p);
            if twin::draw(&ellipses, view.size, &settings).margin() < 1e-6 {
                continue;
            }
            compared += 1;
            let want = twin::uv_gradients(&ellipses, view.size, &settings, &bar);
            let largest = want.iter().flat_map(|w| w.absolute).fold(0.0_f64, f64::max);
            for (ellipse, want) in ellipses.iter().zip(&want) {
                let k = shot.p.gaussians.iter().position(|f| f.index as usize == ellipse.index).unwrap();
                let (absolute, plain) = (absolute[k], gradients[k].uv);
                for (axis, (absolute, plain)) in absolute.into_iter().zip(plain).enumerate() {
                    let near = |what: &str, got: f32, want: f64, scale: f64| {
                        let error = (f64::from(got) - want).abs();
                        assert!(error < 1e-4 * scale + 1e-6 * largest, "{seed}, {k}: {what} {got}, expected {want}");
                    };
                    near("absolute", absolute, want.absolute[axis], want.absolute[axis]);
                    // Of a sum that cancels, as good as its terms.
                    near("plain", plain, want.plain[axis], want.absolute[axis]);
                    assert!(plain.abs() <= absolute * (1.0 + 1e-5), "{seed}, {k}");
                    cancelled += usize::from(want.plain[axis].abs() < 0.2 * want.absolute[axis]);
                }
            }
        }
    }
    assert!(compared >= 3 * Simd::available().count() && cancelled > 50, "{compared} {cancelled}");
}

#[test]
fn asking_for_absolute_gradients_changes_no_bit_of_the_others() {
    let (g, view, settings) = (cloud(9, 1500, 2), view([70, 50]), RasterSettings::DEFAULT);
    let bar = bars(4, view.size);
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &settings);
        let plain = shot.projected_gradients(simd, &settings, &bar);
        let (gradients, absolute) = shot.absolute_gradients(simd, &settings, &bar);
        let bits = |x: &ProjectedGradient<4>| {
            let numbers = x.uv.into_iter().chain(x.conic).chain([x.opacity]).chain(x.features);
            numbers.map(f32::to_bits).collect::<Vec<_>>()
        };
        assert!(plain.iter().zip(&gradients).all(|(a, b)| bits(a) == bits(b)));
        assert_eq!(absolute.len(), gradients.len());
        assert!(absolute.iter().flatten().all(|x| *x >= 0.0) && absolute.iter().flatten().any(|x| *x > 0.0));
        // Other pictures in between leave nothing behind.
        assert_eq!(shot.absolute_gradients(simd, &settings, &bar).1, absolute);
    }
}

#[test]
fn density_control_takes_either() {
    let (g, view, settings) = (cloud(10, 200, 0), view([50, 40]), RasterSettings::DEFAULT);
    let mut shot = shoot(Simd::best(), &g, &view, &settings);
    let (gradients, absolute) = shot.absolute_gradients(Simd::best(), &settings, &bars(4, view.size));
    let [mut a, mut b] = [ViewSpaceGradients::new(g.len()), ViewSpaceGradients::new(g.len())];
    a.add(&shot.p.gaussians, view.size, |k| gradients[k].uv).unwrap();
    b.add(&shot.p.gaussians, view.size, |k| absolute[k]).unwrap();
    assert_eq!(a.views(), b.views());
    assert!(a.mean().iter().zip(b.mean()).all(|(plain, absolute)| *plain <= absolute * (1.0 + 1e-5)));
    assert!(a.mean() != b.mean());
}
