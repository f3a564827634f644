//! What a field of radiance learns about places: features of points, which a decoder turns into density and colour.
//!
//! A `Features` is a hash grid (`HashGridFeatures`), voxels (`VoxelFeatures`), products of planes
//! (`PlaneGridFeatures`), or another table of learned numbers, with the
//! optimiser of these numbers.

mod basis;
#[cfg(test)]
mod basis_tests;
mod blend;
mod decoder;
mod field;
mod hash_grid;
mod mixed;
mod moving_cells;
mod moving_part;
mod moving_points;
mod network;
mod networks;
mod placing;
mod plane_grid;
mod row_network;
mod time_hash;
mod view_times;
mod voxel_variation;
mod voxels;

pub(crate) use basis::Columns;
pub(crate) use decoder::{ColourDecoder, Decoder, DensityDecoder};
pub use decoder::{DecoderChoice, DecoderKind, ExplicitConfig};
pub(crate) use field::{DensityScratch, Field};
pub use hash_grid::HashGridSettings;
pub(crate) use mixed::Mixed;
pub(crate) use moving_cells::MovingCells;
pub(crate) use moving_part::MovingPart;
pub(crate) use moving_points::{MovingBars, MovingPoints};
pub(crate) use network::{fold_gradients, xavier};
pub use networks::{NetworkConfig, NetworkPrecision};
pub(crate) use placing::{Placing, When};
pub(crate) use plane_grid::{PlaneGridSettings, PlaneGridSource};
pub(crate) use row_network::{NetworkParameters, RowNetwork};
pub(crate) use time_hash::{TimeHashSettings, TimeHashSource};
pub(crate) use view_times::{count_of_times, different_times, view_times};
pub use voxels::VoxelSettings;

use crate::schedule::Done;
use crate::settings::Settings;
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use std::fmt::Debug;
use std::sync::Arc;

/// What networks learn with: Adam as in Instant-NGP, whose `epsilon` of 1e-15 lets seldom gradients count.
pub(crate) const NETWORK_ADAM: optim::AdamConfig = optim::AdamConfig::NGP;

/// Points, and their times.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places<'a> {
    /// `[3][n]`, in the unit cube.
    pub(crate) x: &'a [f32],
    /// `[n]`, times in `[-1, 1]`; empty for features that know no time.
    pub(crate) times: &'a [f32],
}

impl<'a> Places<'a> {
    /// Points of features that know no time.
    #[cfg(test)]
    pub(crate) fn still(x: &'a [f32]) -> Self {
        Self { x, times: &[] }
    }

    /// Number of points.
    pub(crate) fn len(&self) -> usize {
        self.x.len() / 3
    }
}

/// What a chunk of a batch brings to the gradient of features.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part<'a> {
    /// The samples.
    pub(crate) places: Places<'a>,
    /// The gradient, as [`Features::pull`] gives it.
    pub(crate) raw_bar: &'a [f32],
}

/// Which detail of the features leads positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Detail {
    /// All of it: the gradient of what is rendered.
    All,
    /// What says where to go at this time of the training: for what moves points.
    Leading,
}

/// The names under which a table's numbers lie in a checkpoint: the numbers, and their moments.
#[derive(Clone, Debug)]
pub(crate) struct Names {
    /// Of the numbers.
    pub(crate) parameters: String,
    /// Of their moments, with the part's number behind a dot.
    pub(crate) moments: String,
}

impl Names {
    pub(crate) fn new(parameters: impl Into<String>, moments: impl Into<String>) -> Self {
        Self { parameters: parameters.into(), moments: moments.into() }
    }
}

/// The settings of some features: what they are made anew from.
pub(crate) trait FeatureSource: Debug + Send + Sync {
    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError>;

    /// Features of the proposal of a round, for these: small, and finer from round to round.
    fn proposal(&self, round: usize) -> Arc<dyn FeatureSource>;

    /// Features before the first step.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot be, or that there is no memory for.
    fn features(&self, rng: Rng) -> Result<Box<dyn Features>, SystemError>;
}

/// Learned features of points in the unit cube, and their optimiser.
pub(crate) trait Features: Send + Sync {
    /// Rows that a network sees.
    fn rows(&self) -> usize;

    /// The learned numbers.
    fn parameters(&self) -> &[f32];

    /// The same, to be written.
    #[cfg(test)]
    fn parameters_mut(&mut self) -> &mut [f32];

    /// Times of the training views, in `[-1, 1]`; empty for features that know no time.
    fn view_times(&self) -> &[f32] {
        &[]
    }

    /// What a network sees of points: `out` `[rows][n]`; `raw` is room for interpolated features.
    fn encode(&self, places: Places<'_>, out: &mut [f32], raw: &mut Vec<f32>);

    /// Bring gradients `bars` `[rows][n]` of what [`Features::encode`] gave, `features`, to interpolated features: those gradients,
    /// in `bars` itself or in `raw`.
    fn pull<'b>(&self, features: &[f32], n: usize, bars: &'b mut [f32], raw: &'b mut Vec<f32>) -> &'b [f32];

    /// Whether [`Features::pull`] leaves its gradients in `bars`.
    fn pulls_in_place(&self) -> bool;

    /// Add the gradient of the positions to `x_bar` `[3][n]`, from that of the interpolated features.
    fn pull_positions(&self, places: Places<'_>, raw_bar: &[f32], detail: Detail, x_bar: &mut [f32]);

    /// Add the gradient of the learned numbers to `out`.
    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]);

    /// One step. The parts add up in order, whatever the number of threads. Returns the count of non-finite gradients.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize;

    /// The table once so much of the training is done: more levels, or more cells with the moments of those that they lie between.
    fn refine(&mut self, done: Done);

    /// Begin with the learned numbers of others of the same shape. Whether these are.
    fn take_values(&mut self, _values: &[f32]) -> bool {
        false
    }

    /// Everything the next step depends on, besides what is done of the schedule.
    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>);

    /// A table that continues from what [`Features::push_state`] gave when so much was done. This one stays as it is.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    fn restored(&self, names: &Names, state: &TensorMap, done: Done) -> Result<Box<dyn Features>, SystemError>;

    /// Bytes by which training will make it grow at most.
    fn growth_bytes(&self) -> usize {
        0
    }
}
