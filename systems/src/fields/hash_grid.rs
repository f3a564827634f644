//! A multiresolution hash grid (Müller et al., 2022, section 3), whose levels may come in one after the other.

use super::{Detail, FeatureSource, Features, Names, Part, Places};
use crate::buffers::shapes_hold;
use crate::schedule::Done;
use crate::settings::{Settings, together};
use engine::memory::room_for;
use engine::system::{
    MOST_LAYERS, SystemError, Tensor, TensorMap, at_most, f32_tensor, push_adam, take_adam, take_numbers,
};
use field_core::encoding::hash_grid::{Growth, HashGrid, HashGridConfig, Interpolation, MAX_LEVELS, Rule, Touched};
use field_core::encoding::window;
use field_core::init::Init;
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Settings of a hash grid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashGridSettings {
    /// Levels of the hash grid.
    pub levels: usize,
    /// Features of a hash grid entry: 1, 2, 4 or 8.
    pub features: usize,
    /// Each level has at most `2^log2_table` entries.
    pub log2_table: u32,
    /// Cells along an axis of the coarsest level.
    pub n_min: u32,
    /// Cells along an axis of the finest level.
    pub n_max: u32,
    /// Steps of the schedule over which the levels come in, coarse to fine; 0: all from the start.
    pub levels_anneal: u64,
    /// Levels there are from the start, where the others come in later.
    pub levels_first: usize,
    /// Coarse levels whose gradient with respect to positions reaches a warp at first: that of the finest says little about where to
    /// go, as long as nothing is near its place.
    pub warp_levels: usize,
    /// Share of the schedule after which further levels begin to lead a warp, one after the other.
    pub warp_levels_from: f64,
    /// Share of the schedule after which all of them do.
    pub warp_levels_until: f64,
}

impl HashGridSettings {
    /// The shape of the grid.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes the grid refuses.
    pub(crate) fn grid(&self) -> Result<HashGrid, SystemError> {
        let bad = |field, value, problem: String| SystemError::Config { field, value, problem };
        at_most(&[("levels", self.levels, MOST_LAYERS)])?;
        for (field, value) in
            [("warp_levels_from", self.warp_levels_from), ("warp_levels_until", self.warp_levels_until)]
        {
            if !(0.0..=1.0).contains(&value) {
                return Err(bad(field, value.to_string(), "must be in 0..=1".into()));
            }
        }
        if self.n_max < self.n_min {
            return Err(bad("n_max", self.n_max.to_string(), "must be at least `n_min`".into()));
        }
        HashGrid::new(
            HashGridConfig::default()
                .with_levels(self.levels)
                .with_features(self.features)
                .with_log2_table(self.log2_table)
                .with_n_min(self.n_min)
                .with_growth(Growth::UpTo(self.n_max))
                .with_rule(Rule::Ngp)
                .with_interpolation(Interpolation::Linear),
        )
        .map_err(|e| together("levels, features, log2_table, n_min, n_max", self, e))
    }

    /// Levels of `all` that lead a warp once a share of the schedule is done.
    fn leading(&self, share: f64, all: usize) -> usize {
        let first = self.warp_levels.min(all);
        let (from, until) = (self.warp_levels_from, self.warp_levels_until);
        if share < from {
            return first;
        }
        let come = if share < until { (share - from) / (until - from) } else { 1.0 };
        first + (come * (all - first) as f64) as usize
    }

    /// Weight of each level after `steps` steps of the schedule: 0 for levels that are not open yet (Nerfies, section 3.5).
    fn level_weights(&self, steps: u64, out: &mut [f32]) {
        let done = if self.levels_anneal == 0 { 1.0 } else { (steps as f64 / self.levels_anneal as f64).min(1.0) };
        let first = self.levels_first.min(out.len());
        let (there, later) = out.split_at_mut(first);
        there.fill(1.0);
        window::nerfies(done * later.len() as f64, later);
    }
}

/// The finest proposal's round whose grid is finer than that of the round before.
const FINEST_PROPOSAL: usize = 3;

/// A small grid, finer from round to round, with tables of at most `2^log2_table` entries.
fn proposal(round: usize, log2_table: u32) -> HashGridSettings {
    HashGridSettings {
        levels: 5,
        features: 2,
        log2_table: log2_table.min(17),
        n_min: 16,
        n_max: 128 << round.min(FINEST_PROPOSAL),
        levels_anneal: 0,
        levels_first: 0,
        warp_levels: 0,
        warp_levels_from: 0.0,
        warp_levels_until: 0.0,
    }
}

