//! Settings that all recipes share.

use crate::limits::{at_least_0, at_least_1, positive, within};
use crate::settings::Settings;
use crate::space::SpaceKind;
use engine::system::{MOST_LAYERS, MOST_RAYS, MOST_UNITS, SystemError, at_most};
use serde::{Deserialize, Serialize};

/// Where the scene is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceConfig {
    /// How space is laid out: `box`, `contracted` or `ndc`.
    pub space: SpaceKind,
    /// Centre of the scene, world units.
    pub centre: [f64; 3],
    /// Internal length 1 in world units.
    pub radius: f64,
}

impl PlaceConfig {
    /// A scene about the origin, of radius 1.
    #[must_use]
    pub fn unit(space: SpaceKind) -> Self {
        Self { space, centre: [0.0; 3], radius: 1.0 }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("radius", self.radius)
    }
}

/// The network of NeRF, of each level or of both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkConfig {
    /// Octaves of the position: 10 for points; 16 for cones, where those finer than a pixel fade out by themselves.
    pub position_octaves: usize,
    /// Octaves of the direction, 4.
    pub direction_octaves: usize,
    /// Width of the layers, 256.
    pub width: usize,
    /// Layers of the trunk, 8.
    pub depth: usize,
    /// Deviation of the noise on the raw density in training.
    pub density_noise: f32,
}

impl NetworkConfig {
    /// As published: eight layers of 256.
    #[must_use]
    pub fn published(position_octaves: usize, density_noise: f32) -> Self {
        Self { position_octaves, direction_octaves: 4, width: 256, depth: 8, density_noise }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[("width", self.width, MOST_UNITS), ("depth", self.depth, MOST_LAYERS)])?;
        within("width", self.width, 2..=MOST_UNITS)?;
        at_least_1("depth", self.depth as u64)?;
        at_least_0("density_noise", self.density_noise)
    }
}

/// Rays: where they are sampled, how often, and how many there are in a batch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RaysConfig {
    /// Distance before which nothing is sampled, internal units.
    pub near: f32,
    /// Half the side of the space, internal units: 1 unless `space` is contracted.
    pub extent: f64,
    /// Samples of the coarse level.
    pub coarse: usize,
    /// Samples of the fine level, of `nerf` besides the coarse ones.
    pub fine: usize,
    /// Rays of a batch. Published: 4096; fewer make more steps in the same time.
    pub batch_rays: usize,
}

impl RaysConfig {
    /// As published, but for `batch_rays`.
    #[must_use]
    pub fn published(coarse: usize, fine: usize) -> Self {
        Self { near: 0.05, extent: 1.0, coarse, fine, batch_rays: 128 }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[
            ("coarse", self.coarse, MOST_UNITS),
            ("fine", self.fine, MOST_UNITS),
            ("batch_rays", self.batch_rays, MOST_RAYS),
        ])?;
        positive("near", self.near)?;
        positive("extent", self.extent)?;
        at_least_1("batch_rays", self.batch_rays as u64)
    }
}

/// What all systems of two levels can be set to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoLevelConfig {
    /// Where the scene is.
    pub place: PlaceConfig,
    /// The networks.
    pub network: NetworkConfig,
    /// Rays of both levels.
    pub rays: RaysConfig,
}

impl TwoLevelConfig {
    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        Ok(Self {
            place: settings.of(&self.place)?,
            network: settings.of(&self.network)?,
            rays: settings.of(&self.rays)?,
        })
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting that cannot work.
    pub fn check(&self) -> Result<(), SystemError> {
        self.network.check()?;
        self.rays.check()?;
        self.place.check()
    }
}
