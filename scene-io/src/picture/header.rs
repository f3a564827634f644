//! Image headers: size and channels without decoding.

use super::refusal::{decoding_failed, limits, zero_bytes};
use crate::SceneError;
use image::{ImageDecoder, ImageReader};
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::Path;

/// What an image's header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub(crate) width: u32,
    pub(crate) height: u32,
    /// 3 or 4: of the image once decoded.
    pub(crate) channels: u8,
}

/// Reads the header of an image file.
pub(crate) fn read_header(path: &Path) -> Result<Header, SceneError> {
    let file = File::open(path).map_err(|e| SceneError::io(path, "open the image", e))?;
    let length = file.metadata().map_err(|e| SceneError::io(path, "read the size of the image", e))?.len();
    if length == 0 {
        return Err(zero_bytes(path));
    }
    let mut reader = BufReader::new(file);
    let start = reader.fill_buf().map_err(|e| SceneError::io(path, "read the image", e))?;
    if start.starts_with(&[0xff, 0xd8]) {
        // The JPEG decoder would read the whole file to answer this.
        if let Some((width, height)) = jpeg_size(&mut reader) {
            return Ok(Header { width, height, channels: 3 });
        }
        reader.rewind().map_err(|e| SceneError::io(path, "read the image", e))?;
    }
    let mut reader = ImageReader::new(reader).with_guessed_format().map_err(|e| SceneError::io(path, "read", e))?;
    reader.limits(limits());
    let decoder = reader.into_decoder().map_err(|e| decoding_failed(path, e))?;
    let (width, height) = decoder.dimensions();
    let channels = if decoder.color_type().has_alpha() { 4 } else { 3 };
    Ok(Header { width, height, channels })
}

/// The EXIF orientation of an image, 1 to 8; `None` for files that cannot be read. Nothing here turns images by it.
pub(crate) fn orientation(path: &Path) -> Option<u8> {
    let mut reader = ImageReader::open(path).ok()?.with_guessed_format().ok()?;
    reader.limits(limits());
    Some(reader.into_decoder().ok()?.orientation().ok()?.to_exif())
}

/// Size from the start-of-frame segment of a JPEG.
fn jpeg_size(reader: &mut (impl BufRead + Seek)) -> Option<(u32, u32)> {
    let mut marker = [0; 2];
    reader.read_exact(&mut marker).ok()?;
    loop {
        reader.read_exact(&mut marker[..1]).ok()?;
        if marker[0] != 0xff {
            return None;
        }
        // Any number of 0xff fill bytes may stand before a marker.
        while marker[0] == 0xff {
            reader.read_exact(&mut marker[..1]).ok()?;
        }
        match marker[0] {
            0x01 | 0xd0..=0xd7 => {}
            // C4, C8 and CC are tables, the other Cx start a frame.
            0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => {
                let mut frame = [0; 7];
                reader.read_exact(&mut frame).ok()?;
                let height = u32::from(u16::from_be_bytes([frame[3], frame[4]]));
                let width = u32::from(u16::from_be_bytes([frame[5], frame[6]]));
                // A height of 0 comes later, in a DNL segment: leave that to the decoder.
                return (width > 0 && height > 0).then_some((width, height));
            }
            0xd9 | 0xda => return None,
            _ => {
                let mut length = [0; 2];
                reader.read_exact(&mut length).ok()?;
                let length = i64::from(u16::from_be_bytes(length)).checked_sub(2).filter(|l| *l >= 0)?;
                reader.seek_relative(length).ok()?;
            }
        }
    }
}

/// Whether a JPEG runs to its end marker. Decoders fill what is missing with grey and say nothing.
pub(crate) fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let mut at = 2;
    loop {
        // At a marker: `ff xx`, with any number of fill bytes.
        while bytes.get(at) == Some(&0xff) && bytes.get(at + 1) == Some(&0xff) {
            at += 1;
        }
        let (Some(0xff), Some(&marker)) = (bytes.get(at), bytes.get(at + 1)) else { return false };
        at += 2;
        match marker {
            0xd9 => return true,
            0x01 | 0xd0..=0xd7 => continue,
            _ => {}
        }
        let (Some(&high), Some(&low)) = (bytes.get(at), bytes.get(at + 1)) else { return false };
        at += usize::from(u16::from_be_bytes([high, low])).max(2);
        if marker == 0xda {
            // Entropy-coded data: 0xff is stuffed with 0 or starts a restart marker.
            loop {
                match (bytes.get(at), bytes.get(at + 1)) {
                    (Some(0xff), Some(0 | 0xd0..=0xd7)) => at += 2,
                    (Some(0xff), Some(0xff)) => at += 1,
                    (Some(0xff), Some(_)) => break,
                    (Some(_), Some(_)) => at += 1,
                    _ => return false,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn jpeg() -> Vec<u8> {
        let picture = image::RgbImage::from_fn(37, 21, |x, y| image::Rgb([(x * 6) as u8, (y * 9) as u8, 99]));
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, image::ImageFormat::Jpeg).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn jpeg_size_is_found_without_decoding() {
        assert_eq!(jpeg_size(&mut Cursor::new(jpeg())), Some((37, 21)));
    }

    #[test]
    fn every_truncation_of_a_jpeg_is_noticed() {
        let bytes = jpeg();
        assert!(jpeg_is_complete(&bytes));
        for length in 0..bytes.len() {
            assert!(!jpeg_is_complete(&bytes[..length]), "{length} of {} bytes", bytes.len());
            let _ = jpeg_size(&mut Cursor::new(&bytes[..length]));
        }
    }
}
