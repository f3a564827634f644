//! What moves as a file.

use super::names::{MOVES, NOT_JUDGED, STAYS};
use crate::error::PrepareError;
use crate::motion::Motion;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use scene_io::export::write_atomically;
use std::io;
use std::path::Path;

/// Writes what moves as grey PNG.
pub(super) fn write_motion(path: &Path, motion: &Motion) -> Result<(), PrepareError> {
    let (width, height) = (motion.moving.width(), motion.moving.height());
    let grey = |(moves, is_judged): (bool, bool)| match (moves, is_judged) {
        (true, _) => MOVES,
        (false, true) => STAYS,
        (false, false) => NOT_JUDGED,
    };
    let pixels: Vec<u8> = motion.moving.iter().zip(motion.judged.iter()).map(grey).collect();
    write_atomically(path, |out| {
        PngEncoder::new(out).write_image(&pixels, width, height, ExtendedColorType::L8).map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            other => io::Error::other(other),
        })
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene_io::BitMask;

    #[test]
    fn a_mask_has_three_greys() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/m.png");
        let moving = BitMask::from_fn(3, 1, |x, _| x == 1);
        let judged = BitMask::from_fn(3, 1, |x, _| x < 2);
        write_motion(&path, &Motion { moving, judged }).unwrap();
        assert_eq!(image::open(path).unwrap().into_luma8().into_raw(), [STAYS, MOVES, NOT_JUDGED]);
    }
}
