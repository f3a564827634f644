//! What moves before what stands still: a second set of features with its deformation, evaluated only where something moves.
//!
//! The still part of the field is a field as for a scene at rest. In cells where something moves ([`MovingCells`]) a sample has both
//! parts: they are mixed by a gate (`fields::blend`). Everywhere else the field costs what it costs at rest.

use super::moving_cells::MovingCells;
use super::placing::{Placing, When, fill_times, knows_time, seen, steps_of};
use super::{DensityDecoder, Features, Names, xavier};
use crate::schedule::Done;
use crate::warps::{Deform, TimeSteps};
use engine::system::{
    SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_counts, take_numbers, take_u64, u64_tensor,
};
use field_core::mlp::{Mlp, Packed};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};

/// The moving part of a field.
pub(crate) struct MovingPart {
    /// What is learnt about places of the canonical scene of what moves.
    pub(crate) features: Box<dyn Features>,
    /// What moves points; `None`: the features know the time themselves.
    pub(crate) deform: Option<Deform>,
    /// From features to density, what colours depend on, the gate, and `more` rows after that.
    pub(crate) network: Mlp,
    /// Rows that the still part does not have, after the gate.
    more: usize,
    /// Whether its network gives by how much it differs from what the still part's gives.
    pub(super) on_top: bool,
    pub(crate) params: Vec<f32>,
    pub(crate) adam: Adam,
    /// Where something moves.
    pub(crate) cells: MovingCells,
    /// How often, after the last look, cells were given back of which nothing came.
    pub(crate) reviews: u64,
    pub(super) packed: Packed,
    time_steps: TimeSteps,
}

/// The names of a checkpoint.
const NETWORK: &str = "moving.density";
const CELLS: &str = "moving.cells";
const REVIEWS: &str = "moving.reviews";
/// Only of parts that are on top of the still one.
const ON_TOP: &str = "moving.on_top";

fn names() -> Names {
    Names::new("moving.grid", "moving.grid")
}

impl MovingPart {
    /// A moving part whose network gives one row more than that of the still part, its gate, and `more` after that; it learns with `adam`.
    pub(crate) fn new(
        features: Box<dyn Features>,
        deform: Option<Deform>,
        network: Mlp,
        more: usize,
        cells: MovingCells,
        adam: AdamConfig,
        rng: Rng,
    ) -> Self {
        let params = xavier(&network, rng);
        let mut part = Self {
            time_steps: steps_of(features.view_times().to_vec()),
            adam: Adam::new(params.len(), adam),
            packed: Packed::default(),
            features,
            deform,
            network,
            more,
            on_top: false,
            params,
            cells,
            reviews: 0,
        };
        part.pack();
        part
    }

    /// Begin as the still part is, and the picture as before; the gate is half open then. Features of the same shape, and the network behind them,
    /// take that part's numbers. Others begin on top of it: by how much the moving part differs is what they learn, from nothing on.
    /// A part with scene flow never does, as it is seen without the still part, too.
    pub(crate) fn begin_as(&mut self, features: &dyn Features, density: &DensityDecoder, params: &[f32]) {
        let (from, to) = (density.mlp().layers(), self.network.layers());
        let alike = from.len() == to.len()
            && self.features.rows() == features.rows()
            && self.features.take_values(features.parameters());
        self.on_top = !alike && self.more == 0;
        if alike {
            self.params.fill(0.0);
            for (from, to) in from.iter().zip(to) {
                let rows = params[from.weights.clone()].chunks_exact(from.inputs);
                for (from, to) in rows.zip(self.params[to.weights.clone()].chunks_exact_mut(to.inputs)) {
                    to[..from.len()].copy_from_slice(from);
                }
            }
        } else if self.on_top {
            to.last().into_iter().for_each(|last| self.params[last.weights.clone()].fill(0.0));
        }
        self.pack();
    }

    /// Renew the packed parameters.
    pub(crate) fn pack(&mut self) {
        self.network.pack(&self.params, &mut self.packed);
    }

