//! Flow and masks as files.

use super::names::{MOVES, NOT_JUDGED, STAYS};
use crate::error::PrepareError;
use crate::motion::Motion;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use scene_io::Flow;
use scene_io::export::write_atomically;
use std::io;
use std::path::Path;

/// What files begin with: `PIEH` in ASCII.
const TAG: f32 = 202_021.25;
/// Both numbers of a flow vector that is not known.
const UNKNOWN: f32 = 1e10;

/// Writes a flow in Middlebury's form: `f32` tag, `i32` columns and rows, then two `f32` (x right, y down, pixels) for each pixel, row by
/// row, all little-endian; `1e10` where the other photo does not show the pixel.
///
/// # Source
/// Baker et al., "A database and evaluation methodology for optical flow", 2011, and its `README.txt`.
pub(super) fn write_flow(path: &Path, flow: &Flow) -> Result<(), PrepareError> {
    let mut bytes = Vec::with_capacity(12 + 8 * flow.vectors.len());
    bytes.extend(TAG.to_le_bytes());
    // The sides of a picture that was decoded are far below 2^31.
    bytes.extend((flow.width as i32).to_le_bytes());
    bytes.extend((flow.height as i32).to_le_bytes());
    for (way, is_seen) in flow.vectors.iter().zip(flow.seen.iter()) {
        let way = if is_seen { *way } else { [UNKNOWN; 2] };
        bytes.extend(way.iter().flat_map(|length| length.to_le_bytes()));
    }
    Ok(write_atomically(path, |out| out.write_all(&bytes))?)
}

/// Writes what moves as grey PNG.
pub(super) fn write_motion(path: &Path, motion: &Motion) -> Result<(), PrepareError> {
    let (width, height) = (motion.moving.width(), motion.moving.height());
    let grey = |(moves, is_judged): (bool, bool)| match (moves, is_judged) {
        (true, _) => MOVES,
        (false, true) => STAYS,
        (false, false) => NOT_JUDGED,
    };
    let pixels: Vec<u8> = motion.moving.iter().zip(motion.judged.iter()).map(grey).collect();
    let written = write_atomically(path, |out| {
        PngEncoder::new(out).write_image(&pixels, width, height, ExtendedColorType::L8).map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })
    });
    Ok(written?)
}

/// Removes what an earlier call with other neighbours wrote; where there is nothing that is fine.
pub(super) fn remove(path: &Path) -> Result<(), PrepareError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(PrepareError::io(path, "remove the file")(e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::BitMask;

    #[test]
    fn a_flow_is_written_as_middlebury_has_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.flo");
        let seen = BitMask::from_fn(3, 2, |x, y| (x, y) != (1, 1));
        let vectors = (0..6).map(|k| [k as f32, -0.5]).collect();
        write_flow(&path, &Flow { width: 3, height: 2, vectors, seen }).unwrap();
        let bytes = std::fs::read(path).unwrap();
        assert_eq!((&bytes[..4], bytes.len()), (b"PIEH".as_slice(), 12 + 48));
        let numbers: Vec<[u8; 4]> = bytes.as_chunks::<4>().0.to_vec();
        assert_eq!([1, 2].map(|i: usize| i32::from_le_bytes(numbers[i])), [3, 2]);
        let flow: Vec<f32> = numbers[3..].iter().map(|b| f32::from_le_bytes(*b)).collect();
        assert_eq!(flow, [0.0, -0.5, 1.0, -0.5, 2.0, -0.5, 3.0, -0.5, 1e10, 1e10, 5.0, -0.5]);
    }

    #[test]
    fn a_mask_has_three_greys() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.png");
        let column = |at: u32| BitMask::from_fn(3, 1, move |x, _| x == at);
        let judged = BitMask::from_fn(3, 1, |x, _| x < 2);
        write_motion(&path, &Motion { moving: column(1), judged, too_near: false }).unwrap();
        assert_eq!(image::open(path).unwrap().into_luma8().into_raw(), [0, 255, 127]);
    }
}
