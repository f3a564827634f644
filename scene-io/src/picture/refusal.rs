//! What is said of image files that cannot be read, and how much of one is too much.

use super::foreign;
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
        ImageError::Unsupported(_) => match foreign::refusal(path) {
            Some(refusal) => return refusal.caused_by(error),
            None => {
                let what = format!("is not an image that can be read: {error}");
                Problem::new(path, what, "convert it to PNG, JPEG, WebP or EXR")
            }
        },
        ImageError::Limits(_) => {
            Problem::new(path, format!("is larger than images may be: {error}"), "scale the image down")
        }
        _ => Problem::new(path, format!("the image is broken or cut off: {error}"), REMEDY),
    };
    SceneError::new(ErrorKind::Image, problem).caused_by(error)
}

/// What a decoder may allocate where it asks, bytes.
pub(super) fn limits(bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(bytes);
    limits
}
