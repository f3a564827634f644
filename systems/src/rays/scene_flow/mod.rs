//! Scene flow: the moving part of a field says where its samples are in the frames beside, and is held to what it shows there.
//!
//! ```text
//! (r, g, gate, S_next, S_previous, p) = network(features(x, t))     rows after the gate: `head`
//! x_j = x + S_j, seen at the time of frame j                        `elsewhere`
//! C_j: colours at x_j, along the ray of this frame                  `rendered`
//! ```
//!
//! The moving part alone is rendered four times along a ray: here, in the next frame, in the previous one, and where it is time for that
//! two frames on or back, by flow upon flow. Where nothing may move a ray has its still part, held: so does the "dynamic render" of a
//! part that is not there. What these renders cost is said by [`FlowTerm`]s, which a paper's file chooses; this driver names none.
//!
//! * `head`: scene flow and what is hidden, from rows of the network, and back; * `film`: which frames follow each other, their cameras
//!   and priors; * `chosen`: rays that take part; * `elsewhere`, `rendered`: a pass forwards and backwards; * `chunk`: all passes of a
//!   chunk, and depth, which is compared over a whole batch; * `term`: what terms read, and the gradients that they add.
//!
//! Source: Li, Niklaus, Snavely, Wang, "Neural Scene Flow Fields for Space-Time View Synthesis of Dynamic Scenes", 2021; Gao, Saraf, Kopf,
//! Huang, "Dynamic View Synthesis from Dynamic Monocular Video", 2021.

mod chosen;
mod chunk;
mod elsewhere;
mod film;
mod head;
mod rendered;
mod term;
#[cfg(test)]
mod tests;

pub(crate) use chosen::Chosen;
pub(super) use chosen::KeptSamples;
pub(super) use chunk::FlowChunk;
pub(crate) use film::Film;
#[cfg(test)]
pub(crate) use film::FramePriors;
pub(crate) use head::FlowHead;
pub(crate) use term::{BEYOND, FlowRays, FlowTerm, HERE, NEXT, PASSES, PREVIOUS, SeenBars};

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
    /// Those of a run in which what moves has `steps` steps from step `from` on: priors fade four times, chains come in the later half.
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
pub(super) struct FlowContext<'a> {
    pub(super) film: &'a Film,
    pub(super) config: &'a FlowConfig,
    pub(super) step: u64,
    /// Steps since something moves.
    pub(super) since: u64,
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
