//! The stage in files, in D-NeRF's form, with what is known about it beside.

use super::{Orbit, OrbitOptions, Sight, orbit, orbit_views};
use crate::bit_mask::BitMask;
use crate::export::write_atomically;
use crate::synthetic::files::{write_mask, write_npy};
use crate::synthetic::write_blender;
use crate::{SceneError, Split};
use serde_json::json;
use std::path::Path;

/// Write the pictures of some options as D-NeRF's data (see [`write_blender`]), and the truth about the training pictures
/// under `truth/`: depth, normals, flow to the next picture, where its points are at time 0. A `README.md` there says what is
/// what.
///
/// # Errors
/// Files that cannot be written.
///
/// # Panics
/// As [`orbit`].
pub fn write_orbit(options: &OrbitOptions, folder: &Path) -> Result<(), SceneError> {
    write_blender(&orbit(options), folder)?;
    let truth = folder.join("truth");
    let stage = Orbit::new(options.seed, options.motion);
    let start = stage.at(0.0);
    let (h, w) = (options.height, options.width);
    let views: Vec<_> = orbit_views(options).into_iter().filter(|v| v.split == Split::Train).collect();
    for (i, view) in views.iter().enumerate() {
        let file = |what: &str, extension: &str| truth.join(format!("{what}/{i:03}.{extension}"));
        let snapshot = stage.at(view.time);
        let exact = snapshot.truth(&view.camera);
        write_npy(&file("depth", "npy"), &[h, w], &exact.depth_map().z)?;
        let normals: Vec<f32> = exact.normal.iter().flat_map(|n| n.as_vec3().to_array()).collect();
        write_npy(&file("normal", "npy"), &[h, w, 3], &normals)?;
        let home = snapshot.flow_to(&view.camera, &start, &view.camera);
        let moved: Vec<f32> = home.moved.iter().flat_map(|m| m.as_vec3().to_array()).collect();
        write_npy(&file("to_start", "npy"), &[h, w, 3], &moved)?;
        if let Some(next) = views.get(i + 1) {
            let flow = snapshot.flow_to(&view.camera, &stage.at(next.time), &next.camera);
            let way: Vec<f32> = flow.flow.iter().flat_map(|f| f.as_vec2().to_array()).collect();
            write_npy(&file("flow", "npy"), &[h, w, 2], &way)?;
            let seen = |column: u32, row: u32| flow.sight[row as usize * w as usize + column as usize] == Sight::Seen;
            write_mask(&file("flow_valid", "png"), &BitMask::from_fn(w, h, seen))?;
        }
    }
    let about = json!({
        "scene": "orbit", "seed": options.seed, "motion": format!("{:?}", options.motion),
        "camera": format!("{:?}", options.camera), "rays_per_pixel": options.rays * options.rays,
    });
    write_atomically(&truth.join("README.md"), |out| writeln!(out, "{README}\n```json\n{about:#}\n```"))
}

const README: &str = "\
# orbit: what is known exactly

A drawn scene with closed-form truth. The pictures one folder up are in D-NeRF's form: `transforms_{train,val,test}.json` with
`time` in 0..1, RGBA PNG with straight alpha, camera-to-world matrices with OpenGL axes, `f = w / (2 tan(camera_angle_x / 2))`,
axis in the middle. World: z up, right-handed. Colour belongs to the material: no shadows, no gloss, light painted on.
Validation and test frames name their exact depth (`depth_path`), all frames the pixels of things that move at some time
(`moving_path`, 255 = moves; a pixel counts if any of its rays met one), test frames where the test frame nearby (`flow_to`)
shows their points: `flow_path`, `flow_valid_path`, in the form of `flow` and `flow_valid` below.

Here, for training picture NNN (its place in `transforms_train.json`), at pixel centres `(column + 0.5, row + 0.5)`, float32:

| file | shape | what |
| --- | --- | --- |
| `depth/NNN.npy` | h, w | depth along the optical axis, world units; 0 = nothing |
| `normal/NNN.npy` | h, w, 3 | outward unit normal, world axes; 0 = nothing |
| `to_start/NNN.npy` | h, w, 3 | where the surface point is at time 0, minus where it is now, world units |
| `flow/NNN.npy` | h, w, 2 | where picture NNN + 1 shows the point, minus the pixel centre: x right, y down |
| `flow_valid/NNN.png` | h, w | 255 where picture NNN + 1 truly shows it: inside, and nothing in front |
";
