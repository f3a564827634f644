//! mip-NeRF: cones instead of rays, one network for both levels.
//!
//! Barron, Mildenhall, Tancik, Hedman, Martin-Brualla, Srinivasan, "Mip-NeRF: A Multiscale Representation for Anti-Aliasing
//! Neural Radiance Fields", 2021.
//!
//! Each pixel's cone is cut into frusta, each frustum is a Gaussian, and the network sees the mean of the encoding over it:
//! detail finer than the frustum fades out. The weights of the coarse intervals, blurred and padded, say where the fine ones
//! are; these replace the coarse ones. The gradients of a step stop at the positions. In normalised device coordinates cones are cylinders;
//! where space has no end, Gaussians are contracted. Differences to the paper are those of `nerf`
//! (`docs/decisions/0008-mip-nerf.md`).

mod config;
mod samples;

pub use config::{ConesConfig, MipNerfConfig, RateConfig};

use super::place::{placed, space_of};
use crate::claims::Claim;
use crate::limits::refusal;
use crate::networks::{Along, Footprint, Level, NetworkShape, Recipe, Tile, TwoLevel};
use crate::plan::{Ask, Built, planned};
use crate::space::{InternalRay, Space};
use engine::system::SystemError;
use field_core::encoding::integrated::Integrated;
use field_core::mlp::Activation;
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use optim::AdamConfig;
use render_core::ray::RayBar;

/// The system.
pub type MipNerf = TwoLevel<MipNerfConfig>;

/// Added to the raw density before the softplus, so that space begins thin.
const DENSITY_SHIFT: f32 = -1.0;

impl Recipe for MipNerfConfig {
    const NAME: &'static str = "mip-nerf";
    const ADAM: AdamConfig = AdamConfig::DEFAULT;
    const FOOTPRINT: Footprint = Footprint::Cone;
    type Position = Integrated;

    fn check(&self) -> Result<(), SystemError> {
        MipNerfConfig::check(self)
    }

    fn networks(&self) -> usize {
        1
    }

    fn network(&self) -> Result<NetworkShape<Integrated>, SystemError> {
        let network = self.levels.network;
        Ok(NetworkShape {
            position: Integrated::new(3, network.position_octaves)
                .map_err(|e| refusal("position_octaves", network.position_octaves, e))?,
            direction_octaves: network.direction_octaves,
            width: network.width,
            depth: network.depth,
            colour_pad: self.cones.colour_padding,
            displacement: None,
        })
    }

    fn batch_rays(&self) -> usize {
        self.levels.rays.batch_rays
    }

    fn learning_rate(&self, step: u64) -> f64 {
        self.rate.learning_rate(step)
    }

    fn level_weight(&self, level: usize) -> f32 {
        if level == 0 { self.cones.coarse_loss } else { 1.0 }
    }

    fn density_noise(&self) -> f32 {
        self.levels.network.density_noise
    }

    fn density(&self, tape: &mut Tape<'_>, raw: Node) -> Result<Node, TapeError> {
        tape.softplus(raw, DENSITY_SHIFT)
    }

    fn density_of(&self, raw: f32) -> f32 {
        Activation::Softplus { shift: DENSITY_SHIFT }.value(raw)
    }

    fn fill_coarse(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        samples::coarse(self, space, rays, random, tile);
    }

    fn fill_fine(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        samples::fine(self, space, rays, random, tile);
    }

    fn pull_rays(&self, space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
        samples::pull_rays(space, along, x_bar, bars);
    }

    fn place_points(&self, space: &Space, n: usize, level: &mut Level) {
        samples::cubes(self.cones.point_size, space, n, level);
    }
}

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "mip-nerf",
    paper: "Barron et al., 2021",
    what: "Cones instead of rays: the same field at every resolution",
    take: "to compare; photos of several resolutions; hours",
    differs: "Network, intervals, losses and learning rate are the published ones. Batches are of 128 rays instead of 4096, \
              rays begin and end at the scene's box, the last interval is finite, and space without an end is contracted.",
    mark: "batches of 128 rays",
};

/// The published settings in the scene's box.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let ground = ask.ground()?;
    let published = MipNerfConfig::published(ground.layout.kind);
    let config = MipNerfConfig {
        levels: placed(published.levels, &ground),
        cones: ConesConfig { point_size: ground.layout.footprint as f32, ..published.cones },
        ..published
    };
    let config = config.asked(&mut ask.settings)?;
    let all = ask.settings.all()?;
    let space = space_of(&ground, ask.data, &config.levels)?;
    let system = MipNerf::new(config, space, ground.background, ask.run.seed)?;
    Ok((Box::new(system), planned(ground, all)))
}
