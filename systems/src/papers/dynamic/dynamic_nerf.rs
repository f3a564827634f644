//! DynamicNeRF: a still part first, from what does not move, and then what moves (Gao, Saraf, Kopf, Huang, "Dynamic View Synthesis from
//! Dynamic Monocular Video", 2021).
//!
//! ```text
//! (g_s, sigma_s) = F_still(x)                                         from pixels that do not move; g: what colours depend on
//! (g_m, sigma_m, s_fw, s_bw, b) = F_moving(x, t)
//! sigma = (1 - m) sigma_s + m sigma_m,   m = 1 - b,   P = m sigma_m / sigma
//! C_full = sum T alpha F_colour((1 - P) g_s + P g_m, d)               fields::blend
//! C_t':  colours at x + s at the time of a frame beside
//! L = 3 L_full + L_dynamic + 0.2 L_motion + 0.04 L_depth + regularisers     cycle and smooth: equations 11 to 13, code
//! ```
//!
//! `C_full` stands for equation 14, where opacities and colours are mixed by `m`: here densities are, and the features that one network makes
//! colours of.
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
    differs: "Two hash grids, the moving one with planes of time, not 8 x 256 networks: there only where something \
              moves, after a seventh of the run. Densities are mixed, and features of one colour network, which learns on \
              while the rest of the still part is held; the gate has another entropy; weighted errors are means over all rays; \
              scene flow is at most a tenth of the cube. Optical flow counts tenfold; priors are optional.",
    mark: "hash grids, a moving part where something moves",
};

/// What the released code multiplies the error of the full render by, which is 1 here: all other factors are divided by it.
const FULL: f32 = 3.0;

/// Factors as released, but for that of optical flow. What they multiply is not in all: means of weighted errors are over all rays (`render_terms`), scene flow is at most
/// a tenth of the unit cube, and the gate has the entropy of `background=static` (docs/decisions/0053). Losses of scene flow are in
/// sides of the unit cube, half of them in NDC.
const WEIGHTS: FlowWeights = FlowWeights {
    flow_renders: 1.0 / FULL,
    flow_hidden: 0.0,
    flow_cycle: 1.0 / FULL,
    flow_optical: nsff::OPTICAL / FULL,
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
