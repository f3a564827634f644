//! Cameras for other programs.

use super::write_atomically;
use crate::{ErrorKind, Frame, ImageSource, Point, Problem, SceneError};
use render_core::camera::{Camera, ColmapModel, Lens};
use render_core::pose::Axes;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;
use std::path::Path;

/// Write `transforms.json` as nerfstudio reads it: OpenGL axes, pixels, intrinsics with every frame.
///
/// Image paths are relative to the file's folder where the images lie below it, else absolute; images that exist in
/// memory only go by the name of their frame. Pinhole, OpenCV (up to `k6`) and OpenCV fisheye lenses can be written.
///
/// # Errors
/// A lens that the format has no name for, naming the frame; a file that cannot be written.
pub fn write_transforms(path: &Path, frames: &[Frame]) -> Result<(), SceneError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut list = Vec::with_capacity(frames.len());
    for frame in frames {
        let camera = &frame.camera;
        let mut entry = Map::new();
        entry.insert("file_path".into(), image_path(frame, folder).into());
        for (key, value) in [("fl_x", camera.fx), ("fl_y", camera.fy), ("cx", camera.cx), ("cy", camera.cy)] {
            entry.insert(key.into(), value.into());
        }
        entry.insert("w".into(), camera.width.into());
        entry.insert("h".into(), camera.height.into());
        lens(camera, &mut entry).ok_or_else(|| {
            let what = format!("transforms.json has no name for its lens {:?}", camera.lens);
            let problem = Problem::new(path, what, "export the cameras as COLMAP text").frame(&frame.name);
            SceneError::new(ErrorKind::Value, problem)
        })?;
        let [a, b, c] = camera.pose.to_matrix(Axes::Gl);
        entry.insert("transform_matrix".into(), json!([a, b, c, [0.0, 0.0, 0.0, 1.0]]));
        if let Some(time) = frame.time {
            entry.insert("time".into(), time.into());
        }
        list.push(Value::Object(entry));
    }
    let text = format!("{:#}\n", json!({ "frames": list }));
    write_atomically(path, |out| out.write_all(text.as_bytes()))
}

fn image_path(frame: &Frame, folder: &Path) -> String {
    match &frame.image {
        ImageSource::Memory(_) => frame.name.clone(),
        ImageSource::File(file) => {
            let path = file.strip_prefix(folder).ok().filter(|p| p.is_relative()).unwrap_or(file);
            path.to_string_lossy().replace('\\', "/")
        }
    }
}

/// Model and coefficients; `None` where there is no name for them.
fn lens(camera: &Camera, entry: &mut Map<String, Value>) -> Option<()> {
    let (model, coefficients): (&str, &[(&str, f64)]) = match camera.lens {
        Lens::Perspective { k: [k1, k2, k3, 0.0, 0.0, 0.0], p: [p1, p2] } => {
            ("OPENCV", &[("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)])
        }
        Lens::Perspective { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] } => (
            "FULL_OPENCV",
            &[("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4), ("k5", k5), ("k6", k6), ("p1", p1), ("p2", p2)],
        ),
        Lens::Fisheye { k: [k1, k2, k3, k4] } => ("OPENCV_FISHEYE", &[("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)]),
        Lens::Fov { .. } | Lens::ThinPrismFisheye { .. } => return None,
    };
    entry.insert("camera_model".into(), model.into());
    for (key, value) in coefficients {
        entry.insert((*key).into(), (*value).into());
    }
    Some(())
}

/// Write a sparse model of COLMAP as text: `cameras.txt`, `images.txt`, `points3D.txt` in a folder. Frames with the same
/// optics share a camera. Points have no tracks.
///
/// # Errors
/// A frame name with blanks, which the format cannot hold; a file that cannot be written.
pub fn write_colmap(folder: &Path, frames: &[Frame], points: &[Point]) -> Result<(), SceneError> {
    let mut optics: Vec<&Camera> = Vec::new();
    let mut images = String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of 2D points\n");
    for (i, frame) in frames.iter().enumerate() {
        if frame.name.is_empty() || frame.name.chars().any(char::is_whitespace) {
            let what = "COLMAP's text format has no names with blanks";
            let problem = Problem::new(folder.join("images.txt"), what, "rename the image").frame(&frame.name);
            return Err(SceneError::new(ErrorKind::Value, problem));
        }
        let camera = optics.iter().position(|c| c.same_optics(&frame.camera)).unwrap_or_else(|| {
            optics.push(&frame.camera);
            optics.len() - 1
        });
        let ([w, x, y, z], [tx, ty, tz]) = frame.camera.pose.to_colmap();
        // Writing to a string does not fail. The shortest form of a number reads back exactly.
        let _ = writeln!(images, "{} {w} {x} {y} {z} {tx} {ty} {tz} {} {}\n", i + 1, camera + 1, frame.name);
    }
    let mut cameras = String::from("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n");
    for (i, camera) in optics.iter().enumerate() {
        let (model, parameters) = ColmapModel::describe(camera);
        let _ = write!(cameras, "{} {} {} {}", i + 1, model.name(), camera.width, camera.height);
        for parameter in parameters {
            let _ = write!(cameras, " {parameter}");
        }
        cameras.push('\n');
    }
    let mut cloud = String::from("# POINT3D_ID X Y Z R G B ERROR TRACK\n");
    for (i, Point { xyz, rgb: [r, g, b] }) in points.iter().enumerate() {
        let _ = writeln!(cloud, "{} {} {} {} {r} {g} {b} 0", i + 1, xyz.x, xyz.y, xyz.z);
    }
    for (name, text) in [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", cloud)] {
        write_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
    }
    Ok(())
}
