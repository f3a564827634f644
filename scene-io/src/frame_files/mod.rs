//! What stands beside a frame's photo, decoded at its own size and checked: `Frame::read_*`.

mod depth;
mod features;
mod flow;
mod masks;
mod motion;
mod segments;

pub use masks::refuse_blank_masks;

use crate::bit_mask::BitMask;
use crate::picture::{same_shape, with_mask};
use crate::{ErrorKind, Problem, SceneError, Size};
use std::path::Path;

/// The white pixels of a mask in the shape of its photo; zeros and ones count as black and white.
fn white(path: &Path, what: &str, photo: Size, remedy: &str) -> Result<BitMask, SceneError> {
    with_mask(path, |mut grey, size| {
        if grey.iter().all(|v| *v <= 1) {
            grey.iter_mut().for_each(|v| *v *= 255);
        }
        fits(path, what, size, photo, remedy)?;
        Ok(BitMask::from_grey(size.width, size.height, &grey))
    })?
}

/// Refuses what has not the shape of its photo.
fn fits(path: &Path, what: &str, is: Size, photo: Size, remedy: &str) -> Result<(), SceneError> {
    if same_shape(is, photo) {
        return Ok(());
    }
    let what = format!("the {what} is {is} and its photo {photo}");
    Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, remedy)))
}
