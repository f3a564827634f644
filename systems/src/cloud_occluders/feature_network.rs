//! A network that says by features of a photo which of its pixels show the scene.
//!
//! ```text
//! h(r) = relu(W1 [F(r), gamma(r)] + b1),  M(r) = sigmoid(w2 h(r) + b2)
//! L = mean(relu(M - U) + relu(B - M)) + l max|W1| max|w2|,  l = 0.5
//! ```
//!
//! Letters: `r` a pixel; `F` features, linearly between the cells of their grid; `gamma` sines and cosines of 20 octaves of the place in
//! the photo; `U` and `B` masks of which `M` is to lie between. `W1 F` is computed at the cells and interpolated, and `W1 gamma` is a sum
//! of a part of the column and a part of the row: all of that is linear.
//!
//! # Source
//! Sabour et al., "SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting", 2024, section 4.1.2, equations 8 to 10. The regulariser
//! has a gradient here.

use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::init::Init;
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use scene_io::Features;
use std::f64::consts::TAU;
use std::ops::Range;

/// Hidden units.
const UNITS: usize = 16;
const OCTAVES: usize = 20;
/// Numbers of one coordinate.
const WAVES: usize = 2 * OCTAVES;
const REGULARISER: f32 = 0.5;
/// Name in checkpoints.
const NAME: &str = "masks.network";

/// Which two of `n` cells are around each of some pixels along an axis, and how far from the first.
fn between(pixels: usize, n: usize) -> Vec<(usize, usize, f32)> {
    let one = |i: usize| {
        let at = ((i as f64 + 0.5) / pixels as f64 * n as f64 - 0.5).clamp(0.0, (n - 1) as f64);
        let low = at as usize;
        (low, (low + 1).min(n - 1), (at - low as f64) as f32)
    };
    (0..pixels).map(one).collect()
}

/// `[pixels][WAVES]`, of one coordinate.
fn waves(pixels: usize) -> Vec<[f32; WAVES]> {
    let one = |i: usize| {
        let at = (i as f64 + 0.5) / pixels as f64;
        std::array::from_fn(|k| {
            let phase = TAU * (at * f64::powi(2.0, (k / 2) as i32)).fract();
            (if k % 2 == 0 { phase.sin() } else { phase.cos() }) as f32
        })
    };
    (0..pixels).map(one).collect()
}

/// Where in the parameters the parts are.
#[derive(Clone, Copy, Debug)]
struct Parts {
    channels: usize,
}

impl Parts {
    /// `W1` of a unit: features, columns, rows.
    fn row(self, unit: usize) -> Range<usize> {
        let len = self.channels + 2 * WAVES;
        unit * len..(unit + 1) * len
    }

    fn first(self) -> Range<usize> {
        0..self.row(UNITS).start
    }

    fn biases(self) -> Range<usize> {
        let first = self.row(UNITS).start;
        first..first + UNITS
    }

    fn second(self) -> Range<usize> {
        let first = self.biases().end;
        first..first + UNITS
    }

    fn bias(self) -> usize {
        self.second().end
    }

    fn len(self) -> usize {
        self.bias() + 1
    }
}

/// What the network made of a photo.
pub(super) struct Judged {
    size: [usize; 2],
    /// `[units][pixels]`.
    hidden: Vec<f32>,
    /// `M`, `[pixels]`.
    pub(super) mask: Vec<f32>,
}

/// The masks that `M` is to lie between, and the pixels that count.
pub(super) struct Bounds<'a> {
    pub(super) least: &'a [bool],
    pub(super) most: &'a [bool],
    pub(super) counts: Option<&'a [f32]>,
}

/// The network, its optimiser, and the gradient of the next step.
pub(super) struct FeatureNetwork {
    parts: Parts,
    params: Vec<f32>,
    adam: Adam,
    grad: Vec<f32>,
}

impl FeatureNetwork {
    /// Uniform within one over the root of the inputs, biases too.
    pub(super) fn new(channels: usize, rng: Rng) -> Self {
        let parts = Parts { channels };
        let mut params = vec![0.0; parts.len()];
        let layers = [(parts.first(), channels + 2 * WAVES), (parts.biases(), channels + 2 * WAVES)];
        for (i, (range, inputs)) in layers.into_iter().chain([(parts.second(), UNITS)]).enumerate() {
            Init::Uniform(1.0 / (inputs as f32).sqrt()).fill(
                rng.substream(i as u64),
                inputs,
                UNITS,
                &mut params[range],
            );
        }
        Self { parts, adam: Adam::new(params.len(), AdamConfig::DEFAULT), grad: vec![0.0; params.len()], params }
    }

