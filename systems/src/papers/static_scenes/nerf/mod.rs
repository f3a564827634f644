//! NeRF: a coarse and a fine network, as published.
//!
//! Mildenhall, Srinivasan, Tancik, Barron, Ramamoorthi, Ng, "NeRF: Representing Scenes as Neural Radiance Fields for View
//! Synthesis", 2020, sections 4 and 5.
//!
//! Each ray: stratified samples, the coarse network, its weights as a density from which the fine samples are drawn, the
//! fine network on all of them; the squared error of both pixels. The gradients of a step stop at the samples' positions. Differences:
//! rays end at the scene's box instead of at two constants, the last interval is finite, and batches are smaller
//! (`docs/decisions/0004-nerf-as-published.md`).

mod config;
mod samples;

pub use config::{NerfConfig, NerfTrainingConfig};

use super::place::{placed, space_of};
use crate::claims::Claim;
use crate::limits::refusal;
use crate::networks::{Along, Footprint, Level, NetworkShape, Recipe, Tile, TwoLevel};
use crate::photo_model::PhotoModel;
use crate::plan::{Ask, Built, Ground, planned};
use crate::space::{InternalRay, Space};
use engine::data::Dataset;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use optim::AdamConfig;
use render_core::quadrature::two::Mixture;
use render_core::ray::RayBar;

/// The system.
pub type Nerf = TwoLevel<NerfConfig>;

impl Recipe for NerfConfig {
    const NAME: &'static str = "nerf";
    const ADAM: AdamConfig = AdamConfig::NERF;
    const FOOTPRINT: Footprint = Footprint::Point;
    type Position = Frequency;

    fn check(&self) -> Result<(), SystemError> {
        NerfConfig::check(self)
    }

    fn networks(&self) -> usize {
        2
    }

    fn network(&self) -> Result<NetworkShape<Frequency>, SystemError> {
        let network = self.levels.network;
        Ok(NetworkShape {
            position: Frequency::new(3, network.position_octaves, Base::One, Identity::Include)
                .map_err(|e| refusal("position_octaves", network.position_octaves, e))?,
            direction_octaves: network.direction_octaves,
            width: network.width,
            depth: network.depth,
            colour_pad: 0.0,
            displacement: None,
        })
    }

    fn batch_rays(&self) -> usize {
        self.levels.rays.batch_rays
    }

    fn learning_rate(&self, step: u64) -> f64 {
        self.training.learning_rate(step)
    }

    fn level_weight(&self, _level: usize) -> f32 {
        1.0
    }

    fn sparsity(&self) -> f32 {
        self.training.sparsity
    }

    fn mixture(&self) -> Mixture {
        self.training.mixture.into()
    }

    fn density_noise(&self) -> f32 {
        self.levels.network.density_noise
    }

    fn density(&self, tape: &mut Tape<'_>, raw: Node) -> Result<Node, TapeError> {
        tape.relu(raw)
    }

    fn density_of(&self, raw: f32) -> f32 {
        raw.max(0.0)
    }

    fn fill_coarse(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        samples::coarse(&self.levels.rays, space, rays, random, tile);
    }

    fn fill_fine(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        samples::fine(&self.levels.rays, space, rays, random, tile);
    }

    fn pull_rays(&self, space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
        samples::pull_rays(space, along, x_bar, bars);
    }

    fn place_points(&self, space: &Space, _n: usize, level: &mut Level) {
        samples::encoder_input(space, level);
    }
}

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "nerf",
    paper: "Mildenhall et al., 2020",
    what: "A coarse and a fine network of sines and cosines of the point",
    take: "to compare with the original; hours",
    differs: "Networks, samples and learning rate are the published ones. Batches are of 128 rays instead of 4096, rays \
              begin and end at the scene's box, the last interval is finite, and space without an end is contracted.",
    mark: "batches of 128 rays",
};

/// The published settings for a scene.
pub(crate) fn settings(ground: &Ground) -> NerfConfig {
    let published = NerfConfig::published(ground.layout.kind);
    NerfConfig { levels: placed(published.levels, ground), ..published }
}

/// The networks of a scene, with a photo model for photos from the wild or without.
///
/// # Errors
/// [`SystemError::Config`] for settings that cannot work.
pub(crate) fn system(
    ground: &Ground,
    data: &Dataset,
    config: &NerfConfig,
    seed: u64,
    photo_model: Option<Box<dyn PhotoModel>>,
) -> Result<Nerf, SystemError> {
    let space = space_of(ground, data, &config.levels)?;
    Nerf::with_photo_model(*config, space, ground.background, seed, photo_model)
}

/// The published settings in the scene's box.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let ground = ask.ground()?;
    let config = settings(&ground).asked(&mut ask.settings)?;
    let all = ask.settings.all()?;
    let system = system(&ground, ask.data, &config, ask.run.seed, None)?;
    Ok((Box::new(system), planned(ground, all)))
}
