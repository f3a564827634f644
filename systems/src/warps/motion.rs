//! The network that moves points, and what its outputs do to them.

use super::at::{At, Moves};
use super::network::Network;
use super::octaves::Octaves;
use super::parameters::{NetworkShape, Parameters, Stream};
use super::settings::{bad, in_range};
use super::time::{Time, TimeKind};
use super::window::Window;
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
    /// Nothing moves, and next to nothing beside it: the network's outputs are taken less those at `t = 0`. The canonical scene is that
    /// of `t = 0`, and the photos of all times nearby hold it there.
    Tied,
    /// Nothing moves, whatever the network says of times beside it (D-NeRF as published): the canonical scene is that of `t = 0` for
    /// photos of exactly that time alone.
    Exact,
    /// What happens at any other time.
    Free,
}

impl Origin {
    /// Whether nothing moves at a time in `[0, 1]`.
    pub(crate) fn rests(self, time: f64) -> bool {
        self != Self::Free && time == 0.0
    }
}

/// Settings of the network that moves points. Its width is that of [`TimeSettings`](super::TimeSettings).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WarpSettings {
    /// What its outputs are: `none`, `translation` or `rigid`.
    #[serde(rename = "warp")]
    pub(crate) motion: Motion,
    /// What happens at `t = 0`: `tied` (nothing, and next to nothing beside it), `exact` (nothing at that time alone, as published) or
    /// `free`.
    pub(crate) origin: Origin,
    /// Octaves of the point that it sees, with the point itself.
    #[serde(rename = "warp_octaves")]
    pub(crate) octaves: usize,
    /// Share of the schedule over which these come in, coarse to fine (Nerfies, section 3.5); 0: all from the start.
    #[serde(rename = "warp_anneal")]
    pub(crate) anneal: f64,
    /// Number of its hidden layers.
    #[serde(rename = "warp_depth")]
    pub(crate) depth: usize,
}

impl WarpSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("warp_octaves", self.octaves, 0..=16)?;
        in_range("warp_anneal", self.anneal, 0.0..=1.0)?;
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
    /// `None` where points stay where they are. Besides points and times the network sees `more` rows.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(
        settings: &WarpSettings,
        time: &Time,
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
        if origin == Origin::Tied && time.settings().kind != TimeKind::Time {
            // What is learned of `t = 0` would get no gradient.
            let problem = "needs `time_input=time`; set that, or `origin=exact`, or `origin=free`";
            return Err(bad("origin", "tied", problem));
        }
        let opens = if anneal == 0.0 { Window::Open } else { Window::Over { from: 0.0, length: anneal } };
        let octaves = Octaves::new(3, octaves, Identity::Include, opens, parameters.simd)?;
        let shape =
            NetworkShape { inputs: octaves.rows() + time.rows() + more, depth, width: time.settings().width, outputs };
        let network = parameters.network(Stream::Warp, shape)?;
        Ok(Some(Self { octaves, network, motion, origin }))
    }

    /// What happens at `t = 0`; nothing special where there is no warp.
    pub(crate) fn origin(warp: Option<&Self>) -> Origin {
        warp.map_or(Origin::Free, |warp| warp.origin)
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

    /// New parameters, once the share `done` of the schedule is over.
    pub(crate) fn renew(&mut self, params: &[f32], done: f64) {
        self.octaves.renew(done);
        self.network.renew(params);
    }
}

/// The warp of points that move; `None` where none does.
pub(crate) fn moving<'w>(warp: &'w Option<Warp>, at: &At<'_>) -> Option<&'w Warp> {
    warp.as_ref().filter(|_| at.moves == Moves::Yes)
}
