//! Cameras to render along: circles and spirals fitted to the training cameras, and paths from files.
//!
//! A path file is JSON in one of two forms, with camera-to-world matrices in OpenGL axes (x right, y up, z backward), in
//! the scene's frame:
//! * `{"frames": [{"transform_matrix": [[4 numbers] x 3 or 4]}, …]}`, the form of `transforms.json`; `fl_x fl_y cx cy w h`
//!   or `camera_angle_x`, at the top or in a frame, set the optics;
//! * `{"camera_path": [{"camera_to_world": [16 numbers], "fov": degrees}, …], "render_width": …, "render_height": …}`, as
//!   nerfstudio's viewer writes it; `fov` is vertical.
//!
//! Optics that a file does not give are those of the first training view, without its distortion.

use crate::data::Dataset;
use crate::error::RunError;
use crate::names;
use crate::picture::limited;
use render_core::camera::{Camera, Lens, Pose};
use render_core::path::{Ends, Orbit, Spiral, through};
use render_core::pose::Axes;
use render_core::rig::focus_point;
use scene_io::{LayoutHint, Scene};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Which path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathKind {
    /// A circle around what the cameras look at.
    Orbit,
    /// A spiral among forward-facing cameras.
    Spiral,
    /// The camera of a frame, again and again: for light that changes while nothing else does.
    Hold(String),
    /// From a file.
    File(PathBuf),
}

impl std::str::FromStr for PathKind {
    type Err = std::convert::Infallible;

    /// `orbit`, `spiral`, `hold:NAME`, or a file name.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "orbit" => Self::Orbit,
            "spiral" => Self::Spiral,
            other => match other.strip_prefix("hold:") {
                Some(name) => Self::Hold(name.into()),
                None => Self::File(other.into()),
            },
        })
    }
}

/// `frames` cameras along a path (default: 60, or as many as the file holds; a file's cameras are joined by a smooth curve
/// when another number is asked for).
///
/// # Errors
/// [`RunError::Option`] when the cameras define no such path; [`RunError::Read`], [`RunError::Content`] for files.
pub fn cameras(kind: &PathKind, scene: &Scene, data: &Dataset, frames: Option<usize>) -> Result<Vec<Camera>, RunError> {
    const FRAMES: usize = 60;
    let poses: Vec<Pose> = data.views().iter().map(|v| v.camera.pose).collect();
    let Some(first) = data.views().first() else {
        return Err(RunError::Option("the run has no training views to take the optics from".into()));
    };
    let optics = Camera { lens: Lens::Perspective { k: [0.0; 6], p: [0.0; 2] }, ..first.camera };
    let along = |poses: Vec<Pose>| poses.into_iter().map(|pose| Camera { pose, ..optics }).collect::<Vec<_>>();
    let none = |path: &str, other: &str| {
        RunError::Option(format!(
            "the training cameras define no {path}: use `--path {other}` or a file of cameras (`--path FILE.json`)"
        ))
    };
    let n = frames.unwrap_or(FRAMES);
    let found = match kind {
        PathKind::Orbit => {
            let orbit = Orbit::fit(&poses).ok_or_else(|| none("circle", "spiral"))?;
            along(orbit.poses(n))
        }
        PathKind::Spiral => {
            let [near, far] = depths(scene, &poses).ok_or_else(|| none("spiral", "orbit"))?;
            let spiral = Spiral::fit(&poses, near, far).ok_or_else(|| none("spiral", "orbit"))?;
            along(spiral.poses(n))
        }
        PathKind::Hold(name) => vec![held(name, scene, data)?; n],
        PathKind::File(path) => from_file(path, &optics, frames)?,
    };
    if found.is_empty() && n > 0 {
        return Err(none("path with a direction to look into", "FILE.json"));
    }
    Ok(found)
}

