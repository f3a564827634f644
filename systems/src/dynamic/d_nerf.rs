//! D-NeRF: a canonical scene and where each point of a moment is in it (Pumarola, Corona, Pons-Moll, Moreno-Noguer,
//! "D-NeRF: Neural Radiance Fields for Dynamic Scenes", 2021).
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t), p)  for t != 0,   0 for t = 0     (equation 3)
//! (c, sigma) = Psi_x(gamma(x + dx), p, gamma(d))                    (equation 2)
//! ```
//!
//! The canonical scene is that of `t = 0`, where the deformation is not evaluated. Besides the octaves of place and time both
//! networks see `p`, planes of features of both, as the field sees a grid of features of place: minutes instead of days, and
//! what no displacement explains in so short a time is there all the same. `planes_seen_by=warp` is the published density,
//! `planes=[]` the published networks.

use super::config::{DynamicConfig, OriginKind, SeesKind, WarpKind};
use super::t_nerf;
use crate::claims::Claim;
use crate::deform::SeenBy;

/// What differs from the paper.
pub(super) const CLAIM: Claim = Claim {
    name: "d-nerf",
    paper: "Pumarola et al., 2021",
    differs: "A hybrid: a hash grid, a displacement of 3 x 64 with 4 octaves of the point and 6 of the time, and \
              planes of place and time that density sees directly, instead of two 8 x 256 networks with 10 \
              octaves. `planes=[]` leaves hash grid and displacement.",
    mark: "hybrid: hash grid, planes of time",
};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig {
        warp: WarpKind::Translation,
        origin: OriginKind::Canonical,
        warp_octaves: 4,
        time_octaves: 6,
        sees: SeesKind::Place,
        planes_seen_by: SeenBy::Both,
        ..t_nerf::settings()
    }
}
