//! TiNeuVox: voxels that know of time (Fang, Yi, Wang, Xie, Zhang, Liu, Niessner, Tian, "Fast Dynamic Radiance Fields with
//! Time-Aware Neural Voxels", 2022).
//!
//! ```text
//! t' = MLP_t(gamma(t))
//! x' = x + MLP_d(gamma(x), t')
//! f  = gamma(V(x'), V/2(x'), V/4(x'))       one grid at three distances (section 3.3)
//! (c, sigma) = MLP(f, t', gamma(x); d)      x where it is, not where it was
//! ```
//!
//! Voxels double in number three times. `t = 0` is a time like any other. Beside the error of pixels it has the released
//! code's losses on the ends of rays (`background_entropy`) and on the colours of samples (`point_colour`), with its factors.

use super::config::{DynamicConfig, MomentKind, OriginKind, SeesKind, WarpKind};
use crate::claims::Claim;
use crate::fields::VoxelSettings;
use crate::rays::RayConfig;
use std::sync::Arc;

/// What differs from the paper.
pub(super) const CLAIM: Claim = Claim {
    name: "tineuvox",
    paper: "Fang et al., 2022",
    differs: "Networks learn at the grid's 2e-2 (released: 8e-4) and geometry has 16 numbers (64); there is no \
              variation loss of voxels. Voxels double every 500 steps, whatever the length of the run: a run of a \
              minute never reaches the full grid.",
    mark: "own rates, grid not grown in minutes",
};

/// Features of a voxel, and voxels along an axis, of the small model (table 1, "S").
const FEATURES: usize = 4;
const VOXELS: usize = 100;
/// Steps between one doubling of the voxels and the next.
const VOXELS_EVERY: u64 = 500;

/// Factors of its losses beside the error of pixels, as released.
const BACKGROUND_ENTROPY: f32 = 1e-3;
const POINT_COLOUR: f32 = 0.01;

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig {
        moment: MomentKind::Network,
        time_octaves: 8,
        moment_dims: 5 * FEATURES,
        warp: WarpKind::Translation,
        origin: OriginKind::Free,
        warp_octaves: 10,
        warp_depth: 2,
        sees: SeesKind::Point,
        sees_octaves: 10,
        warp_lr: 0.03,
        ..DynamicConfig::still()
    }
}

/// Its field.
pub(super) fn field(config: &mut RayConfig) {
    config.features = Arc::new(VoxelSettings { voxels: VOXELS, voxels_every: VOXELS_EVERY, features: FEATURES });
    config.networks.width = 64;
    config.terms.background_entropy = BACKGROUND_ENTROPY;
    config.terms.point_colour = POINT_COLOUR;
}
