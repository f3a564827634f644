//! EndoNeRF: tissue that deforms behind a tool, seen by a stereo endoscope that does not move (Wang, Long, Fan, Dou, "Neural
//! Rendering for Stereo 3D Reconstruction of Deformable Tissues in Robotic Surgery", 2022).
//!
//! The field is D-NeRF's. What is added:
//!
//! ```text
//! V = M (1 + P)                    rays: none through the tool, more where it often is (`data::Guide`)
//! t ~ N(D, s^2)                    cuts of the march around stereo depth
//! L = |C - C'|^2 + l Huber(D - D') depth, too
//! ```
//!
//! and now and then the stereo depths that disagree most with rendered ones give way to these. Distances are along rays in world
//! units, not in normalised device coordinates; samples never leave the ray.

pub(crate) use super::d_nerf::deform;
use crate::claims::Claim;
use crate::plan::{Ask, Built, Moving, RaySettings, moving_field};
use crate::samplers::DepthCueConfig;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "endo-nerf",
    paper: "Wang et al., 2022",
    what: "As `d-nerf`, with rays led by tool masks and samples and losses by measured depth, which is refined",
    take: "endoscopy; a camera that stands still, where depth was measured",
    differs: "The field is the hybrid of `d-nerf` here, not the published networks; distances are in world units \
              along rays instead of device coordinates, and measured depth cuts the march at 16 places instead of \
              placing all samples.",
    mark: "hybrid field, march cut by depth",
};

/// Masks lead the rays: none through a tool, more where it often is.
const RAYS: RaySettings = RaySettings { guided: true, ..RaySettings::ANYWHERE };

/// What measured depth does.
const DEPTH: DepthCueConfig = DepthCueConfig {
    depth: 1.0,
    depth_delta: 0.2,
    // Besides those of the march: where a fifth of the depths are wrong, other places of the ray need samples, too.
    cue_samples: 16,
    cue_spread: 0.05,
    cue_anywhere: 0.0,
    // Four rounds, a fifth of the schedule apart: the plan knows its steps.
    refine_every: 400,
    refine_rounds: 4,
    refine_share: 0.1,
};

/// The field and the deformation of `d-nerf`, led by masks and depths.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { rays: RAYS, depth: DEPTH, ..Moving::deformed(deform) })
}
