//! Truth about what does not belong to the place, and masks that leave nothing to train on.

use super::bits::BitMask;
use crate::picture::{decode_mask, same_shape};
use crate::{ErrorKind, Frame, MaskPolarity, Problem, SceneError, Split};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Truth about passers-by and other things that do not belong to the place: set (white) = occluder.
///
/// For scoring masks a system found; nothing that trains may look at it. Read from `transient_mask_path` of a frame in
/// any `transforms*.json`, and from `mask_path` of a Blender-form clutter file (see [`crate::TrainPhotos`]), whose sense is
/// the opposite of nerfstudio's.
#[derive(Clone, Debug)]
pub enum TransientTruth {
    /// In a file.
    File(PathBuf),
    /// Known already, at the photo's native size.
    Memory(Arc<BitMask>),
}

impl Frame {
    /// The pixels that truly show something else than the place, at the truth's own size; `None` where it is not known.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or has another shape than the photo.
    pub fn read_transient(&self) -> Result<Option<BitMask>, SceneError> {
        match &self.transient {
            None => Ok(None),
            Some(TransientTruth::Memory(mask)) => Ok(Some(BitMask::clone(mask))),
            Some(TransientTruth::File(path)) => {
                let (grey, (width, height)) = decode_mask(path).map_err(|e| e.in_frame(&self.name))?;
                if !same_shape((width, height), self.size()) {
                    let (w, h) = self.size();
                    let what = format!("the truth mask is {width}x{height} and its photo {w}x{h}");
                    let problem = Problem::new(path, what, "make it as large as the photo, or remove it");
                    return Err(SceneError::new(ErrorKind::Image, problem.frame(&self.name)));
                }
                Ok(Some(BitMask::from_grey(width, height, &grey)))
            }
        }
    }
}

/// Refuses ignore masks that leave nothing of more than half of the training photos: almost surely their polarity is
/// the wrong way round. Decodes every mask.
///
/// # Errors
/// [`ErrorKind::Image`] naming the first such mask, or the mask that cannot be decoded.
pub fn refuse_blank_masks(frames: &[Frame]) -> Result<(), SceneError> {
    let training: Vec<&Frame> = frames.iter().filter(|f| f.split == Split::Train).collect();
    let blank = |frame: &&&Frame| -> Option<Result<PathBuf, SceneError>> {
        let path = frame.mask.as_ref()?;
        match decode_mask(path) {
            Err(error) => Some(Err(error.in_frame(&frame.name))),
            Ok((grey, _)) => {
                let used = |v: &u8| (*v >= 128) == (frame.mask_polarity == MaskPolarity::WhiteIsUsed);
                (!grey.iter().any(used)).then(|| Ok(path.clone()))
            }
        }
    };
    let blank: Vec<PathBuf> = training.par_iter().filter_map(|f| blank(&f)).collect::<Result<_, _>>()?;
    let Some(first) = blank.first().filter(|_| 2 * blank.len() > training.len()) else { return Ok(()) };
    let what =
        format!("ignores every pixel, and so do the masks of {} of {} training photos", blank.len(), training.len());
    let remedy = "turn the polarity of the masks round, or load without masks";
    Err(SceneError::new(ErrorKind::Image, Problem::new(first, what, remedy)))
}
