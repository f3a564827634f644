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

/// Settings.
pub(super) fn settings() -> DynamicConfig {
    DynamicConfig { ambient: 2, elastic: 0.0, ..nerfies::settings() }
}
