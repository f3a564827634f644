//! mip-NeRF 360: proposals, contracted Gaussians, and a loss against floaters.
//!
//! Barron, Mildenhall, Verbin, Srinivasan, Hedman, "Mip-NeRF 360: Unbounded Anti-Aliased Neural Radiance Fields", 2022.
//!
//! A step:
//!
//! 1. each ray is sampled in rounds: in proposal rounds a small network says where density may be, and the next round's
//!    intervals gather there; the final round asks the final network (`rounds`);
//! 2. an interval of a pixel's cone is a Gaussian; it is contracted into a ball, and encoded along 21 directions;
//! 3. the final weights teach the proposals (interlevel loss) and are kept together (distortion loss); the pixel's error
//!    teaches the final network; the gradients of a step stop at the Gaussians, `ray_gradient` goes on to the rays;
//! 4. the gradient of each network is clipped by its own norm; Adam.
//!
//! What differs from the paper, and why: `docs/decisions/0009-mip-nerf-360-parts.md`.

mod config;
mod driver;
mod level;
mod network;
mod quadrature;
mod ray_gradient;
#[cfg(test)]
mod ray_gradient_tests;
mod render;
mod rounds;
mod system;
mod tile;

pub use config::{LastSample, LossConfig, MipNerf360Config, NetworksConfig, RoundsConfig, StepConfig};
pub use driver::MipNerf360;

use crate::claims::Claim;
use crate::networks::PlaceConfig;
use crate::plan::{Ask, Built, planned, space};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "mip-nerf-360",
    paper: "Barron et al., 2022",
    what: "Cones in contracted space, a proposal network, interlevel and distortion losses",
    take: "to compare, on scenes without an end; hours to days",
    differs: "Networks and losses of open scenes are the published ones, batches are of 64 rays instead of 16384; objects \
              have a squared error and no distortion loss. Annealing and learning rate are spread over the published 250 000 \
              steps: a run of minutes stays at the start of both.",
    mark: "64 rays, start of 250 000-step schedules",
};

/// The published settings; objects and open scenes have different ones: those of the space asked for.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let ground = ask.ground()?;
    let layout = &ground.layout;
    let asked = ask.run.set.get("space").and_then(|word| word.clone().try_into().ok());
    let published = MipNerf360Config::published(asked.unwrap_or(layout.kind));
    let place = PlaceConfig { centre: layout.centre.to_array(), radius: layout.radius, ..published.place };
    let config = MipNerf360Config { place, ..published }.asked(&mut ask.settings)?;
    let all = ask.settings.all()?;
    config.check()?;
    let MipNerf360Config { place, rounds, .. } = config;
    let space = space(layout, ask.data, place.space, place.centre, place.radius, f64::from(rounds.far), rounds.near)?;
    let system = MipNerf360::new(config, space, ground.background, ask.run.seed)?;
    Ok((Box::new(system), planned(ground, all)))
}
