//! Scenes to files, in the form of NeRF's synthetic scenes.

use super::files::{write_mask, write_picture};
use crate::export::write_atomically;
use crate::npy_writer::write_npy;
use crate::priors::{FlowPlace, FlowTruth, TruthMask};
use crate::{DepthPlace, DepthSource, ErrorKind, Frame, ImageSource, LayoutHint, Problem, Scene, SceneError, Split};
use render_core::pose::Axes;
use serde_json::{Value, json};
use std::path::Path;

/// Write a scene of pictures in memory as `transforms_{train,val,test}.json` and PNG files, to be read again by
/// [`crate::load`]. Splits without frames get no file; unused frames are left out. `time` is written where it is known
/// (D-NeRF's form), depth in memory as `depth/NAME.npy` (`depth_path`; float32 along the optical axis, 0 = nothing), the
/// truth about what moves as `moving/NAME.png` (`moving_path`; 255 = moves), exact flow as `flow/NAME.npy` and
/// `flow/NAME.png` (`flow_path`, `flow_valid_path`, `flow_to`).
///
/// # Errors
/// A frame that is not a picture in memory, or whose camera has another lens, focal length or principal point than the
/// format can say (one horizontal angle for each split, the axis in the middle); files that cannot be written.
///
/// # Panics
/// If a picture, depth map or flow in memory has not as many values as its size says.
pub fn write_blender(scene: &Scene, folder: &Path) -> Result<(), SceneError> {
    for split in [Split::Train, Split::Val, Split::Test] {
        let frames: Vec<&Frame> = scene.split(split).map(|i| &scene.frames[i]).collect();
        let Some(first) = frames.first() else { continue };
        let path = folder.join(format!("transforms_{}.json", split.name()));
        let angle = angle_x(first);
        let mut list: Vec<Value> = Vec::with_capacity(frames.len());
        for frame in frames {
            check(frame, angle).map_err(|what| {
                let problem = Problem::new(&path, what, "export the cameras as transforms.json or COLMAP text");
                SceneError::new(ErrorKind::Value, problem.frame(&frame.name))
            })?;
            if let ImageSource::Memory(image) = &frame.image {
                write_picture(&folder.join(format!("{}.png", frame.name)), image)?;
            }
            let [a, b, c] = frame.camera.pose.to_matrix(Axes::Gl);
            let mut entry = json!({
                "file_path": format!("./{}", frame.name),
                "transform_matrix": [a, b, c, [0.0, 0.0, 0.0, 1.0]],
            });
            if let Some(time) = frame.time {
                entry["time"] = time.into();
            }
            if let Some(DepthSource { place: DepthPlace::Memory(map), .. }) = &frame.depth {
                let name = format!("depth/{}.npy", frame.name);
                write_npy(&folder.join(&name), &[map.height, map.width], &map.z)?;
                entry["depth_path"] = format!("./{name}").into();
            }
            if let Some(TruthMask::Memory(mask)) = &frame.truth.moving {
                let name = format!("moving/{}.png", frame.name);
                write_mask(&folder.join(&name), mask)?;
                entry["moving_path"] = format!("./{name}").into();
            }
            if let Some(FlowTruth { to, place: FlowPlace::Memory(flow) }) = &frame.truth.flow {
                let [name, valid] = ["npy", "png"].map(|extension| format!("flow/{}.{extension}", frame.name));
                write_npy(&folder.join(&name), &[flow.height, flow.width, 2], flow.vectors.as_flattened())?;
                write_mask(&folder.join(&valid), &flow.seen)?;
                entry["flow_path"] = format!("./{name}").into();
                entry["flow_valid_path"] = format!("./{valid}").into();
                entry["flow_to"] = to.as_str().into();
            }
            list.push(entry);
        }
        let mut root = json!({ "camera_angle_x": angle, "frames": list });
        if let LayoutHint::Object { near, far } = scene.layout {
            (root["near"], root["far"]) = (near.into(), far.into());
        }
        let text = format!("{root:#}\n");
        write_atomically(&path, |out| out.write_all(text.as_bytes()))?;
    }
    Ok(())
}

fn angle_x(frame: &Frame) -> f64 {
    2.0 * (0.5 * f64::from(frame.camera.width) / frame.camera.fx).atan()
}

fn check(frame: &Frame, angle: f64) -> Result<(), &'static str> {
    let camera = &frame.camera;
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
    if !matches!(frame.image, ImageSource::Memory(_)) {
        return Err("its picture is a file, not in memory");
    }
    if !camera.lens.is_pinhole() {
        return Err("Blender's form has no lens distortion");
    }
    if !(near(camera.cx, 0.5 * w) && near(camera.cy, 0.5 * h) && near(camera.fx, camera.fy)) {
        return Err("Blender's form has square pixels and the axis in the middle");
    }
    if !near(angle_x(frame), angle) {
        return Err("Blender's form has one angle of view for each split");
    }
    Ok(())
}