/// The camera of a frame as it is, no larger than the training views; lens and all, so that it can be laid beside the photo.
fn held(name: &str, scene: &Scene, data: &Dataset) -> Result<Camera, RunError> {
    let names: Vec<&str> = scene.frames.iter().map(|f| f.name.as_str()).collect();
    let frame = names::find(&names, name, &format!("`--path hold:{name}`"))?;
    let known = data.views().iter().find(|v| v.frame == frame && v.level == 0);
    Ok(known.map_or_else(|| limited(&scene.frames[frame].camera, data.longest_side()), |v| v.camera))
}

/// Smallest and largest z depth of what the cameras see.
fn depths(scene: &Scene, poses: &[Pose]) -> Option<[f64; 2]> {
    let bounds: Vec<[f64; 2]> = scene.frames.iter().filter_map(|f| f.z_bounds).collect();
    if !bounds.is_empty() {
        let low = bounds.iter().map(|b| b[0]).fold(f64::INFINITY, f64::min);
        let high = bounds.iter().map(|b| b[1]).fold(0.0, f64::max);
        return (low > 0.0 && high >= low).then_some([low, high]);
    }
    if let LayoutHint::Object { near, far } = scene.layout {
        return Some([near, far]);
    }
    let mut seen: Vec<f64> = scene
        .points
        .iter()
        .flat_map(|point| poses.iter().map(|pose| pose.to_camera(point.xyz).z))
        .filter(|&z| z > 0.0)
        .collect();
    if !seen.is_empty() {
        seen.sort_by(f64::total_cmp);
        let at = |share: f64| seen[((seen.len() - 1) as f64 * share) as usize];
        return Some([at(0.02), at(0.98)]);
    }
    let focus = focus_point(poses)?;
    let distance = poses.iter().map(|p| p.c.distance(focus)).sum::<f64>() / poses.len() as f64;
    Some([distance * 0.5, distance * 2.0])
}

/// Cameras of a path file; joined by a smooth curve where another number is asked for.
pub(crate) fn from_file(path: &Path, optics: &Camera, frames: Option<usize>) -> Result<Vec<Camera>, RunError> {
    let keys = read(path, optics)?;
    Ok(match (frames, keys.first()) {
        (Some(n), Some(first)) if n != keys.len() => {
            let poses: Vec<Pose> = keys.iter().map(|c| c.pose).collect();
            through(&poses, n, Ends::Open).into_iter().map(|pose| Camera { pose, ..*first }).collect()
        }
        _ => keys,
    })
}

/// Cameras of a path file.
pub(crate) fn read(path: &Path, optics: &Camera) -> Result<Vec<Camera>, RunError> {
    let text = std::fs::read_to_string(path).map_err(RunError::read(path))?;
    let wrong = |problem: String| RunError::Content { path: path.into(), problem };
    let json: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let (list, field, matrix) = match (json.get("frames"), json.get("camera_path")) {
        (Some(Value::Array(list)), _) => (list, "frames", "transform_matrix"),
        (_, Some(Value::Array(list))) => (list, "camera_path", "camera_to_world"),
        _ => return Err(wrong("holds neither a list `frames` nor a list `camera_path`".into())),
    };
    let mut cameras = Vec::with_capacity(list.len());
    for (i, item) in list.iter().enumerate() {
        let place = format!("`{field}[{i}].{matrix}`");
        let rows = item.get(matrix).and_then(rows).ok_or_else(|| wrong(format!("{place} is no 3x4 or 4x4 matrix")))?;
        let (pose, _) = Pose::from_matrix(&rows, Axes::Gl).map_err(|e| wrong(format!("{place}: {e}")))?;
        let camera = with_optics(optics, &json, item)
            .ok_or_else(|| wrong(format!("`{field}[{i}]`: width, height and focal length must be positive numbers")))?;
        cameras.push(Camera { pose, ..camera });
    }
    if cameras.is_empty() {
        return Err(wrong(format!("`{field}` is empty: there is nothing to render")));
    }
    Ok(cameras)
}

/// The upper three rows of a matrix written as rows or as one list.
fn rows(value: &Value) -> Option<[[f64; 4]; 3]> {
    let mut flat = Vec::with_capacity(16);
    for item in value.as_array()? {
        match item {
            Value::Array(row) => row.iter().try_for_each(|x| x.as_f64().map(|x| flat.push(x)))?,
            x => flat.push(x.as_f64()?),
        }
    }
    if flat.len() != 12 && flat.len() != 16 {
        return None;
    }
    Some(std::array::from_fn(|row| std::array::from_fn(|column| flat[row * 4 + column])))
}

