//! Settings of a system of rays, part by part.

use super::head::HeadConfig;
use super::moving_config::MovingConfig;
use crate::fields::{Decoder, DecoderChoice, DecoderKind, FeatureSource, NetworkConfig};
use crate::samplers::{OccupancyConfig, ProposalConfig};
use crate::settings::Settings;
use crate::space::SpaceConfig;
use crate::terms::TermConfig;
use engine::system::{MOST_RAYS, MOST_SAMPLES, SystemError, at_most};
use losses::kernel::Kernel;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What a training batch is, and what of it is left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BatchConfig {
    /// A pixel is the mean of this many rays along each of its sides: 1 is a ray through its centre, 2 are four rays.
    pub rays_per_side: u32,
    /// A training ray ends where its transmittance falls below this; 0: it never does.
    pub train_stop: f32,
    /// Part of a ray's colour that its faintest samples are left out with in training; 0: none of them is. Not where
    /// proposals learn from weights, or a transient part has samples of its own.
    pub train_faint: f32,
    /// Samples a batch aims at; the number of rays adapts.
    pub batch_samples: usize,
    /// Rays a batch has at most.
    pub batch_rays: usize,
    /// Huber threshold of the colour loss; 0 is the squared error.
    pub huber: f32,
}

impl BatchConfig {
    /// The colour loss.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        if self.huber > 0.0 { Kernel::Huber { delta: self.huber } } else { Kernel::Squared }
    }

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[("batch_rays", self.batch_rays, MOST_RAYS), ("batch_samples", self.batch_samples, MOST_SAMPLES)])?;
        positive("batch_samples", self.batch_samples as f64)?;
        positive("batch_rays", self.batch_rays as f64)?;
        if !(0.0..=10.0).contains(&self.huber) {
            return Err(bad("huber", self.huber, "must be in 0..=10"));
        }
        if !(1..=8).contains(&self.rays_per_side) {
            return Err(bad("rays_per_side", self.rays_per_side, "must be in 1..=8"));
        }
        for (field, value) in [("train_stop", self.train_stop), ("train_faint", self.train_faint)] {
            if !(0.0..1.0).contains(&value) {
                return Err(bad(field, value, "must be at least 0 and below 1"));
            }
        }
        Ok(())
    }
}

/// How fast the numbers of a field learn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateConfig {
    /// Learning rate at the start.
    pub lr: f32,
    /// Steps of the schedule after which the learning rate starts to fall.
    pub lr_hold: u64,
    /// Learning rate at `lr_hold * 10` steps, as a part of `lr`; it falls as a power of the step, so that a run may go on
    /// for as long as it likes.
    pub lr_tenfold: f32,
    /// Learning rate of the networks, a factor of that of the features.
    pub network_lr: f32,
    /// L2 penalty on the networks' weights (not on the features).
    pub weight_decay: f32,
}

impl RateConfig {
    /// The rates of a run that is likely to stop after `steps` steps: held for half of them, at the last a tenth of that. Runs too short
    /// for it learn as they are.
    #[must_use]
    pub fn until(self, steps: Option<u64>) -> Self {
        let hold = steps.unwrap_or(0) / 2;
        if hold <= self.lr_hold {
            return self;
        }
        self.over(2 * hold)
    }

    /// The rates of a schedule of `horizon` steps: held for half of them, however few, at the last a tenth of that.
    #[must_use]
    pub fn over(self, horizon: u64) -> Self {
        Self { lr_hold: horizon / 2, lr_tenfold: 0.1_f32.powf(std::f32::consts::LOG2_10), ..self }
    }

    /// Learning rate of a step of the schedule.
    #[must_use]
    pub fn learning_rate(&self, step: u64) -> f32 {
        let x = (step.max(1) as f64 / self.lr_hold.max(1) as f64).log10().max(0.0);
        (f64::from(self.lr) * f64::from(self.lr_tenfold).powf(x)).min(f32::MAX.into()) as f32
    }

    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        positive("lr", f64::from(self.lr))?;
        positive("network_lr", f64::from(self.network_lr))?;
        positive("lr_tenfold", f64::from(self.lr_tenfold))?;
        if !(0.0..=1.0).contains(&self.weight_decay) {
            return Err(bad("weight_decay", self.weight_decay, "must be in 0..=1"));
        }
        Ok(())
    }
}

/// What places samples along a ray.
#[derive(Clone, Debug)]
pub enum SamplerConfig {
    /// A march that skips what an occupancy grid knows to be empty.
    Occupancy(OccupancyConfig),
    /// Small density fields that are asked first: a fixed number of samples a ray, however far space goes.
    Proposals(ProposalConfig),
}

