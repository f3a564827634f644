//! The operation in files, in EndoNeRF's form, with what is known about it beside.

use super::scene::z_range;
use super::{TissueOptions, tissue_camera, tissue_truth};
use crate::export::write_atomically;
use crate::npy_writer::write_npy;
use crate::synthetic::files::{write_mask, write_picture, write_png16};
use crate::{SceneError, Size};
use render_core::pose::Axes;
use serde_json::json;
use std::path::Path;

/// How depth is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TissueDepth {
    /// `.npy`, float32, mm.
    #[default]
    Npy,
    /// 16-bit PNG of whole mm, as coarse as EndoNeRF's own.
    Png,
}

/// Write the pictures of some options as EndoNeRF's data: `poses_bounds.npy` (identity, OpenGL's axes, no columns exchanged),
/// `images/`, `masks/` and `gt_masks/` (255 = tool), `depth/`; and the truth under `truth/`, with a `README.md`. The world
/// unit is the millimetre.
///
/// # Errors
/// Files that cannot be written.
///
/// # Panics
/// As [`tissue_truth`].
pub fn write_tissue(options: &TissueOptions, depth: TissueDepth, folder: &Path) -> Result<(), SceneError> {
    let camera = tissue_camera(options);
    let (h, w) = (options.height, options.width);
    let rows = camera.pose.to_matrix(Axes::Gl);
    let hwf = [f64::from(h), f64::from(w), camera.fx];
    let mut poses: Vec<f64> = Vec::with_capacity(17 * options.frames);
    for (i, truth) in tissue_truth(options).iter().enumerate() {
        let [near, far] = z_range([&truth.seen_depth, &truth.tissue_depth]);
        poses.extend(rows.iter().zip(hwf).flat_map(|([a, b, c, t], last)| [*a, *b, *c, *t, last]).chain([near, far]));
        let file = |place: &str, extension: &str| folder.join(format!("{place}/{i:06}.{extension}"));
        write_picture(&file("images", "png"), &truth.picture)?;
        write_mask(&file("masks", "png"), &truth.mask)?;
        write_mask(&file("gt_masks", "png"), &truth.tool)?;
        match depth {
            TissueDepth::Npy => write_npy(&file("depth", "npy"), &[h, w], &truth.stereo_depth.z)?,
            TissueDepth::Png => {
                let whole: Vec<u16> = truth.stereo_depth.z.iter().map(|z| z.round() as u16).collect();
                write_png16(&file("depth", "png"), &whole, Size::new(w, h))?;
            }
        }
        write_picture(&file("truth/images", "png"), &truth.without_tool)?;
        write_npy(&file("truth/depth", "npy"), &[h, w], &truth.tissue_depth.z)?;
        write_npy(&file("truth/depth_with_tool", "npy"), &[h, w], &truth.seen_depth.z)?;
        write_mask(&file("truth/recoverable", "png"), &truth.recoverable)?;
    }
    write_npy(&folder.join("poses_bounds.npy"), &[options.frames as u32, 17], &poses)?;
    let stereo = options.stereo;
    let about = json!({
        "scene": "tissue", "seed": options.seed, "tool": format!("{:?}", options.tool), "margin": options.margin,
        "stereo": { "baseline": stereo.baseline, "step": stereo.step, "noise": stereo.noise,
            "outliers": stereo.outliers, "holes": stereo.holes },
        "depth": match depth { TissueDepth::Npy => "npy, mm", TissueDepth::Png => "16-bit png, whole mm" },
    });
    write_atomically(&folder.join("truth/README.md"), |out| writeln!(out, "{README}\n```json\n{about:#}\n```"))
}

const README: &str = "\
# tissue: what is known exactly

A drawn operation with closed-form truth, one folder up in EndoNeRF's form: one camera that stands still at the origin (rows of
`poses_bounds.npy`: identity matrix with columns right, up, backwards; height, width, focal length in pixels; nearest and
farthest depth), picture i of n at time i / (n - 1). Unit: the millimetre, in depth files, too. `masks/` are the tool and a margin,
`gt_masks/` the tool itself; 255 = tool. `depth/` is what a stereo matcher would find, tool included; 0 = missing.
Colour belongs to the material: light is painted on.

Here, for picture NNNNNN:

| file | what |
| --- | --- |
| `images/NNNNNN.png` | the same snapshot without the tool |
| `depth/NNNNNN.npy` | exact depth of the tissue along the optical axis at the pixel centres, float32, mm |
| `depth_with_tool/NNNNNN.npy` | exact depth of what is seen |
| `recoverable/NNNNNN.png` | 255: under the mask, and in sight in another picture outside its mask |
";
