//! A multiresolution hash grid of space and time (Wang et al., "Masked Space-Time Hash Encoding for Efficient Dynamic Scene
//! Reconstruction", 2023, section 3.1), for what moves.

use super::view_times::steps_of_time;
use super::{Detail, FeatureSource, Features, Names, Part, Places};
use crate::buffers::{shapes_hold, sized};
use crate::schedule::Done;
use crate::settings::{Settings, together};
use engine::memory::room_for;
use engine::system::{
    MOST_LAYERS, SystemError, Tensor, TensorMap, at_most, f32_tensor, push_adam, take_adam, take_numbers,
};
use field_core::encoding::time_hash::{MAX_LEVELS, TimeHash, TimeHashConfig};
use field_core::init::Init;
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig, touched_len};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A hash grid of space and time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TimeHashSettings {
    /// Levels of the hash grid of space and time.
    pub(crate) moving_levels: usize,
    /// Features of each of its entries: 1, 2, 4 or 8.
    pub(crate) moving_features: usize,
    /// Each of its levels has at most `2^moving_log2_table` entries.
    pub(crate) moving_log2_table: u32,
    /// Cells along an axis of space, of its coarsest level.
    pub(crate) moving_n_min: u32,
    /// Cells along an axis of space, of its finest level.
    pub(crate) moving_n_max: u32,
    /// Cells along the time, of its coarsest level.
    pub(crate) moving_times: u32,
    /// Cells along the time, of its finest level; 0: half the number of the photos' times.
    pub(crate) moving_times_max: u32,
}

/// Settings of the size of a grid.
const SIZES: &str =
    "moving_levels, moving_features, moving_log2_table, moving_n_min, moving_n_max, moving_times, moving_times_max";

impl TimeHashSettings {
    fn grid(&self, times: &[f32]) -> Result<TimeHash, SystemError> {
        at_most(&[("moving_levels", self.moving_levels, MOST_LAYERS)])?;
        let along = match self.moving_times_max {
            0 => steps_of_time(times),
            last => last,
        };
        // What the photos say is not less than what was asked for.
        let first = if self.moving_times_max == 0 { self.moving_times.min(along) } else { self.moving_times };
        TimeHash::new(TimeHashConfig {
            levels: self.moving_levels,
            features: self.moving_features,
            log2_table: self.moving_log2_table,
            space: [self.moving_n_min, self.moving_n_max],
            time: [first, along],
        })
        .map_err(|e| together(SIZES, self, e))
    }
}

/// The grid of a scene: its settings, and the times of its training views in `[-1, 1]`.
#[derive(Clone, Debug)]
pub(crate) struct TimeHashSource {
    settings: TimeHashSettings,
    times: Arc<[f32]>,
}

impl TimeHashSource {
    /// A grid with these settings.
    pub(crate) fn new(settings: TimeHashSettings, times: Arc<[f32]>) -> Self {
        Self { settings, times }
    }
}

impl FeatureSource for TimeHashSource {
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError> {
        Ok(Arc::new(Self { settings: settings.of(&self.settings)?, times: self.times.clone() }))
    }

    fn proposal(&self, round: usize) -> Arc<dyn FeatureSource> {
        let settings = TimeHashSettings {
            moving_levels: 5,
            moving_features: 2,
            moving_n_min: self.settings.moving_n_min.min(16),
            moving_n_max: 128 << round.min(2),
            moving_log2_table: self.settings.moving_log2_table.min(17),
            ..self.settings
        };
        Arc::new(Self { settings, times: self.times.clone() })
    }

    fn features(&self, rng: Rng) -> Result<Box<dyn Features>, SystemError> {
        let grid = self.settings.grid(&self.times)?;
        room_for("moving_log2_table", self.settings.moving_log2_table as usize, grid.params_len())?;
        let mut params = vec![0.0; grid.params_len()];
        Init::Uniform(1e-4).fill(rng, 1, 1, &mut params);
        Ok(Box::new(TimeHashFeatures::new(self.clone(), grid, params)))
    }
}

/// A hash grid of space and time, and its optimiser.
struct TimeHashFeatures {
    source: TimeHashSource,
    simd: Simd,
    grid: TimeHash,
    params: Vec<f32>,
    levels: Vec<LevelState>,
    /// `[chunks][n]`, times of a step in `[0, 1]`.
    times: Vec<Vec<f32>>,
}

/// How a level learns.
struct LevelState {
    adam: Adam,
    /// 0 between steps.
    grad: Vec<f32>,
    touched: Vec<u64>,
}

/// Times in `[0, 1]`, of times in `[-1, 1]`.
fn fill_times(times: &[f32], out: &mut [f32]) {
    // Photos that are all of one time have none.
    out.fill(0.0);
    out.iter_mut().zip(times).for_each(|(out, t)| *out = 0.5 * t + 0.5);
}

