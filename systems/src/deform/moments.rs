//! A moment as the networks are told it: one row of numbers each, for the training views or for a render.

use super::Deform;
use super::config::{Moment, Origin};
use field_core::encoding::frequency::Frequency;
use field_core::mlp::{Mlp, Packed};
use float_core::Simd;

/// Rows of numbers for some moments.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    /// Numbers of a row.
    pub(crate) dims: usize,
    /// `[moments][dims]`
    pub(crate) rows: Vec<f32>,
    /// `[moments]`, times in `[-1, 1]`, for what has an axis of time.
    pub(crate) times: Vec<f32>,
    /// `[moments]`: nothing is warped then.
    pub(crate) still: Vec<bool>,
}

impl Moments {
    /// Number of moments.
    pub(crate) fn len(&self) -> usize {
        self.still.len()
    }

    /// Whether any two of them differ.
    pub(crate) fn differ(&self) -> bool {
        let rows = self.rows.chunks_exact(self.dims.max(1)).any(|row| *row != self.rows[..row.len()]);
        rows || self.times.windows(2).any(|pair| pair[0] != pair[1])
    }
}

/// `t`, its sines and cosines: `[rows][n]`.
fn encoded(time: &Frequency, simd: Simd, times: &[f64]) -> Vec<f32> {
    let t: Vec<f32> = times.iter().map(|&t| t as f32).collect();
    let mut out = vec![0.0; time.out_rows() * t.len()];
    time.encode(simd, &t, None, &mut out).expect("one row of times");
    out
}

/// `[rows][n]` to `[n][rows]`.
fn turned(rows: usize, n: usize, from: &[f32]) -> Vec<f32> {
    (0..n).flat_map(|i| (0..rows).map(move |r| from[r * n + i])).collect()
}

/// A network on the octaves of a time, as TiNeuVox has it.
pub(super) struct TimeNetwork {
    pub(super) mlp: Mlp,
    pub(super) packed: Packed,
}

impl Deform {
    /// Numbers of a moment's row.
    pub(super) fn moment_dims(config: Moment) -> usize {
        match config {
            Moment::Time { octaves } => 1 + 2 * octaves,
            Moment::TimeNetwork { dims, .. } | Moment::Codes { dims } => dims,
        }
    }

    /// The moments of times.
    pub(crate) fn moments_at(&self, times: &[f64]) -> Moments {
        let dims = Self::moment_dims(self.config.moment);
        let n = times.len();
        let canonical = self.config.warp.as_ref().is_some_and(|warp| warp.origin == Origin::Canonical);
        let still = times.iter().map(|&t| canonical && t == 0.0).collect();
        let rows = match self.config.moment {
            Moment::Time { .. } => turned(dims, n, &encoded(&self.time, self.simd, times)),
            Moment::TimeNetwork { .. } => {
                let network = self.time_network.as_ref().expect("made with the moment");
                let x = encoded(&self.time, self.simd, times);
                let (mut y, mut scratch) = (vec![0.0; dims * n], vec![0.0; network.mlp.infer_scratch_len()]);
                network.mlp.infer(self.simd, &network.packed, &x, n, n, &mut y, n, &mut scratch);
                turned(dims, n, &y)
            }
            Moment::Codes { .. } => times
                .iter()
                .flat_map(|&t| {
                    let at = self.times.between(t);
                    let code = |moment: usize| &self.codes[moment * dims..][..dims];
                    let pair = code(at.before).iter().zip(code(at.after));
                    pair.map(|(a, b)| a + at.share * (b - a)).collect::<Vec<f32>>()
                })
                .collect(),
        };
        Moments { dims, rows, times: times.iter().map(|&t| 2.0 * t as f32 - 1.0).collect(), still }
    }

    /// Bring the gradient of the training views' rows, `[views][dims]`, to codes or to the time network, and take one step.
    /// Returns the count of non-finite gradients.
    pub(super) fn learn_moments(&mut self, rows_bar: &[f32], lr: f64) -> usize {
        let dims = Self::moment_dims(self.config.moment);
        match self.config.moment {
            Moment::Time { .. } => 0,
            Moment::Codes { .. } => {
                self.code_grad.fill(0.0);
                for (view, bar) in rows_bar.chunks_exact(dims).enumerate() {
                    let at = self.times.moment(view) * dims;
                    self.code_grad[at..at + dims].iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar);
                }
                self.code_adam.step(self.simd, lr * self.config.code_rate, &mut self.codes, &self.code_grad)
            }
            Moment::TimeNetwork { .. } => {
                let n = self.moments.len();
                let times: Vec<f64> = self.times.of_views().collect();
                let x = encoded(&self.time, self.simd, &times);
                let network = self.time_network.as_ref().expect("made with the moment");
                let mlp = &network.mlp;
                let y_bar = turned(n, dims, rows_bar);
                let mut acts = vec![0.0; mlp.activations_len(n)];
                let mut y = vec![0.0; dims * n];
                mlp.forward(self.simd, &network.packed, &x, n, n, &mut y, n, &mut acts);
                let mut packed = vec![0.0; mlp.packed_grad_len()];
                let mut scratch = vec![0.0; mlp.backward_scratch_len()];
                mlp.backward(self.simd, &network.packed, &acts, &y_bar, n, n, None, &mut packed, &mut scratch);
                self.code_grad.fill(0.0);
                mlp.unpack_grad(&packed, &mut self.code_grad);
                self.code_adam.step(self.simd, lr * self.config.code_rate, &mut self.codes, &self.code_grad)
            }
        }
    }
}
