//! The time as networks see it: a row of numbers for each time step.
//!
//! * `gamma`: the time's sines and cosines, which have nothing to learn;
//! * `network`: the same through a small network;
//! * `codes`: a free code for each time step;
//! * `frames`: the times of the training views.

mod codes;
mod frames;
mod gamma;
mod input;
mod network;

pub(crate) use frames::Times;

use super::parameters::{Parameters, Stream};
use super::settings::in_range;
use codes::Codes;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use float_core::Simd;
use gamma::Gamma;
use input::TimeInput;
use network::TimeNetwork;
use optim::{Adam, AdamConfig};
use serde::{Deserialize, Serialize};

/// How networks see the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum TimeKind {
    /// `t`, its sines and cosines.
    Time,
    /// The same through a small network (TiNeuVox).
    Network,
    /// A free code for each time step trained on, linear in between (Nerfies).
    Codes,
}

/// Settings of what networks see of the time, and what all networks that see it share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TimeSettings {
    /// How networks see the time: `time`, `network` or `codes`.
    #[serde(rename = "time_input")]
    pub(crate) kind: TimeKind,
    /// Octaves of the time (`time`, `network`).
    #[serde(rename = "time_octaves")]
    pub(crate) octaves: usize,
    /// Numbers of a time step (`network`, `codes`).
    #[serde(rename = "time_code_dims")]
    pub(crate) dims: usize,
    /// Width of the hidden layers of the networks that move points, and of that of the time.
    #[serde(rename = "warp_width")]
    pub(crate) width: usize,
    /// Learning rate of networks, planes and codes, a factor of the field's.
    #[serde(rename = "warp_lr")]
    pub(crate) rate: f64,
    /// Learning rate of codes or of the network of the time, a factor of that.
    #[serde(rename = "time_code_lr")]
    pub(crate) code_rate: f64,
    /// Share of the schedule, from the first step of the deformation on, over which both rates rise to that. Before there is anything to
    /// move, gradients are next to nothing, and Adam makes full steps of them, too.
    #[serde(rename = "warp_warmup")]
    pub(crate) warmup: f64,
}

impl TimeSettings {
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("time_octaves", self.octaves, 0..=16)?;
        in_range("time_code_dims", self.dims, 1..=1024)?;
        in_range("warp_width", self.width, 1..=1024)?;
        in_range("warp_lr", self.rate, 0.0..=100.0)?;
        in_range("time_code_lr", self.code_rate, 0.0..=100.0)?;
        in_range("warp_warmup", self.warmup, 0.0..=1.0)
    }
}

/// Time steps as networks see them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct TimeSteps {
    /// Numbers of a row.
    pub(crate) dims: usize,
    /// `[steps][dims]`
    pub(crate) rows: Vec<f32>,
    /// `[steps]`, times in `[-1, 1]`, for what has an axis of time.
    pub(crate) times: Vec<f32>,
    /// `[steps]`: nothing moves then.
    pub(crate) still: Vec<bool>,
}

impl TimeSteps {
    /// Number of time steps.
    pub(crate) fn len(&self) -> usize {
        self.still.len()
    }

    /// Whether any two of them differ.
    pub(crate) fn differ(&self) -> bool {
        let rows = self.rows.chunks_exact(self.dims.max(1)).any(|row| *row != self.rows[..row.len()]);
        rows || self.times.windows(2).any(|pair| pair[0] != pair[1])
    }
}

/// What networks see of the time, with what is learned of it and its optimiser.
pub(crate) struct Time {
    settings: TimeSettings,
    input: Box<dyn TimeInput>,
    times: Times,
    simd: Simd,
    /// Codes `[steps][dims]`, or the parameters of a network.
    pub(super) learned: Vec<f32>,
    adam: Adam,
    grad: Vec<f32>,
}

impl Time {
    /// For training views of these times.
    ///
    /// # Errors
    /// [`SystemError::Config`] for settings that cannot be.
    pub(crate) fn new(settings: TimeSettings, times: Times, parameters: &Parameters) -> Result<Self, SystemError> {
        settings.check()?;
        let TimeSettings { kind, octaves, dims, width, .. } = settings;
        let (simd, rng) = (parameters.simd, parameters.rng(Stream::Time));
        let mut learned = Vec::new();
        let input: Box<dyn TimeInput> = match kind {
            TimeKind::Time => Box::new(Gamma::new(octaves, simd)?),
            TimeKind::Network => {
                Box::new(TimeNetwork::new(Gamma::new(octaves, simd)?, width, dims, &times, rng, &mut learned)?)
            }
            TimeKind::Codes => Box::new(Codes::new(dims, times.clone(), rng, &mut learned)),
        };
        let (adam, grad) = (Adam::new(learned.len(), AdamConfig::DEFAULT), vec![0.0; learned.len()]);
        let mut time = Self { settings, input, times, simd, learned, adam, grad };
        time.renew();
        Ok(time)
    }

    pub(crate) fn settings(&self) -> &TimeSettings {
        &self.settings
    }

    /// Numbers of a time step.
    pub(crate) fn rows(&self) -> usize {
        self.input.dims()
    }

    /// The times of the training views.
    pub(super) fn times(&self) -> &Times {
        &self.times
    }

    /// Time steps at times in `[0, 1]`, in those of which that `rests` names nothing moves.
    pub(super) fn steps_at(&self, times: &[f64], rests: impl Fn(f64) -> bool) -> TimeSteps {
        TimeSteps {
            dims: self.rows(),
            rows: self.input.rows(&self.learned, times),
            times: times.iter().map(|&t| 2.0 * t as f32 - 1.0).collect(),
            still: times.iter().map(|&t| rests(t)).collect(),
        }
    }

    /// Bring the gradient of the training views' rows, `[views][dims]`, to what is learned, and take a step. Returns the count of
    /// non-finite gradients.
    pub(super) fn learn(&mut self, rows_bar: &[f32], lr: f64) -> usize {
        if !self.input.learns() {
            return 0;
        }
        self.grad.fill(0.0);
        self.input.backward(&self.learned, rows_bar, &mut self.grad);
        self.adam.step(self.simd, lr * self.settings.code_rate, &mut self.learned, &self.grad)
    }

    /// The gradient of what is learned, from that of the training views' rows.
    #[cfg(test)]
    pub(super) fn gradient(&self, rows_bar: &[f32]) -> Vec<f32> {
        let mut grad = vec![0.0; self.learned.len()];
        self.input.backward(&self.learned, rows_bar, &mut grad);
        grad
    }

    /// What is learned has changed.
    pub(super) fn renew(&mut self) {
        self.input.renew(&self.learned);
    }

    /// The arrays of a checkpoint.
    pub(super) fn learned_tensor(&self) -> Tensor<'_> {
        f32_tensor("deform.moments", &self.learned)
    }

    pub(super) fn push_adam<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        push_adam(out, "deform.moments", &self.adam);
    }

    /// What the arrays of a checkpoint hold.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or has another shape.
    pub(super) fn take(&self, state: &TensorMap) -> Result<(Vec<f32>, Adam), SystemError> {
        let learned = take_numbers(state, "deform.moments", self.learned.len())?;
        Ok((learned, take_adam(state, "deform.moments", &self.adam)?))
    }

    /// Put back what [`Time::take`] gave.
    pub(super) fn put(&mut self, learned: Vec<f32>, adam: Adam) {
        (self.learned, self.adam) = (learned, adam);
        self.renew();
    }
}