impl FeatureSource for HashGridSettings {
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError> {
        Ok(Arc::new(settings.of(self)?))
    }

    fn proposal(&self, round: usize) -> Arc<dyn FeatureSource> {
        Arc::new(proposal(round, self.log2_table))
    }

    fn features(&self, rng: Rng) -> Result<Box<dyn Features>, SystemError> {
        Ok(Box::new(HashGridFeatures::new(*self, rng)?))
    }
}

/// A hash grid.
pub(crate) struct HashGridFeatures {
    settings: HashGridSettings,
    simd: Simd,
    pub(crate) grid: HashGrid,
    /// Weight of each level: 0 for those that are not there yet.
    weights: Vec<f32>,
    /// Levels that lead a warp.
    leading: usize,
    params: Vec<f32>,
    /// One for each level.
    adam: Vec<Adam>,
    grad: Vec<f32>,
    touched: Touched,
}

/// What the update of one level writes.
struct LevelJob<'a> {
    adam: &'a mut Adam,
    touched: &'a mut [u64],
    params: &'a mut [f32],
    grad: &'a mut [f32],
}

impl HashGridFeatures {
    /// A grid of small random numbers.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot be, or that there is no memory for.
    pub(crate) fn new(settings: HashGridSettings, rng: Rng) -> Result<Self, SystemError> {
        let grid = settings.grid()?;
        room_for("log2_table", settings.log2_table as usize, grid.params_len())?;
        let mut params = vec![0.0; grid.params_len()];
        Init::Uniform(1e-4).fill(rng, 1, 1, &mut params);
        Ok(Self::with(settings, grid, params, Done::default()))
    }

    fn with(settings: HashGridSettings, grid: HashGrid, params: Vec<f32>, done: Done) -> Self {
        let mut weights = vec![1.0; grid.levels().len()];
        settings.level_weights(done.steps, &mut weights);
        Self {
            settings,
            simd: Simd::best(),
            leading: settings.leading(done.share, weights.len()),
            weights,
            adam: (0..grid.levels().len()).map(|l| Adam::new(grid.level_range(l).len(), AdamConfig::NGP)).collect(),
            grad: vec![0.0; grid.params_len()],
            touched: Touched::new(&grid),
            grid,
            params,
        }
    }
}

impl Features for HashGridFeatures {
    fn rows(&self) -> usize {
        self.grid.out_rows()
    }

    fn parameters(&self) -> &[f32] {
        &self.params
    }

    #[cfg(test)]
    fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    /// Level by level, so that one level's table is in the cache at a time.
    fn encode(&self, Places { x, .. }: Places<'_>, out: &mut [f32], _: &mut Vec<f32>) {
        let rows = self.grid.config().features * (x.len() / 3);
        for (level, (out, &weight)) in out.chunks_exact_mut(rows.max(1)).zip(&self.weights).enumerate() {
            if weight == 0.0 {
                out.fill(0.0);
                continue;
            }
            shapes_hold(self.grid.encode_level(self.simd, &self.params, level, x, out));
            if weight < 1.0 {
                out.iter_mut().for_each(|feature| *feature *= weight);
            }
        }
    }

    fn pull<'b>(&self, _: &[f32], n: usize, bars: &'b mut [f32], _: &'b mut Vec<f32>) -> &'b [f32] {
        let rows = self.grid.config().features * n;
        for (bars, &weight) in bars.chunks_exact_mut(rows.max(1)).zip(&self.weights) {
            if weight < 1.0 {
                bars.iter_mut().for_each(|bar| *bar *= weight);
            }
        }
        bars
    }

    fn pulls_in_place(&self) -> bool {
        true
    }

    fn pull_positions(&self, Places { x, .. }: Places<'_>, raw_bar: &[f32], detail: Detail, x_bar: &mut [f32]) {
        let levels = if detail == Detail::All { usize::MAX } else { self.leading };
        shapes_hold(self.grid.encode_backward_x_coarse(self.simd, &self.params, levels, x, raw_bar, x_bar));
    }

