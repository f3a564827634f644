//! The rasteriser against the specification.

use crate::common::{bars, beside_the_picture, cloud, shoot, view};
use crate::twin;
use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{Gaussians, Raster, RasterSettings, View, Widening};

/// Both kinds, by turns.
fn settings(k: u64) -> RasterSettings {
    RasterSettings::DEFAULT.with_widening(if k.is_multiple_of(2) { Widening::Keeps } else { Widening::Dims })
}

#[test]
fn pictures_are_those_of_the_specification() {
    for seed in 0..12 {
        let settings = settings(seed);
        let (g, view) = (cloud(seed, 60 + 40 * seed as usize, seed as usize % 4), view([37, 50]));
        let want =
            twin::draw(&twin::project(&twin::flat(&g), g.len(), g.degree(), &view, &settings), view.size, &settings);
        for simd in Simd::available() {
            let got = shoot(simd, &g, &view, &settings).planes;
            let (worst, unclear) = want.worst(&got);
            println!("{seed} {:?}: {worst:.2} of rounding, {unclear:.3} unclear", simd.level());
            assert!(worst < 2.0 && unclear < 0.01, "{seed}: {worst}, {unclear}");
        }
    }
}

#[test]
fn median_depth_is_where_the_transmittance_falls_to_a_half() {
    let mut found = [0, 0];
    for seed in 0..6 {
        let settings = settings(seed);
        let (g, view) = (cloud(40 + seed, 30 + 20 * seed as usize, 1), view([21, 18]));
        for simd in Simd::available() {
            let shot = shoot(simd, &g, &view, &settings);
            let ellipses = twin::of_projected(&shot.p);
            for (i, got) in shot.median_depth(simd, &view, &settings).into_iter().enumerate() {
                let left = |k: usize| twin::left(&ellipses[..k], [i % view.size[0], i / view.size[0]], &settings);
                let want = (1..=ellipses.len()).find(|&k| left(k) <= 0.5);
                // Rounding may decide otherwise where exactly a half is left.
                if want.is_some_and(|k| (left(k) - 0.5).abs() < 1e-5 || (left(k - 1) - 0.5).abs() < 1e-5) {
                    continue;
                }
                let want = want.map_or(f32::INFINITY, |k| ellipses[k - 1].z as f32);
                found[usize::from(want.is_finite())] += 1;
                assert_eq!(got, want, "{seed}, pixel {i}");
            }
        }
    }
    assert!(found.into_iter().all(|n| n > 500), "{found:?}");
}

#[test]
fn median_depth_of_nothing_and_of_the_wrong_size() {
    let (g, view) = (Gaussians::new(0, 0).unwrap(), view([9, 7]));
    let shot = shoot(Simd::best(), &g, &view, &RasterSettings::DEFAULT);
    assert!(shot.median_depth(Simd::best(), &view, &RasterSettings::DEFAULT).into_iter().all(|z| z == f32::INFINITY));
    let one = cloud(1, 1, 0);
    let other = shoot(Simd::best(), &one, &view, &RasterSettings::DEFAULT);
    assert!(other.try_median_depth(Simd::best(), &RasterSettings::DEFAULT, &mut [0.0; 5]).is_err());
    let mut out = vec![0.0; 63];
    assert!(other.try_median_depth(Simd::best(), &RasterSettings::DEFAULT, &mut out).is_ok());
}

/// Gradients against differences of the specification, relative to `want` and to a thousandth of the largest; `None` where a
/// decision is too near to difference over.
fn worst_gradient(g: &Gaussians, view: &View, settings: &RasterSettings, simd: Simd) -> Option<(f64, String)> {
    let bar = bars(7, view.size);
    let picture = |p: &[f64]| twin::draw(&twin::project(p, g.len(), g.degree(), view, settings), view.size, settings);
    let at = twin::flat(g);
    if picture(&at).margin() < 1e-5 {
        return None;
    }
    let loss = |p: &[f64]| picture(p).planes.iter().zip(&bar).map(|(a, b)| a * f64::from(*b)).sum::<f64>();
    let got = twin::flat(&shoot(simd, g, view, settings).gradients(simd, g, view, settings, &bar));
    let scale = got.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let mut worst = (0.0, String::new());
    for k in 0..at.len() {
        let h = 1e-6;
        let moved = |by: f64| {
            let mut p = at.clone();
            p[k] += by;
            loss(&p)
        };
        let want = (moved(h) - moved(-h)) / (2.0 * h);
        let error = (got[k] - want).abs() / (1e-3 * scale + want.abs());
        if error > worst.0 || error.is_nan() {
            worst = (error, format!("number {k}: {} instead of {want}, largest {scale}", got[k]));
        }
    }
    Some(worst)
}

