//! Pictures, masks and arrays to files.

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

/// Numbers that a NumPy array can hold.
pub(super) trait Number: Copy {
    /// NumPy's name of the type.
    const TYPE: &str;
    /// Little end first.
    fn bytes(self) -> impl IntoIterator<Item = u8>;
}

impl Number for f32 {
    const TYPE: &str = "<f4";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_le_bytes()
    }
}

impl Number for f64 {
    const TYPE: &str = "<f8";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_le_bytes()
    }
}

/// An array in C order as `.npy`, version 1.0.
///
/// # Panics
/// If the shape does not hold the values.
pub(super) fn write_npy<T: Number>(path: &Path, shape: &[u32], values: &[T]) -> Result<(), SceneError> {
    assert_eq!(shape.iter().map(|n| *n as usize).product::<usize>(), values.len(), "shape {shape:?}");
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({sizes}), }}", T::TYPE);
    // Magic, version and length take 10 bytes; values start at a multiple of 64, after a line end.
    let start = (10 + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(start - 10 - header.len() - 1));
    header.push('\n');
    write_atomically(path, |out| {
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&(header.len() as u16).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.bytes()).collect();
        out.write_all(&bytes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_read_by_another_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.npy");
        for shape in [[2, 3].as_slice(), &[6], &[1, 2, 3]] {
            let values = [0.0, -1.5, f64::MAX, 1e-300, f64::INFINITY, 7.0];
            write_npy(&path, shape, &values).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let array = npyz::NpyFile::new(&bytes[..]).unwrap();
            assert_eq!(array.shape(), shape.iter().map(|n| u64::from(*n)).collect::<Vec<_>>());
            assert_eq!(array.into_vec::<f64>().unwrap(), values);
        }
        write_npy(&path, &[0, 4], &[] as &[f32]).unwrap();
        assert_eq!(crate::npy::read(&path).unwrap().shape, [0, 4]);
    }

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