    /// Each level is one task: its gradient, scattered in the order of the samples, and Adam on the entries that it touched.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize {
        let (simd, grid) = (self.simd, &self.grid);
        let features = grid.config().features;
        let mut jobs: [Option<LevelJob<'_>>; MAX_LEVELS] = [const { None }; MAX_LEVELS];
        let (mut params, mut grads) = (&mut self.params[..], &mut self.grad[..]);
        for ((level, adam), touched) in self.adam.iter_mut().enumerate().zip(self.touched.levels_mut()) {
            let len = grid.level_range(level).len();
            let (p, rest) = params.split_at_mut(len);
            params = rest;
            let (grad, rest) = grads.split_at_mut(len);
            grads = rest;
            jobs[level] = Some(LevelJob { adam, touched, params: p, grad });
        }
        let update = |(level, job): (usize, &mut Option<LevelJob<'_>>)| {
            let Some(LevelJob { adam, touched, params, grad }) = job else { return 0 };
            for &Part { places: Places { x, .. }, raw_bar } in parts {
                let n = x.len() / 3;
                let bars = &raw_bar[level * features * n..][..features * n];
                shapes_hold(grid.encode_level_backward(simd, level, x, bars, grad, Some(touched)));
            }
            adam.step_touched(simd, lr, params, grad, touched)
        };
        // Levels that are not there yet have no gradient.
        let open = self.weights.iter().take_while(|&&w| w > 0.0).count();
        jobs[..open].par_iter_mut().enumerate().map(update).sum()
    }

    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]) {
        let (x, n) = (part.places.x, part.places.len());
        shapes_hold(self.grid.encode_backward(self.simd, x, &part.raw_bar[..self.rows() * n], out, None));
    }

    fn refine(&mut self, done: Done) {
        self.settings.level_weights(done.steps, &mut self.weights);
        self.leading = self.settings.leading(done.share, self.weights.len());
    }

    fn take_values(&mut self, values: &[f32]) -> bool {
        let alike = values.len() == self.params.len();
        if alike {
            self.params.copy_from_slice(values);
        }
        alike
    }

    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(names.parameters.clone(), &self.params));
        for (level, adam) in self.adam.iter().enumerate() {
            push_adam(out, &format!("{}.{level}", names.moments), adam);
        }
    }

    fn restored(&self, names: &Names, state: &TensorMap, done: Done) -> Result<Box<dyn Features>, SystemError> {
        let params = take_numbers(state, &names.parameters, self.params.len())?;
        let mut new = Self::with(self.settings, self.settings.grid()?, params, done);
        for (level, adam) in new.adam.iter_mut().enumerate() {
            *adam = take_adam(state, &format!("{}.{level}", names.moments), adam)?;
        }
        Ok(Box::new(new))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_coarse_levels_lead_first_and_all_at_the_end() {
        let settings = HashGridSettings {
            levels: 8,
            features: 2,
            log2_table: 6,
            n_min: 2,
            n_max: 16,
            levels_anneal: 0,
            levels_first: 8,
            warp_levels: 4,
            warp_levels_from: 0.25,
            warp_levels_until: 0.75,
        };
        let leading = [0.0, 0.24, 0.25, 0.5, 0.74, 0.75, 1.0].map(|share| settings.leading(share, 8));
        assert_eq!(leading, [4, 4, 4, 6, 7, 8, 8]);
        let at_once = HashGridSettings { warp_levels_from: 0.5, warp_levels_until: 0.5, ..settings };
        assert_eq!([0.49, 0.5].map(|share| at_once.leading(share, 8)), [4, 8]);
        // More levels than there are lead nowhere else.
        assert_eq!(HashGridSettings { warp_levels: 1000, ..settings }.leading(0.0, 8), 8);

        // What leads is the gradient of the coarse levels alone, then that of all.
        let mut grid = HashGridFeatures::new(settings, Rng::new(1, 2)).unwrap();
        grid.params.iter_mut().enumerate().for_each(|(i, p)| *p = (i as f32 * 0.7).sin());
        let (x, n) = ([0.31, 0.62, 0.17], 1);
        let raw_bar = vec![1.0; grid.rows() * n];
        let pulled = |grid: &HashGridFeatures, detail| {
            let mut x_bar = vec![0.0; 3 * n];
            grid.pull_positions(Places::still(&x), &raw_bar, detail, &mut x_bar);
            x_bar
        };
        let all = pulled(&grid, Detail::All);
        assert_ne!(pulled(&grid, Detail::Leading), all);
        grid.refine(Done::of_share(1.0));
        assert_eq!(pulled(&grid, Detail::Leading), all);
    }

    #[test]
    fn shares_beyond_the_schedule_are_refused() {
        let settings = proposal(0, 6);
        for settings in [
            HashGridSettings { warp_levels_from: -0.1, ..settings },
            HashGridSettings { warp_levels_until: f64::NAN, ..settings },
        ] {
            assert!(matches!(settings.grid(), Err(SystemError::Config { .. })), "{settings:?}");
        }
    }
}