impl TimeHashFeatures {
    fn new(source: TimeHashSource, grid: TimeHash, params: Vec<f32>) -> Self {
        let level = |l: usize| {
            let len = grid.level_range(l).len();
            LevelState {
                adam: Adam::new(len, AdamConfig::NGP),
                grad: vec![0.0; len],
                touched: vec![0; touched_len(len)],
            }
        };
        let levels = (0..grid.levels().len()).map(level).collect();
        Self { source, simd: Simd::best(), grid, params, levels, times: Vec::new() }
    }

    fn level_rows(&self, n: usize) -> usize {
        self.grid.config().features * n
    }
}

impl Features for TimeHashFeatures {
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

    fn view_times(&self) -> &[f32] {
        &self.source.times
    }

    /// Level by level, so that one level's table is in the cache at a time.
    fn encode(&self, places: Places<'_>, out: &mut [f32], raw: &mut Vec<f32>) {
        let times = sized(raw, places.len());
        fill_times(places.times, times);
        for (level, out) in out.chunks_exact_mut(self.level_rows(places.len()).max(1)).enumerate() {
            shapes_hold(self.grid.encode_level(self.simd, &self.params, level, places.x, times, out));
        }
    }

    fn pull<'b>(&self, _: &[f32], _: usize, bars: &'b mut [f32], _: &'b mut Vec<f32>) -> &'b [f32] {
        bars
    }

    fn pulls_in_place(&self) -> bool {
        true
    }

    fn pull_positions(&self, places: Places<'_>, raw_bar: &[f32], _: Detail, x_bar: &mut [f32]) {
        let mut times = vec![0.0; places.len()];
        fill_times(places.times, &mut times);
        for (level, bars) in
            raw_bar[..self.rows() * places.len()].chunks_exact(self.level_rows(places.len()).max(1)).enumerate()
        {
            shapes_hold(self.grid.encode_level_backward_x(
                self.simd,
                &self.params,
                level,
                places.x,
                &times,
                bars,
                x_bar,
            ));
        }
    }

    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]) {
        let mut times = vec![0.0; part.places.len()];
        fill_times(part.places.times, &mut times);
        for (level, bars) in part.raw_bar[..self.rows() * part.places.len()]
            .chunks_exact(self.level_rows(part.places.len()).max(1))
            .enumerate()
        {
            let range = self.grid.level_range(level);
            let mut touched = vec![0; touched_len(range.len())];
            let grad = &mut out[range];
            shapes_hold(self.grid.encode_level_backward(
                self.simd,
                level,
                part.places.x,
                &times,
                bars,
                grad,
                &mut touched,
            ));
        }
    }

    /// Each level is one task: its gradient, scattered in the order of the samples, and Adam on the entries that it touched.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize {
        self.times.resize_with(self.times.len().max(parts.len()), Vec::new);
        for (times, part) in self.times.iter_mut().zip(parts) {
            fill_times(part.places.times, sized(times, part.places.len()));
        }
        let (simd, grid, times, features) = (self.simd, &self.grid, &self.times, self.grid.config().features);
        let mut params = &mut self.params[..];
        let mut jobs: [Option<(&mut LevelState, &mut [f32])>; MAX_LEVELS] = [const { None }; MAX_LEVELS];
        for (job, state) in jobs.iter_mut().zip(&mut self.levels) {
            let (own, rest) = params.split_at_mut(state.grad.len());
            params = rest;
            *job = Some((state, own));
        }
        let update = |(level, job): (usize, &mut Option<(&mut LevelState, &mut [f32])>)| {
            let Some((LevelState { adam, grad, touched }, params)) = job else { return 0 };
            for (part, times) in parts.iter().zip(times) {
                let n = part.places.len();
                let bars = &part.raw_bar[level * features * n..][..features * n];
                shapes_hold(grid.encode_level_backward(simd, level, part.places.x, &times[..n], bars, grad, touched));
            }
            adam.step_touched(simd, lr, params, grad, touched)
        };
        let levels = grid.levels().len();
        jobs[..levels].par_iter_mut().enumerate().map(update).sum()
    }

    fn refine(&mut self, _: Done) {}

    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(names.parameters.clone(), &self.params));
        for (level, state) in self.levels.iter().enumerate() {
            push_adam(out, &format!("{}.{level}", names.moments), &state.adam);
        }
    }

    fn restored(&self, names: &Names, state: &TensorMap, _: Done) -> Result<Box<dyn Features>, SystemError> {
        let params = take_numbers(state, &names.parameters, self.params.len())?;
        let mut new = Self::new(self.source.clone(), self.grid.clone(), params);
        for (level, own) in new.levels.iter_mut().enumerate() {
            own.adam = take_adam(state, &format!("{}.{level}", names.moments), &own.adam)?;
        }
        Ok(Box::new(new))
    }
}

#[cfg(test)]
#[path = "time_hash_tests.rs"]
mod tests;
