//! Files to a [`Scene`] and back.
//!
//! [`load`] finds out which dialect a folder is written in and reads it; everything above sees one type. Axes, units
//! and the pixel centre are those of `CONVENTIONS.md`: cameras are converted to CV axes here, world axes and the world
//! unit stay those of the file. Images are decoded on demand by an [`ImageStore`]. [`check`] lists everything that is
//! wrong with a dataset at once.

mod error;
mod files;
mod options;
mod picture;
mod scene;

pub use error::{ErrorKind, Place, Problem, SceneError, Severity};
pub use options::{Holdout, LoadOptions, Masks, MissingImages};
pub use picture::{Image, ImageStore, StoreOptions};
pub use scene::{Bounds, Dialect, Frame, ImageSource, LayoutHint, MaskPolarity, Point, Scene, Split};
