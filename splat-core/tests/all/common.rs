//! Clouds, a camera, and one picture with its gradients.

use field_core::rng::Rng;
use float_core::Simd;
use splat_core::{Drawn, Gaussians, Projection, Raster, Record, Rules, View};

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
    pub(crate) drawn: Drawn,
    /// `[5][rows][columns]`
    pub(crate) planes: Vec<f32>,
}

pub(crate) fn shoot(simd: Simd, g: &Gaussians, view: &View, rules: &Rules) -> Shot {
    let mut p = Projection::default();
    p.project(simd, g, view, rules, 3).unwrap();
    let features: Vec<[f32; 4]> = p.rgb.iter().zip(&p.footprints).map(|(c, f)| [c[0], c[1], c[2], f.z]).collect();
    let mut raster = Raster::default();
    let drawn = raster.draw(simd, (&p.footprints, &features), view.size, rules).unwrap();
    let mut planes = vec![f32::NAN; 5 * view.size[0] * view.size[1]];
    raster.planes(&mut planes).unwrap();
    Shot { p, features, raster, drawn, planes }
}

impl Shot {
    /// Depths at which half of the light is left.
    pub(crate) fn middles(&self, simd: Simd, view: &View, rules: &Rules) -> Vec<f32> {
        let mut out = vec![f32::NAN; view.size[0] * view.size[1]];
        self.try_middles(simd, rules, &mut out).unwrap();
        out
    }

    pub(crate) fn try_middles(&self, simd: Simd, rules: &Rules, out: &mut [f32]) -> Result<(), splat_core::SplatError> {
        self.raster.middles(simd, (&self.p.footprints, &self.features), rules, out)
    }

    /// Gradients of ellipses.
    pub(crate) fn records(&mut self, simd: Simd, rules: &Rules, bar: &[f32]) -> Vec<Record<4>> {
        let mut records = Vec::new();
        self.raster.backward(simd, (&self.p.footprints, &self.features), rules, bar, &mut records).unwrap();
        records
    }

    /// Gradients of raw parameters.
    pub(crate) fn gradients(
        &mut self,
        simd: Simd,
        g: &Gaussians,
        view: &View,
        rules: &Rules,
        bar: &[f32],
    ) -> Gaussians {
        let records = self.records(simd, rules, bar);
        let mut grad = g.clone();
        for (_, rows) in grad.fields_mut() {
            rows.fill(f32::NAN);
        }
        self.p.backward(simd, g, view, rules, 3, (&records, Some(3)), &mut grad).unwrap();
        grad
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
