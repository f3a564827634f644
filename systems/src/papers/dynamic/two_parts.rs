//! Two parts: the field of `ngp` for what stands still, and before it products of planes of place and time, only where something moves.
//!
//! ```text
//! sigma = (1 - m) sigma_s(x) + m sigma_m(x, t)          m: the moving part's gate, in cells where something moves (`fields::blend`)
//! ```
//!
//! No paper's: the gate is that of NSFF (Li et al., 2021, section 3.3), the planes are those of K-Planes (Fridovich-Keil et al., 2023)
//! with half of the features and nothing that smooths planes of space, which only points of the moving part change. How it is found
//! what moves: `docs/decisions/0052`; when this is the default: `docs/decisions/0054`.

use super::k_planes;
use crate::claims::Claim;
use crate::fields::{PlaneGridSettings, PlaneGridSource, plane_times};
use crate::plan::{Ask, Background, Built, Moving, chosen_sampler, moving_field};
use crate::rays::RayConfig;
use engine::data::Dataset;
use std::sync::Arc;

/// What it is.
pub(crate) const CLAIM: Claim = Claim {
    name: "two-parts",
    paper: "",
    what: "The field of `ngp` for what stands still, and planes of place and time before it where something moves",
    take: "the default for films of a place, in which something moves",
    differs: "What moves is found by what the still part cannot show, or by motion masks; elsewhere it costs nothing.",
    mark: "",
};

/// Fewer features and scales than `k-planes` has for a whole scene.
const FEATURES: usize = 4;
const SCALES: [u32; 2] = [2, 4];

/// Planes for what moves; all else is as in `ngp`.
fn field(config: &mut RayConfig, data: &Dataset) {
    let planes = PlaneGridSettings {
        plane_features: FEATURES,
        plane_scales: SCALES.to_vec(),
        plane_variation: 0.0,
        ..k_planes::of_motion()
    };
    config.features = Arc::new(PlaneGridSource::new(planes, plane_times(data)));
}

/// A still part, and planes before it.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { field, asked: chosen_sampler, background: Background::Static, ..Moving::STILL })
}
