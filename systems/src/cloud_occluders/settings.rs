//! Which kind.

use serde::{Deserialize, Serialize};

/// What is done about occluders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum CloudOccluders {
    /// There are none.
    #[default]
    None,
    /// Masks, found by comparing all photos with their renders.
    Photos,
    /// What has not the structure of its photo is left out, photo by photo.
    Residual,
    /// What is further from its render than most pixels of the last photos is left out.
    Errors,
    /// Pixels whose features look like those of badly rendered pixels are left out.
    Features,
    /// `features` where photos have them as files, else `errors`.
    Auto,
    /// Pixels count less the more their colour is off, photo by photo.
    Visibility,
    /// Pixels count as a network says of the photo, which learns where colours are off.
    #[serde(rename = "visibility_head")]
    Head,
}

/// The kind, as a setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OccluderChoice {
    /// `none`, `photos`, `residual`, `errors`, `features`, `auto`, `visibility` or `visibility_head`.
    pub(crate) occluders: CloudOccluders,
}
