//! What decoding an image file takes, from its headers alone; and decoding it.

use super::jpeg::{Frame, is_complete};
use super::refusal::{REMEDY, decoding_failed, limits, zero_bytes};
use super::shape::same_shape;
use super::{png, webp};
use crate::decode_memory::{DecodeMemory, Reserved};
use crate::{ErrorKind, Problem, SceneError, Size, files};
use exr::prelude::MetaData;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::fs::File;
use std::io::{BufReader, Cursor, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Small things every decoder has: tables, buffers of the file.
const TABLES: u64 = 1 << 18;

/// What an image's headers say, and the memory they ask for.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    path: PathBuf,
    format: Option<ImageFormat>,
    pub(crate) size: Size,
    /// Once decoded.
    colour: ColorType,
    /// Bytes of memory while it is decoded, beside the pixels.
    work: u64,
    /// Of a JPEG: what `work` was counted from.
    frame: Option<Frame>,
}

impl Plan {
    /// Reads the headers of a file. What that takes is little, but for the EXIF chunk of PNG files (16 MiB at most) and for JPEG files
    /// with odd headers, which are read whole: both once there is room.
    pub(crate) fn of(path: &Path) -> Result<Self, SceneError> {
        let (mut reader, length) = open(path)?;
        let reading = |e| SceneError::io(path, "read the image", e);
        let failed = |e| decoding_failed(path, e);
        let guess = ImageReader::new(&mut reader).with_guessed_format().map_err(reading)?;
        let format = guess.format();
        reader.rewind().map_err(reading)?;
        let mut jpeg = None;
        let (size, colour, work) = match format {
            Some(ImageFormat::Jpeg) => {
                // The decoder would read the whole file to answer this.
                let frame = match Frame::read(&mut reader) {
                    Some(frame) => frame,
                    None => {
                        reader.rewind().map_err(reading)?;
                        let _held =
                            DecodeMemory::of_process().reserve(path, "the headers", length.saturating_mul(3))?;
                        let (width, height) = decoder(reader, format, 0).map_err(failed)?.dimensions();
                        Frame::unknown(width, height)
                    }
                };
                let colour = if frame.is_grey() { ColorType::L8 } else { ColorType::Rgb8 };
                // The file, the decoder's copy of it, and profiles and EXIF taken out of that.
                let frame = jpeg.insert(frame);
                let work = frame.work_bytes().saturating_add(length.saturating_mul(3));
                (Size::new(frame.width, frame.height), colour, work)
            }
            Some(ImageFormat::Png) => {
                let most = length.min(png::CHUNKS);
                let _held = DecodeMemory::of_process().reserve(path, "the headers", most)?;
                let headers = png::Headers::read(reader).map_err(failed)?;
                (headers.size, headers.colour, headers.work_bytes())
            }
            Some(ImageFormat::WebP) => {
                let frames = webp::Frames::read(&mut reader);
                reader.rewind().map_err(reading)?;
                let decoder = image::codecs::webp::WebPDecoder::new(reader).map_err(failed)?;
                let (size, colour) = (Size::from(decoder.dimensions()), decoder.color_type());
                let work = frames.work_bytes(length, size.pixels(), colour.has_alpha(), decoder.has_animation());
                (size, colour, work)
            }
            Some(ImageFormat::OpenExr) => {
                let blocks = exr_blocks(&mut reader);
                reader.rewind().map_err(reading)?;
                let decoder = decoder(reader, format, 0).map_err(failed)?;
                let (size, colour) = (Size::from(decoder.dimensions()), decoder.color_type());
                // All pixels are copied once more.
                let copy = size.pixels().saturating_mul(colour.bytes_per_pixel().into());
                (size, colour, copy.saturating_add(blocks))
            }
            _ => {
                let decoder = decoder(reader, format, 0).map_err(failed)?;
                let (size, colour) = (Size::from(decoder.dimensions()), decoder.color_type());
                // GIF: a frame that is placed in the picture.
                (size, colour, size.pixels().saturating_mul(4))
            }
        };
        Ok(Self { path: path.into(), format, size, colour, work: work.saturating_add(TABLES), frame: jpeg })
    }

