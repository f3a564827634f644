//! Settings of the density control: when it works, and those of the one that is taken.

use super::config::{first_of, not_negative, positive, unless};
use crate::settings::Settings;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};
use splat_core::density::{Adc, AxisSplit, Mcmc};

/// How the number and the places of Gaussians change while they learn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DensityKind {
    /// Adaptive density control: clone, split, prune, opacity reset (Kerbl et al., 2023, section 5.2).
    Adc,
    /// Splits along the longest axis, up to a number that grows with the steps ([`AxisSplit`]).
    Split,
    /// Relocation as a Markov chain, with noise (Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024).
    Mcmc,
}

/// When the number and the places of Gaussians change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DensityConfig {
    /// How their number and places change: `split`, `adc` or `mcmc`.
    pub(crate) density: DensityKind,
    /// It changes after this step,
    pub(crate) densify_from: u64,
    /// before this one,
    pub(crate) densify_until: u64,
    /// and so often.
    pub(crate) densify_every: u64,
    /// Gradients on the picture are summed over pixels without their signs, so that those of a large Gaussian over fine detail do not
    /// cancel (Ye et al., "AbsGS", 2024): with about twice the [`densify_gradient`](SplitConfig::densify_gradient).
    pub(crate) densify_absolute: bool,
    /// Gaussians where points are seen through, or where one photo alone sees them and others were taken, are removed, every
    /// [`densify_every`](Self::densify_every) steps to the end.
    pub(crate) free_space: bool,
}

/// Settings of adaptive density control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AdcConfig {
    /// Densification threshold: clone or split where the mean view-space gradient is at least this, in normalised device coordinates.
    pub(crate) densify_gradient: f32,
    /// Steps between two opacity resets, each of which takes some hundred steps to recover from; 0: none.
    pub(crate) reset_every: u64,
    /// Gaussians larger than this many extents of the cameras are removed after the first opacity reset, without resets from the start;
    /// 0: none. Far things are made of large ones.
    pub(crate) prune_size: f32,
}

/// Settings of splits along the longest axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SplitConfig {
    /// Densification threshold: split where the mean view-space gradient is at least this, in normalised device coordinates. Those with
    /// the largest are split first: their number grows evenly, to the most there may be at the last change.
    pub(crate) densify_gradient: f32,
    /// Factor on all opacities in the steps from one change to the next, a little of it every tenth, down to 1/128: what no photo needs
    /// fades, and is removed in the end.
    pub(crate) opacity_decay: f32,
    /// This share of the Gaussians that come begins where a field sees what badly drawn pixels show, which is trained first; the others
    /// are split from Gaussians that are there. 0: no field is trained for them.
    pub(crate) refill: f64,
}

/// Settings of the Markov chain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct McmcConfig {
    /// What opacity and size cost, each a factor of its mean.
    pub(crate) mcmc_cost: f32,
    /// Strength of the noise, a factor of the learning rate of the centres.
    pub(crate) mcmc_noise: f32,
}

/// The density control that is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ControlConfig {
    Adc(AdcConfig),
    Split(SplitConfig),
    Mcmc(McmcConfig),
}

/// What is planned of the density control, whichever is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PlannedDensity {
    pub(crate) schedule: DensityConfig,
    pub(crate) adc: AdcConfig,
    pub(crate) split: SplitConfig,
    pub(crate) mcmc: McmcConfig,
}

/// When and how the density of a cloud is controlled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DensityRules {
    pub(crate) schedule: DensityConfig,
    pub(crate) control: ControlConfig,
}

