//! Splats make the same bits with any number of threads: pictures, gradients, density control.

use field_core::rng::Rng;
use float_core::Simd;
use splat_core::density::{Adc, Mcmc, keep_strongest, without_non_finite};
use splat_core::{
    Cloud, Gaussians, GradientOptions, Gradients, ProjectedGradient, Projection, Raster, RasterSettings, Renderer, View,
};

const SIZE: [usize; 2] = [150, 90];

/// More than three chunks of a thousand.
fn cloud() -> Gaussians {
    let mut g = Gaussians::new(3500, 2).unwrap();
    for (k, (_, rows)) in g.fields_mut().into_iter().enumerate() {
        Rng::new(1, k as u64).fill_normal(0, rows);
    }
    g.log_scale.iter_mut().for_each(|x| *x = 0.5 * *x - 3.0);
    g.logit.iter_mut().for_each(|x| *x = 3.0 * *x - 2.0);
    g
}

/// Everything, as bits.
fn all() -> Vec<u32> {
    let (mut g, simd, rules, rng) = (cloud(), Simd::best(), RasterSettings::DEFAULT, Rng::new(3, 4));
    let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let view = View::from_c2w(one, [0.0, 0.0, -3.0], [120.0; 2], [75.0, 45.0], SIZE);
    let mut p = Projection::default();
    p.project(simd, &g, &view, &rules, 2).unwrap();
    let mut raster = Raster::<3>::default();
    raster.draw(simd, &p.gaussians, &p.rgb, SIZE, &rules).unwrap();
    let mut planes = vec![0.0; 4 * SIZE[0] * SIZE[1]];
    raster.planes(&mut planes).unwrap();
    let mut bar = vec![0.0; planes.len()];
    rng.fill_normal(0, &mut bar);
    let (mut records, mut grad) = (Vec::new(), g.clone());
    raster.backward(simd, &p.gaussians, &p.rgb, &rules, &bar, &mut records).unwrap();
    p.backward(simd, &g, &view, &rules, 2, &records, None, &mut grad).unwrap();
    let mcmc = Mcmc::DEFAULT;
    let loss = mcmc.regularise(&g, &mut grad).unwrap();
    mcmc.add_noise(&mut g, 1e-3, rng).unwrap();
    g.dc[5] = f32::NAN;
    let clean = without_non_finite(&g).unwrap().expect("one was broken").follow(&g).unwrap();
    let pull: Vec<f32> = (0..clean.len()).map(|i| 1e-3 * rng.uniform_at(i as u64)).collect();
    let grown = Adc::DEFAULT.grow(&clean, &pull, 3.0, 5000, rng).unwrap().cloud;
    let moved = mcmc.relocate(&grown, rng).unwrap().cloud;
    let added = mcmc.add(&moved, 6000, rng).unwrap().cloud;
    let last = keep_strongest(&added, 4000, rng).unwrap().follow(&added).unwrap();
    let (some, many) = (features::<17>(&p), features::<40>(&p));
    let facade = facade(&last, &view);
    let floats = [&grad, &last].into_iter().flat_map(|g| g.fields().into_iter().flat_map(|(_, x)| x.to_vec()));
    let bits = planes.into_iter().chain(floats).chain(some).chain(many).map(f32::to_bits);
    bits.chain([(loss.to_bits() >> 32) as u32, loss.to_bits() as u32]).chain(facade).collect()
}

/// Two clouds on one picture, with gradients of the camera and absolute ones.
fn facade(g: &Gaussians, view: &View) -> Vec<u32> {
    let (mut renderer, other) = (Renderer::<4>::new(RasterSettings::DEFAULT).with_depth(true), cloud());
    let mut picture = renderer.render(&[Cloud::new(g), Cloud::new(&other)], view).unwrap();
    let mut bar = vec![0.0; picture.planes().len()];
    Rng::new(7, 8).fill_normal(0, &mut bar);
    let (mut gradients, options) =
        (Gradients::default(), GradientOptions::DEFAULT.with_camera(true).with_absolute(true));
    picture.backward(&bar, options, &mut gradients).unwrap();
    let camera = gradients.camera.expect("asked for");
    assert!(camera.xi.iter().all(|x| x.is_finite() && *x != 0.0));
    let camera = camera.xi.into_iter().chain(camera.f).chain(camera.c).map(f64::to_bits);
    let camera = camera.flat_map(|bits| [(bits >> 32) as u32, bits as u32]);
    let clouds = gradients.clouds.iter().flat_map(|cloud| {
        let numbers = cloud.gaussians.fields().into_iter().flat_map(|(_, x)| x.to_vec());
        numbers.chain(cloud.uv.iter().chain(&cloud.uv_absolute).flatten().copied()).collect::<Vec<_>>()
    });
    picture.planes().iter().copied().chain(clouds).map(f32::to_bits).chain(camera).collect()
}

/// Planes and gradients of a picture with `K` features.
fn features<const K: usize>(p: &Projection) -> Vec<f32> {
    let of = |i: u32| -> [f32; K] { std::array::from_fn(|k| Rng::new(i.into(), k as u64).normal_at(0)) };
    let features: Vec<[f32; K]> = p.gaussians.iter().map(|f| of(f.index)).collect();
    let (mut raster, simd, rules) = (Raster::<K>::default(), Simd::best(), RasterSettings::DEFAULT);
    raster.draw(simd, &p.gaussians, &features, SIZE, &rules).unwrap();
    let mut planes = vec![0.0; (K + 1) * SIZE[0] * SIZE[1]];
    raster.planes(&mut planes).unwrap();
    let (mut bar, mut records) = (vec![0.0; planes.len()], Vec::new());
    Rng::new(5, 6).fill_normal(0, &mut bar);
    raster.backward(simd, &p.gaussians, &features, &rules, &bar, &mut records).unwrap();
    let numbers = |r: &ProjectedGradient<K>| {
        r.uv.into_iter().chain(r.conic).chain([r.opacity]).chain(r.features).collect::<Vec<_>>()
    };
    planes.into_iter().chain(records.iter().flat_map(numbers)).collect()
}

#[test]
fn splats_are_the_same_bits_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads");
        pool.install(all)
    };
    let one = on(1);
    assert!(one.iter().any(|&x| x != 0));
    for threads in [2, 7] {
        assert!(on(threads) == one, "{threads} threads");
    }
}
