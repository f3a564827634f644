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
    /// Step from which what moves is also seen two frames on, or two back, in turns.
    pub(crate) flow_chain_from: u64,
    /// Steps with a moving part in which the factors of flow and disparity priors fall to a tenth.
    pub(crate) flow_fades_in: u64,
    /// Factor of the distance of rendered disparities from those of a prior, aligned; 0: none.
    pub(crate) flow_disparity: f32,
    /// Whether the features and the density of the still part are held once something moves.
    pub(crate) still_freezes: bool,
}

impl FlowSettings {
    /// Those of a run in which what moves has `steps` steps from step `from` on: priors fade after each quarter, chains come in the later half.
    pub(crate) fn of_run(from: u64, steps: u64) -> Self {
        Self {
            flow_share: 0.5,
            flow_reach: 0.1,
            flow_chain_from: from + steps / 2,
            flow_fades_in: (steps / 4).max(1),
            flow_disparity: 0.04,
            still_freezes: false,
        }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    fn check(&self) -> Result<(), SystemError> {
        let refuse = |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        if !(self.flow_share > 0.0 && self.flow_share <= 1.0) {
            return refuse("flow_share", self.flow_share.to_string(), "must be above 0 and at most 1");
        }
        if !(self.flow_reach > 0.0 && self.flow_reach <= 1.0) {
            return refuse("flow_reach", self.flow_reach.to_string(), "must be above 0 and at most 1");
        }
        if !(0.0..=10.0).contains(&self.flow_disparity) {
            return refuse("flow_disparity", self.flow_disparity.to_string(), "must be in 0..=10");
        }
        if self.flow_fades_in == 0 {
            return refuse("flow_fades_in", "0".into(), "must be at least 1");
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
    /// Steps since something moves.
    pub(in crate::rays) since: u64,
}

impl FlowContext<'_> {
    /// Factor of the priors: a tenth of it after each interval.
    pub(super) fn fade(&self) -> f64 {
        0.1_f64.powi((self.since / self.config.settings.flow_fades_in).min(300) as i32)
    }

    /// Which way two frames are looked at, [`NEXT`] or [`PREVIOUS`]; `None` where it is not time for that.
    pub(super) fn chained(&self) -> Option<usize> {
        (self.step >= self.config.settings.flow_chain_from).then_some(if self.step % 2 == 0 { NEXT } else { PREVIOUS })
    }
}
