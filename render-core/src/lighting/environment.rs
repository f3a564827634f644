//! Environment maps to lighting.

use super::{C0, C1, C2, C3, C4, COEFFICIENTS, Kind, Lighting};
use crate::error::{RenderError, check_len};
use alloc::vec::Vec;
use core::f64::consts::PI;
use float_core::m64;

/// Lighting of an equirectangular environment map, radiance in **linear** colour.
///
/// The map is `[height][width][3]`. Row 0 touches `+z`, the last row `-z`; column `u` of `width` looks to the azimuth
/// `2 pi (u + 0.5) / width` from `+x` towards `+y`. For other axes, follow with [`Lighting::rotated`].
///
/// Each pixel is integrated over its whole area, in closed form: the solid angles sum to 4 pi exactly and a constant map has a
/// constant lighting at any resolution. Values of pixels are taken as they are; those of high dynamic range may be large.
///
/// # Errors
/// [`RenderError::Shape`] when the map does not hold `height * width * 3` values or holds none, [`RenderError::NonFinite`] for the
/// first value that is NaN or infinite.
///
/// # Source
/// Ramamoorthi and Hanrahan, 2001, eq. 3.
pub fn project_equirect(map: &[f32], width: usize, height: usize) -> Result<Lighting<f64>, RenderError> {
    // More than can be counted is more than the map has.
    let want = width.saturating_mul(height).saturating_mul(3);
    check_len("map", want, map.len())?;
    // It must not be empty.
    check_len("map", want.max(3), map.len())?;
    if let Some(index) = map.iter().position(|x| !x.is_finite()) {
        return Err(RenderError::NonFinite { what: "map", index });
    }
    let columns: Vec<Column> = (0..width).map(|u| Column::new(u, width)).collect();
    let mut lighting = Lighting::dark(Kind::Radiance);
    for (v, pixels) in map.chunks_exact(3 * width).enumerate() {
        let row = Row::new(v, height);
        // Sums of the row over each function of the azimuth, then once each function of the height.
        let mut sums = [[0.0_f64; 3]; 5];
        for (pixel, column) in pixels.chunks_exact(3).zip(&columns) {
            for (sum, c) in sums.iter_mut().zip(column.0) {
                for (sum, &value) in sum.iter_mut().zip(pixel) {
                    *sum += c * f64::from(value);
                }
            }
        }
        for (k, out) in lighting.coefficients.iter_mut().enumerate() {
            let (c, azimuth) = row.0[k];
            for (out, sum) in out.iter_mut().zip(sums[azimuth]) {
                *out += c * sum;
            }
        }
    }
    Ok(lighting)
}

/// Integrals over one column of `1, cos, sin, sin cos, cos^2 - sin^2` of the azimuth.
struct Column([f64; 5]);

impl Column {
    fn new(u: usize, width: usize) -> Self {
        let edge = |u: usize| 2.0 * PI * u as f64 / width as f64;
        let (a, b) = (edge(u), edge(u + 1));
        let ((sin_a, cos_a), (sin_b, cos_b)) = (m64::sin_cos(a), m64::sin_cos(b));
        let (squares, products) = (0.5 * (sin_b * sin_b - sin_a * sin_a), sin_b * cos_b - sin_a * cos_a);
        Self([2.0 * PI / width as f64, sin_b - sin_a, cos_a - cos_b, squares, products])
    }
}

/// Integrals over one row of each basis function's part in the angle from `+z`, with which function of the azimuth goes
/// along.
struct Row([(f64, usize); COEFFICIENTS]);

impl Row {
    fn new(v: usize, height: usize) -> Self {
        let edge = |v: usize| PI * v as f64 / height as f64;
        let (a, b) = (edge(v), edge(v + 1));
        let ((sin_a, cos_a), (sin_b, cos_b)) = (m64::sin_cos(a), m64::sin_cos(b));
        let cube = |x: f64| x * x * x;
        let one = cos_a - cos_b;
        let sin = 0.5 * (b - a - (sin_b * cos_b - sin_a * cos_a));
        let cos = 0.5 * (sin_b * sin_b - sin_a * sin_a);
        let sin_cos = (cube(sin_b) - cube(sin_a)) / 3.0;
        let cos_cos = (cube(cos_a) - cube(cos_b)) / 3.0;
        let sin_sin = one - cos_cos;
        Self([
            (C0 * one, 0),
            (C1 * sin, 2),
            (C1 * cos, 0),
            (C1 * sin, 1),
            (C2 * sin_sin, 3),
            (C2 * sin_cos, 2),
            (C3 * (3.0 * cos_cos - one), 0),
            (C2 * sin_cos, 1),
            (C4 * sin_sin, 4),
        ])
    }
}