impl DensityRules {
    /// The settings after `--set`, which may choose the control: those of the others are not there.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    pub(crate) fn asked(planned: &PlannedDensity, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let schedule = settings.of(&planned.schedule)?;
        let control = match schedule.density {
            DensityKind::Adc => ControlConfig::Adc(settings.of(&planned.adc)?),
            DensityKind::Split => ControlConfig::Split(settings.of(&planned.split)?),
            DensityKind::Mcmc => ControlConfig::Mcmc(settings.of(&planned.mcmc)?),
        };
        Ok(Self { schedule, control })
    }

    /// The same at other times, where no Gaussian begins from outside.
    pub(crate) fn of_schedule(self, schedule: DensityConfig) -> Self {
        let control = match self.control {
            ControlConfig::Split(split) => ControlConfig::Split(SplitConfig { refill: 0.0, ..split }),
            other => other,
        };
        Self { schedule, control }
    }

    /// The same where opacities do not fade.
    pub(crate) fn without_fading(self) -> Self {
        let control = match self.control {
            ControlConfig::Split(split) => ControlConfig::Split(SplitConfig { opacity_decay: 1.0, ..split }),
            other => other,
        };
        Self { control, ..self }
    }

    /// # Errors
    /// [`SystemError::Config`] naming the first setting that cannot work.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        let every = self.schedule.densify_every;
        first_of([unless(every > 0, "densify_every", every, "must be at least 1")])?;
        match &self.control {
            ControlConfig::Adc(adc) => first_of([
                positive("densify_gradient", adc.densify_gradient.into()),
                not_negative("prune_size", adc.prune_size.into()),
            ]),
            ControlConfig::Split(split) => first_of([
                positive("densify_gradient", split.densify_gradient.into()),
                unless(
                    split.opacity_decay > 0.0 && split.opacity_decay <= 1.0,
                    "opacity_decay",
                    split.opacity_decay,
                    "must be a factor above 0, at most 1",
                ),
                unless((0.0..=1.0).contains(&split.refill), "refill", split.refill, "must be a share, 0 to 1"),
            ]),
            ControlConfig::Mcmc(mcmc) => first_of([
                not_negative("mcmc_cost", mcmc.mcmc_cost.into()),
                not_negative("mcmc_noise", mcmc.mcmc_noise.into()),
            ]),
        }
    }

    /// This share of the Gaussians that come begins from outside.
    pub(crate) fn refill(&self) -> f64 {
        match &self.control {
            ControlConfig::Split(split) => split.refill,
            ControlConfig::Adc(_) | ControlConfig::Mcmc(_) => 0.0,
        }
    }

    /// Steps between two times that opacities fade; `None`: they do not.
    pub(crate) fn fade_every(&self) -> Option<u64> {
        match &self.control {
            ControlConfig::Split(_) => Some(fade_every(&self.schedule)),
            ControlConfig::Adc(_) | ControlConfig::Mcmc(_) => None,
        }
    }

    /// Whether floaters are looked for after `steps` steps of the schedule.
    pub(crate) fn finds_floaters(&self, steps: u64) -> bool {
        self.schedule.free_space && steps.is_multiple_of(self.schedule.densify_every)
    }
}

impl AdcConfig {
    /// The rules of `splat_core`.
    pub(crate) fn rules(&self, schedule: &DensityConfig) -> Adc {
        Adc::DEFAULT
            .with_after(schedule.densify_from)
            .with_until(schedule.densify_until)
            .with_every(schedule.densify_every)
            .with_reset_every(if self.reset_every == 0 { u64::MAX } else { self.reset_every })
            .with_size_after(self.reset_every)
            .with_size_max(if self.prune_size > 0.0 { self.prune_size.into() } else { f64::INFINITY })
            .with_gradient_threshold(self.densify_gradient)
    }
}

/// Steps between two times that opacities fade, where changes are not more often.
const FADE_EVERY: u64 = 10;

fn fade_every(schedule: &DensityConfig) -> u64 {
    schedule.densify_every.clamp(1, FADE_EVERY)
}

impl SplitConfig {
    /// The rules of `splat_core`.
    pub(crate) fn rules(&self, schedule: &DensityConfig) -> AxisSplit {
        let fade_every = fade_every(schedule);
        let share = fade_every as f64 / schedule.densify_every as f64;
        AxisSplit::DEFAULT
            .with_fade_every(fade_every)
            .with_after(schedule.densify_from)
            .with_until(schedule.densify_until)
            .with_every(schedule.densify_every)
            .with_gradient_threshold(self.densify_gradient)
            .with_decay(f64::from(self.opacity_decay).powf(share))
    }
}

impl McmcConfig {
    /// The rules of `splat_core`.
    pub(crate) fn rules(&self, schedule: &DensityConfig) -> Mcmc {
        let cost = f64::from(self.mcmc_cost);
        Mcmc::DEFAULT
            .with_after(schedule.densify_from)
            .with_until(schedule.densify_until)
            .with_every(schedule.densify_every)
            .with_noise(f64::from(self.mcmc_noise))
            .with_opacity_weight(cost)
            .with_scale_weight(cost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacities_fade_as_much_in_small_steps_as_at_once() {
        let split = SplitConfig { densify_gradient: 1e-4, opacity_decay: 0.9, refill: 0.0 };
        for (every, times) in [(100, 10), (50, 5), (7, 1), (1, 1)] {
            let schedule = DensityConfig {
                density: DensityKind::Split,
                densify_from: 0,
                densify_until: 1000,
                densify_every: every,
                densify_absolute: false,
                free_space: false,
            };
            let rules = split.rules(&schedule);
            assert_eq!((1..=every).filter(|step| rules.fades_at(*step)).count(), times, "{every}");
            assert!((rules.decay.powi(times as i32) - 0.9).abs() < 1e-6, "{every}");
        }
    }
}
