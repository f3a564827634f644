//! What a system is built from, and what comes out.

use super::ground::Ground;
use crate::claims::Claim;
use crate::settings::Settings;
use engine::data::Dataset;
use engine::options::{Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// A system and what was decided about it.
pub(crate) type Built = Result<(Box<dyn System>, Plan), SystemError>;

/// What a system is built from.
pub(crate) struct Ask<'a> {
    /// Its name, and how far it is the paper's.
    pub(crate) claim: Claim,
    pub(crate) scene: &'a Scene,
    pub(crate) data: &'a Dataset,
    pub(crate) run: &'a RunOptions,
    /// The settings of its parts.
    pub(crate) settings: Settings<'a>,
}

impl<'a> Ask<'a> {
    pub(crate) fn new(claim: Claim, scene: &'a Scene, data: &'a Dataset, run: &'a RunOptions) -> Self {
        Self { claim, scene, data, run, settings: Settings::new(run) }
    }

    /// What is known of a scene that stands still; the first lines of the plan.
    ///
    /// # Errors
    /// [`SystemError::Config`] for cameras that see no depth; [`SystemError::Scene`] when an image cannot be read.
    pub(crate) fn ground(&self) -> Result<Ground, SystemError> {
        let mut ground = Ground::of(self.scene, self.data, self.run)?;
        ground.lines.extend(self.claim.line());
        Ok(ground)
    }
}

/// The plan of a system with these settings.
pub(crate) fn planned(ground: Ground, config: toml::Table) -> Plan {
    let Ground { lines, background, error_budget, .. } = ground;
    Plan { lines, background, error_budget, config }
}
