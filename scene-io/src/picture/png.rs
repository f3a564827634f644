//! PNG files: what decoding them takes, and their pixels.
//!
//! By the `png` crate itself: colour profiles and texts, which may unpack to a thousand times their size, are skipped and never
//! inflated. Nothing here applies them.

use crate::Size;
use image::error::{DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind};
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageBuffer, ImageError, ImageFormat, ImageResult};
use png::{BitDepth, Decoder, Reader, Transformations};
use std::io::{BufRead, Seek};

/// What chunks beside the pixels may take: palettes and EXIF.
pub(super) const CHUNKS: u64 = 16 << 20;

/// What the headers of a file say.
pub(super) struct Headers<R: BufRead + Seek> {
    reader: Reader<R>,
    pub(super) size: Size,
    /// Once decoded: palettes are expanded, bits are whole bytes.
    pub(super) colour: ColorType,
}

impl<R: BufRead + Seek> Headers<R> {
    /// Reads all chunks before the pixels.
    pub(super) fn read(reader: R) -> ImageResult<Self> {
        let mut decoder = Decoder::new_with_limits(reader, limits(0));
        decoder.set_ignore_iccp_chunk(true);
        decoder.set_ignore_text_chunk(true);
        decoder.set_transformations(Transformations::EXPAND);
        let width = decoder.read_header_info().map_err(failed)?.width;
        decoder.set_limits(limits(width));
        let reader = decoder.read_info().map_err(failed)?;
        let colour = match reader.output_color_type() {
            (png::ColorType::Grayscale, BitDepth::Eight) => ColorType::L8,
            (png::ColorType::Grayscale, BitDepth::Sixteen) => ColorType::L16,
            (png::ColorType::GrayscaleAlpha, BitDepth::Eight) => ColorType::La8,
            (png::ColorType::GrayscaleAlpha, BitDepth::Sixteen) => ColorType::La16,
            (png::ColorType::Rgb, BitDepth::Eight) => ColorType::Rgb8,
            (png::ColorType::Rgb, BitDepth::Sixteen) => ColorType::Rgb16,
            (png::ColorType::Rgba, BitDepth::Eight) => ColorType::Rgba8,
            (png::ColorType::Rgba, BitDepth::Sixteen) => ColorType::Rgba16,
            (colour, depth) => {
                let what = format!("pixels of {colour:?} with {depth:?} bits");
                return Err(ImageError::Decoding(DecodingError::new(ImageFormat::Png.into(), what)));
            }
        };
        Ok(Self { size: reader.info().size().into(), colour, reader })
    }

    /// Bytes that decoding takes beside the pixels: rows before and after their filter, and the EXIF chunk.
    pub(super) fn work_bytes(&self) -> u64 {
        let row = u64::from(self.size.width).saturating_mul(8);
        let exif = self.reader.info().exif_metadata.as_ref().map_or(0, |exif| exif.len() as u64);
        (1 << 19) + row.saturating_mul(16) + 3 * exif
    }

    pub(super) fn orientation(&self) -> Option<Orientation> {
        Orientation::from_exif_chunk(self.reader.info().exif_metadata.as_ref()?)
    }

    /// The pixels of the file, of the first picture where there are several.
    pub(super) fn decode(mut self) -> ImageResult<DynamicImage> {
        let too_large = || ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory));
        let length = self.reader.output_buffer_size().ok_or_else(too_large)?;
        let Size { width, height } = self.size;
        let picture = if matches!(self.colour, ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8) {
            let mut values = vec![0_u8; length];
            self.reader.next_frame(&mut values).map_err(failed)?;
            match self.colour {
                ColorType::L8 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLuma8),
                ColorType::La8 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLumaA8),
                ColorType::Rgb8 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgb8),
                _ => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgba8),
            }
        } else {
            let mut values = vec![0_u16; length / 2];
            self.reader.next_frame(bytemuck::cast_slice_mut(&mut values)).map_err(failed)?;
            values.iter_mut().for_each(|v| *v = u16::from_be(*v));
            match self.colour {
                ColorType::L16 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLuma16),
                ColorType::La16 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageLumaA16),
                ColorType::Rgb16 => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgb16),
                _ => ImageBuffer::from_raw(width, height, values).map(DynamicImage::ImageRgba16),
            }
        };
        picture.ok_or_else(too_large)
    }
}

fn limits(width: u32) -> png::Limits {
    let row = u64::from(width) * 8;
    png::Limits { bytes: usize::try_from(CHUNKS + 2 * row).unwrap_or(usize::MAX) }
}

fn failed(error: png::DecodingError) -> ImageError {
    match error {
        png::DecodingError::IoError(error) => ImageError::IoError(error),
        png::DecodingError::LimitsExceeded => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
        }
        png::DecodingError::Parameter(error) => {
            ImageError::Parameter(ParameterError::from_kind(ParameterErrorKind::Generic(error.to_string())))
        }
        error @ png::DecodingError::Format(_) => {
            ImageError::Decoding(DecodingError::new(ImageFormat::Png.into(), error))
        }
    }
}