    /// Number of its parameters.
    pub(super) fn parameter_count(&self) -> usize {
        self.params.len()
    }

    /// Bytes that a photo of this many pixels takes while the network works on it: hidden units, mask and gradient.
    pub(super) fn bytes(pixels: usize) -> usize {
        (UNITS + 2) * pixels * size_of::<f32>()
    }

    /// The mask of a photo with these features, of a picture of `size` columns and rows.
    pub(super) fn judge(&self, features: &Features, size: [usize; 2]) -> Judged {
        let pixels = size[0] * size[1];
        let (columns, rows) = (between(size[0], features.width), between(size[1], features.height));
        let (along, down) = (waves(size[0]), waves(size[1]));
        let mut hidden = vec![0.0; UNITS * pixels];
        hidden.par_chunks_mut(pixels.max(1)).enumerate().for_each(|(unit, plane)| {
            let weights = &self.params[self.parts.row(unit)];
            let (of_features, of_place) = weights.split_at(self.parts.channels);
            let bias = self.params[self.parts.biases()][unit];
            let cells = features.width * features.height;
            let mut grid = vec![0.0_f32; cells];
            for (weight, channel) in of_features.iter().zip(features.data.chunks_exact(cells)) {
                grid.iter_mut().zip(channel).for_each(|(sum, x)| *sum += weight * x);
            }
            let part = |waves: &[f32; WAVES], weights: &[f32]| waves.iter().zip(weights).map(|(a, b)| a * b).sum();
            let of_columns: Vec<f32> = along.iter().map(|waves| part(waves, &of_place[..WAVES])).collect();
            for ((row, waves), (y0, y1, fy)) in plane.chunks_exact_mut(size[0]).zip(&down).zip(&rows) {
                let of_row: f32 = bias + part(waves, &of_place[WAVES..]);
                let cell = |x: usize| {
                    let [above, below] = [y0, y1].map(|y| grid[y * features.width + x]);
                    above + (below - above) * fy
                };
                for ((out, of_column), (x0, x1, fx)) in row.iter_mut().zip(&of_columns).zip(&columns) {
                    let left = cell(*x0);
                    *out = (left + (cell(*x1) - left) * fx + of_column + of_row).max(0.0);
                }
            }
        });
        let (second, bias) = (&self.params[self.parts.second()], self.params[self.parts.bias()]);
        let mut mask = vec![bias; pixels];
        for (weight, plane) in second.iter().zip(hidden.chunks_exact(pixels.max(1))) {
            mask.iter_mut().zip(plane).for_each(|(sum, h)| *sum += weight * h);
        }
        mask.iter_mut().for_each(|m| *m = 1.0 / (1.0 + (-*m).exp()));
        Judged { size, hidden, mask }
    }

    /// The loss of what it made of a photo; its gradient is kept for the next step.
    pub(super) fn learn(&mut self, features: &Features, judged: &Judged, bounds: &Bounds<'_>) -> f64 {
        let (parts, pixels) = (self.parts, judged.mask.len());
        self.grad.fill(0.0);
        let each = 1.0 / pixels.max(1) as f32;
        let (mut loss, mut outer) = (0.0, vec![0.0; pixels]);
        for (i, (m, outer)) in judged.mask.iter().zip(&mut outer).enumerate() {
            if bounds.counts.is_some_and(|counts| counts.get(i).is_none_or(|weight| *weight <= 0.0)) {
                continue;
            }
            let [least, most] = [bounds.least[i], bounds.most[i]].map(|inside| if inside { 1.0 } else { 0.0 });
            let (over, under) = ((m - most).max(0.0), (least - m).max(0.0));
            loss += f64::from(over + under);
            let sign = f32::from(u8::from(over > 0.0)) - f32::from(u8::from(under > 0.0));
            *outer = each * sign * m * (1.0 - m);
        }
        let (columns, rows) = (between(judged.size[0], features.width), between(judged.size[1], features.height));
        let (along, down) = (waves(judged.size[0]), waves(judged.size[1]));
        let place = Place { columns: &columns, rows: &rows, along: &along, down: &down };
        let second = self.params[parts.second()].to_vec();
        let units: Vec<UnitBar> = judged
            .hidden
            .par_chunks(pixels.max(1))
            .zip(&second)
            .map(|(hidden, second)| place.unit_bar(features, hidden, *second, &outer))
            .collect();
        for (unit, bar) in units.into_iter().enumerate() {
            self.grad[parts.row(unit)].copy_from_slice(&bar.row);
            self.grad[parts.biases()][unit] = bar.bias as f32;
            self.grad[parts.second()][unit] = bar.second as f32;
        }
        self.grad[parts.bias()] = outer.iter().map(|x| f64::from(*x)).sum::<f64>() as f32;
        loss * f64::from(each) + self.regularise()
    }

