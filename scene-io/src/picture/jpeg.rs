//! The headers of JPEG files: size, components, and whether the whole file is there.

use std::io::{BufRead, Seek};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Bytes of an `APPn` segment that every reader reads to its end.
const SHORTEST: u16 = 14;

/// What the headers up to the first scan say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Frame {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Horizontal and vertical sampling of each component, 1 to 4.
    sampling: Vec<(u64, u64)>,
    /// Whether the coefficients of the whole picture are kept until its last scan.
    in_scans: bool,
}

impl Frame {
    /// Reads up to the first scan; `None` where that is not found.
    pub(super) fn read(reader: &mut (impl BufRead + Seek)) -> Option<Self> {
        let mut marker = [0; 2];
        reader.read_exact(&mut marker).ok()?;
        let mut frame: Option<Self> = None;
        loop {
            reader.read_exact(&mut marker[..1]).ok()?;
            if marker[0] != 0xff {
                return None;
            }
            // Any number of 0xff fill bytes may stand before a marker.
            while marker[0] == 0xff {
                reader.read_exact(&mut marker[..1]).ok()?;
            }
            // Of these, only before a scan, each reader makes something else: fill bytes, or segments with a length.
            if matches!(marker[0], 0x00 | 0x01 | 0xd0..=0xd7 | 0xd9) {
                return None;
            }
            let mut length = [0; 2];
            reader.read_exact(&mut length).ok()?;
            let length = u16::from_be_bytes(length).checked_sub(2)?;
            match marker[0] {
                // Too short for what it is: readers go on at different bytes.
                0xe0..=0xef if length < SHORTEST => return None,
                // C4, C8 and CC are tables, the other Cx start a frame; C2, C6, CA and CE are progressive.
                kind @ (0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf) => {
                    let mut segment = vec![0; usize::from(length)];
                    reader.read_exact(&mut segment).ok()?;
                    frame = Some(Self::parse(kind, &segment)?);
                }
                0xda => {
                    let mut components = [0; 1];
                    reader.read_exact(&mut components).ok()?;
                    let mut frame = frame?;
                    frame.in_scans |= usize::from(components[0]) != frame.sampling.len();
                    return Some(frame);
                }
                _ => reader.seek_relative(i64::from(length)).ok()?,
            }
        }
    }

    fn parse(kind: u8, segment: &[u8]) -> Option<Self> {
        let number = |at: usize| Some(u32::from(u16::from_be_bytes([*segment.get(at)?, *segment.get(at + 1)?])));
        let (height, width) = (number(1)?, number(3)?);
        let sampling: Vec<(u64, u64)> =
            segment.get(6..)?.as_chunks::<3>().0.iter().map(|c| (u64::from(c[1] >> 4), u64::from(c[1] & 15))).collect();
        // A height of 0 comes later, in a DNL segment: leave that to the decoder.
        let known = width > 0 && height > 0 && usize::from(*segment.get(5)?) == sampling.len() && !sampling.is_empty();
        known.then_some(Self { width, height, sampling, in_scans: matches!(kind, 0xc2 | 0xc6 | 0xca | 0xce) })
    }

    /// A frame of which only the size is known: as if it took most.
    pub(super) fn unknown(width: u32, height: u32) -> Self {
        Self { width, height, sampling: vec![(4, 4); 4], in_scans: true }
    }

