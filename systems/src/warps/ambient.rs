//! Ambient coordinates: the bendy sheet that cuts a template of more than three dimensions (HyperNeRF, section 3.3).

use super::at::At;
use super::network::Network;
use super::octaves::Octaves;
use super::parameters::{NetworkShape, Parameters, Stream};
use super::settings::in_range;
use super::window::Window;
use engine::system::SystemError;
use field_core::encoding::frequency::Identity;
use field_core::tape::{Node, Tape, TapeError};
use serde::{Deserialize, Serialize};

/// Octaves of the ambient coordinates that the density network sees.
const SEEN_OCTAVES: usize = 1;

/// Settings of ambient coordinates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AmbientSettings {
    /// Coordinates beyond space; 0: none.
    #[serde(rename = "ambient")]
    pub(crate) dims: usize,
    /// Octaves of the point that their network sees, without the point itself.
    #[serde(rename = "ambient_octaves")]
    pub(crate) octaves: usize,
    /// Width of its hidden layers.
    #[serde(rename = "ambient_width")]
    pub(crate) width: usize,
    /// Number of its hidden layers.
    #[serde(rename = "ambient_depth")]
    pub(crate) depth: usize,
    /// Share of the schedule before they come in.
    #[serde(rename = "ambient_from")]
    pub(crate) from: f64,
    /// Share of the schedule over which they come in.
    #[serde(rename = "ambient_anneal")]
    pub(crate) anneal: f64,
}

impl AmbientSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("ambient", self.dims, 0..=16)?;
        // Without octaves the network would see nothing of the point.
        in_range("ambient_octaves", self.octaves, 1..=16)?;
        in_range("ambient_width", self.width, 1..=1024)?;
        in_range("ambient_from", self.from, 0.0..=1.0)?;
        in_range("ambient_anneal", self.anneal, 0.0..=1.0)?;
        in_range("ambient_depth", self.depth, 1..=16)
    }
}

/// The network of ambient coordinates, `H`, and their octaves.
pub(crate) struct Ambient {
    point: Octaves,
    network: Network,
    seen: Octaves,
}

impl Ambient {
    /// `None` for no coordinates. `time_rows` is what the network sees of the time.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(
        settings: &AmbientSettings,
        time_rows: usize,
        parameters: &mut Parameters,
    ) -> Result<Option<Self>, SystemError> {
        settings.check()?;
        let &AmbientSettings { dims, octaves, width, depth, from, anneal } = settings;
        if dims == 0 {
            return Ok(None);
        }
        let simd = parameters.simd;
        let point = Octaves::new(3, octaves, Identity::Omit, Window::Open, simd)?;
        // Without the coordinates themselves, which no window closes: before they come in nothing is seen of them.
        let opens = Window::Over { from, length: anneal };
        let seen = Octaves::new(dims, SEEN_OCTAVES, Identity::Omit, opens, simd)?;
        let shape = NetworkShape { inputs: point.rows() + time_rows, depth, width, outputs: dims };
        Ok(Some(Self { point, network: parameters.network(Stream::Ambient, shape)?, seen }))
    }

    /// Rows of [`Ambient::of`].
    pub(crate) fn rows(&self) -> usize {
        self.seen.rows()
    }

    /// Weights of the octaves of the coordinates, as of now.
    pub(crate) fn window(&self) -> &[f32] {
        self.seen.window()
    }

    /// `gamma_b(a)`, `a = H(gamma(x), w_i)`: octaves of the ambient coordinates of points, which come in late.
    ///
    /// # Errors
    /// [`TapeError`] for other shapes.
    pub(crate) fn of<'a>(&'a self, tape: &mut Tape<'a>, at: &At<'_>) -> Result<Node, TapeError> {
        if self.seen.is_closed() {
            // All of it would be multiplied by 0, and so would its gradients.
            let columns = tape.shape(at.x)?.cols;
            return Ok(tape.fill(self.rows(), columns, 0.0));
        }
        let gamma = self.point.of(tape, at.x)?;
        let a = self.network.of(tape, &[gamma, at.time])?;
        self.seen.of(tape, a)
    }

    /// New parameters, once the share `done` of the schedule is over.
    pub(crate) fn renew(&mut self, params: &[f32], done: f64) {
        self.seen.renew(done);
        self.network.renew(params);
    }

    /// Other weights until the next step.
    #[cfg(test)]
    pub(crate) fn set_window(&mut self, window: &[f32]) {
        self.seen.set_window(window);
    }
}
