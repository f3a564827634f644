//! Cameras from a file.
//!
//! A path file is JSON in one of two forms, with camera-to-world matrices in OpenGL axes (x right, y up, z backward), in
//! the scene's frame:
//! * `{"frames": [{"transform_matrix": [[4 numbers] x 3 or 4]}, …]}`, the form of `transforms.json`; `fl_x fl_y cx cy w h`
//!   or `camera_angle_x`, at the top or in a frame, set the optics;
//! * `{"camera_path": [{"camera_to_world": [16 numbers], "fov": degrees}, …], "render_width": …, "render_height": …}`, as
//!   nerfstudio's viewer writes it; `fov` is vertical.
//!
//! Optics that a file does not give are those of the photos, without distortion.

use super::PATHS;
use crate::error::RunError;
use render_core::camera::{Camera, Pose};
use render_core::path::{Ends, through};
use render_core::pose::Axes;
use serde_json::Value;
use std::path::Path;

/// Cameras of a path file; joined by a smooth curve where another number is asked for.
///
/// # Errors
/// [`RunError`] naming the file and what is wrong in it.
pub fn from_file(path: &Path, optics: &Camera, frames: Option<usize>) -> Result<Vec<Camera>, RunError> {
    if !path.exists() {
        return Err(RunError::Option(format!(
            "`--path {}`: there is no such file; the paths are {PATHS}",
            path.display()
        )));
    }
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
        let rows =
            item.get(matrix).and_then(rows).ok_or_else(|| wrong(format!("{place} is not a 3x4 or 4x4 matrix")))?;
        let (pose, _) = Pose::from_matrix(&rows, Axes::Gl).map_err(|e| wrong(format!("{place}: {e}")))?;
        let camera = with_optics(optics, &json, item)
            .ok_or_else(|| wrong(format!("`{field}[{i}]`: width, height and focal length must be positive numbers, and sides at most 65535 pixels")))?;
        let camera = Camera { pose, ..camera };
        camera.check().map_err(|e| wrong(format!("`{field}[{i}]`: no camera can have this: {e}")))?;
        cameras.push(camera);
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
            (r#"{"cx": 1e308, "frames": [{"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}"#, "cx = 1e308"),
            (r#"{"frames": [{"transform_matrix": [[1,0,0,1e90],[0,1,0,0],[0,0,1,0]]}]}"#, "centre x = 1e90"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
