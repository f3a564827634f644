//! Proofs of `render-core`.

use crate::wrong::{Wrong, near};
use float_core::Simd;
use render_core::camera::{Camera, Lens, Pose};
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};

/// A pixel's ray projects to the pixel, through a fisheye lens.
pub(crate) fn camera() -> Result<(), Wrong> {
    let pose = Pose::IDENTITY;
    let straight = Camera::pinhole(640, 480, 300.0, 310.0, 320.0, 240.0, pose);
    let camera = Camera { lens: Lens::Fisheye { k: [0.02, -0.01, 0.003, 0.0] }, ..straight };
    let lost = |what| Wrong { what, got: f64::NAN, want: 0.0 };
    let ray = camera.ray((100.5, 400.5).into()).ok_or(lost("ray"))?;
    let pixel = camera.project(ray.o + 3.0 * ray.d).ok_or(lost("projection"))?;
    near("column", pixel.x, 100.5, 1e-9)?;
    near("row", pixel.y, 400.5, 1e-9)
}

/// Two intervals that each take half of what arrives: weights 1/2 and 1/4, and 1/4 of the background.
pub(crate) fn quadrature() -> Result<(), Wrong> {
    const HALF: f32 = core::f32::consts::LN_2;
    let samples = Samples { offsets: &[0, 2], tau: &[HALF, HALF], last: LastInterval::Finite };
    let values = Values { data: &[1.0, 0.6], stride: 2, channels: 1 };
    let (mut colour, mut opacity, mut w, mut trans_end) = ([0.0], [0.0], [0.0; 2], [0.0]);
    let out = Composite { colour: &mut colour, opacity: &mut opacity, w: &mut w, trans_end: &mut trans_end };
    composite(Simd::best(), samples, values, &[0.2], out);
    near("colour", colour[0], 0.5 + 0.25 * 0.6 + 0.25 * 0.2, 1e-6)?;
    near("opacity", opacity[0], 0.75, 1e-6)?;

    let (mut tau_bar, mut values_bar, mut background_bar) = ([0.0; 2], [0.0; 2], [0.0]);
    composite_backward(
        Simd::best(),
        samples,
        values,
        &[0.2],
        Weights { w: &w, trans_end: &trans_end },
        CompositeBar { colour: &[1.0], w: None, trans_end: None },
        CompositeGrads { tau: &mut tau_bar, values: &mut values_bar, background: Some(&mut background_bar) },
    );
    // More of the first interval: what it shows comes in, what lies behind it fades.
    near("tau_bar[0]", tau_bar[0], 0.5 - 0.25 * 0.6 - 0.25 * 0.2, 1e-6)?;
    near("tau_bar[1]", tau_bar[1], 0.25 * (0.6 - 0.2), 1e-6)?;
    near("values_bar[1]", values_bar[1], 0.25, 1e-6)?;
    near("background_bar", background_bar[0], 0.25, 1e-6)
}
