//! What is known exactly about the training pictures of things that move, in files beside them.

use super::Snapshot;
use super::film::SnapshotView;
use crate::export::write_atomically;
use crate::npy_writer::write_npy;
use crate::synthetic::files::write_mask;
use crate::{SceneError, Split};
use serde_json::Value;
use std::path::Path;

/// Write the truth about the training pictures among `views` under `truth/`: depth, normals, flow to the next picture, where
/// its points are at time 0. A `README.md` there says what is what, and what `about` holds: the scene's name and options.
///
/// # Errors
/// Files that cannot be written.
pub(in crate::synthetic) fn write_truth(
    at: impl Fn(f64) -> Snapshot,
    views: &[SnapshotView],
    about: &Value,
    folder: &Path,
) -> Result<(), SceneError> {
    let truth = folder.join("truth");
    let start = at(0.0);
    let views: Vec<&SnapshotView> = views.iter().filter(|v| v.split == Split::Train).collect();
    for (i, view) in views.iter().enumerate() {
        let file = |what: &str, extension: &str| truth.join(format!("{what}/{i:03}.{extension}"));
        let snapshot = at(view.time);
        let (h, w) = (view.camera.height, view.camera.width);
        let exact = snapshot.truth(&view.camera);
        write_npy(&file("depth", "npy"), &[h, w], &exact.depth_map().z)?;
        let normals: Vec<f32> = exact.normal.iter().flat_map(|n| n.as_vec3().to_array()).collect();
        write_npy(&file("normal", "npy"), &[h, w, 3], &normals)?;
        let home = snapshot.flow_to(&view.camera, &start, &view.camera);
        let moved: Vec<f32> = home.moved.iter().flat_map(|m| m.as_vec3().to_array()).collect();
        write_npy(&file("to_start", "npy"), &[h, w, 3], &moved)?;
        if let Some(next) = views.get(i + 1) {
            let flow = snapshot.flow_to(&view.camera, &at(next.time), &next.camera).to_flow();
            write_npy(&file("flow", "npy"), &[h, w, 2], flow.vectors.as_flattened())?;
            write_mask(&file("flow_valid", "png"), &flow.seen)?;
        }
    }
    write_atomically(&truth.join("README.md"), |out| writeln!(out, "{README}\n```json\n{about:#}\n```"))
}

const README: &str = "\
# What is known exactly

A drawn scene with closed-form truth. The pictures one folder up are in D-NeRF's form: `transforms_{train,val,test}.json` with
`time` in 0..1, RGBA PNG with straight alpha, camera-to-world matrices with OpenGL axes, `f = w / (2 tan(camera_angle_x / 2))`,
axis in the middle. World: z up, right-handed. Colour belongs to the material: no shadows, no gloss, light painted on.
Validation and test frames name their exact depth (`depth_path`), all frames the pixels of things that move at some time
(`moving_path`, 255 = moves; a pixel counts if any of its rays met one), test frames (and validation frames of `mouth`) where
the frame of their split that is nearby (`flow_to`) shows their points: `flow_path`, `flow_valid_path`, in the form of `flow` and
`flow_valid` below.

Here, for training picture NNN (its place in `transforms_train.json`), at pixel centres `(column + 0.5, row + 0.5)`, float32:

| file | shape | what |
| --- | --- | --- |
| `depth/NNN.npy` | h, w | depth along the optical axis, world units; 0 = nothing |
| `normal/NNN.npy` | h, w, 3 | outward unit normal, world axes; 0 = nothing |
| `to_start/NNN.npy` | h, w, 3 | where the surface point is at time 0, minus where it is now, world units |
| `flow/NNN.npy` | h, w, 2 | where picture NNN + 1 shows the point, minus the pixel centre: x right, y down |
| `flow_valid/NNN.png` | h, w | 255 where picture NNN + 1 truly shows it: inside, and nothing in front |
";
