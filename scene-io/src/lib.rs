//! Files to a [`Scene`] and back.
//!
//! [`load`] finds out which dialect a folder is written in and reads it; everything above sees one type. Axes, units
//! and the pixel centre are those of `CONVENTIONS.md`: cameras are converted to CV axes here, world axes and the world
//! unit stay those of the file. Images are decoded on demand by an [`ImageStore`]. [`check`] lists everything that is
//! wrong with a dataset at once. Clouds of Gaussians are read and written by [`read_splats`] and [`write_splats`].
#![expect(clippy::result_large_err, reason = "a problem is moved once for each bad frame: boxing would buy nothing")]

mod assemble;
mod blender;
pub mod capture;
mod check;
pub mod colmap;
mod decode_memory;
mod depth;
mod detect;
mod endonerf;
mod error;
pub mod export;
mod files;
mod hash;
mod images_folder;
mod instant_ngp;
mod json;
mod limits;
mod llff;
mod load;
mod mask_files;
mod naming;
mod nerfies;
mod nerfstudio;
mod npy;
mod nr_nerf;
mod options;
mod perturb;
mod picture;
mod ply;
mod pose;
mod priors;
mod random;
mod reading;
mod scene;
mod splats;
mod splits;
pub mod synthetic;
pub mod time;
mod transforms;
mod unposed;
mod validation;

pub use check::{Depth, DepthSummary, Report, check};
pub use decode_memory::{DecodeMemory, available_bytes};
pub use depth::{DepthMap, DepthMeaning, DepthPlace, DepthSource};
pub use detect::lacks_cameras;
pub use error::{ErrorKind, Place, Problem, SceneError, Severity, one_line};
pub use load::{load, load_cameras};
pub use options::{Holdout, LoadOptions, Masks, MissingImages, TrainPhotos, Validation};
pub use perturb::{Bars, ColourChange, Disturbance, Perturbation, perturb};
pub use picture::{Image, ImageStore, Picture, StoreOptions, decode_photo, photo_size, with_photo};
pub use priors::{
    BitMask, Features, Flow, FlowPlace, FlowTruth, LabelMap, Priors, PromptedSegment, Segments, TrackPoint, TruthMask,
    refuse_blank_masks,
};
pub use scene::{
    AlphaMeaning, Bounds, Dialect, Frame, FrameIds, ImageSource, LayoutHint, MaskPolarity, Point, Scene, Split, Truth,
};
pub use splats::{SplatFile, SplatFormat, SplatOptions, encode_splats, parse_splats, read_splats, write_splats};
pub use unposed::{Unposed, is_photo, is_video, unposed};
