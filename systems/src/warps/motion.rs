//! The network that moves points, and what its outputs do to them.

use super::at::{At, Moves};
use super::network::Network;
use super::octaves::{Octaves, Schedule};
use super::parameters::{NetworkShape, Parameters, Stream};
use super::settings::in_range;
use engine::system::SystemError;
use field_core::deform;
use field_core::encoding::frequency::Identity;
use field_core::tape::{Node, Tape, TapeError};
use serde::{Deserialize, Serialize};

/// What the outputs of the network are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Motion {
    /// There is no network: points stay where they are.
    None,
    /// A displacement.
    Translation,
    /// A rotation about the middle of the scene and a translation, through the exponential map.
    Rigid,
}

/// What happens at `t = 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Origin {
    /// Nothing moves: the canonical scene is that of `t = 0`, exactly (D-NeRF).
    Canonical,
    /// What happens at any other time.
    Free,
}

/// Settings of the network that moves points. Its width is that of [`TimeSettings`](super::TimeSettings).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WarpSettings {
    /// What its outputs are: `none`, `translation` or `rigid`.
    #[serde(rename = "warp")]
    pub(crate) motion: Motion,
    /// What happens at `t = 0`: `canonical` (nothing) or `free`.
    pub(crate) origin: Origin,
    /// Octaves of the point that it sees, with the point itself.
    #[serde(rename = "warp_octaves")]
    pub(crate) octaves: usize,
    /// Steps over which these come in, coarse to fine (Nerfies, section 3.5); 0: all from the start.
    #[serde(rename = "warp_anneal")]
    pub(crate) anneal: u64,
    /// Number of its hidden layers.
    #[serde(rename = "warp_depth")]
    pub(crate) depth: usize,
}

impl WarpSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("warp_octaves", self.octaves, 0..=16)?;
        in_range("warp_depth", self.depth, 1..=16)
    }
}

/// A network that moves points.
pub(crate) struct Warp {
    /// Octaves of the point that the network sees.
    pub(crate) octaves: Octaves,
    /// Octaves, time and more to what moves a point.
    pub(crate) network: Network,
    motion: Motion,
    origin: Origin,
}

impl Warp {
    /// `None` where points stay where they are. `time_rows` is what the network sees of the time, `more` what it sees besides.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(
        settings: &WarpSettings,
        width: usize,
        time_rows: usize,
        more: usize,
        parameters: &mut Parameters,
    ) -> Result<Option<Self>, SystemError> {
        settings.check()?;
        let &WarpSettings { motion, origin, octaves, anneal, depth } = settings;
        let outputs = match motion {
            Motion::None => return Ok(None),
            Motion::Translation => 3,
            Motion::Rigid => 6,
        };
        let schedule = if anneal == 0 { Schedule::Open } else { Schedule::Over { from: 0, length: anneal } };
        let octaves = Octaves::new(3, octaves, Identity::Include, schedule, parameters.simd)?;
        let shape = NetworkShape { inputs: octaves.rows() + time_rows + more, depth, width, outputs };
        let network = parameters.network(Stream::Warp, shape)?;
        Ok(Some(Self { octaves, network, motion, origin }))
    }

    /// Whether nothing moves at a time in `[0, 1]`.
    pub(crate) fn rests(&self, time: f64) -> bool {
        self.origin == Origin::Canonical && time == 0.0
    }

    /// Points `x` `[3 x n]` moved by outputs of the network: `x + delta` (D-NeRF, equation 2), or `exp(omega) x + V(omega) v`
    /// (Nerfies, section 3.2).
    ///
    /// # Errors
    /// [`TapeError`] for other shapes.
    pub(crate) fn moved(&self, tape: &mut Tape<'_>, x: Node, outputs: Node) -> Result<Node, TapeError> {
        if self.motion == Motion::Rigid {
            let (omega, v) = (tape.slice(outputs, 0..3)?, tape.slice(outputs, 3..6)?);
            return deform::rigid(tape, x, omega, v);
        }
        deform::translate(tape, x, outputs)
    }

    /// New parameters, after `steps` steps.
    pub(crate) fn renew(&mut self, params: &[f32], steps: u64) {
        self.octaves.renew(steps);
        self.network.renew(params);
    }
}

/// The warp of points that move; `None` where none does.
pub(crate) fn moving<'w>(warp: &'w Option<Warp>, at: &At<'_>) -> Option<&'w Warp> {
    warp.as_ref().filter(|_| at.moves == Moves::Yes)
}
