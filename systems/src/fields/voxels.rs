//! Voxels seen at three distances, which become more as training goes on (TiNeuVox, Fang et al., 2022, section 3.3).

use super::voxel_variation::vary;
use super::{Detail, FeatureSource, Features, Names, Part, Places};
use crate::buffers::{shapes_hold, sized};
use crate::schedule::Done;
use crate::settings::{Settings, together};
use engine::memory::room_for;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::BLOCK_FLOATS;
use field_core::encoding::multi_distance::{MultiDistance, STRIDES};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How often the number of voxels doubles.
const DOUBLINGS: f64 = 3.0;
/// A share of a doubling that is rounding.
const ROUNDING: f64 = 1e-9;
/// Octaves of interpolated features that the network sees.
const OCTAVES: usize = 2;
/// What voxels learn with.
const ADAM: AdamConfig = AdamConfig::NGP;
/// Bytes of a parameter: itself, a gradient for each of three distances, two moments; a checkpoint's copy.
const BYTES: usize = 4 * (1 + 3 + 2 + 3);

/// Settings of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoxelSettings {
    /// Voxels along an axis in the end. They begin with an eighth of them in all, and double in number three times.
    pub voxels: usize,
    /// Share of the schedule between one doubling and the next; 0: all are there from the start.
    pub voxels_every: f64,
    /// Features of a voxel.
    pub features: usize,
    /// Factor of the variation of voxels, of those alone that a step sees; 0: none.
    pub voxel_variation: f32,
}

impl VoxelSettings {
    /// Voxels along an axis once a share of the schedule is done.
    fn after(&self, share: f64) -> usize {
        // Nothing is divided by 0; what a share misses of a doubling by rounding alone does not put it off.
        let doublings = if self.voxels_every > 0.0 { share / self.voxels_every + ROUNDING } else { DOUBLINGS };
        let left = DOUBLINGS - doublings.floor().min(DOUBLINGS);
        ((self.voxels as f64 * 2.0_f64.powf(-left / 3.0)).round() as usize).max(2)
    }

    /// The grid once a share of the schedule is done.
    fn grid(&self, share: f64) -> Result<MultiDistance, SystemError> {
        let refused =
            |field, value: String, problem: &str| Err(SystemError::Config { field, value, problem: problem.into() });
        if !(8..=512).contains(&self.voxels) {
            return refused("voxels", self.voxels.to_string(), "must be in 8..=512");
        }
        if !(0.0..=1.0).contains(&self.voxels_every) {
            return refused("voxels_every", self.voxels_every.to_string(), "must be in 0..=1, a share of the schedule");
        }
        if !(0.0..=100.0).contains(&self.voxel_variation) {
            return refused("voxel_variation", self.voxel_variation.to_string(), "must be in 0..=100");
        }
        MultiDistance::new([self.after(share) as u32; 3], self.features)
            .map_err(|e| together("voxels, features", self, e))
    }

    /// The largest grid.
    fn last_grid(&self) -> Result<MultiDistance, SystemError> {
        Self { voxels_every: 0.0, ..*self }.grid(1.0)
    }
}

impl FeatureSource for VoxelSettings {
    fn asked(&self, settings: &mut Settings<'_>) -> Result<Arc<dyn FeatureSource>, SystemError> {
        Ok(Arc::new(settings.of(self)?))
    }

    fn proposal(&self, _: usize) -> Arc<dyn FeatureSource> {
        Arc::new(Self { voxels: self.voxels / 2, ..*self })
    }

    fn features(&self, _: Rng) -> Result<Box<dyn Features>, SystemError> {
        Ok(Box::new(VoxelFeatures::new(*self)?))
    }
}

/// One grid, and the octaves of what it holds.
pub(crate) struct VoxelFeatures {
    settings: VoxelSettings,
    simd: Simd,
    grid: MultiDistance,
    octaves: Frequency,
    params: Vec<f32>,
    adam: Adam,
    /// One for each distance.
    distances: [Distance; STRIDES.len()],
}

struct Distance {
    grad: Vec<f32>,
    touched: Vec<u64>,
}