    /// 3 or 4: of the image as [`super::decode::decode`] gives it.
    pub(crate) fn channels(&self) -> u8 {
        if self.colour.has_alpha() { 4 } else { 3 }
    }

    /// Columns times rows.
    pub(crate) fn pixels(&self) -> u64 {
        self.size.pixels()
    }

    /// Bytes of the pixels as [`Plan::decode`] gives them.
    pub(crate) fn pixel_bytes(&self) -> u64 {
        self.pixels().saturating_mul(self.colour.bytes_per_pixel().into())
    }

    /// Most bytes held at one time while the file is decoded and then made into something of `each` bytes a pixel, beside
    /// which the pixels as decoded are kept.
    pub(crate) fn bytes(&self, each: u64) -> u64 {
        let decoded = self.pixel_bytes();
        decoded.saturating_add(self.work.max(self.pixels().saturating_mul(each).saturating_add(TABLES)))
    }

    /// As [`Plan::bytes`] for 3 or 4 values of 8 bits a pixel.
    pub(crate) fn bytes_in_8_bit(&self) -> u64 {
        let is_it = matches!(self.colour, ColorType::Rgb8 | ColorType::Rgba8);
        self.bytes(if is_it { 0 } else { self.channels().into() })
    }

    /// As [`Plan::bytes`] for one value of 8 bits a pixel.
    pub(crate) fn bytes_in_grey(&self) -> u64 {
        self.bytes(u64::from(self.colour != ColorType::L8))
    }

    /// Reserves `bytes` for work on this image.
    pub(crate) fn reserve(&self, bytes: u64) -> Result<Reserved<'static>, SceneError> {
        let what = format!("its {} pixels", self.size);
        DecodeMemory::of_process().reserve(&self.path, &what, bytes)
    }

    /// Decodes the file to whatever it holds. Memory must have been reserved. The EXIF orientation is not applied.
    pub(crate) fn decode(&self) -> Result<DynamicImage, SceneError> {
        let path = &self.path;
        let failed = |e| decoding_failed(path, e);
        let same = |size: Size, colour: ColorType| {
            if size != self.size {
                return Err(SceneError::new(ErrorKind::Image, wrong_size(path, size, self.size)));
            }
            if colour.bytes_per_pixel() > self.colour.bytes_per_pixel() {
                let what = format!("holds {colour:?} where its headers said {:?}", self.colour);
                return Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, REMEDY)));
            }
            Ok(())
        };
        match self.format {
            Some(ImageFormat::Png) => {
                let headers = png::Headers::read(open(path)?.0).map_err(failed)?;
                same(headers.size, headers.colour)?;
                headers.decode().map_err(failed)
            }
            Some(ImageFormat::Jpeg) => {
                let bytes = files::read_bytes(path)?;
                if !is_complete(&bytes) {
                    let what = format!("the JPEG is cut off: its {} bytes hold no end marker", bytes.len());
                    return Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, REMEDY)));
                }
                if !self.frame.as_ref().is_some_and(|frame| frame.covers(&bytes)) {
                    let what = "the JPEG shows two readers two pictures, of which one needs more memory";
                    return Err(SceneError::new(
                        ErrorKind::Image,
                        Problem::new(path, what, "save it again as a plain JPEG"),
                    ));
                }
                let decoder = decoder(Cursor::new(bytes.as_slice()), self.format, self.work).map_err(failed)?;
                same(decoder.dimensions().into(), decoder.color_type())?;
                DynamicImage::from_decoder(decoder).map_err(failed)
            }
            format => {
                let decoder = decoder(open(path)?.0, format, self.work).map_err(failed)?;
                same(decoder.dimensions().into(), decoder.color_type())?;
                DynamicImage::from_decoder(decoder).map_err(failed)
            }
        }
    }
}

