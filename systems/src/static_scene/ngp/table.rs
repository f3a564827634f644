//! The learned features behind the density network: a hash grid, or voxels seen at three distances that become finer as
//! training goes on (TiNeuVox).

use super::NgpConfig;
use super::field::{shapes_hold, sized};
use super::grid_trainer::{GridTrainer, Part};
use super::voxel_trainer::VoxelTrainer;
use engine::system::SystemError;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::HashGrid;
use field_core::encoding::multi_distance::MultiDistance;
use float_core::Simd;
use optim::Adam;

/// A table's shape. Its parameters lie in the field.
pub(super) enum Table {
    /// Levels of growing resolution, each with its weight: 0 for those that are not there yet.
    Hash(Box<HashGrid>, Vec<f32>),
    /// One grid, and the octaves of what it holds.
    Voxels(MultiDistance, Frequency),
}

fn refuse(e: impl ToString) -> SystemError {
    super::config::bad("voxels, features", "", &e.to_string())
}

/// Octaves of interpolated features that the network sees.
const OCTAVES: usize = 2;

impl Table {
    /// As it is after so many steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for sizes that cannot be.
    pub(super) fn new(config: &NgpConfig, steps: u64) -> Result<Self, SystemError> {
        if config.voxels == 0 {
            let grid = config.grid()?;
            let mut weights = vec![1.0; grid.levels().len()];
            config.level_weights(steps, &mut weights);
            return Ok(Self::Hash(Box::new(grid), weights));
        }
        let grid = MultiDistance::new([config.voxels_after(steps) as u32; 3], config.features).map_err(refuse)?;
        let lift = Frequency::new(grid.out_rows(), OCTAVES, Base::One, Identity::Include).map_err(refuse)?;
        Ok(Self::Voxels(grid, lift))
    }

    /// Learned numbers.
    pub(super) fn params_len(&self) -> usize {
        match self {
            Self::Hash(grid, _) => grid.params_len(),
            Self::Voxels(grid, _) => grid.params_len(),
        }
    }

    /// The setting that it grows with most, and its value.
    pub(super) fn size_setting(&self, config: &NgpConfig) -> (&'static str, usize) {
        match self {
            Self::Hash(..) => ("log2_table", config.log2_table as usize),
            Self::Voxels(..) => ("voxels", config.voxels),
        }
    }

    /// Rows that the network sees.
    pub(super) fn out_rows(&self) -> usize {
        match self {
            Self::Hash(grid, _) => grid.out_rows(),
            Self::Voxels(_, lift) => lift.out_rows(),
        }
    }

    /// What the network sees of points: `x` `[3][n]` in the unit cube, `out` `[out_rows][n]`; `raw` is room for features.
    pub(super) fn encode(&self, simd: Simd, (params, x): (&[f32], &[f32]), out: &mut [f32], raw: &mut Vec<f32>) {
        match self {
            Self::Hash(grid, weights) => {
                let rows = grid.config().features * (x.len() / 3);
                for (level, (out, &weight)) in out.chunks_exact_mut(rows.max(1)).zip(weights).enumerate() {
                    if weight == 0.0 {
                        out.fill(0.0);
                        continue;
                    }
                    shapes_hold(grid.encode_level(simd, params, level, x, out));
                    if weight < 1.0 {
                        out.iter_mut().for_each(|feature| *feature *= weight);
                    }
                }
            }
            Self::Voxels(grid, lift) => {
                let features = sized(raw, grid.out_rows() * (x.len() / 3));
                shapes_hold(grid.encode(simd, params, x, features));
                shapes_hold(lift.encode(simd, features, None, out));
            }
        }
    }

