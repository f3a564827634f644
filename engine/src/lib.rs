//! What every radiance-field system shares: from photos in memory to a finished run folder. It knows no method.
//!
//! The contract of a method is [`system::System`]; crate `systems` has the methods.
//!
//! **Before training**
//! * [`source`], [`names`]: scenes by word or path; names of views.
//! * [`data`]: views at training resolution and the ray batches drawn from them.
//! * [`options`]: what a run is asked for and what was decided from it.
//! * [`photo_points`], [`scene_points`], [`neighbours`]: points found in photos, which points training may use, distances to
//!   the nearest of them.
//! * [`memory`], [`frame_memory`]: what a run and the pictures of a path will take, and which are refused.
//!
//! **Training**
//! * [`run`]: the folder of one training, from start or resume to report.
//! * [`train`]: the loop of steps, evaluation and checkpoints; [`log`] its `metrics.csv`, [`checkpoint`] its state.
//! * [`watch`]: warnings of runs that explain the scene away. [`halt`]: interrupts. [`progress`]: what people see meanwhile.
//! * [`output`]: files that are written whole or not at all. [`identity`]: whether a scene is the one trained on.
//!
//! **After training**
//! * [`render`], [`picture`]: pictures. [`appearance`]: in which photo's appearance. [`canonical`]: which point of the scene at
//!   rest a pixel shows.
//! * [`eval`], [`eval_scales`], [`lpips_file`]: how good they are. [`skips`]: what they left out. [`report`], [`summary`]: all of
//!   it on one page.
//! * [`camera_path`], [`time_path`]: cameras and times to render along. [`video`]: pictures to a video, by `ffmpeg`.
//! * [`crop`]: which part of a reconstruction is shown and exported. [`surface`], [`mesh`], [`frame_points`]: points and meshes.

pub mod appearance;
pub mod camera_path;
pub mod canonical;
pub mod checkpoint;
pub mod crop;
pub mod data;
pub mod error;
pub mod eval;
pub mod eval_scales;
pub mod frame_memory;
pub mod frame_points;
pub mod halt;
pub mod identity;
pub mod log;
pub mod lpips_file;
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
pub mod skips;
pub mod source;
pub mod summary;
pub mod surface;
pub mod system;
pub mod time_path;
pub mod train;
pub mod video;
pub mod watch;

pub use error::RunError;
