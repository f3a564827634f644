//! D-NeRF: a canonical scene and where each point of a moment is in it (Pumarola, Corona, Pons-Moll, Moreno-Noguer,
//! "D-NeRF: Neural Radiance Fields for Dynamic Scenes", 2021).
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t))  for t != 0,   0 for t = 0        (equation 3)
//! (c, sigma) = Psi_x(gamma(x + dx), gamma(d))                      (equation 2)
//! ```
//!
//! The canonical scene is that of `t = 0`, where the deformation is not evaluated. Besides the octaves of place and time its network
//! sees planes of features of both, as the field sees a grid of features of place: minutes instead of days.

use super::config::{DynamicConfig, OriginKind, WarpKind};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig {
        warp: WarpKind::Translation,
        origin: OriginKind::Canonical,
        warp_octaves: 4,
        planes: vec![16, 32],
        ..DynamicConfig::still()
    }
}
