//! Radiance-field systems, composed from the math crates, and what is written once above them.
//!
//! * [`system`]: the contract of a reconstruction method.
//! * [`method`]: the seam between a field and what a method for photographs from the wild adds to it.
//! * [`data`]: views at training resolution and the ray batches drawn from them.
//! * [`options`]: what a run is told and what was decided from it.
//! * [`run`]: the folder of one training, from start or resume to report.
//! * [`train`]: the loop of steps, evaluation and checkpoints; [`log`] its `metrics.csv`, [`checkpoint`] its state.
//! * [`frame_memory`]: what the pictures of a path take, and which are refused.
//! * [`render`], [`picture`], [`eval`], [`eval_scales`], [`skips`], [`report`]: pictures, how good they are, and what they left out.
//! * [`canonical`]: which point of the scene at rest a pixel shows.
//! * [`appearance`]: in which photo's light pictures are rendered.
//! * [`splats`]: systems of Gaussian splats. [`bake`]: any field as a cloud of Gaussians, to look at and to export.
//! * [`crop`]: which part of a reconstruction is shown and exported.
//! * [`source`], [`names`], [`camera_path`], [`surface`]: scenes by word, cameras to render along, points and meshes to export;
//!   [`mesh`]: the same out of rendered depth, for fields and clouds alike.
//! * [`video`]: pictures to a video, by `ffmpeg`.

pub mod appearance;
pub mod bake;
pub mod camera_path;
pub mod canonical;
pub mod checkpoint;
pub mod claims;
pub mod crop;
pub mod data;
pub mod deform;
pub mod dynamic;
pub mod error;
pub mod eval;
pub mod eval_scales;
pub mod frame_memory;
pub mod frame_points;
pub(crate) mod free_space;
pub mod halt;
pub mod identity;
pub mod layout;
pub mod log;
pub mod lpips_file;
pub mod memory;
pub mod mesh;
pub mod method;
pub mod names;
pub mod options;
pub mod output;
pub mod photo_points;
pub mod picture;
pub mod plan;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub(crate) mod same_place;
pub mod skips;
pub mod source;
pub mod space;
pub mod splats;
pub mod static_scene;
pub mod summary;
pub mod surface;
pub mod system;
pub mod time_path;
pub mod train;
pub mod video;
pub(crate) mod watch;
pub mod wild;

pub use error::RunError;
