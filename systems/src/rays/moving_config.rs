//! Settings of a part of the field for what moves.

use super::scene_flow::FlowConfig;
use crate::fields::FeatureSource;
use crate::settings::Settings;
use crate::terms::{MovingShare, RayTerm};
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Settings of a part of the field for what moves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MovingSettings {
    /// Share of the schedule that the still part has alone, after which what moves is looked for.
    pub(crate) moving_from: f64,
    /// Factor of the share of a ray that moves, mean over rays; 0: none.
    pub(crate) moving_share: f32,
    /// Factor of the entropy of the samples' shares, mean over rays; 0: none.
    pub(crate) moving_entropy: f32,
}

impl MovingSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        for (field, value) in [("moving_share", self.moving_share), ("moving_entropy", self.moving_entropy)] {
            if !(0.0..=10.0).contains(&value) {
                let problem = "must be in 0..=10".into();
                return Err(SystemError::Config { field, value: value.to_string(), problem });
            }
        }
        if !(1e-3..=1.0).contains(&self.moving_from) {
            let problem = "must be in 0.001..=1: what moves is found by what the still part cannot explain".into();
            return Err(SystemError::Config { field: "moving_from", value: self.moving_from.to_string(), problem });
        }
        Ok(())
    }
}

/// A part of the field for what moves.
#[derive(Clone, Debug)]
pub struct MovingConfig {
    /// What it learns about places.
    pub(crate) features: Arc<dyn FeatureSource>,
    /// When it begins, and what it costs.
    pub(crate) settings: MovingSettings,
    /// Its scene flow, where it has one.
    pub(crate) flow: Option<FlowConfig>,
}

impl MovingConfig {
    /// A part with these features.
    pub(crate) fn new(features: Arc<dyn FeatureSource>, settings: MovingSettings) -> Self {
        Self { features, settings, flow: None }
    }

    /// The same with scene flow.
    pub(crate) fn with_flow(self, flow: FlowConfig) -> Self {
        Self { flow: Some(flow), ..self }
    }

    /// Share of the schedule after which what moves is looked for.
    pub(crate) fn from(&self) -> f64 {
        self.settings.moving_from
    }

    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let asked: MovingSettings = settings.of(&self.settings)?;
        asked.check()?;
        Ok(Self { settings: asked, ..self })
    }

    /// What it costs that something moves.
    pub(super) fn term(&self) -> Option<Box<dyn RayTerm>> {
        let MovingSettings { moving_share: share, moving_entropy: entropy, .. } = self.settings;
        (share > 0.0 || entropy > 0.0).then(|| Box::new(MovingShare { share, entropy }) as Box<dyn RayTerm>)
    }
}