    /// Bring gradients of [`Table::encode`]'s output `features`, `bars` `[out_rows][n]`, to interpolated features: those
    /// gradients, in `bars` itself or in `raw`.
    pub(super) fn pull<'b>(
        &self,
        simd: Simd,
        features: &[f32],
        n: usize,
        bars: &'b mut [f32],
        raw: &'b mut Vec<f32>,
    ) -> &'b [f32] {
        match self {
            Self::Hash(grid, weights) => {
                let rows = grid.config().features * n;
                for (bars, &weight) in bars.chunks_exact_mut(rows.max(1)).zip(weights) {
                    if weight < 1.0 {
                        bars.iter_mut().for_each(|bar| *bar *= weight);
                    }
                }
                bars
            }
            Self::Voxels(grid, lift) => {
                // The first rows of an encoding are what is encoded.
                let features = &features[..grid.out_rows() * n];
                raw.clear();
                raw.resize(features.len(), 0.0);
                shapes_hold(lift.encode_backward(simd, features, None, bars, raw));
                raw
            }
        }
    }

    /// Add the gradient of the positions, from that of the interpolated features; of a hash grid that of its first `levels`
    /// levels.
    pub(super) fn pull_positions(
        &self,
        simd: Simd,
        (params, x): (&[f32], &[f32]),
        raw_bar: &[f32],
        levels: usize,
        x_bar: &mut [f32],
    ) {
        shapes_hold(match self {
            Self::Hash(grid, _) => grid.encode_backward_x_coarse(simd, params, levels, x, raw_bar, x_bar),
            Self::Voxels(grid, _) => grid.encode_backward_x(simd, params, x, raw_bar, x_bar),
        });
    }
}

/// Moments and gradients of a table's parameters.
pub(super) enum TableTrainer {
    Hash(GridTrainer),
    Voxels(Box<VoxelTrainer>),
}

impl TableTrainer {
    pub(super) fn new(table: &Table) -> Self {
        match table {
            Table::Hash(grid, _) => Self::Hash(GridTrainer::new(grid)),
            Table::Voxels(grid, _) => Self::Voxels(Box::new(VoxelTrainer::new(grid))),
        }
    }

