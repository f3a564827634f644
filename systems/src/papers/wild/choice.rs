//! The parts that a system is made of.

pub use crate::papers::field_kind::FieldKind;
use serde::{Deserialize, Serialize};

/// The appearance model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AppearanceKind {
    /// One appearance for all photos.
    #[default]
    None,
    /// A free code for each photo (NeRF-W).
    Codes,
    /// A network encodes the photo (Ha-NeRF).
    Encoder,
}

/// The occluder model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OccluderKind {
    /// There are no occluders.
    #[default]
    None,
    /// Outliers are left out (RobustNeRF).
    Robust,
    /// A second field explains occluders (NeRF-W).
    Transient,
    /// A network in image space predicts where they are (Ha-NeRF).
    Visibility,
    /// A network in image space predicts where they are and of what colour (SF-NeRF).
    Filter,
    /// They are found after a short training, then masked (HuGS).
    Masks,
}

/// The parts of a system.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// `ngp` or `mlp`.
    pub field: FieldKind,
    /// `none`, `codes` or `encoder`.
    pub appearance: AppearanceKind,
    /// `none`, `robust`, `transient`, `visibility`, `filter` or `masks`.
    pub occluders: OccluderKind,
}

impl Choice {
    /// The name of the system that these parts make.
    #[must_use]
    pub fn name(self) -> &'static str {
        use AppearanceKind as A;
        use OccluderKind as O;
        match (self.appearance, self.occluders) {
            (A::None, O::None) => "plain",
            (A::Encoder, O::None) => "ha-nerf-a",
            (A::None, O::Visibility) => "ha-nerf-t",
            (_, O::Visibility) => "ha-nerf",
            (_, O::None) => "nerf-a",
            (A::None, O::Transient) => "nerf-u",
            (_, O::Transient) => "nerf-w",
            (_, O::Robust) => "robust-nerf",
            (_, O::Masks) => "hugs",
            (_, O::Filter) => "sf-nerf",
        }
    }
}
