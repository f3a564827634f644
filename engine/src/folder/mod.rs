//! The folder of a run: the names of what lies in it, whether it may be written to, and by whom.
//!
//! ```text
//! layout.rs    names of the files and folders of a run
//! place.rs     whether a folder may become a run folder; what is removed from one
//! home.rs      whether the folder is still the one that the run began in
//! lock.rs      one writer a run folder
//! ```

mod home;
mod layout;
mod lock;
mod place;

pub(crate) use home::{Home, Place};
pub use layout::{ANIMATION, BAKED, MASKS, REPORT};
pub(crate) use layout::{
    APPEARANCE, CONFIG, EVAL, EVAL_CSV, EVAL_SCALES, EVAL_VIEWS, FINISHED, HELD_OUT, METRICS, PHOTO_POINTS, PROBE,
    RENDERS, SCHEDULE, SUMMARY, VALIDATION,
};
pub use lock::FolderLock;
pub(crate) use lock::was_locked;
pub use place::{clear, config};
pub(crate) use place::{refuse_foreign, sweep};
