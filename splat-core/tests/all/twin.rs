//! The specification, `testkit::reference::splats`, of this crate's types.

use splat_core::{Gaussians, ProjectedGaussian, Projection, RasterSettings, View, Widening};
use testkit::reference::splats;
pub(crate) use testkit::reference::splats::{Camera, Ellipse, Picture};

/// Parameters as one long vector, in the order of `Gaussians::fields`.
pub(crate) fn flat(cloud: &Gaussians) -> Vec<f64> {
    cloud.fields().into_iter().flat_map(|(_, x)| x.iter().map(|&x| f64::from(x))).collect()
}

fn wide(settings: &RasterSettings) -> splats::Rules {
    splats::Rules {
        near: settings.near.into(),
        blur: settings.blur.into(),
        dims: settings.widening == Widening::Dims,
        alpha_min: settings.alpha_min.into(),
        alpha_max: settings.alpha_max.into(),
        stop: settings.transmittance_min.into(),
    }
}

pub(crate) fn project(p: &[f64], n: usize, degree: usize, view: &View, settings: &RasterSettings) -> Vec<Ellipse> {
    project_by(p, n, degree, &camera(view), settings)
}

pub(crate) fn camera(view: &View) -> Camera {
    Camera {
        r: view.r.map(|row| row.map(f64::from)),
        t: view.t.map(f64::from),
        f: view.f.map(f64::from),
        c: view.c.map(f64::from),
        size: view.size,
    }
}

pub(crate) fn project_by(
    p: &[f64],
    n: usize,
    degree: usize,
    camera: &Camera,
    settings: &RasterSettings,
) -> Vec<Ellipse> {
    splats::project(p, n, degree, camera, &wide(settings))
}

/// What the rasteriser was given, in f64: no difference is left but that of compositing.
pub(crate) fn of_projected(p: &Projection) -> Vec<Ellipse> {
    let ellipse = |(f, rgb): (&ProjectedGaussian, &[f32; 3])| {
        Ellipse::rounded(f.index as usize, f.uv, f.conic, [f.opacity, f.q_max, f.z], *rgb)
    };
    let mut out: Vec<Ellipse> = p.gaussians.iter().zip(&p.rgb).map(ellipse).collect();
    splats::front_to_back(&mut out);
    out
}

/// Light that ellipses in order leave of a pixel.
pub(crate) fn left(ellipses: &[Ellipse], at: [usize; 2], settings: &RasterSettings) -> f64 {
    let values = splats::pixel(ellipses, at, &wide(settings)).values;
    values[values.len() - 1]
}

/// Composite ellipses that are in order.
pub(crate) fn draw(ellipses: &[Ellipse], size: [usize; 2], settings: &RasterSettings) -> Picture {
    splats::draw(ellipses, size, &wide(settings))
}

/// Gradient with respect to a centre: the sum over pixels, and that of absolute values.
#[derive(Clone, Copy, Default)]
pub(crate) struct UvGradient {
    pub(crate) plain: [f64; 2],
    pub(crate) absolute: [f64; 2],
}

/// Gradients with respect to the centres of ellipses in order, of `<bar, planes>`: each pixel alone.
pub(crate) fn uv_gradients(
    ellipses: &[Ellipse],
    [w, h]: [usize; 2],
    settings: &RasterSettings,
    bar: &[f32],
) -> Vec<UvGradient> {
    let mut out = vec![UvGradient::default(); ellipses.len()];
    for i in 0..w * h {
        let mut bars = vec![splats::EllipseBar::default(); ellipses.len()];
        let of_pixel = core::array::from_fn(|k| f64::from(bar[k * w * h + i]));
        splats::pixel_backward(ellipses, [i % w, i / w], &wide(settings), of_pixel, &mut bars);
        for (out, bar) in out.iter_mut().zip(&bars) {
            for axis in 0..2 {
                out.plain[axis] += bar.uv[axis];
                out.absolute[axis] += bar.uv[axis].abs();
            }
        }
    }
    out
}
