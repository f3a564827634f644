//! Borrowed images, and the 8-bit grid that metrics are measured on.

use super::MetricError;
use alloc::vec::Vec;

/// A borrowed image: rows top to bottom, channels interleaved, peak 1.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    width: usize,
    height: usize,
    channels: usize,
    pixels: Pixels<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Pixels<'a> {
    /// Value / 255.
    U8(&'a [u8]),
    F32(&'a [f32]),
}

impl<'a> Image<'a> {
    /// 8-bit values `0..=255`, read as `value / 255` exactly.
    ///
    /// # Errors
    /// [`MetricError::Shape`] unless `data` holds `width * height * channels` values.
    pub fn from_u8(width: usize, height: usize, channels: usize, data: &'a [u8]) -> Result<Self, MetricError> {
        check_len("image", [width, height, channels], data.len())?;
        Ok(Self { width, height, channels, pixels: Pixels::U8(data) })
    }

    /// Values with peak 1. They are taken as they are, outside `[0, 1]` too: clip and round with [`quantise`] before, as
    /// published numbers do.
    ///
    /// # Errors
    /// [`MetricError::Shape`] unless `data` holds `width * height * channels` values; [`MetricError::NonFinite`].
    pub fn from_f32(width: usize, height: usize, channels: usize, data: &'a [f32]) -> Result<Self, MetricError> {
        check_len("image", [width, height, channels], data.len())?;
        match data.iter().position(|x| !x.is_finite()) {
            Some(index) => Err(MetricError::NonFinite { index }),
            None => Ok(Self { width, height, channels, pixels: Pixels::F32(data) }),
        }
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Values a pixel.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Value `index` in memory order.
    #[inline(always)]
    pub(super) fn value(&self, index: usize) -> f64 {
        match self.pixels {
            Pixels::U8(data) => f64::from(data[index]) / 255.0,
            Pixels::F32(data) => f64::from(data[index]),
        }
    }

    /// Values in all.
    pub(super) fn len(&self) -> usize {
        self.width * self.height * self.channels
    }

    /// One channel.
    pub(super) fn plane(&self, channel: usize) -> Plane {
        let data = (0..self.width * self.height).map(|i| self.value(i * self.channels + channel)).collect();
        Plane { width: self.width, height: self.height, data }
    }
}

/// One channel, rows top to bottom.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<f64>,
}

/// A pixel value on the 8-bit grid: clipped to `[0, 1]`, times 255, rounded half away from zero. NaN gives 0.
#[inline]
#[must_use]
pub fn quantise_value(x: f32) -> u8 {
    // In f64, where x * 255 + 1/2 is exact for every f32 worth rounding; the cast cuts off, clips, and maps NaN to 0.
    (f64::from(x) * 255.0 + 0.5) as u8
}

/// [`quantise_value`] of each.
#[must_use]
pub fn quantise(x: &[f32]) -> Vec<u8> {
    x.iter().map(|&x| quantise_value(x)).collect()
}

/// Both images have the same shape and at least one value.
pub(super) fn check_pair(metric: &'static str, a: &Image<'_>, b: &Image<'_>) -> Result<(), MetricError> {
    let shape = |x: &Image<'_>| [x.width, x.height, x.channels];
    if shape(a) != shape(b) {
        return Err(MetricError::Mismatch { a: shape(a), b: shape(b) });
    }
    if a.channels == 0 {
        return Err(MetricError::Channels { want: 1, got: 0 });
    }
    check_side(metric, a, 1)
}

/// Both sides reach `min_side`.
pub(super) fn check_side(metric: &'static str, a: &Image<'_>, min_side: usize) -> Result<(), MetricError> {
    if a.width.min(a.height) < min_side {
        return Err(MetricError::TooSmall { metric, min_side, width: a.width, height: a.height });
    }
    Ok(())
}

pub(super) fn check_len(what: &'static str, shape: [usize; 3], got: usize) -> Result<(), MetricError> {
    // A product past usize::MAX cannot be met by any slice.
    let want = shape.iter().try_fold(1_usize, |n, &x| n.checked_mul(x)).unwrap_or(usize::MAX);
    if want == got { Ok(()) } else { Err(MetricError::Shape { what, want, got }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantise_rounds_half_away_and_clips() {
        for (x, want) in [
            (0.0, 0),
            (-0.0, 0),
            (-3.0, 0),
            (0.5 / 255.0 - 1e-6, 0),
            (0.501 / 255.0, 1),
            (0.5, 128), // 127.5
            (1.0, 255),
            (1.7, 255),
            (f32::INFINITY, 255),
            (f32::NEG_INFINITY, 0),
            (f32::NAN, 0),
            (f32::MAX, 255),
            (f32::MIN_POSITIVE / 8.0, 0),
        ] {
            assert_eq!(quantise_value(x), want, "{x}");
        }
    }

    #[test]
    fn quantise_keeps_values_of_the_grid() {
        for v in 0..=255_u8 {
            assert_eq!(quantise_value(f32::from(v) / 255.0), v);
        }
    }

    #[test]
    fn plane_takes_one_channel() {
        let image = Image::from_u8(2, 1, 3, &[0, 51, 255, 102, 153, 204]).unwrap();
        assert_eq!(image.plane(1).data, [0.2, 0.6]);
        assert_eq!(image.value(2), 1.0);
    }
}
