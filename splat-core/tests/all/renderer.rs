//! The facade against the functions that it is made of, and several clouds on one picture against one.

use crate::common::{bars, cloud, reordered, shoot, view};
use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{
    Cloud, Gaussians, GradientOptions, Gradients, Picture, Projection, Raster, RasterSettings, Renderer, SplatError,
    View,
};

const SETTINGS: RasterSettings = RasterSettings::DEFAULT;
const ALL: GradientOptions = GradientOptions::DEFAULT.with_camera(true).with_absolute(true);

/// `[E][n]` numbers for the Gaussians with these indices.
fn extras(e: usize, indices: core::ops::Range<usize>) -> Vec<f32> {
    (0..e).flat_map(|k| indices.clone().map(move |i| Rng::new(77, k as u64).normal_at(i as u64))).collect()
}

fn gradients<const K: usize>(picture: &mut Picture<'_, '_, K>, bar: &[f32], options: GradientOptions) -> Gradients {
    let mut gradients = Gradients::default();
    picture.backward(bar, options, &mut gradients).unwrap();
    gradients
}

#[test]
fn it_gives_the_bits_of_the_functions_below() {
    let (g, view) = (cloud(1, 1500, 2), view([70, 50]));
    let bar = bars(2, view.size);
    for simd in Simd::available() {
        let mut shot = shoot(simd, &g, &view, &SETTINGS);
        let mut renderer = Renderer::<4>::new(SETTINGS).with_simd(simd).with_depth(true);
        // Another picture before leaves nothing behind.
        renderer.render(&[Cloud::new(&cloud(3, 40, 0))], &View { size: [90, 20], ..view }).unwrap();
        let mut picture = renderer.render(&[Cloud::new(&g)], &view).unwrap();
        assert_eq!(picture.planes(), shot.planes);
        assert_eq!(picture.plane(4), &shot.planes[4 * 3500..]);
        assert_eq!((picture.stats(), picture.projected(0)), (shot.drawn, &shot.p.gaussians[..]));
        let mut median = vec![f32::NAN; 3500];
        picture.median_depth(&mut median).unwrap();
        assert_eq!(median, shot.median_depth(simd, &view, &SETTINGS));
        let got = gradients(&mut picture, &bar, ALL);
        let (want, camera) = shot.gradients_with_camera(simd, &g, &view, &SETTINGS, &bar);
        let (projected, absolute) = shot.absolute_gradients(simd, &SETTINGS, &bar);
        assert_eq!(got.clouds[0].gaussians, want);
        assert_eq!(got.camera, Some(camera));
        assert_eq!(got.clouds[0].uv_absolute, absolute);
        assert!(got.clouds[0].uv.iter().zip(&projected).all(|(uv, gradient)| *uv == gradient.uv));
        let less = gradients(&mut picture, &bar, GradientOptions::default());
        assert_eq!(less.clouds[0].gaussians, want);
        assert!(less.camera.is_none() && less.clouds[0].uv_absolute.is_empty());
    }
}

#[test]
fn several_clouds_are_one_cloud_cut_into_pieces() {
    let (g, view, n) = (cloud(5, 400, 2), view([70, 50]), 400);
    let bar = {
        let mut bar = vec![0.0; 7 * 3500];
        Rng::new(8, 8).fill_normal(0, &mut bar);
        bar
    };
    // Depth and two extras; one piece is empty.
    for simd in Simd::available() {
        let whole_extras = extras(2, 0..n);
        let mut renderer = Renderer::<6>::new(SETTINGS).with_simd(simd).with_depth(true);
        let (planes, whole) = {
            let mut picture = renderer.render(&[Cloud::new(&g).with_extras(&whole_extras)], &view).unwrap();
            (picture.planes().to_vec(), gradients(&mut picture, &bar, ALL))
        };
        let cuts = [0..150, 150..150, 150..399, 399..400];
        let parts = cuts.clone().map(|cut| (reordered(&g, &cut.clone().collect::<Vec<_>>()), extras(2, cut)));
        let clouds: Vec<Cloud<'_>> = parts.iter().map(|(g, extras)| Cloud::new(g).with_extras(extras)).collect();
        let mut picture = renderer.render(&clouds, &view).unwrap();
        assert_eq!(picture.planes(), planes);
        let got = gradients(&mut picture, &bar, ALL);
        assert_eq!(got.clouds.len(), 4);
        let mut seen = 0;
        for (cloud, cut) in got.clouds.iter().zip(cuts) {
            assert_eq!(cloud.gaussians, reordered(&whole.clouds[0].gaussians, &cut.clone().collect::<Vec<_>>()));
            for e in 0..2 {
                let want = &whole.clouds[0].extras[e * n..][cut.clone()];
                assert_eq!(&cloud.extras[e * cut.len()..][..cut.len()], want);
                assert!(cut.is_empty() || cut.len() == 1 || want.iter().any(|x| *x != 0.0));
            }
            assert_eq!(cloud.uv, &whole.clouds[0].uv[seen..][..cloud.uv.len()]);
            assert_eq!(cloud.uv_absolute, &whole.clouds[0].uv_absolute[seen..][..cloud.uv.len()]);
            seen += cloud.uv.len();
        }
        assert_eq!(seen, whole.clouds[0].uv.len());
        // Summed in another order.
        let (a, b) = (got.camera.unwrap(), whole.camera.unwrap());
        for (a, b) in a.xi.iter().chain(&a.f).chain(&a.c).zip(b.xi.iter().chain(&b.f).chain(&b.c)) {
            assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} and {b}");
        }
    }
}

