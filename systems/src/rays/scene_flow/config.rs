//! Settings of scene flow, and what the chunks of a step know of it.

use super::film::{Film, NEXT, PREVIOUS};
use super::head::FlowHead;
use super::term::FlowTerm;
use crate::settings::Settings;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Settings of scene flow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FlowSettings {
    /// Share of a batch's pixels whose rays are also seen in the frames beside theirs.
    pub(crate) flow_share: f32,
    /// Largest scene flow from one frame to the next along an axis, in sides of the unit cube.
    pub(crate) flow_reach: f32,
    /// Share of the schedule after which what moves is also seen two frames on, or two back, in turns.
    pub(crate) flow_chain_from: f64,
    /// Share of the schedule with a moving part in which the factors of flow and disparity priors fall to a tenth.
    pub(crate) flow_fades_in: f64,
    /// Factor of the distance of rendered disparities from those of a prior, aligned; 0: none.
    pub(crate) flow_disparity: f32,
    /// Whether the features and the density of the still part are held once something moves.
    pub(crate) still_freezes: bool,
}

impl FlowSettings {
    /// Priors fade after each quarter of what a moving part has of the run, chains come in the later half.
    pub(crate) const PLANNED: Self = Self {
        flow_share: 0.5,
        flow_reach: 0.1,
        flow_chain_from: 0.58,
        flow_fades_in: 0.21,
        flow_disparity: 0.04,
        still_freezes: false,
    };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    fn check(&self) -> Result<(), SystemError> {
        let refuse =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        if !(self.flow_share > 0.0 && self.flow_share <= 1.0) {
            return refuse("flow_share", self.flow_share.to_string(), "must be above 0 and at most 1");
        }
        if !(self.flow_reach > 0.0 && self.flow_reach <= 1.0) {
            return refuse("flow_reach", self.flow_reach.to_string(), "must be above 0 and at most 1");
        }
        if !(0.0..=10.0).contains(&self.flow_disparity) {
            return refuse("flow_disparity", self.flow_disparity.to_string(), "must be in 0..=10");
        }
        if !(0.0..=1.0).contains(&self.flow_chain_from) {
            return refuse("flow_chain_from", self.flow_chain_from.to_string(), "must be in 0..=1");
        }
        if !(1e-3..=1.0).contains(&self.flow_fades_in) {
            return refuse("flow_fades_in", self.flow_fades_in.to_string(), "must be in 0.001..=1");
        }
        Ok(())
    }
}

/// Scene flow of a moving part, and what it costs.
#[derive(Clone, Debug)]
pub(crate) struct FlowConfig {
    pub(crate) settings: FlowSettings,
    /// Whether the moving part also says what of it is hidden in the frames beside.
    pub(crate) hides: bool,
    /// What renders and flow cost, besides disparities.
    pub(crate) terms: Arc<[Box<dyn FlowTerm>]>,
}

impl FlowConfig {
    /// The settings after `--set`, with these terms.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value that cannot be.
    pub(crate) fn asked(
        planned: &FlowSettings,
        hides: bool,
        terms: Vec<Box<dyn FlowTerm>>,
        settings: &mut Settings<'_>,
    ) -> Result<Self, SystemError> {
        let settings: FlowSettings = settings.of(planned)?;
        settings.check()?;
        Ok(Self { settings, hides, terms: terms.into() })
    }

    /// The rows of the moving part's network that are for it.
    pub(crate) fn head(&self) -> FlowHead {
        FlowHead { reach: self.settings.flow_reach, hides: self.hides }
    }
}

/// What the chunks of a step know of scene flow.
#[derive(Clone, Copy)]
pub(in crate::rays) struct FlowContext<'a> {
    pub(in crate::rays) film: &'a Film,
    pub(in crate::rays) config: &'a FlowConfig,
    pub(in crate::rays) step: u64,
    /// Share of the schedule that is done, and the share that was when what moves began.
    pub(in crate::rays) share: f64,
    pub(in crate::rays) from: f64,
}

impl FlowContext<'_> {
    /// Factor of the priors: a tenth of it after each interval.
    pub(super) fn fade(&self) -> f64 {
        0.1_f64.powi(((self.share - self.from).max(0.0) / self.config.settings.flow_fades_in).min(300.0) as i32)
    }

    /// Which way two frames are looked at, [`NEXT`] or [`PREVIOUS`]; `None` where it is not time for that.
    pub(super) fn chained(&self) -> Option<usize> {
        (self.share >= self.config.settings.flow_chain_from).then_some(if self.step.is_multiple_of(2) {
            NEXT
        } else {
            PREVIOUS
        })
    }
}
