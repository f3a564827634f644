//! Two parts: the field of `ngp` for what stands still, and before it a hash grid of space and time, only where something moves.
//!
//! ```text
//! sigma = (1 - m) sigma_s(x) + m sigma_m(x, t)          m: the moving part's gate, in cells where something moves (`fields::blend`)
//! ln sigma_m = ln sigma_s(x) + delta(x, t)              what moves is on top of what stands still (`fields::mixed`); so are its features
//! ```
//!
//! No paper's: the gate is that of NSFF (Li et al., 2021, section 3.3); what moves has a hash grid of space and time as in MSTH (Wang et
//! al., "Masked Space-Time Hash Encoding for Efficient Dynamic Scene Reconstruction", 2023, section 3.1), whose mask is a learned
//! number for each place. How it is found what moves: `docs/decisions/0052`; when this is the default: `docs/decisions/0054`; why
//! not planes: `docs/decisions/0057`; why on top: `docs/decisions/0058`.

use crate::claims::Claim;
use crate::fields::{TimeHashSettings, TimeHashSource, view_times};
use crate::plan::{Ask, Background, Built, Moving, chosen_sampler, moving_field};
use crate::rays::RayConfig;
use engine::data::Dataset;
use std::sync::Arc;

/// What it is.
pub(crate) const CLAIM: Claim = Claim {
    name: "two-parts",
    paper: "",
    what: "The field of `ngp` for what stands still, and a hash grid of space and time before it where something moves",
    take: "the default for films of a place, in which something moves",
    differs: "What moves is found by what the still part cannot show, or by motion masks; elsewhere it costs nothing.",
    mark: "",
};

/// What moves covers few pixels, each seen at few times: levels are fewer and coarser than those of the still part, and a
/// cell of the finest is as long as two steps from photo to photo.
const MOVING: TimeHashSettings = TimeHashSettings {
    moving_levels: 6,
    moving_features: 4,
    moving_log2_table: 17,
    moving_n_min: 16,
    moving_n_max: 256,
    moving_times: 4,
    moving_times_max: 0,
};

/// A hash grid of space and time for what moves; all else is as in `ngp`.
fn field(config: &mut RayConfig, data: &Dataset) {
    config.features = Arc::new(TimeHashSource::new(MOVING, view_times(data)));
}

/// A still part, and that before it.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    moving_field(ask, &Moving { field, asked: chosen_sampler, background: Background::Static, ..Moving::STILL })
}
