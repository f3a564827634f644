//! The rasteriser against the specification.

mod twin;

use field_core::rng::Rng;
use float_core::Simd;
use splat_core::{Gaussians, Projection, Raster, Rules, View, Widening};

fn cloud(seed: u64, n: usize, degree: usize) -> Gaussians {
    let mut g = Gaussians::new(n, degree).unwrap();
    let rng = Rng::new(seed, 0);
    for (k, (_, rows)) in g.fields_mut().into_iter().enumerate() {
        let rng = rng.substream(k as u64);
        for (i, x) in rows.iter_mut().enumerate() {
            let u = rng.normal_at(i as u64);
            *x = match k {
                0 => 0.7 * u,
                1 => -2.2 + 0.7 * u,
                2 => u,
                3 => 1.5 * u,
                4 => 0.8 * u,
                _ => 0.3 * u,
            };
        }
    }
    g
}

fn view(size: [usize; 2]) -> View {
    let (s, c) = 0.3_f64.sin_cos();
    let f = 0.9 * size[0] as f64;
    View::from_c2w(
        [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        [-3.0 * s, 0.1, -3.0 * c],
        [f, 1.1 * f],
        [0.47 * size[0] as f64, 0.55 * size[1] as f64],
        size,
    )
}

fn draw(simd: Simd, g: &Gaussians, view: &View, rules: &Rules) -> Vec<f32> {
    let mut p = Projection::default();
    p.project(simd, g, view, rules, 3).unwrap();
    let features: Vec<[f32; 4]> = p.rgb.iter().zip(&p.footprints).map(|(c, f)| [c[0], c[1], c[2], f.z]).collect();
    let mut raster = Raster::<4>::default();
    raster.draw(simd, (&p.footprints, &features), view.size, rules).unwrap();
    let mut out = vec![0.0; 5 * view.size[0] * view.size[1]];
    raster.planes(&mut out).unwrap();
    out
}

#[test]
fn pictures_are_those_of_the_specification() {
    for (seed, widening) in (0..12).map(|s| (s, if s % 2 == 0 { Widening::Keeps } else { Widening::Dims })) {
        let rules = Rules { widening, ..Rules::DEFAULT };
        let (g, view) = (cloud(seed, 60 + 40 * seed as usize, seed as usize % 4), view([37, 50]));
        let ellipses = twin::project(&twin::flat(&g), g.len(), g.degree(), &view, &rules);
        let (want, margin) = twin::draw(&ellipses, view.size, &rules);
        for simd in Simd::available() {
            let got = draw(simd, &g, &view, &rules);
            let worst = got.iter().zip(&want).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            println!("{seed} {:?}: {worst:.2e}, margin {margin:.1e}", simd.level());
            assert!(worst < 2e-2, "{seed}: {worst}");
        }
    }
}

#[test]
fn gradients_are_those_of_the_specification() {
    for seed in 0..6 {
        let rules = Rules { widening: if seed % 2 == 0 { Widening::Keeps } else { Widening::Dims }, ..Rules::DEFAULT };
        let (g, view) = (cloud(100 + seed, 12, 3), view([21, 18]));
        let pixels = view.size[0] * view.size[1];
        let rng = Rng::new(seed, 9);
        let bar: Vec<f32> = (0..5 * pixels).map(|i| rng.normal_at(i as u64)).collect();
        let loss = |p: &[f64]| {
            let (out, margin) = twin::draw(&twin::project(p, g.len(), 3, &view, &rules), view.size, &rules);
            (out.iter().zip(&bar).map(|(a, b)| a * f64::from(*b)).sum::<f64>(), margin)
        };
        let simd = Simd::best();
        let mut p = Projection::default();
        p.project(simd, &g, &view, &rules, 3).unwrap();
        let features: Vec<[f32; 4]> = p.rgb.iter().zip(&p.footprints).map(|(c, f)| [c[0], c[1], c[2], f.z]).collect();
        let mut raster = Raster::<4>::default();
        raster.draw(simd, (&p.footprints, &features), view.size, &rules).unwrap();
        let mut records = Vec::new();
        raster.backward(simd, (&p.footprints, &features), &rules, &bar, &mut records).unwrap();
        let mut grad = g.clone();
        p.backward(simd, &g, &view, &rules, 3, (&records, Some(3)), &mut grad).unwrap();
        let got = twin::flat(&grad);
        let at = twin::flat(&g);
        let mut worst = (0.0, 0, 0.0, 0.0);
        let scale = got.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for k in 0..at.len() {
            let h = 1e-6;
            let moved = |by: f64| {
                let mut p = at.clone();
                p[k] += by;
                loss(&p).0
            };
            let want = (moved(h) - moved(-h)) / (2.0 * h);
            let error = (got[k] - want).abs() / (1e-3 * scale + want.abs());
            if error > worst.0 {
                worst = (error, k, got[k], want);
            }
        }
        println!("{seed}: {worst:?} of {scale}");
    }
}
