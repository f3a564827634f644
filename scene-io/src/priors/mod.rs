//! What other programs made of the photos: segments, features, point tracks, motion, and truth to score against.
//!
//! No foreign network runs here; what one would produce is read from files. All of them are optional, stand beside the
//! photo and are named after it, `STEM` being its name without extension:
//!
//! | file | holds | without it |
//! | --- | --- | --- |
//! | `STEM.mask.png` | ignore mask, white = used (see [`crate::Masks`]) | all pixels are used |
//! | `STEM.segs.png` | segments: 16-bit (or 8-bit) grey label map, 0 = in no segment | the stack below |
//! | `STEM.segs/*.png` | segments: one black and white picture each, may overlap | no segments |
//! | `STEM.points/*.png` | segments around feature points, one picture each; `scores.txt` beside them: a line for each picture in the order of names, score and stability | none |
//! | `STEM.features.npy` | dense features, `C x H' x W'`, `f32` or `f16` | none |
//!
//! What is known of motion lies in folders, as NSFF, DynamicNeRF and RoDynRF write it: beside the photos' folder (or in it), by the
//! photo's name without extension, or by its number with 3 to 5 digits where that name is one. The number is the photo's own: where
//! photos begin at 1 and flow at 0, one of them must be renamed. What `nerf-dynamic priors` makes lies in such folders in `priors` of the
//! dataset's own, and is read where there is nothing beside the photos. [`LoadOptions::priors`](crate::LoadOptions::priors) names another
//! folder of such folders, in the place of all these.
//!
//! | file | holds | without it |
//! | --- | --- | --- |
//! | `flow/STEM_fwd.flo`, `.npz`, `.npy` (or `flow_i1/`; or `flow/STEM.flo`) | optical flow to the next photo | none for that photo |
//! | `flow/STEM_bwd.flo`, `.npz`, `.npy` (or `flow_i1/`) | optical flow to the photo before | none for that photo |
//! | `disp/STEM.npy`, `.png` (or `dpt/`) | disparity, `H' x W'` numbers or 8-bit or 16-bit grey: no unit, larger = nearer | none |
//! | `motion_masks/STEM.png` (or `epipolar_error_png/`) | white = moves | not known what moves |
//!
//! Flow is `H' x W' x 2`, x to the right before y down, in pixels of its own size, with a mask of where it is valid in `.npz`; NaN,
//! infinity and more than 1e9 are not valid. All of these may be smaller or larger than the photo, in its shape.
//!
//! Truth masks of what does not belong to the place are named in the dataset's own file (`transient_mask_path`, see
//! [`TruthMask`]), and so is exact flow (`flow_path`, see [`FlowTruth`]): they are for scoring and never reach training. So is exact scene
//! flow ([`SceneFlow`]), which drawn scenes carry and no file holds. Where priors are to be perfect, they are written as priors from what a
//! scene was drawn from ([`Drawn`](crate::synthetic::Drawn)), and read as any others.
//!
//! Paths only are kept in a [`Frame`](crate::Frame); `Frame::read_*` decodes at the file's own size and checks it.

mod features;
mod flow;
mod motion;
mod scene_flow;
mod segments;
mod truth;

use std::path::{Path, PathBuf};

pub use features::Features;
pub use flow::{Flow, FlowPlace, FlowTruth};
pub use motion::{Disparity, FlowPrior, MotionFiles};
pub(crate) use scene_flow::one_frame_on;
pub use scene_flow::{FollowedPoint, SceneFlow};
pub use segments::{LabelMap, PromptedSegment, Segments};
pub use truth::TruthMask;

/// Files that other programs made of a photo. See the table above for their names and forms.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Priors {
    /// Segments that cover the photo: a label map, or a folder of black and white pictures.
    pub segments: Option<PathBuf>,
    /// Segments around feature points: a folder of black and white pictures.
    pub prompted: Option<PathBuf>,
    /// Dense features.
    pub features: Option<PathBuf>,
    /// Optical flow, disparity, what moves.
    pub motion: MotionFiles,
}

impl Priors {
    /// The files that stand beside a photo of the dataset in the folder `root`. A label map comes before a stack.
    #[must_use]
    pub fn beside(photo: &Path, root: &Path) -> Self {
        let file = |extension: &str| Some(photo.with_extension(extension)).filter(|p| p.is_file());
        let folder = |extension: &str| Some(photo.with_extension(extension)).filter(|p| p.is_dir());
        Self {
            segments: file("segs.png").or_else(|| folder("segs")),
            prompted: folder("points"),
            features: file("features.npy"),
            motion: MotionFiles::beside(photo, root),
        }
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// A feature of a photo that belongs to a reconstructed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// Where it is seen: column and row at the photo's native size, [`Frame::camera`](crate::Frame::camera); pixel `(i, j)` has its centre at
    /// `(i + 0.5, j + 0.5)`.
    pub pixel: [f32; 2],
    /// Number of photos of the model the point is seen in, this one included.
    pub length: u32,
    /// Index into [`crate::Scene::points`].
    pub point: u32,
}
