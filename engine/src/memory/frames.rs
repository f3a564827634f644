//! How much memory the pictures of a camera path take, and refusing those that the machine has not.

use crate::error::RunError;
use crate::memory::{available_bytes, human};
use crate::system::{Canonical, LayerRequest, Normals};
use render_core::camera::Camera;
use scene_io::Size;

/// Beside pixels: rays of a strip, what networks make of them, encoders.
const FIXED: u64 = 64 << 20;

/// Most bytes held at one time while a picture of `size` is rendered with these layers, coloured and written: an
/// upper bound for fields and Gaussians alike.
#[must_use]
pub fn frame_bytes(size: Size, layers: LayerRequest) -> u64 {
    // Colour, opacity, depth, median depth: `f32`.
    let mut each = 24;
    // Gaussians: planes of colour, depth and transmittance, middles, and what the tiles keep of each pixel. All of it is gone before
    // flow is made, which is less: a vector and a bit.
    each += 20 + 4 + 24;
    if layers.normals == Normals::Compute {
        // Normals, and the planes that Gaussians make them of.
        each += 12 + 16;
    }
    if layers.canonical == Canonical::Compute {
        each += 24;
    }
    // The range of depths sorts those of what was hit, in a list that grows by doubling; before the first picture is made.
    let sorted = 12;
    // Of 8 bits: colour, the layer that is written, the one of the preview or video, and a PNG file that grows by doubling.
    let pictures = 3 * 3 + 9;
    each += u64::max(sorted, pictures);
    size.pixels().saturating_mul(each).saturating_add(FIXED)
}

/// Refuses a picture of `size` that needs more than the machine has available. `what` begins the message:
/// "frame 3 of the path".
///
/// # Errors
/// [`RunError::Option`] with the size, what it takes and what is available.
pub fn check_frame(what: &str, size: Size, layers: LayerRequest) -> Result<(), RunError> {
    check(what, size, frame_bytes(size, layers), available())
}

/// As [`check_frame`] for all frames of a path, one after the other, and for their animated preview, which is kept until the last
/// one: `preview_side` is its longest side, pixels.
///
/// # Errors
/// As [`check_frame`], naming the first frame that is too large; or the number of frames that is.
pub fn check_path(cameras: &[Camera], layers: LayerRequest, preview_side: u32) -> Result<(), RunError> {
    let available = available();
    let mut preview = 0_u64;
    for (i, camera) in cameras.iter().enumerate() {
        let size = Size::from(camera);
        check(&format!("frame {i} of the path"), size, frame_bytes(size, layers), available)?;
        let small = crate::picture::limited(camera, Some(preview_side));
        // The picture, and at most two bytes a pixel of the file.
        preview = preview.saturating_add(Size::from(&small).pixels().saturating_mul(5));
    }
    if preview > available {
        return Err(too_many(cameras.len(), preview, available));
    }
    Ok(())
}

/// Refuses a number of frames whose cameras alone need more memory than the machine has available.
///
/// # Errors
/// [`RunError::Option`] with the number, what it takes and what is available.
pub fn check_count(frames: usize) -> Result<(), RunError> {
    // The camera, its place before and after it was shortened and smoothed, and what photos saw of it.
    let each = 4 * size_of::<Camera>() as u64 + 64;
    let (bytes, available) = ((frames as u64).saturating_mul(each), available());
    if bytes > available { Err(too_many(frames, bytes, available)) } else { Ok(()) }
}

fn too_many(frames: usize, bytes: u64, available: u64) -> RunError {
    let (bytes, available) = (human(bytes), human(available));
    RunError::Option(format!(
        "{frames} frames take {bytes} of memory, and {available} are available: give fewer `--frames`"
    ))
}

fn check(what: &str, size: Size, bytes: u64, available: u64) -> Result<(), RunError> {
    if bytes <= available {
        return Ok(());
    }
    let (bytes, available) = (human(bytes), human(available));
    Err(RunError::Option(format!(
        "{what} has {size} pixels: to draw and write it takes {bytes} of memory, and {available} are available; give \
         `--longest-side PX`, or a camera of fewer pixels"
    )))
}

/// What may be asked for; where the system does not say, what can be addressed.
fn available() -> u64 {
    available_bytes().unwrap_or(isize::MAX as u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use render_core::camera::Pose;

    fn camera(width: u32, height: u32) -> Camera {
        let pose = Pose { r: DMat3::IDENTITY, c: DVec3::ZERO };
        Camera::pinhole(width, height, 100.0, 100.0, 50.0, 50.0, pose)
    }

    #[test]
    fn pictures_that_no_machine_draws_are_refused_with_one_line() {
        let layers = LayerRequest::default();
        for side in [1_000_000, 4_000_000_000] {
            let cameras = [camera(64, 48), camera(side, side)];
            let error = check_path(&cameras, layers, 480).unwrap_err().to_string();
            assert!(error.contains(&format!("frame 1 of the path has {side}x{side} pixels")), "{error}");
            assert!(error.contains("--longest-side PX") && !error.contains('\n'), "{error}");
        }
        check_path(&[camera(64, 48)], layers, 480).unwrap();
        let size = Size::new(30_000, 30_000);
        let error = check("it", size, frame_bytes(size, layers), 8_000_000_000).unwrap_err();
        assert!(error.to_string().contains("takes 81.07 GB of memory, and 8.00 GB are available"), "{error}");
    }

    #[test]
    fn numbers_of_frames_are_bounded() {
        check_count(10_000).unwrap();
        for frames in [usize::MAX, usize::MAX / 1000] {
            let error = check_count(frames).unwrap_err().to_string();
            assert!(error.contains(&format!("{frames} frames take")) && error.contains("--frames"), "{error}");
        }
    }

    #[test]
    fn layers_cost_what_they_hold() {
        let all = LayerRequest { normals: Normals::Compute, canonical: Canonical::Compute, ..LayerRequest::default() };
        let size = Size::new(100, 10);
        let plain = frame_bytes(size, LayerRequest::default());
        assert_eq!(frame_bytes(size, all) - plain, 1000 * (12 + 16 + 24));
    }
}