impl VoxelFeatures {
    /// Voxels that hold 0.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot be, or that there is no memory for.
    pub(crate) fn new(settings: VoxelSettings) -> Result<Self, SystemError> {
        let grid = settings.grid(0.0)?;
        room_for("voxels", settings.voxels, grid.params_len())?;
        // The largest grid is refused now, not in the middle of the training.
        settings.last_grid()?;
        let adam = Adam::new(grid.params_len(), ADAM);
        let params = vec![0.0; grid.params_len()];
        Self::with(settings, grid, params, adam)
    }

    fn with(settings: VoxelSettings, grid: MultiDistance, params: Vec<f32>, adam: Adam) -> Result<Self, SystemError> {
        let distance = || Distance { grad: vec![0.0; grid.params_len()], touched: vec![0; grid.touched_words()] };
        Ok(Self {
            settings,
            simd: Simd::best(),
            octaves: Frequency::new(grid.out_rows(), OCTAVES, Base::One, Identity::Include)
                .map_err(|e| together("voxels, features", &settings, e))?,
            adam,
            distances: std::array::from_fn(|_| distance()),
            grid,
            params,
        })
    }
}

impl Features for VoxelFeatures {
    fn rows(&self) -> usize {
        self.octaves.out_rows()
    }

    fn parameters(&self) -> &[f32] {
        &self.params
    }

    #[cfg(test)]
    fn parameters_mut(&mut self) -> &mut [f32] {
        &mut self.params
    }

    fn encode(&self, Places { x, .. }: Places<'_>, out: &mut [f32], raw: &mut Vec<f32>) {
        let features = sized(raw, self.grid.out_rows() * (x.len() / 3));
        shapes_hold(self.grid.encode(self.simd, &self.params, x, features));
        shapes_hold(self.octaves.encode(self.simd, features, None, out));
    }

    fn pull<'b>(&self, features: &[f32], n: usize, bars: &'b mut [f32], raw: &'b mut Vec<f32>) -> &'b [f32] {
        // The first rows of an encoding are what is encoded.
        let features = &features[..self.grid.out_rows() * n];
        raw.clear();
        raw.resize(features.len(), 0.0);
        shapes_hold(self.octaves.encode_backward(self.simd, features, None, bars, raw));
        raw
    }

    fn pulls_in_place(&self) -> bool {
        false
    }

    fn pull_positions(&self, Places { x, .. }: Places<'_>, raw_bar: &[f32], _: Detail, x_bar: &mut [f32]) {
        shapes_hold(self.grid.encode_backward_x(self.simd, &self.params, x, raw_bar, x_bar));
    }

    /// Each distance scatters into a gradient of its own, these are added in order, that of the variation comes on top, and Adam steps
    /// on what was touched.
    fn step(&mut self, lr: f64, parts: &[Part<'_>]) -> usize {
        let (simd, grid) = (self.simd, &self.grid);
        self.distances.par_iter_mut().enumerate().for_each(|(k, Distance { grad, touched })| {
            for &Part { places: Places { x, .. }, raw_bar } in parts {
                let rows = grid.features() * (x.len() / 3);
                let bars = &raw_bar[k * rows..][..rows];
                shapes_hold(grid.encode_stride_backward_touched(simd, k, x, bars, grad, touched));
            }
        });
        let [all, others @ ..] = &mut self.distances;
        for other in others {
            fold(all, other);
        }
        vary(grid, f64::from(self.settings.voxel_variation), &self.params, &mut all.grad, &all.touched);
        self.adam.step_touched(simd, lr, &mut self.params, &mut all.grad, &mut all.touched)
    }

    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]) {
        let (x, n) = (part.places.x, part.places.len());
        shapes_hold(self.grid.encode_backward(self.simd, x, &part.raw_bar[..self.grid.out_rows() * n], out));
    }

    /// Values and moments of the optimiser between the voxels that were there: what has been learnt of how to learn stays. Second
    /// moments are means of them, so they stay at least 0.
    fn refine(&mut self, done: Done) {
        if self.grid.resolution()[0] as usize == self.settings.after(done.share) {
            return;
        }
        let finer = self.settings.grid(done.share).expect("the largest grid was checked");
        let between = |of: &[f32]| self.grid.upsampled(of, &finer);
        let params = between(&self.params);
        let (m, v) = (between(self.adam.first_moment()), between(self.adam.second_moment()));
        let adam = Adam::restore(self.adam.config(), m, v, self.adam.steps()).expect("means of moments are moments");
        *self = Self::with(self.settings, finer, params, adam).expect("the largest grid was checked");
    }

    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(names.parameters.clone(), &self.params));
        push_adam(out, &format!("{}.0", names.moments), &self.adam);
    }

    fn restored(&self, names: &Names, state: &TensorMap, done: Done) -> Result<Box<dyn Features>, SystemError> {
        // Its resolution is that of the place in the schedule.
        let grid = self.settings.grid(done.share)?;
        let params = take_numbers(state, &names.parameters, grid.params_len())?;
        let adam = Adam::new(grid.params_len(), ADAM);
        let adam = take_adam(state, &format!("{}.0", names.moments), &adam)?;
        Ok(Box::new(Self::with(self.settings, grid, params, adam)?))
    }

    fn growth_bytes(&self) -> usize {
        // Voxels double in number; the last of them are made while those before are there, and the pages of these come back late.
        let Ok(last) = self.settings.last_grid() else { return 0 };
        BYTES * last.params_len().saturating_sub(self.params.len()) + 8 * last.params_len()
    }
}

