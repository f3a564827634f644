//! Photos to upright pictures of a scene.

use crate::error::PrepareError;
use crate::exif::{CameraFacts, camera_facts};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::metadata::Orientation;
use image::{DynamicImage, ExtendedColorType, ImageEncoder};
use scene_io::export::write_atomically;
use scene_io::{Image, Size, with_photo};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::Path;

/// Quality of JPEG files that are written: differences from the pixels given are about one level.
const QUALITY: u8 = 95;

/// A picture of the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Picture {
    /// Name in `images`.
    pub(crate) name: String,
    /// The file it was made from.
    pub(crate) source: String,
    /// Columns, rows: a pair, as in the file of the stage.
    pub(crate) size: (u32, u32),
    /// Maker, model and lens; empty where they are not known.
    pub(crate) device: String,
    /// Focal length, pixels, where the photo says it.
    pub(crate) focal: Option<f64>,
}

/// The ending a photo's picture will have: what can be copied as it is keeps its own.
pub(crate) fn ending(photo: &Path) -> &'static str {
    let extension = photo.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("png") => "png",
        _ => "jpg",
    }
}

/// Writes the picture of a photo: upright, no longer than `longest`. A photo that is both already is copied byte for byte.
///
/// `pixels` is where the pixels are: the photo itself, or what it was converted to, which is upright.
///
/// # Errors
/// [`PrepareError::Scene`] for photos that cannot be decoded or written.
pub(crate) fn write(
    photo: &Path,
    pixels: &Path,
    folder: &Path,
    name: &str,
    longest: Option<u32>,
) -> Result<Picture, PrepareError> {
    let path = folder.join(name);
    // Turned, as 8 bits, scaled: at most two copies at one time.
    let (size, facts) = with_photo(pixels, 2, |decoded| -> Result<_, PrepareError> {
        let stored = Size::new(decoded.width(), decoded.height());
        let facts = camera_facts(photo, stored);
        let is_turned = facts.orientation != 1 && pixels == photo;
        let fits = longest.is_none_or(|l| stored.longest_side() <= l);
        if !is_turned && fits && pixels == photo && has_own_ending(photo, name) {
            let bytes = std::fs::read(photo).map_err(PrepareError::io(photo, "read the photo"))?;
            write_atomically(&path, |out| out.write_all(&bytes))?;
            return Ok((stored, facts));
        }
        let upright = upright(decoded, if is_turned { facts.orientation } else { 1 });
        let upright = fitted(upright, longest);
        save(&path, &upright)?;
        Ok((Size::new(upright.width(), upright.height()), facts))
    })??;
    let CameraFacts { device, focal, .. } = facts;
    let focal = focal.map(|f| f * f64::from(size.longest_side()));
    let size = (size.width, size.height);
    Ok(Picture { name: name.into(), source: photo.display().to_string(), size, device, focal })
}

/// Whether a photo can lie under the name as it is: JPEG and PNG, which COLMAP and `scene-io` read.
fn has_own_ending(photo: &Path, name: &str) -> bool {
    let extension = photo.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    matches!(
        (extension.as_deref(), name.rsplit('.').next()),
        (Some("jpg" | "jpeg"), Some("jpg")) | (Some("png"), Some("png"))
    )
}

/// Turned and mirrored as EXIF says.
fn upright(mut picture: DynamicImage, orientation: u8) -> DynamicImage {
    if let Some(orientation) = Orientation::from_exif(orientation) {
        picture.apply_orientation(orientation);
    }
    picture
}

/// 8 bits, with alpha where there is alpha, scaled down to the longest side: each pixel the mean of the area it covers.
fn fitted(picture: DynamicImage, longest: Option<u32>) -> DynamicImage {
    let has_alpha = picture.color().has_alpha();
    let (width, height) = (picture.width(), picture.height());
    let side = width.max(height);
    let Some(longest) = longest.filter(|l| *l < side) else {
        return if has_alpha { picture.into_rgba8().into() } else { picture.into_rgb8().into() };
    };
    let scale =
        |x: u32| ((u64::from(x) * u64::from(longest) * 2 + u64::from(side)) / (2 * u64::from(side))).max(1) as u32;
    let (to_width, to_height) = (scale(width), scale(height));
    // The lengths fit: they are those of the pictures.
    if has_alpha {
        let whole = Image::rgba(width, height, picture.into_rgba8().into_raw());
        let small = whole.map(|i| i.resized(to_width, to_height));
        small.and_then(|i| image::RgbaImage::from_raw(to_width, to_height, i.data)).unwrap_or_default().into()
    } else {
        let whole = Image::rgb(width, height, picture.into_rgb8().into_raw());
        let small = whole.map(|i| i.resized(to_width, to_height));
        small.and_then(|i| image::RgbImage::from_raw(to_width, to_height, i.data)).unwrap_or_default().into()
    }
}

