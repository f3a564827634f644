//! The chunks of WebP files: how large the pictures in them are, whatever the header says.

use std::io::{Read, Seek, SeekFrom};

/// Chunks that are looked at. A file of more is taken for one with the largest pictures there can be.
const CHUNKS: usize = 10_000;

/// Most pixels of one picture in the file, by how it is compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Frames {
    /// Whole blocks of 16 x 16.
    lossy: u64,
    lossless: u64,
}

impl Frames {
    /// Looks through the chunks from the start of the file; what is not a WebP has no frames.
    pub(super) fn read(reader: &mut (impl Read + Seek)) -> Self {
        let mut frames = Self::default();
        let (mut at, mut end_of_frame) = (12, None);
        for _ in 0..CHUNKS {
            let mut start = [0; 18];
            if reader.seek(SeekFrom::Start(at)).is_err() {
                return frames;
            }
            let mut have = 0;
            while have < start.len() {
                match reader.read(&mut start[have..]) {
                    Ok(0) | Err(_) => break,
                    Ok(n) => have += n,
                }
            }
            if have < 8 {
                return frames;
            }
            let number = |i: usize| u32::from_le_bytes([start[i], start[i + 1], start[i + 2], start[i + 3]]);
            let length = u64::from(number(4));
            match &start[..4] {
                b"VP8 " => {
                    let side = |i: usize| {
                        u64::from(u16::from_le_bytes([start[i], start[i + 1]]) & 0x3fff).next_multiple_of(16)
                    };
                    frames.lossy = frames.lossy.max(side(14) * side(16));
                }
                b"VP8L" => {
                    let sides = number(9);
                    let area = (u64::from(sides & 0x3fff) + 1) * (u64::from(sides >> 14 & 0x3fff) + 1);
                    frames.lossless = frames.lossless.max(area);
                }
                // A frame of an animation: 16 bytes, then chunks again.
                b"ANMF" => {
                    end_of_frame = Some(at + 8 + length + length % 2);
                    at += 8 + 16;
                    continue;
                }
                _ => {}
            }
            at += 8 + length + length % 2;
            // Readers that have no use for a frame go on behind it, whatever the chunks in it say of their lengths.
            if let Some(end) = end_of_frame
                && at >= end
            {
                (at, end_of_frame) = (end, None);
            }
        }
        Self { lossy: 1 << 28, lossless: 1 << 28 }
    }

    /// Bytes that decoding a file of `file` bytes takes beside the pixels, `pixels` of them in the header.
    pub(super) fn work_bytes(&self, file: u64, pixels: u64, alpha: bool, animated: bool) -> u64 {
        // The compressed bytes and a copy of them, and one luma and two quarter chroma planes.
        let lossy = if self.lossy > 0 { file.saturating_mul(2) + self.lossy * 3 / 2 } else { 0 };
        // Transparency beside a lossy picture is a lossless one, of which one channel is taken.
        let transparency = if self.lossy > 0 && alpha { 6 * pixels } else { 0 };
        // Where they are not decoded in place; and transforms, which are at most a quarter of the pixels each.
        let lossless = if alpha && !animated { self.lossless } else { 5 * self.lossless } + file;
        // The canvas and one frame.
        let animation = if animated { 8 * pixels } else { 0 };
        // Planes and transparency are not needed at one time with the pixels of a lossless picture.
        (1 << 17) + animation + (lossy + transparency).max(if self.lossless > 0 { lossless } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn chunk(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
        [kind.as_slice(), &(body.len() as u32).to_le_bytes(), body, &[0][..body.len() % 2]].concat()
    }

    fn frames(chunks: &[Vec<u8>]) -> Frames {
        Frames::read(&mut Cursor::new([&[0; 12][..], &chunks.concat()].concat()))
    }

    #[test]
    fn pictures_are_measured_by_their_own_headers() {
        let lossy = [0, 0, 0, 0x9d, 1, 0x2a, 100, 0, 50, 0];
        // 14 bits each: 300 - 1 and 20 - 1.
        let lossless = [&[0x2f][..], &(299_u32 | 19 << 14).to_le_bytes()].concat();
        let header = chunk(b"VP8X", &[0; 10]);
        let alone = Frames { lossy: 112 * 64, lossless: 0 };
        assert_eq!(frames(&[header.clone(), chunk(b"ICCP", &[0; 7]), chunk(b"VP8 ", &lossy)]), alone);
        assert_eq!(frames(&[chunk(b"VP8L", &lossless)]), Frames { lossy: 0, lossless: 6000 });
        let animated = chunk(b"ANMF", &[&[0; 16][..], &chunk(b"ALPH", &[0; 3]), &chunk(b"VP8 ", &lossy)].concat());
        assert_eq!(frames(&[header, animated, chunk(b"VP8L", &lossless)]), Frames { lossy: 112 * 64, lossless: 6000 });
        // A chunk in a frame that says it reaches over what follows the frame.
        let long = [b"ALPH".as_slice(), &200_u32.to_le_bytes()].concat();
        let hiding = chunk(b"ANMF", &[&[0; 16][..], &long].concat());
        assert_eq!(frames(&[hiding, chunk(b"VP8 ", &lossy)]), alone);
        assert_eq!(frames(&[]), Frames::default());
        assert_eq!(frames(&vec![chunk(b"EXIF", &[]); CHUNKS]).lossy, 1 << 28);
    }
}
