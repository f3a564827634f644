//! Files to 8-bit pixels.
//!
//! Grey becomes RGB, palettes are expanded, 16 bits are rounded to 8, high dynamic range (EXR) is taken as linear light
//! with premultiplied alpha, clipped to `[0, 1]` and encoded as sRGB with straight alpha. Colour profiles and the EXIF
//! orientation are **not** applied: cameras belong to the pixels as they are stored, and so do COLMAP's.

use super::image::Image;
use super::plan::Plan;
use crate::{ErrorKind, Problem, SceneError, Size};
use image::{ColorType, DynamicImage};
use std::path::Path;

/// Decodes an image file for which memory was reserved: [`Plan::bytes_in_8_bit`]. `mask` (values >= 128 are used) tells which
/// pixels may be NaN or infinite.
pub(crate) fn decode(path: &Path, plan: &Plan, mask: Option<(&[u8], Size)>) -> Result<Image, SceneError> {
    match plan.decode()? {
        DynamicImage::ImageRgb32F(pixels) => from_linear(path, pixels.dimensions().into(), 3, pixels.as_raw(), mask),
        DynamicImage::ImageRgba32F(pixels) => from_linear(path, pixels.dimensions().into(), 4, pixels.as_raw(), mask),
        other => {
            let (width, height) = (other.width(), other.height());
            let (channels, data) = match other.color() {
                ColorType::La8 | ColorType::La16 | ColorType::Rgba8 | ColorType::Rgba16 => {
                    (4, other.into_rgba8().into_raw())
                }
                _ => (3, other.into_rgb8().into_raw()),
            };
            Ok(Image { width, height, channels, data, mask: None })
        }
    }
}

/// Decodes a mask file to one value a pixel, its brightness, and does something with that within [`crate::DecodeMemory`].
pub(crate) fn with_mask<T>(path: &Path, work: impl FnOnce(Vec<u8>, Size) -> T) -> Result<T, SceneError> {
    let plan = Plan::of(path)?;
    let _held = plan.reserve(plan.bytes_in_grey())?;
    let (grey, size) = decode_grey(&plan)?;
    Ok(work(grey, size))
}

/// Decodes a mask to its brightness, where [`Plan::bytes_in_grey`] was reserved.
pub(crate) fn decode_grey(plan: &Plan) -> Result<(Vec<u8>, Size), SceneError> {
    let grey = plan.decode()?.into_luma8();
    let size = grey.dimensions().into();
    Ok((grey.into_raw(), size))
}

/// Decodes a map of whole numbers: a grey picture of 8 or 16 bits.
pub(crate) fn decode_labels(path: &Path) -> Result<(Vec<u16>, Size), SceneError> {
    let plan = Plan::of(path)?;
    let _held = plan.reserve(plan.bytes(2))?;
    let picture = plan.decode()?;
    let size = Size::new(picture.width(), picture.height());
    let labels = match picture {
        DynamicImage::ImageLuma8(grey) => grey.into_raw().into_iter().map(u16::from).collect(),
        DynamicImage::ImageLuma16(grey) => grey.into_raw(),
        other => {
            let what = format!("is not a label map but a picture of {:?}", other.color());
            let remedy = "write the numbers of at most 65535 segments as 16-bit grey PNG";
            return Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, remedy)));
        }
    };
    Ok((labels, size))
}

/// Decodes an image file to whatever it holds. The EXIF orientation is not applied. While it is decoded, its memory counts in
/// [`crate::DecodeMemory`]; the picture that comes out belongs to the caller. Where several threads decode, [`with_photo`]
/// bounds what they hold together.
///
/// # Errors
/// [`ErrorKind::Image`] for files that are empty, cut off or no image; [`ErrorKind::Io`] for those that cannot be read;
/// [`ErrorKind::Memory`] for those that are too large.
pub fn decode_photo(path: &Path) -> Result<DynamicImage, SceneError> {
    with_photo(path, 0, |picture| picture)
}

/// Decodes an image file and does something with it, all within [`crate::DecodeMemory`]: `copies` is the number of further
/// pictures of the same size, at most 8 bits a value, that are made at one time. The work must not wait for other threads.
///
/// # Errors
/// As [`decode_photo`].
pub fn with_photo<T>(path: &Path, copies: u32, work: impl FnOnce(DynamicImage) -> T) -> Result<T, SceneError> {
    let plan = Plan::of(path)?;
    let _held = plan.reserve(plan.bytes(4 * u64::from(copies)))?;
    Ok(work(plan.decode()?))
}

/// Columns and rows of an image file, from its headers.
///
/// # Errors
/// As [`decode_photo`], for what is wrong with the headers.
pub fn photo_size(path: &Path) -> Result<Size, SceneError> {
    Ok(Plan::of(path)?.size)
}

/// The sRGB curve (IEC 61966-2-1), linear light in `[0, 1]` to `[0, 1]`.
pub(crate) fn srgb_from_linear(x: f32) -> f32 {
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn to_u8(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn from_linear(
    path: &Path,
    size: Size,
    channels: u8,
    values: &[f32],
    mask: Option<(&[u8], Size)>,
) -> Result<Image, SceneError> {
    let Size { width, height } = size;
    let step = usize::from(channels);
    let mut data = Vec::with_capacity(values.len());
    for (index, pixel) in values.chunks_exact(step).enumerate() {
        let (column, row) = (index as u64 % u64::from(width), index as u64 / u64::from(width));
        if let Some((channel, value)) = pixel.iter().enumerate().find(|(_, v)| !v.is_finite()) {
            if mask.is_some_and(|(mask, of_mask)| !used(mask, of_mask, size, column, row)) {
                data.extend(std::iter::repeat_n(0, step));
                continue;
            }
            let what = format!("pixel (column {column}, row {row}) is not finite");
            let remedy = "repair the pixel or cover it with an ignore mask";
            let problem = Problem::new(path, what, remedy).field(["R", "G", "B", "A"][channel.min(3)]).value(value);
            return Err(SceneError::new(ErrorKind::Image, problem));
        }
        let alpha = if channels == 4 { pixel[3].clamp(0.0, 1.0) } else { 1.0 };
        // EXR stores premultiplied colours; where alpha is 0 there is no colour (light without cover is dropped).
        let unmultiply = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
        for value in &pixel[..3] {
            data.push(to_u8(srgb_from_linear((value * unmultiply).clamp(0.0, 1.0))));
        }
        if channels == 4 {
            data.push(to_u8(alpha));
        }
    }
    Ok(Image { width, height, channels, data, mask: None })
}

/// Whether a mask of `size` leaves a pixel of an image of size `image` in the loss.
fn used(mask: &[u8], size: Size, image: Size, column: u64, row: u64) -> bool {
    let x = column * u64::from(size.width) / u64::from(image.width);
    let y = row * u64::from(size.height) / u64::from(image.height);
    mask.get((y * u64::from(size.width) + x) as usize).is_none_or(|v| *v >= 128)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_curve_has_its_known_values() {
        assert_eq!(to_u8(srgb_from_linear(0.0)), 0);
        assert_eq!(to_u8(srgb_from_linear(1.0)), 255);
        assert!((srgb_from_linear(0.214_041_14) - 0.5).abs() < 1e-6);
        assert_eq!(to_u8(srgb_from_linear(0.001)), 3); // 12.92 * 0.001 * 255 = 3.29
    }
}
