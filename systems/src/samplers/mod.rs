//! Where samples lie along a ray.
//!
//! * `Occupancy`: a march through what an occupancy grid does not know to be empty.
//! * `Proposals`: small density fields that say where the weight of a ray lies; a fixed number of samples a ray.
//! * `MeasuredDepth`: cuts a march around depths that were measured.

mod depth;
mod occupancy;
mod occupancy_config;
mod probe;
mod proposals;
mod proposed;
mod reopened;
mod silhouette;
mod time_bins;

pub use depth::DepthCueConfig;
pub(crate) use depth::{CutRoom, Intervals, MeasuredDepth};
use occupancy::OccupancyState;
pub(crate) use occupancy::{Marcher, Moves, Occupancy};
pub use occupancy_config::OccupancyConfig;
pub use proposals::ProposalConfig;
#[cfg(test)]
pub(crate) use proposals::ProposalField;
pub(crate) use proposals::{ProposalNetwork, ProposalState, Proposals};
pub(crate) use proposed::{Draw, Proposed, RaysInSpace};

use crate::schedule::Done;
use engine::system::{SystemError, Tensor, TensorMap};

/// What places the samples of a field.
pub(crate) enum Sampler {
    /// An occupancy grid.
    Occupancy(Box<Occupancy>),
    /// Proposals.
    Proposals(Proposals),
}

/// What a checkpoint says of a sampler.
pub(crate) enum SamplerState {
    Occupancy(Box<OccupancyState>),
    Proposals(Vec<ProposalState>),
}

impl Sampler {
    /// The occupancy grid, where that places the samples.
    pub(crate) fn occupancy(&self) -> Option<&Occupancy> {
        match self {
            Self::Occupancy(occupancy) => Some(occupancy),
            Self::Proposals(_) => None,
        }
    }

    /// The same, to be changed.
    pub(crate) fn occupancy_mut(&mut self) -> Option<&mut Occupancy> {
        match self {
            Self::Occupancy(occupancy) => Some(occupancy),
            Self::Proposals(_) => None,
        }
    }

    /// The proposals, where these place the samples.
    pub(crate) fn proposals(&self) -> Option<&Proposals> {
        match self {
            Self::Occupancy(_) => None,
            Self::Proposals(proposals) => Some(proposals),
        }
    }

    /// Part of a sample's interval that lies in front of it: a march samples where a step begins, proposals in the middle.
    pub(crate) fn lead(&self) -> f32 {
        if self.proposals().is_some() { 0.5 } else { 0.0 }
    }

    /// Random numbers of a training ray.
    pub(crate) fn randoms(&self) -> usize {
        1 + self.proposals().map_or(0, |proposals| proposals.fields.len())
    }

    /// Updates of the occupancy grid so far.
    pub(crate) fn updates(&self) -> u64 {
        self.occupancy().map_or(0, |occupancy| occupancy.grid.updates())
    }

    /// Number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.proposals().map_or(0, Proposals::parameter_count)
    }

    /// Bytes held besides parameters and their moments.
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Occupancy(occupancy) => occupancy.bytes(),
            Self::Proposals(proposals) => 4 * proposals.parameter_count(),
        }
    }

    /// Everything the next step depends on, besides the numbers of steps and updates.
    pub(crate) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        match self {
            Self::Occupancy(occupancy) => occupancy.push_state(out),
            Self::Proposals(proposals) => proposals.push_state(out),
        }
    }

    /// The state in a checkpoint that was written after so many updates, when so much was done.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(crate) fn read_state(&self, state: &TensorMap, updates: u64, done: Done) -> Result<SamplerState, SystemError> {
        Ok(match self {
            Self::Occupancy(occupancy) => SamplerState::Occupancy(Box::new(occupancy.read_state(state, updates)?)),
            Self::Proposals(proposals) => SamplerState::Proposals(proposals.read_state(state, done)?),
        })
    }

    /// Go on from what [`Sampler::read_state`] gave.
    pub(crate) fn restore(&mut self, state: SamplerState) {
        match (self, state) {
            (Self::Occupancy(occupancy), SamplerState::Occupancy(state)) => occupancy.restore(*state),
            (Self::Proposals(proposals), SamplerState::Proposals(state)) => proposals.restore(state),
            _ => unreachable!("the state was read by this sampler"),
        }
    }
}
