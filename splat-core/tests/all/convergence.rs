//! Gaussians that were moved away from a picture find back to it.

use float_core::Simd;
use float_core::rng::Rng;
use optim::{Adam, AdamConfig};
use splat_core::{Gaussians, Projection, Raster, RasterSettings, View, Widening};

const SIZE: [usize; 2] = [64, 64];
const PIXELS: usize = 64 * 64;

/// Five that overlap, of different shapes and colours, four units in front of the camera.
fn truth() -> (Gaussians, View) {
    let mut g = Gaussians::new(5, 1).unwrap();
    let means = [[-0.8, -0.6, 4.0], [0.7, -0.7, 4.4], [0.0, 0.1, 3.6], [-0.6, 0.8, 4.2], [0.9, 0.6, 3.9]];
    let sizes = [[0.3, 0.15, 0.2], [0.2, 0.35, 0.1], [0.4, 0.12, 0.25], [0.15, 0.3, 0.3], [0.25, 0.2, 0.4]];
    let colours = [[1.2, -1.0, -1.0], [-1.0, 1.0, -0.8], [1.0, 1.1, -1.2], [-1.0, -0.6, 1.3], [0.9, -0.9, 1.0]];
    for i in 0..5 {
        for k in 0..3 {
            g.mean[5 * k + i] = means[i][k];
            g.log_scale[5 * k + i] = f32::ln(sizes[i][k]);
            g.dc[5 * k + i] = colours[i][k];
        }
        g.logit[i] = 0.5 + 0.4 * i as f32;
    }
    Rng::new(1, 0).fill_normal(0, &mut g.wxyz);
    Rng::new(1, 1).fill_normal(0, &mut g.rest);
    g.rest.iter_mut().for_each(|x| *x *= 0.1);
    let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    (g, View { r, t: [0.0; 3], f: [70.0; 2], c: [32.0; 2], size: SIZE })
}

/// Where each number of a cloud is moved to, in the order of its fields: a step that shows.
const MOVES: [f32; 6] = [0.08, 0.25, 0.2, 0.4, 0.3, 0.05];
/// Rates of its fields.
const RATES: [f64; 6] = [4e-3, 1e-2, 1e-2, 3e-2, 1e-2, 3e-3];

/// Decibels after `steps` steps of Adam, the rates falling to a hundredth; and before.
fn fit(simd: Simd, settings: &RasterSettings, steps: u32) -> [f64; 2] {
    let (want, view) = truth();
    let shot = |g: &Gaussians, p: &mut Projection, raster: &mut Raster<3>, planes: &mut [f32]| {
        p.project(simd, g, &view, settings, 1).unwrap();
        raster.draw(simd, &p.gaussians, &p.rgb, SIZE, settings).unwrap();
        raster.planes(planes).unwrap();
    };
    let (mut p, mut raster) = (Projection::default(), Raster::default());
    let (mut target, mut planes) = (vec![0.0; 4 * PIXELS], vec![0.0; 4 * PIXELS]);
    shot(&want, &mut p, &mut raster, &mut target);

    let mut g = want.clone();
    for (k, (_, rows)) in g.fields_mut().into_iter().enumerate() {
        let rng = Rng::new(2, k as u64);
        rows.iter_mut().enumerate().for_each(|(i, x)| *x += MOVES[k] * rng.normal_at(i as u64));
    }
    let mut adams = g.fields().map(|(_, rows)| Adam::new(rows.len(), AdamConfig::DEFAULT.with_eps(1e-15)));
    let (mut grad, mut gradients) = (g.clone(), Vec::new());
    let mut decibels = [0.0; 2];
    for step in 0..=steps {
        shot(&g, &mut p, &mut raster, &mut planes);
        // Colours over black.
        let mut bar: Vec<f32> = planes[..3 * PIXELS].iter().zip(&target).map(|(a, b)| a - b).collect();
        let mse = bar.iter().map(|e| f64::from(*e).powi(2)).sum::<f64>() / bar.len() as f64;
        decibels[usize::from(step > 0)] = -10.0 * mse.log10();
        bar.resize(4 * PIXELS, 0.0);
        raster.backward(simd, &p.gaussians, &p.rgb, settings, &bar, &mut gradients).unwrap();
        p.backward(simd, &g, &view, settings, 1, &gradients, None, &mut grad).unwrap();
        let fall = 0.01_f64.powf(f64::from(step) / f64::from(steps));
        for (((_, x), (_, x_bar)), (adam, rate)) in
            g.fields_mut().into_iter().zip(grad.fields()).zip(adams.iter_mut().zip(RATES))
        {
            assert_eq!(adam.step(simd, rate * fall, x, x_bar), 0, "a gradient is not finite");
        }
    }
    decibels
}

#[test]
fn five_gaussians_find_back_to_their_picture() {
    for widening in [Widening::Keeps, Widening::Dims] {
        let settings = RasterSettings::DEFAULT.with_widening(widening);
        for simd in Simd::available() {
            let [before, after] = fit(simd, &settings, 600);
            println!("{widening:?} {:?}: {before:.1} dB before, {after:.1} dB after", simd.level());
            assert!(before < 25.0, "{before} dB: nothing to find back from");
            assert!(after > 40.0, "{after} dB");
        }
    }
}
