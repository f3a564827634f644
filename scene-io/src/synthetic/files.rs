//! Pictures and masks to files.

use crate::bit_mask::BitMask;
use crate::export::write_atomically;
use crate::{Image, SceneError, Size};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::path::Path;

/// A picture as PNG, 8 bit.
pub(super) fn write_picture(path: &Path, picture: &Image) -> Result<(), SceneError> {
    let colour = if picture.channels == 4 { ExtendedColorType::Rgba8 } else { ExtendedColorType::Rgb8 };
    write_png(path, &picture.data, picture.size(), colour)
}

/// A mask as grey PNG: 255 in the set, 0 elsewhere.
pub(super) fn write_mask(path: &Path, mask: &BitMask) -> Result<(), SceneError> {
    let places = (0..mask.height()).flat_map(|row| (0..mask.width()).map(move |column| (column, row)));
    let grey: Vec<u8> = places.map(|(column, row)| if mask.get(column, row) { 255 } else { 0 }).collect();
    write_png(path, &grey, Size::new(mask.width(), mask.height()), ExtendedColorType::L8)
}

/// Whole numbers as grey PNG, 16 bit.
pub(super) fn write_png16(path: &Path, values: &[u16], size: Size) -> Result<(), SceneError> {
    // The encoder takes the machine's byte order.
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
    write_png(path, &bytes, size, ExtendedColorType::L16)
}

fn write_png(path: &Path, data: &[u8], size: Size, colour: ExtendedColorType) -> Result<(), SceneError> {
    write_atomically(path, |out| {
        PngEncoder::new(out).write_image(data, size.width, size.height, colour).map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_keep_all_their_bits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.png");
        let values = [0, 1, 255, 256, 40_000, u16::MAX];
        write_png16(&path, &values, Size::new(3, 2)).unwrap();
        let image::DynamicImage::ImageLuma16(read) = image::open(&path).unwrap() else { panic!("not 16 bit") };
        assert_eq!((read.width(), read.height()), (3, 2));
        assert_eq!(read.into_raw(), values);
    }
}
