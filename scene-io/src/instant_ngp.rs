//! `transforms.json` as instant-ngp writes and reads it.
//!
//! Intrinsics at top level or per frame, OpenCV or OpenCV-fisheye distortion, OpenGL axes. Listed images that are not
//! there are skipped, as instant-ngp does. `scale` (0.33), `offset` (0.5) and `aabb_scale` (1) describe the box the scene
//! lies in, which becomes [`crate::Scene::bounds`] in the file's own frame; poses are left as they are.

use crate::json::{Document, Object};
use crate::limits::is_point;
use crate::options::MissingImages;
use crate::reading::{DialectSplits, Reading};
use crate::transforms::raw_frame;
use crate::{Bounds, ErrorKind, LayoutHint, Problem, SceneError, Split};
use glam::DVec3;
use std::path::Path;

/// Scale of instant-ngp from file units to its unit cube.
const SCALE: f64 = 0.33;
/// Where instant-ngp puts the file's origin in its unit cube.
const OFFSET: f64 = 0.5;

pub(crate) fn read(document: &Document) -> Result<Reading, SceneError> {
    let format = |p: Problem| SceneError::new(ErrorKind::Format, p);
    let root = document.file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Every(8);
    reading.missing = MissingImages::Skip;
    let top = document.top().map_err(format)?;
    let frames = top.objects("frames").map_err(format)?.ok_or_else(|| {
        format(top.problem("frames", "is missing", "is this a transforms file? It needs a list of frames"))
    })?;
    match bounds(&top) {
        Ok((bounds, side)) => {
            reading.bounds = bounds;
            reading.layout = if side > 1.0 { LayoutHint::Unbounded } else { LayoutHint::Unknown };
        }
        Err(problem) => reading.problems.push(problem),
    }
    for frame in frames {
        match raw_frame(root, &top, &frame, Split::Train) {
            Ok(raw) => reading.frames.push(raw),
            Err(problem) => reading.problems.push(problem),
        }
    }
    Ok(reading)
}

/// The box of side `aabb_scale` about the middle of the unit cube, in file units; and that side.
fn bounds(top: &Object<'_>) -> Result<(Option<Bounds>, f64), Problem> {
    let side = top.number("aabb_scale")?;
    let scale = top.number("scale")?.unwrap_or(SCALE);
    let offset = match top.get("offset") {
        Some(serde_json::Value::Number(_)) => DVec3::splat(top.number("offset")?.unwrap_or(OFFSET)),
        _ => DVec3::from(top.triple("offset")?.unwrap_or([OFFSET; 3])),
    };
    for (key, value) in [("aabb_scale", side), ("scale", Some(scale))] {
        if value.is_some_and(|v| v <= 0.0) {
            return Err(top.problem(key, "must be above 0", "remove it or give a positive number"));
        }
    }
    let Some(side) = side else { return Ok((None, 1.0)) };
    let corner = |sign: f64| (DVec3::splat(0.5 + sign * side / 2.0) - offset) / scale;
    if !is_point(corner(-1.0)) || !is_point(corner(1.0)) {
        let what = "with `scale` and `offset` this puts the box outside of any scene";
        return Err(top.problem("aabb_scale", what, "correct `aabb_scale`, `scale` and `offset`, or remove them"));
    }
    Ok((Some(Bounds { min: corner(-1.0), max: corner(1.0) }), side))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_is_mapped_back_to_file_units() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("transforms.json");
        std::fs::write(&file, r#"{"aabb_scale": 4, "scale": 0.5, "offset": [0.5, 0.25, 0.0], "frames": []}"#).unwrap();
        let reading = read(&Document::read(&file).unwrap()).unwrap();
        // In the cube the box is -1.5 to 2.5 on each axis: (x - offset) / 0.5.
        let bounds = reading.bounds.unwrap();
        assert_eq!(bounds.min, DVec3::new(-4.0, -3.5, -3.0));
        assert_eq!(bounds.max, DVec3::new(4.0, 4.5, 5.0));
        assert_eq!(reading.layout, LayoutHint::Unbounded);
    }
}
