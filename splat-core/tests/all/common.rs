//! Clouds, a camera, and one picture with its gradients.

use float_core::Simd;
use float_core::rng::Rng;
use splat_core::{CameraGradient, DrawStats, Gaussians, ProjectedGradient, Projection, Raster, RasterSettings, View};

/// Gaussians like any other, about the origin.
pub(crate) fn cloud(seed: u64, n: usize, degree: usize) -> Gaussians {
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

/// From three units away, turned a little, its axis beside the middle.
pub(crate) fn view(size: [usize; 2]) -> View {
    let (s, c) = 0.3_f64.sin_cos();
    let f = 0.9 * size[0].max(8) as f64;
    View::from_c2w(
        [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
        [-3.0 * s, 0.1, -3.0 * c],
        [f, 1.1 * f],
        [0.47 * size[0] as f64, 0.55 * size[1] as f64],
        size,
    )
}

/// A picture of colours and depths.
pub(crate) struct Shot {
    pub(crate) p: Projection,
    pub(crate) features: Vec<[f32; 4]>,
    raster: Raster<4>,
    pub(crate) drawn: DrawStats,
    /// `[5][rows][columns]`
    pub(crate) planes: Vec<f32>,
}

pub(crate) fn shoot(simd: Simd, g: &Gaussians, view: &View, settings: &RasterSettings) -> Shot {
    let mut p = Projection::default();
    p.project(simd, g, view, settings, 3).unwrap();
    let features: Vec<[f32; 4]> = p.rgb.iter().zip(&p.gaussians).map(|(c, f)| [c[0], c[1], c[2], f.z]).collect();
    let mut raster = Raster::default();
    let drawn = raster.draw(simd, &p.gaussians, &features, view.size, settings).unwrap();
    let mut planes = vec![f32::NAN; 5 * view.size[0] * view.size[1]];
    raster.planes(&mut planes).unwrap();
    Shot { p, features, raster, drawn, planes }
}

impl Shot {
    /// Depths at which half of the light is left.
    pub(crate) fn median_depth(&self, simd: Simd, view: &View, settings: &RasterSettings) -> Vec<f32> {
        let mut out = vec![f32::NAN; view.size[0] * view.size[1]];
        self.try_median_depth(simd, settings, &mut out).unwrap();
        out
    }

    pub(crate) fn try_median_depth(
        &self,
        simd: Simd,
        settings: &RasterSettings,
        out: &mut [f32],
    ) -> Result<(), splat_core::SplatError> {
        self.raster.median_depth(simd, &self.p.gaussians, &self.features, settings, out)
    }

    /// Gradients of ellipses.
    pub(crate) fn projected_gradients(
        &mut self,
        simd: Simd,
        settings: &RasterSettings,
        bar: &[f32],
    ) -> Vec<ProjectedGradient<4>> {
        let mut gradients = Vec::new();
        self.raster.backward(simd, &self.p.gaussians, &self.features, settings, bar, &mut gradients).unwrap();
        gradients
    }

    /// Gradients of ellipses, and absolute ones of their centres.
    pub(crate) fn absolute_gradients(
        &mut self,
        simd: Simd,
        settings: &RasterSettings,
        bar: &[f32],
    ) -> (Vec<ProjectedGradient<4>>, Vec<[f32; 2]>) {
        let (mut gradients, mut absolute) = (Vec::new(), vec![[f32::NAN; 2]; 3]);
        self.raster
            .backward_absolute(simd, &self.p.gaussians, &self.features, settings, bar, &mut gradients, &mut absolute)
            .unwrap();
        (gradients, absolute)
    }

    /// Gradients of raw parameters.
    pub(crate) fn gradients(
        &mut self,
        simd: Simd,
        g: &Gaussians,
        view: &View,
        settings: &RasterSettings,
        bar: &[f32],
    ) -> Gaussians {
        let gradients = self.projected_gradients(simd, settings, bar);
        let mut grad = g.clone();
        for (_, rows) in grad.fields_mut() {
            rows.fill(f32::NAN);
        }
        self.p.backward(simd, g, view, settings, 3, &gradients, Some(3), &mut grad).unwrap();
        grad
    }
}

impl Shot {
    /// Gradients of raw parameters and of the camera.
    pub(crate) fn gradients_with_camera(
        &mut self,
        simd: Simd,
        g: &Gaussians,
        view: &View,
        settings: &RasterSettings,
        bar: &[f32],
    ) -> (Gaussians, CameraGradient) {
        let gradients = self.projected_gradients(simd, settings, bar);
        let mut grad = g.clone();
        for (_, rows) in grad.fields_mut() {
            rows.fill(f32::NAN);
        }
        let camera = self.p.backward_with_camera(simd, g, view, settings, 3, &gradients, Some(3), &mut grad).unwrap();
        (grad, camera)
    }
}

/// Gradients of a picture, all different.
pub(crate) fn bars(seed: u64, [w, h]: [usize; 2]) -> Vec<f32> {
    let mut bar = vec![0.0; 5 * w * h];
    Rng::new(seed, 9).fill_normal(0, &mut bar);
    bar
}

/// The same Gaussians in another order: row `i` is row `order[i]` of before.
pub(crate) fn reordered(g: &Gaussians, order: &[usize]) -> Gaussians {
    let mut out = Gaussians::new(order.len(), g.degree()).unwrap();
    let n = g.len();
    for ((_, to), (_, from)) in out.fields_mut().into_iter().zip(g.fields()) {
        for (to, from) in to.chunks_exact_mut(order.len().max(1)).zip(from.chunks_exact(n)) {
            for (to, &i) in to.iter_mut().zip(order) {
                *to = from[i];
            }
        }
    }
    out
}

/// Clouds beside the picture of [`view`]`([21, 18])` on all sides, large enough to reach into it: there the Jacobian is clamped.
pub(crate) fn beside_the_picture(view: &View) -> impl Iterator<Item = (usize, Gaussians)> {
    let places = [[2.2, 0.2], [-2.2, -0.3], [0.4, 2.0], [-0.3, -2.2], [2.0, 1.8]];
    places.into_iter().enumerate().map(|(k, [x, y])| {
        let mut g = cloud(k as u64, 3, 1);
        for i in 0..3 {
            // Camera axes: world = r^T (camera - t).
            let camera = [x + 0.1 * i as f32, y, 2.0 + 0.5 * i as f32];
            for a in 0..3 {
                g.mean[a * 3 + i] = (0..3).map(|b| view.r[b][a] * (camera[b] - view.t[b])).sum();
                g.log_scale[a * 3 + i] += 1.4;
            }
        }
        (k, g)
    })
}
