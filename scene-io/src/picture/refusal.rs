//! What is said of image files that cannot be read, and how much of one is too much.

use crate::{ErrorKind, Problem, SceneError};
use image::{ImageError, Limits};
use std::path::Path;

/// What to do about a broken image.
pub(super) const REMEDY: &str = "copy the file again, or remove its frame from the dataset";

pub(super) fn zero_bytes(path: &Path) -> SceneError {
    SceneError::new(ErrorKind::Image, Problem::new(path, "the image file is empty (0 bytes)", REMEDY))
}

pub(super) fn decoding_failed(path: &Path, error: ImageError) -> SceneError {
    let problem = match &error {
        ImageError::Unsupported(_) => {
            Problem::new(path, format!("is no image that can be read: {error}"), "convert it to PNG, JPEG or EXR")
        }
        ImageError::Limits(_) => {
            Problem::new(path, format!("is larger than images may be: {error}"), "scale the image down")
        }
        _ => Problem::new(path, format!("the image is broken or cut off: {error}"), REMEDY),
    };
    SceneError::new(ErrorKind::Image, problem).caused_by(error)
}

/// What a decoder may allocate: 2 GiB, enough for 250 megapixels at 16 bits, and no more for a forged header.
pub(super) fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(2 << 30);
    limits
}
