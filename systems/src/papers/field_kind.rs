//! Fast field or published networks: `--set field=ngp|mlp` of the systems that work on either.

use serde::{Deserialize, Serialize};

/// The field that is trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FieldKind {
    /// Hash grid and tiny networks: minutes.
    #[default]
    Ngp,
    /// The networks of NeRF, as published: hours.
    Mlp,
}
