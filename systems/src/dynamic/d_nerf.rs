//! D-NeRF: a canonical scene and where each point of a moment is in it (Pumarola, Corona, Pons-Moll, Moreno-Noguer,
//! "D-NeRF: Neural Radiance Fields for Dynamic Scenes", 2021).
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t))  for t != 0,   0 for t = 0        (equation 3)
//! (c, sigma) = Psi_x(gamma(x + dx), gamma(d))                      (equation 2)
//! ```
//!
//! The canonical scene is that of `t = 0`, where the deformation is not evaluated.

use super::config::{DynamicConfig, OriginKind, WarpKind};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig { warp: WarpKind::Translation, origin: OriginKind::Canonical, ..DynamicConfig::still() }
}