    /// The regulariser; its gradient is added.
    fn regularise(&mut self) -> f64 {
        let largest = |range: Range<usize>| {
            range.reduce(|a, b| if self.params[b].abs() > self.params[a].abs() { b } else { a }).unwrap_or(0)
        };
        let at = [largest(self.parts.first()), largest(self.parts.second())];
        let [first, second] = at.map(|i| self.params[i]);
        // 0 has no sign: it is the largest only where all are 0.
        let sign = |x: f32| if x == 0.0 { 0.0 } else { x.signum() };
        self.grad[at[0]] += REGULARISER * sign(first) * second.abs();
        self.grad[at[1]] += REGULARISER * sign(second) * first.abs();
        f64::from(REGULARISER) * f64::from(first.abs()) * f64::from(second.abs())
    }

    /// A step with the gradient that is kept. Returns how many entries were not finite.
    pub(super) fn step(&mut self, simd: Simd, rate: f64) -> usize {
        self.adam.step(simd, rate, &mut self.params, &self.grad)
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(NAME, &self.params));
        push_adam(out, NAME, &self.adam);
    }

    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit. Nothing has changed then.
    pub(super) fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_numbers(state, NAME, self.params.len())?;
        self.adam = take_adam(state, NAME, &self.adam)?;
        self.params = params;
        Ok(())
    }
}

/// Gradients of a hidden unit.
struct UnitBar {
    row: Vec<f32>,
    bias: f64,
    second: f64,
}

/// Where the pixels of a picture are.
struct Place<'a> {
    columns: &'a [(usize, usize, f32)],
    rows: &'a [(usize, usize, f32)],
    along: &'a [[f32; WAVES]],
    down: &'a [[f32; WAVES]],
}

impl Place<'_> {
    /// From `hidden` and the gradient with respect to what the sigmoid is given, both `[rows][columns]`.
    fn unit_bar(&self, features: &Features, hidden: &[f32], second: f32, outer: &[f32]) -> UnitBar {
        let (width, cells) = (features.width, features.width * features.height);
        let (mut grid, mut of_columns) = (vec![0.0_f64; cells], vec![0.0_f64; self.columns.len()]);
        let mut of_rows = vec![0.0_f64; self.rows.len()];
        let mut of_second = 0.0;
        let mut line = vec![0.0_f64; width];
        let n = self.columns.len().max(1);
        for (y, (hidden, outer)) in hidden.chunks_exact(n).zip(outer.chunks_exact(n)).enumerate() {
            line.fill(0.0);
            for (x, (h, outer)) in hidden.iter().zip(outer).enumerate().filter(|(_, (h, _))| **h > 0.0) {
                of_second += f64::from(*h) * f64::from(*outer);
                let bar = f64::from(second) * f64::from(*outer);
                of_columns[x] += bar;
                of_rows[y] += bar;
                let (x0, x1, fx) = self.columns[x];
                line[x0] += bar * (1.0 - f64::from(fx));
                line[x1] += bar * f64::from(fx);
            }
            let (y0, y1, fy) = self.rows[y];
            for (x, bar) in line.iter().enumerate() {
                grid[y0 * width + x] += bar * (1.0 - f64::from(fy));
                grid[y1 * width + x] += bar * f64::from(fy);
            }
        }
        let of_feature = |channel: &[f32]| channel.iter().zip(&grid).map(|(x, bar)| f64::from(*x) * bar).sum::<f64>();
        let mut row: Vec<f32> = features.data.chunks_exact(cells).map(|channel| of_feature(channel) as f32).collect();
        for (waves, bars) in [(self.along, &of_columns), (self.down, &of_rows)] {
            let wave = |k: usize| waves.iter().zip(bars).map(|(waves, bar)| f64::from(waves[k]) * bar).sum::<f64>();
            row.extend((0..WAVES).map(|k| wave(k) as f32));
        }
        UnitBar { row, bias: of_rows.iter().sum(), second: of_second }
    }
}

#[cfg(test)]
mod tests;
