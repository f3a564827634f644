//! `camera/<id>.json`.

use crate::json::Object;
use crate::pose::{Axes, Mended, pose_from};
use crate::reading::Intrinsics;
use crate::{Problem, Size};
use glam::{DMat3, DVec3};
use render_core::camera::{Lens, Pose};

/// A camera as its file gives it.
pub(super) struct FileCamera {
    pub(super) size: Size,
    pub(super) intrinsics: Intrinsics,
    pub(super) lens: Lens,
    pub(super) pose: Pose,
    pub(super) mended: Mended,
}

/// Pixels that a skewed pixel grid may be off by before it is refused: the largest skew times half the image's height over
/// the focal length.
const SKEW_PIXELS: f64 = 0.01;

/// `orientation` is world-to-camera with rows right, down, forward; `principal_point` counts from the corner of the image.
pub(super) fn camera(top: &Object<'_>) -> Result<FileCamera, Problem> {
    let missing = |key: &str| top.problem(key, "is missing", "export the camera again");
    let rows = top.blocks("orientation", 1, 3)?.filter(|rows| rows.len() == 3).ok_or_else(|| {
        top.problem("orientation", "is not a 3x3 matrix", "write the world-to-camera rotation as a list of rows")
    })?;
    let row = |r: usize| DVec3::new(rows[r][0], rows[r][1], rows[r][2]);
    // Columns of the camera-to-world rotation are rows of its inverse.
    let rotation = DMat3::from_cols(row(0), row(1), row(2));
    let centre = DVec3::from(top.triple("position")?.ok_or_else(|| missing("position"))?);
    let (pose, mended) = pose_from(Axes::Cv, rotation, centre)
        .map_err(|bad| Problem::new(top.file, bad.what, bad.remedy).field("orientation").value(bad.value))?;
    let focal = top.number("focal_length")?.ok_or_else(|| missing("focal_length"))?;
    if focal <= 0.0 {
        return Err(top.problem("focal_length", "the focal length must be above 0", "give it in pixels"));
    }
    let aspect = top.number("pixel_aspect_ratio")?.unwrap_or(1.0);
    if aspect <= 0.0 {
        return Err(top.problem("pixel_aspect_ratio", "must be above 0", "pixels are square: write 1"));
    }
    let pair = |key: &str| match top.numbers(key)?.as_deref() {
        Some(&[a, b]) => Ok([a, b]),
        Some(_) => Err(top.problem(key, "is not a list of two numbers", "write [x, y]")),
        None => Err(missing(key)),
    };
    let [cx, cy] = pair("principal_point")?;
    let [w, h] = pair("image_size")?;
    let side = |x: f64| (x >= 1.0 && x <= f64::from(u32::MAX) && x.fract() == 0.0).then_some(x as u32);
    let (Some(width), Some(height)) = (side(w), side(h)) else {
        return Err(top.problem("image_size", "is not an image size", "write [width, height] in pixels"));
    };
    let skew = top.number("skew")?.unwrap_or(0.0);
    if (skew * f64::from(height) / (2.0 * focal)).abs() > SKEW_PIXELS {
        return Err(top.problem("skew", "skewed pixels are not supported", "undistort the images"));
    }
    let coefficients = |keys: &[&str], n: usize| -> Result<Vec<f64>, Problem> {
        let Some(key) = keys.iter().find(|key| top.has(key)) else { return Ok(vec![0.0; n]) };
        let values = top.numbers(key)?.unwrap_or_default();
        if values.len() == n {
            Ok(values)
        } else {
            Err(top.problem(key, format!("is not a list of {n} coefficients"), "write the missing ones as 0"))
        }
    };
    // The first releases called it `radial`, the first Nerfies `tangential`.
    let k = coefficients(&["radial_distortion", "radial"], 3)?;
    let p = coefficients(&["tangential_distortion", "tangential"], 2)?;
    Ok(FileCamera {
        size: Size::new(width, height),
        intrinsics: Intrinsics::Pixels { fx: focal, fy: focal * aspect, cx: Some(cx), cy: Some(cy) },
        lens: Lens::Perspective { k: [k[0], k[1], k[2], 0.0, 0.0, 0.0], p: [p[0], p[1]] },
        pose,
        mended,
    })
}
