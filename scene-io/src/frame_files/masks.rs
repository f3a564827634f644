//! Masks of a frame: what is truly there, and masks that leave nothing to train on.

use crate::bit_mask::BitMask;
use crate::picture::with_mask;
use crate::priors::TruthMask;
use crate::{ErrorKind, Frame, MaskPolarity, Problem, SceneError, Split};
use rayon::prelude::*;
use std::path::PathBuf;

impl Frame {
    /// The pixels that truly show something else than the place, at the truth's own size; `None` where it is not known.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or has another shape than the photo.
    pub fn read_transient(&self) -> Result<Option<BitMask>, SceneError> {
        self.truth.transient.as_ref().map(|truth| self.read_truth(truth)).transpose()
    }

    /// The pixels that truly show things that move at some time, at the truth's own size; `None` where it is not known.
    ///
    /// # Errors
    /// As [`Frame::read_transient`].
    pub fn read_moving(&self) -> Result<Option<BitMask>, SceneError> {
        self.truth.moving.as_ref().map(|truth| self.read_truth(truth)).transpose()
    }

    /// The pixels of a test frame that show what training frames saw, too (DyCheck's masked scores are taken on them), at the
    /// mask's own size; `None` where it is not known. A mask of zeros and ones counts as one of black and white.
    ///
    /// # Errors
    /// As [`Frame::read_transient`].
    pub fn read_covisible(&self) -> Result<Option<BitMask>, SceneError> {
        self.truth.covisible.as_ref().map(|truth| self.read_truth(truth)).transpose()
    }

    /// The mask as it is written, at its own size: its white pixels, whatever [`Frame::mask_polarity`] takes white for. `None`
    /// without one.
    ///
    /// # Errors
    /// Names the mask that cannot be decoded.
    pub fn read_mask(&self) -> Result<Option<BitMask>, SceneError> {
        let Some(path) = &self.mask else { return Ok(None) };
        let mask = with_mask(path, |grey, size| BitMask::from_grey(size.width, size.height, &grey));
        mask.map(Some).map_err(|e| e.in_frame(&self.name))
    }

    fn read_truth(&self, truth: &TruthMask) -> Result<BitMask, SceneError> {
        match truth {
            TruthMask::Memory(mask) => Ok(BitMask::clone(mask)),
            TruthMask::Bars(Some(bars)) => Ok(bars.mask()),
            TruthMask::Bars(None) => Ok(BitMask::new(self.camera.width, self.camera.height)),
            TruthMask::File(path) => {
                super::white(path, "truth mask", self.size(), "make it as large as the photo, or remove it")
                    .map_err(|e| e.in_frame(&self.name))
            }
        }
    }
}

/// Refuses ignore masks that leave nothing of more than half of the training photos: almost surely their polarity is
/// the wrong way round. Decodes every mask. Returns the mean share of pixels that masks leave; `None` without masks.
///
/// # Errors
/// [`ErrorKind::Image`] naming the first such mask, or the mask that cannot be decoded.
pub fn refuse_blank_masks(frames: &[Frame]) -> Result<Option<f64>, SceneError> {
    let training: Vec<&Frame> = frames.iter().filter(|f| f.split == Split::Train).collect();
    let left = |frame: &&&Frame| -> Option<Result<(PathBuf, f64), SceneError>> {
        let path = frame.mask.as_ref()?;
        let used = |v: &&u8| (**v >= 128) == (frame.mask_polarity != MaskPolarity::WhiteIsIgnored);
        let share = |grey: Vec<u8>| grey.iter().filter(used).count() as f64 / grey.len().max(1) as f64;
        let share = with_mask(path, |grey, _| (path.clone(), share(grey)));
        Some(share.map_err(|error| error.in_frame(&frame.name)))
    };
    let left: Vec<(PathBuf, f64)> = training.par_iter().filter_map(|f| left(&f)).collect::<Result<_, _>>()?;
    let blank: Vec<&PathBuf> = left.iter().filter(|(_, share)| *share == 0.0).map(|(path, _)| path).collect();
    let Some(first) = blank.first().filter(|_| 2 * blank.len() > training.len()) else {
        let sum: f64 = left.iter().map(|(_, share)| share).sum();
        return Ok((!left.is_empty()).then(|| sum / left.len() as f64));
    };
    let what =
        format!("ignores every pixel, and so do the masks of {} of {} training photos", blank.len(), training.len());
    let remedy = "say what white means (`--mask-white`), or give `--masks off`";
    Err(SceneError::new(ErrorKind::Image, Problem::new(*first, what, remedy)))
}