    /// Rows that its network shares with the still part's: density, and what colours depend on. The gate comes after them.
    pub(crate) fn still_rows(&self) -> usize {
        self.network.outputs() - 1 - self.more
    }

    /// What its network sees of points wherever they are, `out` `[rows][m]`, and their times. Their positions `x` `[3][m]` become canonical.
    pub(crate) fn seen(
        &self,
        x: &mut [f32],
        when: When<'_>,
        times: &mut Vec<f32>,
        out: &mut [f32],
        placing: &mut Placing,
    ) {
        fill_times(&*self.features, when, times);
        seen(&*self.features, self.deform.as_ref(), x, when, out, placing);
    }

    /// What its network gives, `out` `[outputs][m]`, of what it sees, `features` `[rows][m]`.
    pub(crate) fn forward(&self, simd: Simd, features: &[f32], m: usize, out: &mut [f32], acts: &mut [f32]) {
        self.network.forward(simd, &self.packed, features, m, m, out, m, acts);
    }

    /// The way back of [`MovingPart::forward`]: added to `features_bar` and to the packed gradient `grad`.
    #[expect(clippy::too_many_arguments, reason = "two matrices, and where the gradients of each go")]
    pub(crate) fn backward(
        &self,
        simd: Simd,
        acts: &[f32],
        out_bar: &[f32],
        m: usize,
        features_bar: &mut [f32],
        grad: &mut [f32],
        scratch: &mut [f32],
    ) {
        self.network.backward(simd, &self.packed, acts, out_bar, m, m, Some((features_bar, m)), grad, scratch);
    }

    /// Rows that its network sees.
    pub(crate) fn rows(&self) -> usize {
        self.network.inputs()
    }

    /// Whether anything depends on the time.
    pub(crate) fn is_timed(&self) -> bool {
        self.deform.is_some() || knows_time(&*self.features)
    }

    /// Time steps of the training views.
    pub(crate) fn time_steps(&self) -> &TimeSteps {
        self.deform.as_ref().map_or(&self.time_steps, Deform::time_steps)
    }

    /// Number of trainable parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        let deform = self.deform.as_ref().map_or(0, Deform::parameter_count);
        self.features.parameters().len() + self.params.len() + deform
    }

    /// Bytes of the parameters, their packed copies and the cells.
    pub(crate) fn bytes(&self) -> usize {
        4 * (self.features.parameters().len() + 3 * self.params.len()) + 8 * MovingCells::WORDS
    }

    /// Everything the next step depends on.
    pub(crate) fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![
            f32_tensor(NETWORK, &self.params),
            u64_tensor(CELLS, self.cells.words().to_vec()),
            u64_tensor(REVIEWS, vec![self.reviews]),
        ];
        out.extend(self.on_top.then(|| u64_tensor(ON_TOP, vec![1])));
        push_adam(&mut out, NETWORK, &self.adam);
        self.features.push_state(&names(), &mut out);
        out.extend(self.deform.iter().flat_map(Deform::state));
        out
    }

    /// The cells of a checkpoint; `None` where it has no moving part.
    ///
    /// # Errors
    /// [`SystemError::State`] for an array of another shape.
    pub(crate) fn cells_of(state: &TensorMap) -> Result<Option<MovingCells>, SystemError> {
        if !state.contains_key(CELLS) {
            return Ok(None);
        }
        Ok(MovingCells::of_words(take_u64(state, CELLS, MovingCells::WORDS)?))
    }

    /// Put back what [`MovingPart::state`] gave when so much of the run was done.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(crate) fn load_state(&mut self, state: &TensorMap, done: Done) -> Result<(), SystemError> {
        let params = take_numbers(state, NETWORK, self.params.len())?;
        let reviews = take_counts(state, REVIEWS, 1)?[0];
        let adam = take_adam(state, NETWORK, &self.adam)?;
        let features = self.features.restored(&names(), state, done)?;
        if let Some(deform) = &mut self.deform {
            deform.load_state(state)?;
        }
        (self.params, self.adam, self.features) = (params, adam, features);
        self.reviews = reviews;
        self.on_top = state.contains_key(ON_TOP);
        self.pack();
        Ok(())
    }
}
