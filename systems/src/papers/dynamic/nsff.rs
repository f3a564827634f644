//! NSFF: what moves says where it goes (Li, Niklaus, Snavely, Wang, "Neural Scene Flow Fields for Space-Time View Synthesis of Dynamic
//! Scenes", 2021).
//!
//! ```text
//! (g_s, sigma_s) = F_still(x),   (g_i, sigma_i, v, S_i, p_i) = F_moving(x, i)         g: what colours depend on
//! sigma = (1 - v) sigma_s + v sigma_i,   P = v sigma_i / sigma,   c = F_colour((1 - P) g_s + P g_i, d)         fields::blend
//! C_ji: colours at x + S_ij at the time of j, along the ray of i
//! L = L_full + L_photo + L_cycle + 0.2 L_flow + 0.04 L_depth + 0.1 (L_hidden + L_small + L_spatial + L_steady)     (section 3.2)
//! ```
//!
//! The second line stands for the sum over both parts of section 3.3, where opacities and colours are mixed by `v`: here densities are, and
//! the features that one network makes colours of.
//!
//! `F_moving` is a hash grid with planes of place and time, in cells where something moves; `F_still` is the field of `ngp`. The gate `v`
//! belongs to the moving part, as it is there for its cells alone. What each loss is stands in `flow_terms`; its factors are those
//! of the released code. Those of optical flow and disparities fall to a tenth after each quarter of what is left of the run; after the
//! first of them renders count by the share of a ray that moves. Chains of two frames come in its later half.

use super::flow_terms::FlowWeights;
use super::t_nerf;
use crate::claims::Claim;
use crate::plan::{Ask, Built, Moving, RaySettings, moving_field};
use crate::rays::{FlowConfig, FlowSettings};
use crate::settings::Settings;
use engine::system::SystemError;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "nsff",
    paper: "Li et al., 2021",
    what: "A still part, and a moving one that says where its points are a frame on and a frame back; held to optical flow and disparities, if any",
    take: "a film by one camera that moves; one photo a time",
    differs: "Two hash grids, the moving one with planes of time, not 8 x 256 networks: there only where something moves, \
              after a seventh of the run; elsewhere it shows the still part. Densities and features are mixed; the gate knows the time and has another entropy; errors are means over all rays; scene flow ends at a \
              tenth of the cube; hard rays have large errors. Optical flow counts ten times as much; priors are optional.",
    mark: "hash grids, a moving part where something moves",
};

/// Ten times the released 0.02: hundreds of steps are not 250 000, and in pictures of 128 rows a pixel is more than two of those it was
/// released for (docs/decisions/0053).
pub(super) const OPTICAL: f32 = 0.2;

/// Factors as released, but for that of optical flow. What they multiply is not in all: means of weighted errors are over all rays (`render_terms`), scene flow is at most
/// a tenth of the unit cube, and the gate has the entropy of `background=static` (docs/decisions/0053). Losses of scene flow are in
/// sides of the unit cube, half of them in NDC.
const WEIGHTS: FlowWeights = FlowWeights {
    flow_renders: 1.0,
    flow_hidden: 0.1,
    flow_cycle: 1.0,
    flow_optical: OPTICAL,
    flow_small: 0.1,
    flow_spatial: 0.1,
    flow_steady: 0.1,
    flow_order: 0.0,
    flow_still: 0.0,
    flow_mask: 0.0,
    flow_entropy: 0.0,
    flow_by_share: true,
};

/// Half of the rays where the errors are.
pub(super) const RAYS: RaySettings = RaySettings { by_error: true, ..RaySettings::ANYWHERE };

/// Scene flow and what is hidden.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot be.
pub(crate) fn flow(settings: &mut Settings<'_>) -> Result<FlowConfig, SystemError> {
    let terms = WEIGHTS.asked(settings)?.terms();
    FlowConfig::asked(&FlowSettings::PLANNED, true, terms, settings)
}

/// A still part, and before it one that moves.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { rays: RAYS, flow: Some(flow), ..Moving::deformed(t_nerf::deform) })
}