    /// One step. The parts add up in order, whatever the number of threads. Returns the count of non-finite gradients.
    pub(super) fn step(&mut self, simd: Simd, table: &Table, params: &mut [f32], lr: f64, parts: &[Part<'_>]) -> usize {
        match (self, table) {
            (Self::Hash(trainer), Table::Hash(grid, weights)) => {
                // Levels that are not there yet have no gradient.
                let open = weights.iter().take_while(|&&w| w > 0.0).count();
                trainer.step(simd, grid, params, lr, parts, open)
            }
            (Self::Voxels(trainer), Table::Voxels(grid, _)) => trainer.step(simd, grid, params, lr, parts),
            _ => unreachable!("a trainer is made for its table"),
        }
    }

    /// Moments, one after the other.
    pub(super) fn adams(&self) -> &[Adam] {
        match self {
            Self::Hash(trainer) => &trainer.adam,
            Self::Voxels(trainer) => std::slice::from_ref(&trainer.adam),
        }
    }

    /// The same, to be put back.
    pub(super) fn adams_mut(&mut self) -> &mut [Adam] {
        match self {
            Self::Hash(trainer) => &mut trainer.adam,
            Self::Voxels(trainer) => std::slice::from_mut(&mut trainer.adam),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::budget_tests::small;
    use super::*;
    use crate::space::SpaceKind;
    use field_core::rng::Rng;

    const N: usize = 11;

    fn voxels(voxels: usize, steps: u64) -> Table {
        let config = NgpConfig { voxels, features: 2, voxels_every: 10, ..small(SpaceKind::Box) };
        Table::new(&config, steps).unwrap()
    }

    fn uniform(n: usize, stream: u64) -> Vec<f32> {
        let mut out = vec![0.0; n];
        Rng::new(4, stream).fill_uniform(0, &mut out);
        out
    }

    /// Sum of the outputs times fixed factors.
    fn value(table: &Table, params: &[f32], x: &[f32], bars: &[f32]) -> f64 {
        let mut out = vec![0.0; bars.len()];
        table.encode(Simd::best(), (params, x), &mut out, &mut Vec::new());
        out.iter().zip(bars).map(|(out, bar)| f64::from(*out) * f64::from(*bar)).sum()
    }

    #[test]
    fn voxels_are_pulled_as_differences_say() {
        let (table, simd) = (voxels(12, 30), Simd::best());
        let params: Vec<f32> = uniform(table.params_len(), 1).iter().map(|u| u - 0.5).collect();
        let x = uniform(3 * N, 2);
        let bars = uniform(table.out_rows() * N, 3);
        let (mut pulled, mut raw) = (bars.clone(), Vec::new());
        let mut features = vec![0.0; bars.len()];
        table.encode(simd, (&params, &x), &mut features, &mut Vec::new());
        let raw_bar = table.pull(simd, &features, N, &mut pulled, &mut raw);
        let mut x_bar = vec![0.25; 3 * N];
        table.pull_positions(simd, (&params, &x), raw_bar, 0, &mut x_bar);
        let Table::Voxels(grid, _) = &table else { panic!("voxels were asked for") };
        let mut params_bar = vec![0.0; params.len()];
        grid.encode_backward(simd, &x, raw_bar, &mut params_bar).unwrap();

        let close = |got: f32, plus: f64, minus: f64, h: f32, what: &str| {
            let want = (plus - minus) / (2.0 * f64::from(h));
            assert!((f64::from(got) - want).abs() < 1e-2 * want.abs().max(1.0), "{what}: {got} and {want}");
        };
        let h = 2e-3;
        let touched: Vec<usize> = (0..params.len()).filter(|&i| params_bar[i] != 0.0).collect();
        assert!(touched.len() > 100, "three distances of eight corners each: {}", touched.len());
        for &i in touched.iter().step_by(touched.len() / 40) {
            let at = |step: f32| {
                let mut params = params.clone();
                params[i] += step;
                value(&table, &params, &x, &bars)
            };
            close(params_bar[i], at(h), at(-h), h, &format!("parameter {i}"));
        }
        // Inside cells: the slope jumps at their faces.
        let (h, cells) = (1e-3, f64::from(grid.resolution()[0] - 1));
        let mut tried = 0;
        for i in 0..3 * N {
            let inside = (f64::from(x[i]) * cells).fract();
            if !(0.05..0.95).contains(&inside) || !(0.02..0.98).contains(&x[i]) {
                continue;
            }
            let at = |step: f32| {
                let mut x = x.clone();
                x[i] += step;
                value(&table, &params, &x, &bars)
            };
            close(x_bar[i] - 0.25, at(h), at(-h), h, &format!("coordinate {i}"));
            tried += 1;
        }
        assert!(tried > N, "{tried}");
    }

    #[test]
    fn what_is_seen_of_voxels_is_what_they_hold_and_its_octaves() {
        let table = voxels(12, 30);
        let params = vec![0.3; table.params_len()];
        let mut out = vec![0.0; table.out_rows() * N];
        table.encode(Simd::best(), (&params, &uniform(3 * N, 2)), &mut out, &mut Vec::new());
        // Three distances of two features; each with itself, and sine and cosine of two octaves.
        assert_eq!(table.out_rows(), 6 * 5);
        let seen = [0.3, 0.3_f32.sin(), 0.3_f32.cos(), 0.6_f32.sin(), 0.6_f32.cos()];
        for (i, value) in out.iter().enumerate() {
            assert!(seen.iter().any(|s| (s - value).abs() < 1e-5), "row {}: {value}", i / N);
        }
    }

    #[test]
    fn voxels_double_in_number_three_times() {
        let len = |steps| voxels(32, steps).params_len() as f64;
        assert_eq!(len(0), len(9));
        for (before, after) in [(9, 10), (19, 20), (29, 30)] {
            let more = len(after) / len(before);
            assert!((1.6..2.4).contains(&more), "after {after} steps: {more} times as many");
        }
        assert_eq!(len(30), len(1000));
    }
}