#[test]
fn gradients_are_those_of_the_specification() {
    let mut compared = 0;
    for seed in 0..8 {
        let (g, view) = (cloud(100 + seed, 12, 3), view([21, 18]));
        for simd in Simd::available() {
            let Some((worst, what)) = worst_gradient(&g, &view, &settings(seed), simd) else { continue };
            compared += 1;
            println!("{seed} {:?}: {worst:.1e}", simd.level());
            assert!(worst < 2e-4, "{seed}: {what}");
        }
    }
    assert!(compared >= 5 * Simd::available().count(), "{compared}");
}

#[test]
fn gradients_hold_where_slopes_are_clamped() {
    let view = view([21, 18]);
    let mut compared = 0;
    for (k, g) in beside_the_picture(&view) {
        for simd in Simd::available() {
            assert!(
                !shoot(simd, &g, &view, &settings(k as u64)).p.gaussians.is_empty(),
                "{k}: nothing reaches the picture"
            );
            let Some((worst, what)) = worst_gradient(&g, &view, &settings(k as u64), simd) else { continue };
            compared += 1;
            println!("{k} {:?}: {worst:.1e}", simd.level());
            assert!(worst < 1e-4, "{k}: {what}");
        }
    }
    assert!(compared >= 3 * Simd::available().count(), "{compared}");
}

#[test]
fn any_number_of_features_is_composited_as_colour_is() {
    fn check<const K: usize>(simd: Simd) {
        let (g, view, settings) = (cloud(3, 200, 0), view([33, 20]), RasterSettings::DEFAULT);
        let pixels = view.size[0] * view.size[1];
        let mut shot = shoot(simd, &g, &view, &settings);
        let of = |i: usize| -> [f32; K] { core::array::from_fn(|k| Rng::new(i as u64, k as u64).normal_at(0)) };
        let features: Vec<[f32; K]> = shot.p.gaussians.iter().map(|f| of(f.index as usize)).collect();
        let mut raster = Raster::<K>::default();
        let drawn = raster.draw(simd, &shot.p.gaussians, &features, view.size, &settings).unwrap();
        assert_eq!(drawn, shot.drawn);
        let mut planes = vec![f32::NAN; (K + 1) * pixels];
        raster.planes(&mut planes).unwrap();
        // Each feature as the red of another picture: the same bits.
        let mut bar = vec![0.0_f32; (K + 1) * pixels];
        Rng::new(1, 2).fill_normal(0, &mut bar);
        let mut gradients = Vec::new();
        raster.backward(simd, &shot.p.gaussians, &features, &settings, &bar, &mut gradients).unwrap();
        let mut sums = vec![[0.0_f64; 6]; shot.p.gaussians.len()];
        for k in 0..K {
            shot.features = features.iter().map(|f| [f[k], 0.0, 0.0, 0.0]).collect();
            let mut alone = Raster::<4>::default();
            alone.draw(simd, &shot.p.gaussians, &shot.features, view.size, &settings).unwrap();
            let mut red = vec![f32::NAN; 5 * pixels];
            alone.planes(&mut red).unwrap();
            assert_eq!(red[..pixels], planes[k * pixels..][..pixels], "feature {k} of {K}");
            assert_eq!(red[4 * pixels..], planes[K * pixels..]);
            let mut red_bar = vec![0.0; 5 * pixels];
            red_bar[..pixels].copy_from_slice(&bar[k * pixels..][..pixels]);
            if k == 0 {
                red_bar[4 * pixels..].copy_from_slice(&bar[K * pixels..]);
            }
            let mut own = Vec::new();
            alone.backward(simd, &shot.p.gaussians, &shot.features, &settings, &red_bar, &mut own).unwrap();
            for ((sum, own), all) in sums.iter_mut().zip(&own).zip(&gradients) {
                let numbers = [own.opacity, own.uv[0], own.uv[1], own.conic[0], own.conic[1], own.conic[2]];
                sum.iter_mut().zip(numbers).for_each(|(sum, x)| *sum += f64::from(x));
                assert_eq!(own.features[0], all.features[k], "feature {k} of {K}");
            }
        }
        for number in 0..6 {
            let scale = sums.iter().fold(0.0_f64, |m, x| m.max(x[number].abs()));
            for (sum, all) in sums.iter().zip(&gradients) {
                let all = [all.opacity, all.uv[0], all.uv[1], all.conic[0], all.conic[1], all.conic[2]][number];
                let error = (sum[number] - f64::from(all)).abs();
                assert!(error < 1e-5 * scale, "{K} features, number {number}: {}, together {all}", sum[number]);
            }
        }
    }
    for simd in Simd::available() {
        check::<1>(simd);
        check::<2>(simd);
        check::<3>(simd);
        check::<7>(simd);
        check::<16>(simd);
        check::<17>(simd);
        check::<40>(simd);
    }
}

