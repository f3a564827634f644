//! What every radiance-field system shares: from photos in memory to a finished run folder. It names no system.
//!
//! The contract of a system is [`system::System`]; the crate `systems` has the systems.
//!
//! A room imports from the rooms above it in this list, never the other way round.
//!
//! **Ground**
//! * [`error`]: what can go wrong. [`halt`]: a request to stop. [`output`]: files that are written whole or not at all.
//!   [`identity`]: hashes of files and datasets. [`names`]: names of views.
//! * [`options`]: what a run was asked for and what was decided from it, as plain data. [`progress`]: what is shown meanwhile.
//! * [`neighbours`], [`same_place`], [`scene_points`]: distances to the nearest of many points, masks that show one place, points
//!   that training may use. [`time_path`]: times to render along.
//!
//! **Before training**
//! * [`source`]: scenes by word or path. [`tensors`]: named arrays of a checkpoint. [`data`]: views at training resolution and
//!   the ray batches drawn from them.
//! * [`system`]: the contract of a system.
//! * [`checkpoint`]: the state of a training on the disk. [`folder`]: the run folder: names in it, its lock, whether it is still
//!   the same.
//! * [`photo_points`]: points found in photos.
//!
//! **Training and measuring**
//! * [`render`], [`picture`]: pictures. [`canonical`]: which point of the canonical scene a pixel shows.
//! * [`memory`]: what a run and the pictures of a path will take, and which are refused.
//! * [`eval`]: how good held-out views are, at several scales, with masks, and what renders skip. [`log`]: `metrics.csv`.
//! * [`train`]: the loop of steps, evaluation and checkpoints. [`summary`], [`report`]: the results, for programs and as a page.
//!
//! **After training**
//! * [`camera_path`]: cameras to render along. [`flow`]: where pixels go from one of its frames to the next. [`video`]: pictures to a
//!   video, by `ffmpeg`.
//! * [`crop`]: which part of a reconstruction is shown and exported. [`surface`], [`mesh`]: points and meshes.
//!
//! **The whole**
//! * [`run`]: one training and its folder, from start or resume to report. [`appearance`]: its pictures in the appearance of a
//!   photo.

pub mod appearance;
pub mod camera_path;
pub mod canonical;
pub mod checkpoint;
pub mod crop;
pub mod data;
pub mod error;
pub mod eval;
pub mod flow;
pub mod folder;
pub mod halt;
pub mod identity;
pub mod log;
pub mod memory;
pub mod mesh;
pub mod names;
pub mod neighbours;
pub mod options;
pub mod output;
pub mod photo_points;
pub mod picture;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub mod same_place;
pub mod scene_points;
pub mod source;
pub mod summary;
pub mod surface;
pub mod system;
pub mod tensors;
pub mod time_path;
pub mod train;
pub mod video;

pub use error::RunError;
