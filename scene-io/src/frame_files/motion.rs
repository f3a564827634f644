//! What other programs say of motion in a frame: optical flow, disparity, what moves.

use crate::bit_mask::BitMask;
use crate::depth::{DepthMap, read_file as read_numbers};
use crate::flow_files;
use crate::picture::{same_shape, with_mask};
use crate::priors::{Disparity, Flow, FlowPrior};
use crate::{ErrorKind, Frame, Problem, SceneError, Size};
use std::path::{Path, PathBuf};

impl Frame {
    /// Optical flow to the neighbouring photos at its files' own sizes: none where there is no file.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or has another shape than the photo.
    pub fn read_flow_prior(&self) -> Result<FlowPrior, SceneError> {
        let read = |path: &Option<PathBuf>| -> Result<Option<Flow>, SceneError> {
            let flow = path.as_ref().map(|path| flow_files::read_file(path, self.size())).transpose();
            flow.map_err(|e| e.in_frame(&self.name))
        };
        let motion = &self.priors.motion;
        Ok(FlowPrior { forward: read(&motion.forward)?, backward: read(&motion.backward)? })
    }

    /// Disparity of the photo at its file's own size; `None` where there is no file. Pixels that are not finite are not known.
    ///
    /// # Errors
    /// As [`Frame::read_flow_prior`].
    pub fn read_disparity(&self) -> Result<Option<Disparity>, SceneError> {
        let Some(path) = &self.priors.motion.disparity else { return Ok(None) };
        let read = || -> Result<Disparity, SceneError> {
            let DepthMap { width, height, z } = read_numbers(path)?;
            fits(path, "disparity", Size::new(width, height), self.size())?;
            Disparity::new(width, height, z).ok_or_else(|| {
                let what = format!("does not hold {width} x {height} numbers");
                SceneError::new(ErrorKind::Format, Problem::new(path, what, "write it again"))
            })
        };
        read().map(Some).map_err(|e| e.in_frame(&self.name))
    }

    /// The pixels that show something that moves, as another program sees it, at its file's own size; `None` where there is no file.
    /// White moves; a mask of zeros and ones counts as one of black and white.
    ///
    /// # Errors
    /// As [`Frame::read_flow_prior`].
    pub fn read_motion_mask(&self) -> Result<Option<BitMask>, SceneError> {
        let Some(path) = &self.priors.motion.mask else { return Ok(None) };
        let mask = with_mask(path, |mut grey, size| -> Result<BitMask, SceneError> {
            if grey.iter().all(|v| *v <= 1) {
                grey.iter_mut().for_each(|v| *v *= 255);
            }
            fits(path, "motion mask", size, self.size())?;
            Ok(BitMask::from_grey(size.width, size.height, &grey))
        });
        mask.and_then(|mask| mask).map(Some).map_err(|e| e.in_frame(&self.name))
    }
}

fn fits(path: &Path, what: &str, is: Size, photo: Size) -> Result<(), SceneError> {
    if same_shape(is, photo) {
        return Ok(());
    }
    let what = format!("the {what} is {is} and its photo {photo}");
    let problem = Problem::new(path, what, "make it from the photo that it belongs to, or remove it");
    Err(SceneError::new(ErrorKind::Image, problem))
}
