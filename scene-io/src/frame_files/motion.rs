//! What other programs say of motion in a frame: optical flow, disparity, what moves.

use crate::bit_mask::BitMask;
use crate::depth::{DepthMap, read_file as read_numbers};
use crate::flow_files;
use crate::priors::{Disparity, Flow, FlowPrior, MotionFiles};
use crate::{ErrorKind, Frame, Problem, SceneError, Size};
use std::path::Path;

/// What to do about a file of another shape than its photo.
const REMEDY: &str = "make it from the photo that it belongs to, or remove it";

impl Frame {
    /// Optical flow to the neighbouring photos at its files' own sizes: none where there is no file.
    ///
    /// # Errors
    /// Names the file that cannot be decoded or has another shape than the photo.
    pub fn read_flow_prior(&self) -> Result<FlowPrior, SceneError> {
        let MotionFiles { forward, backward, .. } = &self.priors.motion;
        let [forward, backward] = [forward, backward].map(|path| self.read_flow_file(path.as_deref()));
        Ok(FlowPrior { forward: forward?, backward: backward? })
    }

    /// One of these files.
    pub(crate) fn read_flow_file(&self, path: Option<&Path>) -> Result<Option<Flow>, SceneError> {
        path.map(|path| flow_files::read_file(path, self.size())).transpose().map_err(|e| e.in_frame(&self.name))
    }

    /// Disparity of the photo at its file's own size; `None` where there is no file. Pixels that are not finite are not known.
    ///
    /// # Errors
    /// As [`Frame::read_flow_prior`].
    pub fn read_disparity(&self) -> Result<Option<Disparity>, SceneError> {
        let Some(path) = &self.priors.motion.disparity else { return Ok(None) };
        let read = || -> Result<Disparity, SceneError> {
            let DepthMap { width, height, z } = read_numbers(path)?;
            super::fits(path, "disparity", Size::new(width, height), self.size(), REMEDY)?;
            Disparity::new(width, height, z).ok_or_else(|| {
                let what = format!("does not hold {width} x {height} numbers");
                SceneError::new(ErrorKind::Format, Problem::new(path, what, "write it again"))
            })
        };
        read().map(Some).map_err(|e| e.in_frame(&self.name))
    }

    /// The pixels that show something that moves, as another program sees it, at its file's own size; `None` where there is no file.
    /// White moves; a mask of zeros and ones counts as one of black and white. What is below one half does not move: neither does the 127
    /// that `priors` writes where nothing could be judged.
    ///
    /// # Errors
    /// As [`Frame::read_flow_prior`].
    pub fn read_motion_mask(&self) -> Result<Option<BitMask>, SceneError> {
        let Some(path) = &self.priors.motion.mask else { return Ok(None) };
        super::white(path, "motion mask", self.size(), REMEDY).map(Some).map_err(|e| e.in_frame(&self.name))
    }
}