#[test]
fn many_features_are_those_of_the_specification() {
    fn check<const K: usize>() {
        let (g, view, settings) = (cloud(5, 40, 0), view([33, 20]), RasterSettings::DEFAULT);
        let pixels = view.size[0] * view.size[1];
        let p = shoot(Simd::best(), &g, &view, &settings).p;
        let of = |i: u32| -> [f32; K] { core::array::from_fn(|k| Rng::new(i.into(), k as u64).normal_at(0)) };
        let features: Vec<[f32; K]> = p.gaussians.iter().map(|f| of(f.index)).collect();
        // What each pixel takes of each ellipse, front to back: what is left before it, less what is left behind it.
        let ellipses = twin::of_projected(&p);
        assert!(twin::draw(&ellipses, view.size, &settings).margin() > 1e-6, "a decision too near to compare");
        let left: Vec<Vec<f64>> = (0..=ellipses.len())
            .map(|n| {
                let at = |i: usize| [i % view.size[0], i / view.size[0]];
                (0..pixels).map(|i| twin::left(&ellipses[..n], at(i), &settings)).collect()
            })
            .collect();
        let mut bar = vec![0.0_f32; (K + 1) * pixels];
        Rng::new(1, 2).fill_normal(0, &mut bar);
        for simd in Simd::available() {
            let mut raster = Raster::<K>::default();
            raster.draw(simd, &p.gaussians, &features, view.size, &settings).unwrap();
            let (mut planes, mut gradients) = (vec![f32::NAN; (K + 1) * pixels], Vec::new());
            raster.planes(&mut planes).unwrap();
            raster.backward(simd, &p.gaussians, &features, &settings, &bar, &mut gradients).unwrap();
            let mut want = vec![0.0_f64; planes.len()];
            want[K * pixels..].copy_from_slice(&left[ellipses.len()]);
            for (n, ellipse) in ellipses.iter().enumerate() {
                let row = p.gaussians.iter().position(|f| f.index as usize == ellipse.index).unwrap();
                for k in 0..K {
                    let (mut slope, mut size) = (0.0, 0.0);
                    for i in 0..pixels {
                        let w = left[n][i] - left[n + 1][i];
                        want[k * pixels + i] += w * f64::from(features[row][k]);
                        slope += w * f64::from(bar[k * pixels + i]);
                        size += w * f64::from(bar[k * pixels + i]).abs();
                    }
                    let got = f64::from(gradients[row].features[k]);
                    assert!((got - slope).abs() <= 1e-5 * size + 1e-7, "{K}: feature {k} of {n}: {got}, not {slope}");
                }
            }
            for (i, (got, want)) in planes.iter().zip(&want).enumerate() {
                assert!((f64::from(*got) - want).abs() < 1e-5, "{K}: number {i}: {got}, not {want}");
            }
        }
    }
    check::<1>();
    check::<3>();
    check::<16>();
    check::<17>();
    check::<40>();
}
