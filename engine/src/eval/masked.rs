//! Metrics of the pixels inside a mask.

use image::RgbImage;
use losses::metrics::{Image, MaskedSsim, masked_psnr, masked_ssim};

/// Where a photo is more opaque than not, 255 or 0 a pixel; `None` without alpha.
pub(super) fn object_mask(photo: &scene_io::Image) -> Option<Vec<u8>> {
    let opaque = |pixel: &[u8]| if pixel[3] >= 128 { 255 } else { 0 };
    (photo.channels == 4).then(|| photo.data.chunks_exact(4).map(opaque).collect())
}

/// PSNR of a picture's pixels inside a mask; `None` where there are none, or where they all equal the truth.
pub(super) fn inside(picture: &RgbImage, truth: &RgbImage, mask: &[u8]) -> Option<f64> {
    let image = |p| Image::from_u8(truth.width() as usize, truth.height() as usize, 3, p).ok();
    let mask: Vec<f32> = mask.iter().map(|&m| if m >= 128 { 1.0 } else { 0.0 }).collect();
    let db = masked_psnr(&image(picture.as_raw())?, &image(truth.as_raw())?, &mask).ok()?;
    db.is_finite().then_some(db)
}

/// SSIM inside a mask as DyCheck measures it; `None` for pictures smaller than a window.
pub(super) fn ssim_inside(picture: &RgbImage, truth: &RgbImage, mask: &[u8]) -> Option<f64> {
    let image = |p| Image::from_u8(truth.width() as usize, truth.height() as usize, 3, p).ok();
    let mask: Vec<f32> = mask.iter().map(|&m| if m >= 128 { 1.0 } else { 0.0 }).collect();
    masked_ssim(&image(picture.as_raw())?, &image(truth.as_raw())?, &mask, MaskedSsim::DyCheck).ok()
}