/// PNG by that ending, JPEG otherwise.
fn save(path: &Path, picture: &DynamicImage) -> Result<(), PrepareError> {
    let is_png = path.extension().is_some_and(|e| e == "png");
    let (size, colour) = ((picture.width(), picture.height()), picture.color());
    write_atomically(path, |out| {
        let result = match (is_png, colour.has_alpha()) {
            (true, true) => {
                PngEncoder::new(out).write_image(picture.as_bytes(), size.0, size.1, ExtendedColorType::Rgba8)
            }
            (true, false) => {
                PngEncoder::new(out).write_image(picture.as_bytes(), size.0, size.1, ExtendedColorType::Rgb8)
            }
            _ => JpegEncoder::new_with_quality(out, QUALITY).encode_image(&picture.to_rgb8()),
        };
        result.map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exif::testing;
    use image::{Rgb, RgbImage};

    /// Red on the left, blue on the right.
    fn flag() -> RgbImage {
        RgbImage::from_fn(64, 32, |x, _| if x < 32 { Rgb([220, 20, 20]) } else { Rgb([20, 20, 220]) })
    }

    fn near(a: &[u8], b: [u8; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 30)
    }

    #[test]
    fn a_turned_photo_becomes_upright_and_keeps_its_focal_length() {
        let folder = tempfile::tempdir().unwrap();
        let photo = folder.path().join("in.jpg");
        // 6: the camera was held upright, the rows of the file run from the right to the left of what was seen.
        testing::jpeg(&photo, &flag(), &testing::phone(6, 35));
        let picture = write(&photo, &photo, folder.path(), "out.jpg", None).unwrap();
        assert_eq!(picture.size, (32, 64));
        // 35 mm on film: 35 / 43.27 diagonals.
        let want = 35.0 / 43.266_615 * 64_f64.hypot(32.0);
        assert!((picture.focal.unwrap() - want).abs() < 1e-6, "{picture:?}");
        let turned = image::open(folder.path().join("out.jpg")).unwrap().into_rgb8();
        assert!(near(&turned.get_pixel(16, 4).0, [220, 20, 20]), "red is above");
        assert!(near(&turned.get_pixel(16, 60).0, [20, 20, 220]), "blue is below");
    }

    #[test]
    fn all_eight_orientations_end_upright() {
        let folder = tempfile::tempdir().unwrap();
        // Four corners of different colours, upright.
        let colours = [[200, 0, 0], [0, 200, 0], [0, 0, 200], [200, 200, 0]];
        let want = RgbImage::from_fn(40, 40, |x, y| Rgb(colours[usize::from(x >= 20) + 2 * usize::from(y >= 20)]));
        for orientation in 1..=8_u8 {
            // How a camera stores it: the inverse of what EXIF asks for.
            let inverse = match orientation {
                6 => 8,
                8 => 6,
                same => same,
            };
            let stored = upright(want.clone().into(), inverse).into_rgb8();
            let photo = folder.path().join(format!("{orientation}.jpg"));
            testing::jpeg(&photo, &stored, &testing::phone(orientation.into(), 35));
            write(&photo, &photo, folder.path(), "out.jpg", None).unwrap();
            let got = image::open(folder.path().join("out.jpg")).unwrap().into_rgb8();
            for (x, y) in [(5, 5), (35, 5), (5, 35), (35, 35)] {
                assert!(near(&got.get_pixel(x, y).0, want.get_pixel(x, y).0), "orientation {orientation} at {x}, {y}");
            }
        }
    }

    #[test]
    fn what_fits_is_copied_and_what_is_too_large_is_scaled() {
        let folder = tempfile::tempdir().unwrap();
        let photo = folder.path().join("in.jpeg");
        testing::jpeg(&photo, &flag(), &testing::phone(1, 35));
        let picture = write(&photo, &photo, folder.path(), "same.jpg", Some(64)).unwrap();
        assert_eq!(std::fs::read(&photo).unwrap(), std::fs::read(folder.path().join("same.jpg")).unwrap());
        let small = write(&photo, &photo, folder.path(), "small.jpg", Some(16)).unwrap();
        assert_eq!(small.size, (16, 8));
        assert!((small.focal.unwrap() * 4.0 - picture.focal.unwrap()).abs() < 1e-9);
    }

    #[test]
    fn webp_is_read_and_broken_photos_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let photo = folder.path().join("in.webp");
        flag().save_with_format(&photo, image::ImageFormat::WebP).unwrap();
        assert_eq!(write(&photo, &photo, folder.path(), "in.jpg", None).unwrap().size, (64, 32));
        let broken = folder.path().join("broken.jpg");
        std::fs::write(&broken, &std::fs::read(folder.path().join("in.jpg")).unwrap()[..200]).unwrap();
        let error = write(&broken, &broken, folder.path(), "x.jpg", None).unwrap_err().to_string();
        assert!(error.contains("broken.jpg") && error.contains("cut off"), "{error}");
    }
}
