//! Files to a [`Scene`] and back: dataset readers, exporters, and drawn scenes with exact truth.
//!
//! * Reading: [`load`] and [`load_cameras`], with [`LoadOptions`], find out in which format a folder is written, and read it
//!   (Blender, instant-ngp, nerfstudio, COLMAP, LLFF, NR-NeRF, Nerfies, EndoNeRF); [`check()`] lists everything that is wrong
//!   with it at once; [`capture`] finds photos and cameras that cannot give a good result; [`unposed()`] finds photos without
//!   cameras.
//! * The scene: [`Scene`], [`Frame`], [`Priors`], and [`Truth`], which is for scoring only.
//! * Pictures: [`Scene::picture`] decodes one photo; [`ImageStore`] decodes many on demand, within [`DecodeMemory`]; [`Size`].
//! * Maps beside photos: [`DepthMap`], [`Segments`], [`Features`], [`Flow`], [`Disparity`], [`BitMask`]; [`write_flo`], [`write_disparity`].
//!   Points that are followed: [`SceneFlow`].
//! * Splats: [`read_splats`] and [`write_splats`] (PLY, SPLAT, SPZ).
//! * Writing: [`export`] (meshes as PLY, OBJ and GLB, points, cameras), [`colmap`].
//! * Drawn scenes with exact truth: [`synthetic`]; photos with known damage: [`perturb()`].
//!
//! Code that uses this crate sees one type, [`Scene`], whatever the format ([`Dialect`]) of the files. Cameras are converted to
//! CV axes (x right, y down, z forward) with pixel centres at `+ 0.5`; world axes and the world unit stay those of the file.
//! Errors name file, field, value and remedy. There are no features.
//!
//! ```
//! use scene_io::synthetic::{TabletopOptions, tabletop};
//! use scene_io::{Split, glam::DVec2};
//!
//! // A drawn scene; `load(path, &LoadOptions::default())?` reads one from a folder.
//! let scene = tabletop(&TabletopOptions { train: 2, test: 1, ..TabletopOptions::default() });
//! for i in scene.split(Split::Train) {
//!     let (camera, picture) = (&scene.frames[i].camera, scene.picture(i)?);
//!     let colours = picture.over([1.0; 3]);
//!     assert_eq!(colours.len(), camera.width as usize * camera.height as usize);
//!     let ray = camera.ray(DVec2::new(0.5, 0.5)).expect("a pinhole has a ray for every pixel");
//!     assert!((ray.d.length() - 1.0).abs() < 1e-12);
//! }
//! # Ok::<(), scene_io::SceneError>(())
//! ```
#![forbid(unsafe_code)]
#![expect(clippy::result_large_err, reason = "a problem is moved once for each bad frame: boxing would buy nothing")]

mod assemble;
mod bit_mask;
mod blender;
pub mod capture;
mod check;
pub mod colmap;
mod decode_memory;
mod depth;
mod detect;
mod disparity_files;
mod endonerf;
mod error;
pub mod export;
mod files;
mod flow_files;
mod frame_files;
mod given_priors;
mod hash;
mod image_store;
mod images_folder;
mod instant_ngp;
mod json;
mod limits;
mod listing;
mod llff;
mod load;
mod mask_files;
mod naming;
mod nerfies;
mod nerfstudio;
mod npy;
mod npy_writer;
mod npz;
mod nr_nerf;
mod options;
mod perturb;
mod perturbation;
mod picture;
mod ply;
mod pose;
mod priors;
mod random;
mod reading;
mod scene;
mod size;
mod splats;
mod splits;
pub mod synthetic;
pub mod time;
mod transforms;
mod unposed;
mod validation;

pub use glam;
pub use render_core;
pub use splat_core;

pub use bit_mask::BitMask;
pub use check::{Depth, DepthSummary, MotionSummary, Report, check};
pub use decode_memory::{DecodeMemory, available_bytes};
pub use depth::{DepthMap, DepthMeaning, DepthPlace, DepthSource};
pub use detect::{holds_no_dataset, lacks_cameras};
pub use disparity_files::write_disparity;
pub use error::{ErrorKind, Place, Problem, SceneError, Severity, one_line};
pub use files::images_in;
pub use flow_files::write_flo;
pub use frame_files::refuse_blank_masks;
pub use image_store::{ImageStore, StoreOptions};
pub use load::{load, load_cameras};
pub use options::{Holdout, LoadOptions, Masks, MissingImages, TrainPhotos, Validation};
pub use perturb::perturb;
pub use perturbation::{Bars, ColourChange, Perturbation, PerturbationKind};
pub use picture::{Image, Picture, decode_photo, photo_size, with_photo};
pub use priors::{
    Disparity, Features, Flow, FlowPlace, FlowPrior, FlowTruth, FollowedPoint, LabelMap, MotionFiles, Priors,
    PromptedSegment, SceneFlow, Segments, TrackPoint, TruthMask,
};
pub use scene::{
    AlphaMeaning, Bounds, Dialect, Frame, FrameIds, ImageSource, LayoutHint, MaskPolarity, Point, Scene, Split, Truth,
};
pub use size::Size;
pub use splats::{SplatFile, SplatFormat, SplatOptions, encode_splats, parse_splats, read_splats, write_splats};
pub use unposed::{Unposed, is_photo, is_video, unposed};
