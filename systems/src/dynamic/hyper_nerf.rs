//! HyperNeRF: Nerfies' motions, and coordinates beyond space in which what motion cannot explain may change (Park, Sinha,
//! Hedman, Barron, Bouaziz, Goldman, Martin-Brualla, Seitz, "HyperNeRF: A Higher-Dimensional Representation for
//! Topologically Varying Neural Radiance Fields", 2021).
//!
//! ```text
//! x' = T(x, w_i)                 as Nerfies, without the elastic loss
//! a  = H(gamma(x), w_i)          ambient coordinates: a bendy sheet that cuts the template (section 3.3)
//! (c, sigma) = F(x', gamma_b(a), d)
//! ```

use super::config::DynamicConfig;
use super::nerfies;
use crate::claims::Claim;

/// What differs from the paper.
pub(super) const CLAIM: Claim = Claim {
    name: "hypernerf",
    paper: "Park et al., 2021",
    differs: "As `nerfies` here, on a hash grid with planes of place and time in the warp and short schedules; the \
              ambient coordinates are those of the bendy sheet alone. The axis-aligned plane and codes of \
              appearance are not built.",
    mark: "hash grid, short schedules",
};

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig { ambient: 2, elastic: 0.0, ..nerfies::settings() }
}
