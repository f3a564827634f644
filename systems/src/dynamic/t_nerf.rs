//! T-NeRF: a field that depends on time (Pumarola, Corona, Pons-Moll, Moreno-Noguer, "D-NeRF: Neural Radiance Fields for
//! Dynamic Scenes", 2021, section 4, the baseline without deformation).
//!
//! ```text
//! (c, sigma) = F(gamma(x), gamma(t), gamma(d))
//! ```
//!
//! Nothing ties one moment to the next but the smoothness of the network, and that of planes of features of place and time
//! (Fridovich-Keil et al., "K-Planes", 2023), which it sees as the field sees a grid of features of place: minutes instead of
//! days. `planes=[]` leaves the network alone.

use super::config::{DynamicConfig, SeesKind};
use crate::claims::Claim;
use crate::deform::SeenBy;

/// What differs from the paper.
pub(super) const CLAIM: Claim = Claim {
    name: "t-nerf",
    paper: "Pumarola et al., 2021",
    differs: "A hash grid and planes of features of place and time instead of the published 8 x 256 network, and 3 \
              octaves of the time instead of 10. `planes=[]` leaves the hash grid and a small network.",
    mark: "hash grid, planes of time",
};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig {
        sees: SeesKind::Moment,
        planes: vec![32, 64],
        planes_seen_by: SeenBy::Density,
        plane_tv: 1e-3,
        plane_slow: 1e-2,
        ..DynamicConfig::still()
    }
}
