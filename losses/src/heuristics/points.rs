//! What feature tracks say: a point that many photos agree on stands still, and so does what it belongs to.

use super::extent::Extent;
use crate::LossError;
use float_core::m64;

/// The shortest track that counts among `images` photos: `max(2, ceil(t_sfm images))`.
///
/// `t_sfm` share of the photos that have to see a point, usually 0.01 to 0.2. Less than two photos see nothing stand still.
///
/// # Errors
/// [`LossError::Parameter`] for a share outside `[0, 1]`.
pub fn min_track(t_sfm: f32, images: usize) -> Result<usize, LossError> {
    if !(0.0..=1.0).contains(&t_sfm) {
        return Err(LossError::Parameter { what: "`t_sfm`", value: t_sfm, range: "0 to 1" });
    }
    // One ulp less: 0.2 as an f32 is a little more than a fifth.
    let share = f64::from(t_sfm) * (1.0 - f64::from(f32::EPSILON)) * images as f64;
    Ok((m64::ceil(share) as usize).max(2))
}

/// Radius of [`discs`] where no segment says more: 1 % of the shorter side, pixels.
#[must_use]
pub fn disc_radius(extent: Extent) -> f32 {
    0.01 * extent.width.min(extent.height) as f32
}

/// Discs around points: static where a pixel's centre is within `radius` of a point, and the pixel the point is in.
///
/// # Shapes and units
/// * `points` `[n]` (column, row) in pixels, pixel centres at `+0.5`; NaN and those outside the image don't count
/// * `radius` pixels, `>= 0`
/// * `out` mask, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] unless the radius is finite and `>= 0`.
pub fn discs(extent: Extent, points: &[[f32; 2]], radius: f32, out: &mut [u8]) -> Result<(), LossError> {
    extent.check("out", out.len())?;
    if !(radius >= 0.0 && radius.is_finite()) {
        return Err(LossError::Parameter {
            what: "radius of a disc",
            value: radius,
            range: "a finite number from 0 on",
        });
    }
    out.fill(0);
    for &point in points {
        let Some(own) = pixel(extent, point) else { continue };
        out[own] = 1;
        let (cx, cy, radius) = (f64::from(point[0]), f64::from(point[1]), f64::from(radius));
        // `as` saturates: columns and rows that can be within the radius.
        let span = |c: f64, n: usize| (c - radius) as usize..((c + radius) as usize).saturating_add(1).min(n);
        for y in span(cy, extent.height) {
            for x in span(cx, extent.width) {
                let (dx, dy) = (x as f64 + 0.5 - cx, y as f64 + 0.5 - cy);
                if dx * dx + dy * dy <= radius * radius {
                    out[y * extent.width + x] = 1;
                }
            }
        }
    }
    Ok(())
}

/// Union of the segments that hold a point; label 0 (unassigned) is none.
///
/// # Shapes and units
/// * `labels` `[height][width]`, `points` as [`discs`], `out` mask, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn segments_at(extent: Extent, labels: &[u16], points: &[[f32; 2]], out: &mut [u8]) -> Result<(), LossError> {
    extent.check("labels", labels.len())?;
    extent.check("out", out.len())?;
    // One bit for each label there can be: 8 KiB.
    let mut held = [0_u64; 1 << 10];
    for label in points.iter().filter_map(|&p| pixel(extent, p)).map(|i| usize::from(labels[i])) {
        held[label / 64] |= 1 << (label % 64);
    }
    held[0] &= !1;
    for (out, &label) in out.iter_mut().zip(labels) {
        *out = (held[usize::from(label) / 64] >> (label % 64)) as u8 & 1;
    }
    Ok(())
}

/// Union of the segments prompted by points, one mask each.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree.
pub fn union(extent: Extent, stack: &[&[u8]], out: &mut [u8]) -> Result<(), LossError> {
    extent.check("out", out.len())?;
    out.fill(0);
    for segment in stack {
        extent.check("segment", segment.len())?;
        out.iter_mut().zip(*segment).for_each(|(out, &s)| *out |= u8::from(s != 0));
    }
    Ok(())
}

/// The pixel a point is in.
fn pixel(extent: Extent, [x, y]: [f32; 2]) -> Option<usize> {
    let inside = |v: f32, n: usize| v >= 0.0 && v < n as f32;
    // `as` cuts off; the minimum is for sides that an f32 rounds up.
    let place = |v: f32, n: usize| (v as usize).min(n - 1);
    (inside(x, extent.width) && inside(y, extent.height))
        .then(|| place(y, extent.height) * extent.width + place(x, extent.width))
}