    /// Whether the decoder finds no more in the whole file than this: no coefficients kept to the end, no more components. A file can
    /// show two readers two pictures.
    pub(super) fn covers(&self, bytes: &[u8]) -> bool {
        let any_size = DecoderOptions::default().set_max_width(usize::MAX).set_max_height(usize::MAX);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), any_size);
        // What it cannot read it does not decode.
        if decoder.decode_headers().is_err() {
            return true;
        }
        decoder.info().is_none_or(|found| {
            let kept = !found.sof.is_sequential_dct();
            usize::from(found.components) <= self.sampling.len() && (self.in_scans || !kept)
        })
    }

    /// Whether the picture is grey.
    pub(super) fn is_grey(&self) -> bool {
        self.sampling.len() == 1
    }

    /// Bytes that the decoder takes beside the file and the pixels: the coefficients of all scans (2 bytes each, whole blocks)
    /// and rows of blocks before and after they are scaled up.
    pub(super) fn work_bytes(&self) -> u64 {
        let most = |of: fn(&(u64, u64)) -> u64| self.sampling.iter().map(of).max().unwrap_or(1).max(1);
        let (h_most, v_most) = if self.is_grey() { (1, 1) } else { (most(|s| s.0), most(|s| s.1)) };
        let columns = u64::from(self.width).div_ceil(8 * h_most);
        let rows = u64::from(self.height).div_ceil(8 * v_most);
        let blocks: u64 = self.sampling.iter().map(|(h, v)| if self.is_grey() { 1 } else { h * v }).sum();
        let coefficients = if self.in_scans { 128 * columns * rows * blocks } else { 0 };
        // A row of blocks as numbers of 2 bytes, 8 lines for each vertical sample. Where samples differ, they are scaled up (to
        // `r` times as many, and to twice as many lines while a buffer grows), with single lines above and below.
        let lines = |(h, v): &(u64, u64)| {
            let (h, v) = ((*h).max(1), (*v).max(1));
            let r = (h_most / h).max(1) * (v_most / v).max(1);
            16 * columns * h * if h_most * v_most == 1 { 8 * v } else { 26 * v + 17 * r * v + 8 }
        };
        let lines: u64 = self.sampling.iter().map(lines).sum();
        coefficients + lines
    }
}

/// Whether a JPEG runs to its end marker. Decoders fill what is missing with grey and say nothing.
pub(super) fn is_complete(bytes: &[u8]) -> bool {
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
    fn headers_are_read_without_decoding() {
        let frame = Frame::read(&mut Cursor::new(jpeg())).unwrap();
        assert_eq!((frame.width, frame.height, frame.sampling.len(), frame.in_scans), (37, 21, 3, false));
    }

    #[test]
    fn headers_that_readers_take_differently_are_not_believed() {
        let bytes = jpeg();
        let with = |start: &[u8]| [&bytes[..2], start, &bytes[2..]].concat();
        for start in [
            [0xff, 0x00].as_slice(),
            &[0xff, 0x01],
            &[0xff, 0xd3],
            &[0xff, 0xe0, 0, 6, b'J', b'F', b'I', b'F'],
            &[0xff, 0xe1, 0, 2],
        ] {
            assert_eq!(Frame::read(&mut Cursor::new(with(start))), None, "{start:?}");
        }
        // Fill bytes are the same to all.
        assert!(Frame::read(&mut Cursor::new(with(&[0xff, 0xff]))).is_some());
    }

    #[test]
    fn what_the_decoder_finds_is_held_against_the_headers() {
        let bytes = jpeg();
        let frame = Frame::read(&mut Cursor::new(&bytes)).unwrap();
        assert!(frame.covers(&bytes) && Frame::unknown(37, 21).covers(&bytes));
        assert!(!Frame { sampling: vec![(1, 1)], ..frame.clone() }.covers(&bytes), "three components");
        // The same file, said to come in scans.
        let at = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
        let mut in_scans = bytes.clone();
        in_scans[at + 1] = 0xc2;
        assert!(!frame.covers(&in_scans) && Frame::unknown(37, 21).covers(&in_scans));
    }

    #[test]
    fn every_truncation_of_a_jpeg_is_noticed() {
        let bytes = jpeg();
        assert!(is_complete(&bytes));
        for length in 0..bytes.len() {
            assert!(!is_complete(&bytes[..length]), "{length} of {} bytes", bytes.len());
            let _ = Frame::read(&mut Cursor::new(&bytes[..length]));
        }
    }

    #[test]
    fn coefficients_count_with_their_sampling() {
        // 4:2:0, 100x50: 7 x 4 units of 4 + 1 + 1 blocks of 128 bytes.
        let full =
            |sampling: &[(u64, u64)], in_scans| Frame { width: 100, height: 50, sampling: sampling.into(), in_scans };
        let of = |sampling: &[(u64, u64)]| full(sampling, true).work_bytes() - full(sampling, false).work_bytes();
        assert_eq!(of(&[(2, 2), (1, 1), (1, 1)]), 7 * 4 * 6 * 128);
        assert_eq!(of(&[(1, 1); 3]), 13 * 7 * 3 * 128);
        assert_eq!(of(&[(2, 2)]), 13 * 7 * 128, "grey has no subsampling, whatever it says");
    }
}
