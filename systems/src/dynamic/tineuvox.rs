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
//! Voxels double in number three times. `t = 0` is a time like any other. The released code's losses beside the error of pixels
//! are settings of the field, `background_entropy=1e-3` and `point_colour=0.01`; they are off, as what they bring was not measured.

use super::config::{DynamicConfig, MomentKind, OriginKind, SeesKind, WarpKind};
use crate::static_scene::ngp::NgpConfig;

/// Features of a voxel, and voxels along an axis, of the small model (table 1, "S").
const FEATURES: usize = 4;
const VOXELS: usize = 100;

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
pub(super) fn field(config: &mut NgpConfig) {
    (config.voxels, config.features, config.width) = (VOXELS, FEATURES, 64);
}
