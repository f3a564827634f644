//! The specification, `testkit::reference::splats`, of this crate's types.
#![allow(dead_code, reason = "each test takes what it needs")]

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
    let ellipse = |f: &Footprint, rgb: &[f32; 3]| {
        let conic = f.conic.map(f64::from);
        let det = conic[0] * conic[2] - conic[1] * conic[1];
        Ellipse {
            index: f.index as usize,
            uv: f.uv.map(f64::from),
            cov: [conic[2] / det, -conic[1] / det, conic[0] / det],
            conic,
            opacity: f64::from(f.opacity),
            q_max: f64::from(f.q_max),
            z: f64::from(f.z),
            rgb: rgb.map(f64::from),
        }
    };
    let mut out: Vec<Ellipse> = p.footprints.iter().zip(&p.rgb).map(|(f, rgb)| ellipse(f, rgb)).collect();
    out.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.index.cmp(&b.index)));
    out
}

/// Composite ellipses that are in order.
pub(crate) fn draw(ellipses: &[Ellipse], size: [usize; 2], rules: &Rules) -> Picture {
    splats::draw(ellipses, size, &wide(rules))
}