/// Add what was touched of one gradient to another, and clear it.
fn fold(all: &mut Distance, other: &mut Distance) {
    for (word, (marks, own)) in all.touched.iter_mut().zip(&mut other.touched).enumerate() {
        *marks |= *own;
        while *own != 0 {
            let block = 64 * word + own.trailing_zeros() as usize;
            let from = block * BLOCK_FLOATS;
            let to = (from + BLOCK_FLOATS).min(all.grad.len());
            for (sum, g) in all.grad[from..to].iter_mut().zip(&mut other.grad[from..to]) {
                *sum += std::mem::take(g);
            }
            *own &= *own - 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 11;

    fn voxels(voxels: usize, share: f64) -> VoxelFeatures {
        let settings = VoxelSettings { voxels, features: 2, voxels_every: 0.1, voxel_variation: 0.0 };
        let mut features = VoxelFeatures::new(settings).unwrap();
        features.refine(Done::of_share(share));
        features
    }

    fn uniform(n: usize, stream: u64) -> Vec<f32> {
        let mut out = vec![0.0; n];
        Rng::new(4, stream).fill_uniform(0, &mut out);
        out
    }

    /// Sum of the outputs times fixed factors.
    fn value(features: &VoxelFeatures, x: &[f32], bars: &[f32]) -> f64 {
        let mut out = vec![0.0; bars.len()];
        features.encode(Places::still(x), &mut out, &mut Vec::new());
        out.iter().zip(bars).map(|(out, bar)| f64::from(*out) * f64::from(*bar)).sum()
    }

    #[test]
    fn voxels_are_pulled_as_differences_say() {
        let mut table = voxels(12, 0.3);
        let params: Vec<f32> = uniform(table.params.len(), 1).iter().map(|u| u - 0.5).collect();
        table.params.copy_from_slice(&params);
        let x = uniform(3 * N, 2);
        let bars = uniform(table.rows() * N, 3);
        let (mut pulled, mut raw) = (bars.clone(), Vec::new());
        let mut features = vec![0.0; bars.len()];
        table.encode(Places::still(&x), &mut features, &mut Vec::new());
        let raw_bar = table.pull(&features, N, &mut pulled, &mut raw);
        let mut x_bar = vec![0.25; 3 * N];
        table.pull_positions(Places::still(&x), raw_bar, Detail::All, &mut x_bar);
        let mut params_bar = vec![0.0; params.len()];
        table.grid.encode_backward(table.simd, &x, raw_bar, &mut params_bar).unwrap();

        let close = |got: f32, plus: f64, minus: f64, h: f32, what: &str| {
            let want = (plus - minus) / (2.0 * f64::from(h));
            assert!((f64::from(got) - want).abs() < 1e-2 * want.abs().max(1.0), "{what}: {got} and {want}");
        };
        let h = 2e-3;
        let touched: Vec<usize> = (0..params.len()).filter(|&i| params_bar[i] != 0.0).collect();
        assert!(touched.len() > 100, "three distances of eight corners each: {}", touched.len());
        for &i in touched.iter().step_by(touched.len() / 40) {
            let mut at = |step: f32| {
                table.params[i] = params[i] + step;
                let value = value(&table, &x, &bars);
                table.params[i] = params[i];
                value
            };
            close(params_bar[i], at(h), at(-h), h, &format!("parameter {i}"));
        }
        // Inside cells: the derivative jumps at their faces.
        let (h, cells) = (1e-3, f64::from(table.grid.resolution()[0] - 1));
        let mut tried = 0;
        for i in 0..3 * N {
            let inside = (f64::from(x[i]) * cells).fract();
            if !(0.05..0.95).contains(&inside) || !(0.02..0.98).contains(&x[i]) {
                continue;
            }
            let at = |step: f32| {
                let mut x = x.clone();
                x[i] += step;
                value(&table, &x, &bars)
            };
            close(x_bar[i] - 0.25, at(h), at(-h), h, &format!("coordinate {i}"));
            tried += 1;
        }
        assert!(tried > N, "{tried}");
    }

    #[test]
    fn what_is_seen_of_voxels_is_what_they_hold_and_its_octaves() {
        let mut table = voxels(12, 0.3);
        table.params.fill(0.3);
        let mut out = vec![0.0; table.rows() * N];
        table.encode(Places::still(&uniform(3 * N, 2)), &mut out, &mut Vec::new());
        // Three distances of two features; each with itself, and sine and cosine of two octaves.
        assert_eq!(table.rows(), 6 * 5);
        let seen = [0.3, 0.3_f32.sin(), 0.3_f32.cos(), 0.6_f32.sin(), 0.6_f32.cos()];
        for (i, value) in out.iter().enumerate() {
            assert!(seen.iter().any(|s| (s - value).abs() < 1e-5), "row {}: {value}", i / N);
        }
    }

    #[test]
    fn voxels_double_in_number_three_times() {
        let len = |share| voxels(32, share).params.len() as f64;
        assert_eq!(len(0.0), len(0.09));
        for (before, after) in [(0.09, 0.1), (0.19, 0.2), (0.29, 0.3)] {
            let more = len(after) / len(before);
            assert!((1.6..2.4).contains(&more), "after {after} of the schedule: {more} times as many");
        }
        assert_eq!(len(0.3), len(1.0));
    }

    /// A step on points all over the grid.
    fn learn(table: &mut VoxelFeatures, stream: u64) {
        let x = uniform(3 * 400, stream);
        let raw_bar: Vec<f32> = uniform(table.grid.out_rows() * 400, stream + 1).iter().map(|u| u - 0.3).collect();
        assert_eq!(table.step(1e-2, &[Part { places: Places::still(&x), raw_bar: &raw_bar }]), 0);
    }

    #[test]
    fn moments_of_the_optimiser_survive_a_doubling() {
        let mut table = voxels(24, 0.0);
        (0..20).for_each(|k| learn(&mut table, 100 + 2 * k));
        let before = (table.grid, table.adam.clone());
        table.refine(Done::of_share(0.1));
        assert!(table.adam.len() > before.1.len(), "it doubled");
        assert_eq!((table.adam.steps(), table.adam.config()), (before.1.steps(), before.1.config()));
        let (coarse, fine) = (before.0, table.grid);
        for (was, is) in [
            (before.1.first_moment(), table.adam.first_moment()),
            (before.1.second_moment(), table.adam.second_moment()),
        ] {
            assert!(was.iter().any(|&m| m != 0.0));
            // As the values are: the blend of what was there, seen at the finer voxels.
            assert_eq!(is, coarse.upsampled(was, &fine));
            let mean = |of: &[f32]| of.iter().map(|&m| f64::from(m)).sum::<f64>() / of.len() as f64;
            assert!((0.3..3.0).contains(&(mean(is) / mean(was))), "{} and {}", mean(was), mean(is));
        }
        // It learns on.
        learn(&mut table, 999);
        assert_eq!(table.adam.steps(), before.1.steps() + 1);
    }
}
