//! Tissue that breathes and is pulled, seen by an endoscope that stands still, with a tool in front.
//!
//! World axes are OpenGL's at the camera (x right, y up, z backwards: the camera's matrix is the identity, as in EndoNeRF's
//! data), the unit is the millimetre. The tissue is a height field whose material points move across and along the line of
//! sight by closed formulas that can be inverted; colour belongs to the material (light is painted on). So what the tool
//! hides is known exactly: its colour, its depth, and whether it comes into sight at another time.

mod scene;
mod sheet;
mod snapshot;
mod stereo;
mod tool;
mod write;

pub use scene::{TissueOptions, TissueTruth, tissue, tissue_camera, tissue_truth};
pub use snapshot::{Tissue, TissueHit, TissueSnapshot};
pub use stereo::{Stereo, StereoOcclusion};
pub use tool::TissueTool;
pub use write::{TissueDepth, write_tissue};

#[cfg(test)]
mod tests;
