//! The specification, `testkit::reference::splats`, of this crate's types.

use splat_core::{Footprint, Gaussians, Projection, Rules, View, Widening};
use testkit::reference::splats;
pub(crate) use testkit::reference::splats::{Ellipse, Picture};

/// Parameters as one long vector, in the order of `Gaussians::fields`.
pub(crate) fn flat(cloud: &Gaussians) -> Vec<f64> {
    cloud.fields().into_iter().flat_map(|(_, x)| x.iter().map(|&x| f64::from(x))).collect()
}

fn wide(rules: &Rules) -> splats::Rules {
    splats::Rules {
        near: rules.near.into(),
        blur: rules.blur.into(),
        dims: rules.widening == Widening::Dims,
        alpha_min: rules.alpha_min.into(),
        alpha_max: rules.alpha_max.into(),
        stop: rules.stop.into(),
    }
}

pub(crate) fn project(p: &[f64], n: usize, degree: usize, view: &View, rules: &Rules) -> Vec<Ellipse> {
    let camera = splats::Camera {
        r: view.r.map(|row| row.map(f64::from)),
        t: view.t.map(f64::from),
        f: view.f.map(f64::from),
        c: view.c.map(f64::from),
        size: view.size,
    };
    splats::project(p, n, degree, &camera, &wide(rules))
}

/// What the rasteriser was given, in f64: no difference is left but that of compositing.
pub(crate) fn of_footprints(p: &Projection) -> Vec<Ellipse> {
    let ellipse = |(f, rgb): (&Footprint, &[f32; 3])| {
        Ellipse::rounded(f.index as usize, f.uv, f.conic, [f.opacity, f.q_max, f.z], *rgb)
    };
    let mut out: Vec<Ellipse> = p.footprints.iter().zip(&p.rgb).map(ellipse).collect();
    splats::front_to_back(&mut out);
    out
}

/// Light that ellipses in order leave of a pixel.
pub(crate) fn left(ellipses: &[Ellipse], at: [usize; 2], rules: &Rules) -> f64 {
    let values = splats::pixel(ellipses, at, &wide(rules)).values;
    values[values.len() - 1]
}

/// Composite ellipses that are in order.
pub(crate) fn draw(ellipses: &[Ellipse], size: [usize; 2], rules: &Rules) -> Picture {
    splats::draw(ellipses, size, &wide(rules))
}
