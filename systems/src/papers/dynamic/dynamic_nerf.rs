//! DynamicNeRF: a still part first, from what does not move, and then what moves (Gao, Saraf, Kopf, Huang, "Dynamic View Synthesis from
//! Dynamic Monocular Video", 2021).
//!
//! ```text
//! (c_s, sigma_s) = F_still(x, d)                                      from pixels that do not move
//! (c, sigma, s_fw, s_bw, b) = F_moving(x, t, d)
//! C_full = sum T (m alpha c + (1 - m) alpha_s c_s),   m = 1 - b       equation 14
//! C_t':  colours at x + s at the time of a frame beside
//! L = 3 L_full + L_dynamic + 0.02 L_motion + 0.04 L_depth + regularisers     cycle and smooth: equations 11 to 13, code
//! ```
//!
//! `F_moving` is a hash grid with planes of place and time, in cells where something moves; `F_still` is the field of `ngp`, whose density
//! is held once something moves. What each loss is stands in `flow_terms`; its factors are those of the released code.

use super::flow_terms::FlowWeights;
use super::{nsff, t_nerf};
use crate::claims::Claim;
use crate::plan::{Ask, Built, Moving, moving_field};
use crate::rays::{FlowConfig, FlowSettings};
use crate::settings::Settings;
use engine::system::SystemError;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "dynamic-nerf",
    paper: "Gao et al., 2021",
    what: "A still part from what masks leave, then held; before it one that moves, with scene flow, at the depths of the still one",
    take: "as `nsff`, with masks of what moves",
    differs: "Two hash grids, the moving one with planes of place and time, instead of 8 x 256 networks: it is there only where something \
              moves, after a seventh of the run, and its renders show the still part elsewhere. One network gives the colours of \
              both, and learns on while the rest of the still part is held. Densities are mixed, not colours; flow, disparities \
              and masks are optional.",
    mark: "hash grids, a moving part where something moves",
};

/// What the released code multiplies the error of the full render by, which is 1 here: all other factors are divided by it.
const FULL: f32 = 3.0;

/// As released; losses of scene flow are in sides of the unit cube, half of them in NDC.
const WEIGHTS: FlowWeights = FlowWeights {
    flow_renders: 1.0 / FULL,
    flow_hidden: 0.0,
    flow_cycle: 1.0 / FULL,
    flow_optical: 0.02 / FULL,
    flow_small: 0.01 / FULL,
    flow_spatial: 0.1 / FULL,
    flow_steady: 0.1 / FULL,
    flow_order: 0.1 / FULL,
    flow_still: 0.1 / FULL,
    flow_mask: 0.1 / FULL,
    flow_entropy: 1e-3 / FULL,
    flow_by_share: false,
};

/// Scene flow; the still part is held once something moves.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn flow(settings: &mut Settings<'_>) -> Result<FlowConfig, SystemError> {
    let terms = WEIGHTS.asked(settings)?.terms();
    let flow_disparity = FlowSettings::PLANNED.flow_disparity / FULL;
    let planned = FlowSettings { still_freezes: true, flow_disparity, ..FlowSettings::PLANNED };
    FlowConfig::asked(&planned, false, terms, settings)
}

/// A still part, and before it one that moves.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { rays: nsff::RAYS, flow: Some(flow), ..Moving::deformed(t_nerf::deform) })
}
