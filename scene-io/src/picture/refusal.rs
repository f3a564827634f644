//! What is said of image files that cannot be read, and how much of one is too much.

use super::foreign;
use super::plan::orientation;
use super::store::same_shape;
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

/// An image that has not the size its camera says, with the cause where the file tells it.
pub(crate) fn wrong_size(path: &Path, is: (u32, u32), said: (u32, u32)) -> Problem {
    let what = format!("the image is {}x{} and its camera says {}x{}", is.0, is.1, said.0, said.1);
    let turned = same_shape((is.1, is.0), said);
    let text =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new(".")).display().to_string();
    let folder = shlex::try_quote(&text).map_or_else(|_| text.clone(), std::borrow::Cow::into_owned);
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let (cause, remedy) = match orientation(path) {
        Some(exif @ 5..=8) if turned => (
            format!(
                ": the cause is its EXIF rotation (orientation {exif}), which turns the picture by 90 degrees where it is \
                 shown, but not the pixels in the file"
            ),
            format!(
                "`mogrify -auto-orient {folder}/*.{extension}` (ImageMagick) turns the pixels of all photos of the folder; \
                 keep a copy"
            ),
        ),
        Some(exif @ 2..) => (
            format!(" (its EXIF orientation, {exif}, is not applied)"),
            "use the image the cameras were computed for, or resize it uniformly".into(),
        ),
        _ if turned => (
            ": one of them is turned by 90 degrees".into(),
            "turn the image as it was when the cameras were computed".into(),
        ),
        _ => (String::new(), "use the image the cameras were computed for, or resize it uniformly".into()),
    };
    Problem::new(path, what + &cause, remedy)
}

/// What a decoder may allocate where it asks, bytes.
pub(super) fn limits(bytes: u64) -> Limits {
    let mut limits = Limits::default();
    limits.max_alloc = Some(bytes);
    limits
}
