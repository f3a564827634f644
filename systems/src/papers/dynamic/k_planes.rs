//! K-Planes: features are products of planes, three of space and three of time (Fridovich-Keil, Meanti, Warburg, Recht, Kanazawa,
//! "K-Planes: Explicit Radiance Fields in Space, Time, and Appearance", 2023).
//!
//! ```text
//! f_s(q) = prod_c psi(P_c^s, pi_c(q))      q = (x, y, z) of a scene at rest, (x, y, z, t) of one that moves (equation 1)
//! f(q)   = concat_s f_s(q)                 scales s; time is not multiplied by s (section 3.1)
//! (log sigma, g) = MLP(f),  c = MLP(g, SH(d))          the hybrid model (section 3.4)
//! log sigma = a . f,  c_i = sigmoid(f . MLP_i(d))       the explicit model
//! L = |C - C'|^2 + a mean_c TV(P_c) + b mean_c |d^2 P_c / dt^2|^2 + e mean_c |1 - P_c|       (equations 3 to 5)
//! ```
//!
//! Planes of space begin uniform, planes of time at 1: the scene stands still until the photos say otherwise.

use crate::claims::Claim;
use crate::fields::{DecoderChoice, DecoderKind, ExplicitConfig, PlaneGridSettings, PlaneGridSource, view_times};
use crate::plan::{Ask, Built, Moving, MovingParts, Shown, chosen_sampler, field_settings, moving_field, planned};
use crate::rays::RayConfig;
use engine::data::Dataset;
use std::sync::Arc;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "k-planes",
    paper: "Fridovich-Keil et al., 2023",
    what: "Products of planes of features at several scales: three planes of space and, for scenes that move, three of time",
    take: "to compare; one method for static scenes and moving ones",
    differs: "8 features at scales 1, 2 and 4 instead of 32 at 1 to 8, and an occupancy grid instead of proposals (which \
              `sampler=proposal` brings back); the schedule is that of `ngp` here, from 2 or 4 times the published rate. The \
              hybrid model, or with `decoder=explicit` the explicit one, whose basis sees the direction with a bias. There are no \
              codes of appearance.",
    mark: "8 features, 3 scales, occupancy grid",
};

/// Planes of the released code for D-NeRF's scenes, with fewer features and scales.
pub(super) fn of_motion() -> PlaneGridSettings {
    PlaneGridSettings {
        plane_vertices: 64,
        plane_scales: vec![1, 2, 4],
        plane_features: 8,
        plane_times: 0,
        plane_variation: 1e-4,
        plane_smoothness: 0.1,
        plane_transients: 1e-4,
    }
}

/// Those of the released code for scenes at rest.
fn of_rest() -> PlaneGridSettings {
    PlaneGridSettings { plane_variation: 0.01, plane_smoothness: 0.0, plane_transients: 0.0, ..of_motion() }
}

/// Planes behind either decoder, the networks of the hybrid model where none is asked for.
fn planes(config: &mut RayConfig, planes: PlaneGridSource) {
    if planes.is_still() && config.terms.distortion == 0.0 {
        config.terms.distortion = DISTORTION;
    }
    config.features = Arc::new(planes);
    (config.networks.width, config.networks.colour_layers) = (64, 2);
    let explicit = ExplicitConfig { density_bias: config.networks.density_bias, ..ExplicitConfig::PAPER };
    config.decoder = Some(DecoderChoice { decoder: DecoderKind::Hybrid, explicit });
    config.rates.lr = RATE;
}

/// The field of a scene that moves.
pub(crate) fn field(config: &mut RayConfig, data: &Dataset) {
    let times = view_times(data);
    let settings = if times.is_empty() { of_rest() } else { of_motion() };
    planes(config, PlaneGridSource::new(settings, times));
}

/// Learning rate of either model; 0.01 as released is too small for runs of minutes, and with 0.04 the explicit model fails on lego
/// with most seeds (`docs/decisions/0039-k-planes.md`).
const RATE: f32 = 0.02;
/// Factor of the distortion loss of scenes at rest, as released.
const DISTORTION: f32 = 1e-3;

/// Planes for a scene at rest.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    if Shown::of(ask.scene) == Shown::Times {
        return moving_field(ask, &Moving { field, asked: chosen_sampler, ..Moving::STILL });
    }
    let mut ground = ask.ground()?;
    let mut config = field_settings(&mut ground, ask.data);
    planes(&mut config, PlaneGridSource::new(of_rest(), Arc::default()));
    let config = chosen_sampler(config, &mut ask.settings)?;
    let all = ask.settings.all()?;
    let system = ground.moving(ask.data, &config, ask.run.seed, ask.scene, CLAIM.name, MovingParts::default())?;
    Ok((Box::new(system), planned(ground, all)))
}