/// `optics` with what the file says at the top and in the item.
fn with_optics(optics: &Camera, top: &Value, item: &Value) -> Option<Camera> {
    const LARGEST: f64 = 65_535.0; // pixels a side
    let number = |names: [&str; 2]| {
        let of = |value: &Value| names.iter().find_map(|name| value.get(name)?.as_f64());
        of(item).or_else(|| of(top))
    };
    let mut camera = *optics;
    let (w, h) = (number(["w", "render_width"]), number(["h", "render_height"]));
    if w.is_some() || h.is_some() {
        let size = |given: Option<f64>, own: u32| {
            let side = given.unwrap_or(f64::from(own));
            (1.0..=LARGEST).contains(&side).then_some(side as u32)
        };
        camera = camera.resized(size(w, camera.width)?, size(h, camera.height)?);
        // Another aspect cuts the picture, it does not stretch it.
        camera.fx = camera.fy;
    }
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    if let Some(angle) = number(["camera_angle_x", "camera_angle_x"]) {
        camera.fx = 0.5 * width / (0.5 * angle).tan();
        camera.fy = camera.fx;
    }
    if let Some(degrees) = number(["fov", "fov"]) {
        camera.fy = 0.5 * height / (0.5 * degrees.to_radians()).tan();
        camera.fx = camera.fy;
    }
    camera.fx = number(["fl_x", "fl_x"]).unwrap_or(camera.fx);
    camera.fy = number(["fl_y", "fl_x"]).unwrap_or(camera.fy);
    camera.cx = number(["cx", "cx"]).unwrap_or(camera.cx);
    camera.cy = number(["cy", "cy"]).unwrap_or(camera.cy);
    let good = |f: f64| f.is_finite() && f > 0.0;
    (good(camera.fx) && good(camera.fy) && camera.cx.is_finite() && camera.cy.is_finite()).then_some(camera)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};

    fn optics() -> Camera {
        Camera::pinhole(40, 30, 50.0, 50.0, 20.0, 15.0, Pose { r: DMat3::IDENTITY, c: DVec3::ZERO })
    }

    fn parse(text: &str) -> Result<Vec<Camera>, RunError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        read(file.path(), &optics())
    }

    #[test]
    fn matrices_are_camera_to_world_in_gl_axes() {
        let text = r#"{"frames": [{"transform_matrix": [[1,0,0,7],[0,1,0,8],[0,0,1,9],[0,0,0,1]]}]}"#;
        let camera = parse(text).unwrap()[0];
        assert_eq!(camera.pose.c, DVec3::new(7.0, 8.0, 9.0));
        assert!((camera.optical_axis() - DVec3::NEG_Z).length() < 1e-12, "GL cameras look along -z");
        assert_eq!((camera.width, camera.height, camera.fx), (40, 30, 50.0));
    }

    #[test]
    fn optics_of_the_file_replace_those_of_the_run() {
        let eye = "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]";
        let text = format!(
            r#"{{"render_width": 80, "render_height": 80, "camera_path": [{{"camera_to_world": {eye}, "fov": 90}}]}}"#
        );
        let camera = parse(&text).unwrap()[0];
        assert_eq!((camera.width, camera.height), (80, 80));
        assert!((camera.fy - 40.0).abs() < 1e-9 && camera.fx == camera.fy);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_named() {
        for (text, part) in [
            ("{", "EOF"),
            ("{}", "`frames`"),
            (r#"{"frames": []}"#, "empty"),
            (r#"{"frames": [{}]}"#, "`frames[0].transform_matrix`"),
            (r#"{"frames": [{"transform_matrix": [[0,0,0,0],[0,0,0,0],[0,0,0,0]]}]}"#, "`frames[0].transform_matrix`"),
            (r#"{"fl_x": 0, "frames": [{"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}"#, "focal length"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