/// An image that has not the size its camera says, with the cause where the file tells it.
pub(crate) fn wrong_size(path: &Path, is: Size, said: Size) -> Problem {
    let what = format!("the image is {is} and its camera says {said}");
    let turned = same_shape(Size::new(is.height, is.width), said);
    let text =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).display().to_string();
    let folder = shlex::try_quote(&text).map_or_else(|_| text.clone(), std::borrow::Cow::into_owned);
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let (cause, remedy) = match orientation(path) {
        Some(exif @ 5..=8) if turned => (
            format!(
                ": the cause is its EXIF rotation (orientation {exif}), which turns the picture by 90 degrees where it is \
                 shown, but not the pixels in the file"
            ),
            format!(
                "`mogrify -auto-orient {folder}/*.{extension}` (ImageMagick) turns the pixels of all photos of the folder; \
                 keep a copy"
            ),
        ),
        Some(exif @ 2..) => (
            format!(" (its EXIF orientation, {exif}, is not applied)"),
            "use the image the cameras were computed for, or resize it uniformly".into(),
        ),
        _ if turned => (
            ": one of them is turned by 90 degrees".into(),
            "turn the image as it was when the cameras were computed".into(),
        ),
        _ => (String::new(), "use the image the cameras were computed for, or resize it uniformly".into()),
    };
    Problem::new(path, what + &cause, remedy)
}

/// The EXIF orientation of an image, 1 to 8; `None` for files that cannot be read. Nothing here turns images by it.
fn orientation(path: &Path) -> Option<u8> {
    let (mut reader, length) = open(path).ok()?;
    let format = ImageReader::new(&mut reader).with_guessed_format().ok()?.format();
    reader.rewind().ok()?;
    let orientation = match format {
        Some(ImageFormat::Png) => png::Headers::read(reader).ok()?.orientation(),
        _ => {
            let _held = DecodeMemory::of_process().reserve(path, "the headers", length.saturating_mul(3)).ok()?;
            decoder(reader, format, 0).ok()?.orientation().ok()
        }
    };
    Some(orientation?.to_exif())
}

/// A file that is not empty, and its length.
fn open(path: &Path) -> Result<(BufReader<File>, u64), SceneError> {
    files::refuse_folder(path)?;
    let file = File::open(path).map_err(|e| SceneError::io(path, "open the image", e))?;
    let length = file.metadata().map_err(|e| SceneError::io(path, "read the size of the image", e))?.len();
    if length == 0 { Err(zero_bytes(path)) } else { Ok((BufReader::new(file), length)) }
}

/// The decoder of a format, which may allocate `beside` bytes beside the pixels where it asks.
fn decoder<'a, R: std::io::BufRead + Seek + 'a>(
    reader: R,
    format: Option<ImageFormat>,
    beside: u64,
) -> image::ImageResult<impl ImageDecoder + 'a> {
    let mut reader = match format {
        Some(format) => ImageReader::with_format(reader, format),
        None => ImageReader::new(reader),
    };
    reader.limits(limits(beside));
    reader.into_decoder()
}

/// Bytes for the blocks of an EXR file, packed, unpacked and sorted, and for the table of them.
pub(crate) fn exr_blocks(reader: &mut BufReader<File>) -> u64 {
    let meta = reader.seek(SeekFrom::Start(0)).ok().and_then(|_| MetaData::read_from_buffered(reader, false).ok());
    let headers = meta.map(|meta| meta.headers).unwrap_or_default();
    let block = headers.iter().map(|h| h.max_block_byte_size() as u64).max().unwrap_or(0);
    let table: u64 = headers.iter().map(|h| h.chunk_count as u64 * 16).fold(0, u64::saturating_add);
    block.saturating_mul(4).saturating_add(table)
}
