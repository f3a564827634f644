//! Proofs of `splat-core`.

use alloc::vec::Vec;

use crate::wrong::{Wrong, near};
use field_core::rng::Rng;
use float_core::{Simd, m64};
use splat_core::density::{Adc, relocation};
use splat_core::{Gaussians, Projection, Raster, RasterSettings, SplatError, View};

fn refused(_: SplatError) -> Wrong {
    Wrong { what: "splats", got: f64::NAN, want: 0.0 }
}

/// Two Gaussians on the axis of a camera at the origin, 2 and 4 units away, as large as a quarter and half a unit, half opaque.
fn cloud() -> Result<Gaussians, Wrong> {
    let mut cloud = Gaussians::new(2, 0).map_err(refused)?;
    cloud.mean[4..].copy_from_slice(&[2.0, 4.0]);
    for row in cloud.log_scale.chunks_exact_mut(2) {
        row.copy_from_slice(&[-2.0 * core::f32::consts::LN_2, -core::f32::consts::LN_2]);
    }
    // The first is red.
    cloud.dc[0] = 1.0;
    Ok(cloud)
}

const VIEW: View = View {
    r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    t: [0.0; 3],
    f: [20.0; 2],
    c: [8.5; 2],
    size: [17, 17],
};
/// The pixel whose centre is on the axis, and all pixels.
const MIDDLE: usize = 8 * 17 + 8;
const PIXELS: usize = 17 * 17;

/// Ellipses, their colours, and the picture `[4][PIXELS]`.
type Shot = (Projection, Raster<3>, Vec<f32>);

fn shoot(cloud: &Gaussians) -> Result<Shot, Wrong> {
    let simd = Simd::best();
    let mut projection = Projection::default();
    projection.project(simd, cloud, &VIEW, &RasterSettings::DEFAULT, 0).map_err(refused)?;
    let mut raster = Raster::default();
    raster.draw(simd, &projection.gaussians, &projection.rgb, VIEW.size, &RasterSettings::DEFAULT).map_err(refused)?;
    let mut planes = alloc::vec![0.0; 4 * PIXELS];
    raster.planes(&mut planes).map_err(refused)?;
    Ok((projection, raster, planes))
}

/// The middle sees half of the first and a quarter of the second; a deviation is 2.5 pixels, and the blur.
pub(crate) fn picture() -> Result<(), Wrong> {
    let (projection, _, planes) = shoot(&cloud()?)?;
    let [a, b, c] = projection.gaussians[0].conic;
    near("conic a", a, 1.0 / 6.55, 1e-6)?;
    near("conic b", b, 0.0, 1e-6)?;
    near("conic c", c, 1.0 / 6.55, 1e-6)?;
    near("red", planes[MIDDLE], 0.5 * (0.5 + 0.282_094_79) + 0.25 * 0.5, 1e-6)?;
    near("green", planes[PIXELS + MIDDLE], 0.75 * 0.5, 1e-6)?;
    near("light left", planes[3 * PIXELS + MIDDLE], 0.25, 1e-6)?;
    let alpha = 0.5 * m64::exp(-0.5 * 9.0 / 6.55);
    near("light left three pixels away", planes[3 * PIXELS + MIDDLE + 3], (1.0 - alpha) * (1.0 - alpha), 1e-6)
}

/// Of the red in the middle: `d/d logit = o (1 - o) d/d o`, `d/d dc = SH_0 w`; nothing moves it along x, by symmetry.
pub(crate) fn gradients() -> Result<(), Wrong> {
    let cloud = cloud()?;
    let (projection, mut raster, _) = shoot(&cloud)?;
    let mut bar = alloc::vec![0.0; 4 * PIXELS];
    bar[MIDDLE] = 1.0;
    let (simd, mut records, mut grad) = (Simd::best(), Vec::new(), cloud.clone());
    raster
        .backward(simd, &projection.gaussians, &projection.rgb, &RasterSettings::DEFAULT, &bar, &mut records)
        .map_err(refused)?;
    projection
        .backward(simd, &cloud, &VIEW, &RasterSettings::DEFAULT, 0, &records, None, &mut grad)
        .map_err(refused)?;
    near("dc of the first", grad.dc[0], 0.282_094_79 * 0.5, 1e-6)?;
    near("dc of the second", grad.dc[1], 0.282_094_79 * 0.25, 1e-6)?;
    near("logit of the first", grad.logit[0], 0.25 * (0.5 + 0.282_094_79 - 0.5 * 0.5), 1e-6)?;
    near("logit of the second", grad.logit[1], 0.25 * 0.5 * 0.5, 1e-6)?;
    near("x of the first", grad.mean[0], 0.0, 1e-6)
}

/// The first has a large view-space gradient and splits; two that replace one of opacity 1/2.
pub(crate) fn density() -> Result<(), Wrong> {
    let cloud = cloud()?;
    let grown = Adc::DEFAULT.grow(&cloud, &[1.0, 0.0], 1.0, 100, Rng::new(1, 2)).map_err(refused)?;
    near("Gaussians", grown.cloud.len() as f64, 3.0, 0.0)?;
    near("size of a child", m64::exp(grown.cloud.log_scale[1].into()), 0.25 / 1.6, 1e-6)?;
    let (each, factor) = relocation(0.5, 2);
    near("opacity of each", each, 1.0 - core::f64::consts::FRAC_1_SQRT_2, 1e-12)?;
    near("their size", factor, 0.952_153, 1e-6)
}