/// A system of rays: its parts and their settings.
#[derive(Clone, Debug)]
pub struct RayConfig {
    /// Where the scene is.
    pub space: SpaceConfig,
    /// What is learnt about places.
    pub(crate) features: Arc<dyn FeatureSource>,
    /// The networks behind the features, where these are what decodes them.
    pub networks: NetworkConfig,
    /// What decodes the features, where that can be chosen; `None`: the networks.
    pub decoder: Option<DecoderChoice>,
    /// What places samples.
    pub sampler: SamplerConfig,
    /// Training batches.
    pub batch: BatchConfig,
    /// Learning rates.
    pub rates: RateConfig,
    /// What whole rays cost.
    pub terms: TermConfig,
    /// The transient head, where there is one.
    pub head: Option<HeadConfig>,
    /// A part of the field for what moves, where one is asked for; `features` are those of what stands still then.
    pub moving: Option<MovingConfig>,
}

fn bad(field: &'static str, value: impl ToString, problem: &str) -> SystemError {
    SystemError::Config { field, value: value.to_string(), problem: problem.into() }
}

fn positive(field: &'static str, value: f64) -> Result<(), SystemError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(bad(field, value, "must be positive and finite")) }
}

impl RayConfig {
    /// The same after `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let decoder = self.decoder.as_ref().map(|planned| planned.asked(settings)).transpose()?;
        let explicit = decoder.is_some_and(|choice| choice.decoder == DecoderKind::Explicit);
        Ok(Self {
            space: settings.of(&self.space)?,
            features: self.features.asked(settings)?,
            networks: if explicit { self.networks } else { settings.of(&self.networks)? },
            decoder,
            sampler: match &self.sampler {
                SamplerConfig::Occupancy(config) => SamplerConfig::Occupancy(settings.of(config)?),
                SamplerConfig::Proposals(config) => SamplerConfig::Proposals(settings.of(config)?),
            },
            batch: settings.of(&self.batch)?,
            rates: settings.of(&self.rates)?,
            terms: settings.of(&self.terms)?,
            head: self.head.as_ref().map(|head| settings.of(head)).transpose()?,
            moving: self.moving.clone(),
        })
    }

    /// What decodes the features.
    pub(crate) fn decoder(&self) -> Decoder<'_> {
        match &self.decoder {
            Some(DecoderChoice { decoder: DecoderKind::Explicit, explicit, .. }) => Decoder::Explicit(explicit),
            _ => Decoder::Hybrid(&self.networks),
        }
    }

    /// The settings of the occupancy grid, where that places the samples.
    pub(crate) fn occupancy_mut(&mut self) -> Option<&mut OccupancyConfig> {
        match &mut self.sampler {
            SamplerConfig::Occupancy(config) => Some(config),
            SamplerConfig::Proposals(_) => None,
        }
    }

    /// Check what the parts do not check when they are made.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        self.space.check()?;
        match self.decoder() {
            Decoder::Hybrid(networks) => networks.check()?,
            Decoder::Explicit(explicit) => explicit.check()?,
        }
        match &self.sampler {
            SamplerConfig::Occupancy(config) => config.check(self.space.cascades)?,
            SamplerConfig::Proposals(config) => config.check()?,
        }
        self.batch.check()?;
        self.rates.check()?;
        self.terms.check()?;
        self.head.as_ref().map_or(Ok(()), HeadConfig::check)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_of_a_run_with_a_stop_are_held_for_half_of_it_and_end_at_a_tenth() {
        let planned = RateConfig { lr: 2e-2, lr_hold: 500, lr_tenfold: 0.1, network_lr: 1.0, weight_decay: 0.0 };
        for short in [None, Some(0), Some(1000)] {
            assert_eq!(planned.until(short), planned);
        }
        let rates = planned.until(Some(4000));
        let parts = [1, 2000, 4000, 40_000].map(|step| rates.learning_rate(step) / rates.lr);
        assert_eq!(parts[..2], [1.0, 1.0]);
        assert!((parts[2] - 0.1).abs() < 1e-4 && parts[3] < 1e-4, "{parts:?}");
    }

    #[test]
    fn rates_of_a_schedule_end_at_a_tenth_however_short_it_is() {
        let planned = RateConfig { lr: 2e-2, lr_hold: 500, lr_tenfold: 0.1, network_lr: 1.0, weight_decay: 0.0 };
        for horizon in [2, 60, 650, 100_000] {
            let rates = planned.over(horizon);
            let parts = [0, horizon / 2, horizon].map(|step| rates.learning_rate(step) / rates.lr);
            assert!(parts[..2] == [1.0, 1.0] && (parts[2] - 0.1).abs() < 1e-4, "{horizon}: {parts:?}");
        }
        assert!(planned.over(0).learning_rate(0) == planned.lr && planned.over(0).learning_rate(9) > 0.0);
    }
}
