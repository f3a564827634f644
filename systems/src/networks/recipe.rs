//! What distinguishes the systems of two levels.

use super::along::Along;
use super::cones::Footprint;
use super::network::NetworkShape;
use super::samples::{Level, Tile};
use crate::space::{InternalRay, Space};
use engine::data::DrawnFrom;
use engine::system::SystemError;
use field_core::rng::Rng;
use field_core::tape::{Encoder, Node, Tape, TapeError};
use optim::AdamConfig;
use render_core::quadrature::two::Mixture;
use render_core::ray::RayBar;

/// Settings of a system of two levels, and what follows from them.
pub trait Recipe: Clone + Send + Sync {
    /// Name on the command line.
    const NAME: &'static str;
    /// The optimiser.
    const ADAM: AdamConfig;
    /// What a ray is.
    const FOOTPRINT: Footprint;
    /// Encoding of positions.
    type Position: Encoder + Copy + Send;

    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the field.
    fn check(&self) -> Result<(), SystemError>;

    /// 2 where each level has its own network, 1 where they share one.
    fn networks(&self) -> usize;

    /// Shape of a network.
    ///
    /// # Errors
    /// [`SystemError::Config`] for encodings that cannot be.
    fn network(&self) -> Result<NetworkShape<Self::Position>, SystemError>;

    /// Rays of a batch.
    fn batch_rays(&self) -> usize;

    /// Which pixels the batch of a step is drawn from.
    fn drawn_from(&self, _step: u64) -> DrawnFrom<'_> {
        DrawnFrom::ALL
    }

    /// Times of the training views, in `[0, 1]`, where points move; empty where nothing does.
    fn view_times(&self) -> &[f32] {
        &[]
    }

    /// Factor of the variation of displacements between a view's time and one beside it: the squared difference, summed over the fine
    /// samples of a ray, mean over rays; 0: none.
    fn variation(&self) -> f32 {
        0.0
    }

    /// A time beside that of a training view, from two uniform numbers.
    fn time_beside(&self, view: usize, _u: [f32; 2]) -> f32 {
        self.view_times().get(view).copied().unwrap_or_default()
    }

    /// Learning rate of a step.
    fn learning_rate(&self, step: u64) -> f64;

    /// Factor of a level's squared error in the loss.
    fn level_weight(&self, level: usize) -> f32;

    /// How a transient part shares an interval with the static one, where there is one.
    fn mixture(&self) -> Mixture {
        Mixture::default()
    }

    /// Factor of the prior `ln(1 + 2 sigma^2)` on the densities of the coarse level, mean over its samples; 0: none.
    fn sparsity(&self) -> f32 {
        0.0
    }

    /// Deviation of the noise on the raw density in training.
    fn density_noise(&self) -> f32;

    /// Densities from raw ones, on the tape.
    ///
    /// # Errors
    /// What the tape refuses.
    fn density(&self, tape: &mut Tape<'_>, raw: Node) -> Result<Node, TapeError>;

    /// Density of one raw one.
    fn density_of(&self, raw: f32) -> f32;

    /// Samples of the coarse level; random ones in training.
    fn fill_coarse(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile);

    /// Samples of the fine level, from the weights `tile.w` of the coarse one.
    fn fill_fine(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile);

    /// Add to `bars`, the gradients of the rays in internal coordinates, what `x_bar` `[rows][n]` says of them: the gradient of
    /// `level.x`, for samples that stay at their distances.
    fn pull_rays(&self, space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]);

    /// Fill in `level.x` for the `n` points `level.p`.
    fn place_points(&self, space: &Space, n: usize, level: &mut Level);
}
