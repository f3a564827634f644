//! Occluders before a cloud of Gaussians: which pixels of the photos show the scene.
//!
//! | kind | file |
//! | --- | --- |
//! | `photos`: found by comparing all photos with their renders, from time to time | [`photo_masks`] |
//! | `residual`: by the structure of one photo and its render, in each step | [`structure`] |
//! | `errors`, `features`: by errors of one photo, and what errors and features of the last photos say of them | [`spotless`] |
//! | `visibility`: by the colours of one photo and its render, in each step | [`visibility`] |
//! | `visibility_head`: as a network says of the photo, which learns where colours are off | [`visibility_head`] |

mod error_histogram;
mod feature_network;
mod photo_features;
mod photo_masks;
mod settings;
mod spotless;
mod structure;
mod structure_parts;
mod visibility;
mod visibility_head;

pub(crate) use photo_features::PhotoFeatures;
pub(crate) use photo_masks::{MaskSettings, PhotoMasks};
pub(crate) use settings::{CloudOccluders, OccluderChoice};
pub(crate) use spotless::{ErrorJudge, ErrorMaskSettings, FeatureMaskSettings};
pub(crate) use structure::{StructureJudge, StructureSettings};
pub(crate) use visibility::{VisibilityJudge, VisibilitySettings};
pub(crate) use visibility_head::{HeadSettings, VisibilityHead};
