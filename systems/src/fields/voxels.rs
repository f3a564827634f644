//! Voxels seen at three distances, which become more as training goes on (TiNeuVox, Fang et al., 2022, section 3.3).

use super::{Detail, FeatureSource, Features, Names, Part, Places};
use crate::buffers::{shapes_hold, sized};
use crate::settings::Settings;
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
const DOUBLINGS: u64 = 3;
/// Octaves of interpolated features that the network sees.
const OCTAVES: usize = 2;
/// Bytes of a parameter: itself, a gradient for each of three distances, two moments; a checkpoint's copy.
const BYTES: usize = 4 * (1 + 3 + 2 + 3);

/// Settings of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VoxelSettings {
    /// Voxels along an axis in the end. They begin with an eighth of them in all, and double in number three times.
    pub voxels: usize,
    /// Steps between one doubling and the next.
    pub voxels_every: u64,
    /// Features of a voxel.
    pub features: usize,
}

impl VoxelSettings {
    /// Voxels along an axis after `steps` steps.
    fn after(&self, steps: u64) -> usize {
        let left = DOUBLINGS.saturating_sub(steps.checked_div(self.voxels_every).unwrap_or(DOUBLINGS));
        let share = 2.0_f64.powf(-(left as f64) / 3.0);
        ((self.voxels as f64 * share).round() as usize).max(2)
    }

    /// The grid after `steps` steps.
    fn grid(&self, steps: u64) -> Result<MultiDistance, SystemError> {
        if !(8..=512).contains(&self.voxels) {
            let problem = "must be in 8..=512".into();
            return Err(SystemError::Config { field: "voxels", value: self.voxels.to_string(), problem });
        }
        MultiDistance::new([self.after(steps) as u32; 3], self.features).map_err(refuse)
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

fn refuse(e: impl ToString) -> SystemError {
    SystemError::Config { field: "voxels, features", value: String::new(), problem: e.to_string() }
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
        let grid = settings.grid(0)?;
        room_for("voxels", settings.voxels, grid.params_len())?;
        // The largest grid is refused now, not in the middle of the training.
        settings.grid(u64::MAX)?;
        let params = vec![0.0; grid.params_len()];
        Self::with(settings, grid, params)
    }

    fn with(settings: VoxelSettings, grid: MultiDistance, params: Vec<f32>) -> Result<Self, SystemError> {
        let distance = || Distance { grad: vec![0.0; grid.params_len()], touched: vec![0; grid.touched_words()] };
        Ok(Self {
            settings,
            simd: Simd::best(),
            octaves: Frequency::new(grid.out_rows(), OCTAVES, Base::One, Identity::Include).map_err(refuse)?,
            adam: Adam::new(grid.params_len(), AdamConfig::NGP),
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

    /// Each distance scatters into a gradient of its own, these are added in order, and Adam steps on what was touched.
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
        self.adam.step_touched(simd, lr, &mut self.params, &mut all.grad, &mut all.touched)
    }

    #[cfg(test)]
    fn scatter(&self, part: &Part<'_>, out: &mut [f32]) {
        let (x, n) = (part.places.x, part.places.len());
        shapes_hold(self.grid.encode_backward(self.simd, x, &part.raw_bar[..self.grid.out_rows() * n], out));
    }

    fn refine(&mut self, steps: u64) {
        if self.grid.resolution()[0] as usize == self.settings.after(steps) {
            return;
        }
        let finer = self.settings.grid(steps).expect("the largest grid was checked");
        let params = self.grid.upsampled(&self.params, &finer);
        *self = Self::with(self.settings, finer, params).expect("the largest grid was checked");
    }

    fn push_state<'a>(&'a self, names: &Names, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(names.parameters.clone(), &self.params));
        push_adam(out, &format!("{}.0", names.moments), &self.adam);
    }

    fn restored(&self, names: &Names, state: &TensorMap, steps: u64) -> Result<Box<dyn Features>, SystemError> {
        // Its resolution is that of the step.
        let grid = self.settings.grid(steps)?;
        let params = take_numbers(state, &names.parameters, grid.params_len())?;
        let mut new = Self::with(self.settings, grid, params)?;
        new.adam = take_adam(state, &format!("{}.0", names.moments), &new.adam)?;
        Ok(Box::new(new))
    }

    fn growth_bytes(&self) -> usize {
        // Voxels double in number; the last of them are made while those before are there, and the pages of these come back late.
        let Ok(last) = self.settings.grid(u64::MAX) else { return 0 };
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

    fn voxels(voxels: usize, steps: u64) -> VoxelFeatures {
        let mut features = VoxelFeatures::new(VoxelSettings { voxels, features: 2, voxels_every: 10 }).unwrap();
        features.refine(steps);
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
        let mut table = voxels(12, 30);
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
        let mut table = voxels(12, 30);
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
        let len = |steps| voxels(32, steps).params.len() as f64;
        assert_eq!(len(0), len(9));
        for (before, after) in [(9, 10), (19, 20), (29, 30)] {
            let more = len(after) / len(before);
            assert!((1.6..2.4).contains(&more), "after {after} steps: {more} times as many");
        }
        assert_eq!(len(30), len(1000));
    }
}
