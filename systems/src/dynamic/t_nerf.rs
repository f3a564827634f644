//! T-NeRF: a field that depends on time (Pumarola, Corona, Pons-Moll, Moreno-Noguer, "D-NeRF: Neural Radiance Fields for
//! Dynamic Scenes", 2021, section 4, the baseline without deformation).
//!
//! ```text
//! (c, sigma) = F(gamma(x), gamma(t), gamma(d))
//! ```
//!
//! Nothing ties one moment to the next but the smoothness of the network.

use super::config::{DynamicConfig, SeesKind};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig { sees: SeesKind::Moment, ..DynamicConfig::still() }
}
