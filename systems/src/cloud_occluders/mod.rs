//! Occluders before a cloud of Gaussians: which pixels of the photos show the scene.
//!
//! | kind | file |
//! | --- | --- |
//! | `photos`: found by comparing all photos with their renders, from time to time | [`photo_masks`] |
//! | `residual`: by the structure of one photo and its render, in each step | [`structure`] |
//! | `visibility`: by the colours of one photo and its render, in each step | [`visibility`] |

mod photo_masks;
mod settings;
mod structure;
mod structure_parts;
mod visibility;

pub(crate) use photo_masks::{MaskSettings, PhotoMasks};
pub(crate) use settings::{CloudOccluders, OccluderChoice};
pub(crate) use structure::{StructureJudge, StructureSettings};
pub(crate) use visibility::{VisibilityJudge, VisibilitySettings};
