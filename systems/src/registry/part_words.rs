//! The words of `--set appearance=` and `--set occluders=`: fields have others than clouds.

use crate::cloud_appearance::CloudAppearance;
use crate::cloud_occluders::CloudOccluders;
use crate::papers::wild::{AppearanceKind, OccluderKind};
use crate::settings::words_of;

/// The words of both settings, in the order in which they are defined.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartWords {
    /// Of `appearance`.
    pub appearance: Vec<String>,
    /// Of `occluders`.
    pub occluders: Vec<String>,
}

impl PartWords {
    /// Of systems on a field.
    #[must_use]
    pub fn of_fields() -> Self {
        Self { appearance: words_of::<AppearanceKind>(), occluders: words_of::<OccluderKind>() }
    }

    /// Of clouds of Gaussians.
    #[must_use]
    pub fn of_clouds() -> Self {
        Self { appearance: words_of::<CloudAppearance>(), occluders: words_of::<CloudOccluders>() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_and_clouds_have_words_of_their_own() {
        let [fields, clouds] = [PartWords::of_fields(), PartWords::of_clouds()];
        assert_eq!(fields.appearance, ["none", "codes", "encoder"]);
        assert_eq!(fields.occluders, ["none", "robust", "transient", "visibility", "filter", "masks"]);
        assert_eq!(clouds.appearance, ["none", "codes", "maps", "triplane"]);
        assert_eq!(
            clouds.occluders,
            ["none", "photos", "residual", "errors", "features", "auto", "visibility", "visibility_head"]
        );
    }
}