#[test]
fn extras_are_composited_as_features_and_have_their_gradient() {
    let (g, view, n) = (cloud(6, 60, 0), view([33, 20]), 60);
    let own = extras(3, 0..n);
    let mut bar = vec![0.0; 7 * 660];
    Rng::new(9, 9).fill_normal(0, &mut bar);
    let simd = Simd::best();
    let mut renderer = Renderer::<6>::new(SETTINGS);
    assert_eq!(renderer.extras(), 3);
    let mut picture = renderer.render(&[Cloud::new(&g).with_extras(&own)], &view).unwrap();
    let mut p = Projection::default();
    p.project(simd, &g, &view, &SETTINGS, 0).unwrap();
    let features: Vec<[f32; 6]> = p
        .gaussians
        .iter()
        .zip(&p.rgb)
        .map(|(f, rgb)| {
            let x = |e: usize| own[e * n + f.index as usize];
            [rgb[0], rgb[1], rgb[2], x(0), x(1), x(2)]
        })
        .collect();
    let mut raster = Raster::<6>::default();
    raster.draw(simd, &p.gaussians, &features, view.size, &SETTINGS).unwrap();
    let (mut planes, mut want) = (vec![0.0; 7 * 660], Vec::new());
    raster.planes(&mut planes).unwrap();
    raster.backward(simd, &p.gaussians, &features, &SETTINGS, &bar, &mut want).unwrap();
    assert_eq!(picture.planes(), planes);
    let got = gradients(&mut picture, &bar, GradientOptions::default());
    let mut left = got.clouds[0].extras.clone();
    for (f, gradient) in p.gaussians.iter().zip(&want) {
        for e in 0..3 {
            let x = &mut left[e * n + f.index as usize];
            assert_eq!(*x, gradient.features[3 + e]);
            *x = 0.0;
        }
    }
    assert!(left.iter().all(|x| *x == 0.0), "one that is not visible has no gradient");
}

#[test]
fn nothing_and_wrong_inputs() {
    let view = view([20, 20]);
    let g = cloud(1, 5, 1);
    let mut renderer = Renderer::<4>::new(SETTINGS);
    let mut picture = renderer.render(&[], &view).unwrap();
    assert!(picture.plane(4).iter().all(|t| *t == 1.0) && picture.plane(0).iter().all(|c| *c == 0.0));
    let mut out = Gradients::default();
    picture.backward(&vec![1.0; 5 * 400], ALL, &mut out).unwrap();
    assert!(out.clouds.is_empty());
    let refused = picture.backward(&[1.0; 7], ALL, &mut out);
    assert_eq!(refused, Err(SplatError::Shape { what: "planes_bar", want: 2000, got: 7 }));
    let refused =
        |renderer: &mut Renderer<4>, cloud, view: &View| renderer.render(&[cloud], view).map(|_| ()).unwrap_err();
    let cloud = Cloud::new(&g);
    assert_eq!(refused(&mut renderer, cloud, &view), SplatError::Shape { what: "extras", want: 5, got: 0 });
    let bad = View { f: [-1.0; 2], ..view };
    assert!(matches!(refused(&mut renderer, cloud, &bad), SplatError::Value { what: "view.f", .. }));
    let mut colours = Renderer::<3>::new(SETTINGS).with_depth(true);
    let refused = colours.render(&[cloud], &view).map(|_| ()).unwrap_err();
    assert_eq!(refused, SplatError::Shape { what: "features", want: 4, got: 3 });
    // Of a lower degree.
    let mut renderer = Renderer::<3>::new(SETTINGS);
    let low = renderer.render(&[cloud.with_degree(0)], &view).unwrap().planes().to_vec();
    let mut flat = g.clone();
    flat.rest.fill(0.0);
    assert_eq!(low, renderer.render(&[Cloud::new(&flat).with_degree(0)], &view).unwrap().planes());
    let mut broken = Gaussians::new(2, 0).unwrap();
    broken.logit.pop();
    assert!(renderer.render(&[Cloud::new(&broken)], &view).is_err());
}
