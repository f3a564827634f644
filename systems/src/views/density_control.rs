//! When Gaussians come and go during a training, and what else has to follow.

use super::density_config::ControlConfig;
use super::drawing::SeenGaussians;
use super::sky::FAR;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use field_core::rng::Rng;
use splat_core::density::{
    Adc, AxisSplit, Mcmc, Rows, SizeLimit, ViewSpaceGradients, keep_in_range, morton_order, opacity, without_non_finite,
};
use splat_core::{Gaussians, SplatError};

pub(crate) use super::density_config::DensityRules;

/// Stream of random numbers of the first cloud, and those of its uses in a step.
const STREAM: u64 = 0x6465_6e73;
const GROW: u64 = 0;
const ADD: u64 = 1;
const NOISE: u64 = 2;
/// Steps between two checks for parameters out of range.
const TIDY_EVERY: u64 = 10;
/// Extent of the scene, internal units.
const EXTENT: f64 = 1.0;

/// The density control of a cloud, and what it has seen.
#[derive(Clone, Debug)]
pub(super) struct DensityControl {
    /// Of random numbers.
    stream: u64,
    control: Control,
}

#[derive(Clone, Debug)]
enum Control {
    /// Clone, split, prune, reset opacities.
    Adc {
        rules: Adc,
        /// View-space gradients since the last change.
        gradients: ViewSpaceGradients,
    },
    /// Fade, prune, split along the longest axis.
    Split {
        rules: AxisSplit,
        /// View-space gradients since the last change.
        gradients: ViewSpaceGradients,
        /// This share of the Gaussians that come begins from outside.
        refill: f64,
    },
    /// Relocate, add, inject noise.
    Mcmc { rules: Mcmc },
}

/// A change that is due.
#[derive(Clone, Copy, Debug)]
pub(super) struct Change<'a> {
    /// Seed of everything random.
    pub(super) seed: u64,
    pub(super) when: ChangeTime,
    /// Never more Gaussians than this.
    pub(super) max: usize,
    /// The step's learning rate of the centres.
    pub(super) rate: f64,
    /// The step's gradient had entries that were not finite: parameters may have some.
    pub(super) has_non_finite: bool,
    /// Where photos were taken, and how large Gaussians may be near there.
    pub(super) cameras: &'a [[f32; 3]],
    pub(super) size_limit: Option<SizeLimit>,
}

/// When a change comes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChangeTime {
    /// The step of the training, counted from 0.
    pub(crate) step: u64,
    /// That of the schedule.
    pub(crate) position: u64,
    /// Steps of the schedule that are done with it: published schedules count from 1.
    pub(crate) steps_done: u64,
    /// The same, for what happens between the changes.
    pub(crate) fades_done: u64,
}

/// What became of the rows of a cloud in a step.
#[derive(Debug, Default)]
pub(super) struct Changed {
    /// Where each row comes from; `None`: nothing moved.
    pub(super) rows: Option<Rows>,
    /// Opacities were set anew.
    pub(super) opacity_reset: bool,
}

impl DensityControl {
    /// For cloud number `index`, of `n` Gaussians.
    pub(super) fn new(rules: &DensityRules, index: usize, n: usize) -> Self {
        let control = match &rules.control {
            ControlConfig::Adc(adc) => {
                Control::Adc { rules: adc.rules(&rules.schedule), gradients: ViewSpaceGradients::new(n) }
            }
            ControlConfig::Split(split) => Control::Split {
                rules: split.rules(&rules.schedule),
                gradients: ViewSpaceGradients::new(n),
                refill: split.refill,
            },
            ControlConfig::Mcmc(mcmc) => Control::Mcmc { rules: mcmc.rules(&rules.schedule) },
        };
        Self { stream: STREAM + index as u64, control }
    }

    /// A photo of `size` (columns, rows) was seen in step `step` of the schedule, counted from 0.
    pub(super) fn see(&mut self, step: u64, size: [usize; 2], seen: SeenGaussians<'_>) -> Result<(), SplatError> {
        let (until, gradients) = match &mut self.control {
            Control::Adc { rules, gradients } => (rules.until, gradients),
            Control::Split { rules, gradients, .. } => (rules.until, gradients),
            Control::Mcmc { .. } => return Ok(()),
        };
        if step + 1 < until { gradients.add(seen.gaussians, size, |k| seen.uv[k]) } else { Ok(()) }
    }

    /// How many Gaussians begin from outside after `steps` steps of the schedule, where there are `n`, and `max` at most.
    pub(super) fn count_from_outside(&self, steps: u64, n: usize, max: usize) -> usize {
        match &self.control {
            Control::Split { rules, refill, .. } if rules.grows_at(steps) => {
                (refill * rules.room(steps, n, max).saturating_sub(n) as f64) as usize
            }
            _ => 0,
        }
    }

    /// Rows were added.
    pub(super) fn follow(&mut self, rows: &Rows) -> Result<(), SplatError> {
        if let Control::Adc { gradients, .. } | Control::Split { gradients, .. } = &mut self.control {
            *gradients = gradients.follow(rows)?;
        }
        Ok(())
    }

    /// What opacity and size cost: its gradient is added. Returns the cost.
    pub(super) fn regularise(&self, cloud: &Gaussians, gradient: &mut Gaussians) -> Result<f64, SplatError> {
        match &self.control {
            Control::Adc { .. } | Control::Split { .. } => Ok(0.0),
            Control::Mcmc { rules } => rules.regularise(cloud, gradient),
        }
    }

    /// What happens after a step of the optimiser. `floaters` says which rows are left without them, if any are.
    pub(super) fn change(
        &mut self,
        change: &Change<'_>,
        cloud: &mut Gaussians,
        floaters: impl FnOnce(&Gaussians) -> Result<Option<Rows>, SplatError>,
    ) -> Result<Changed, SplatError> {
        let count = change.when.steps_done;
        let rng = Rng::new(change.seed, self.stream).substream(change.when.step);
        let mut changed = Changed::default();
        if change.has_non_finite {
            changed.drop_non_finite(cloud)?;
        }
        if let Some(rows) = floaters(cloud)? {
            changed.keep(rows, cloud)?;
        }
        match &mut self.control {
            Control::Adc { rules, gradients } => {
                if let Some(rows) = &changed.rows {
                    *gradients = gradients.follow(rows)?;
                }
                if rules.grows_at(count) {
                    // Children are drawn from their parents: not from what has no end.
                    keep_in_range(cloud, EXTENT)?;
                    let grown = rules.grow(cloud, &gradients.mean(), EXTENT, change.max, rng.substream(GROW))?;
                    *cloud = grown.cloud;
                    changed.then(grown.rows)?;
                    let kept = rules.prune(cloud, EXTENT, count, |i| is_sky(cloud, i, rules.opacity_min))?;
                    *cloud = kept.follow(cloud)?;
                    changed.then(kept)?;
                    changed.order(cloud)?;
                    *gradients = ViewSpaceGradients::new(cloud.len());
                }
                if rules.resets_at(count) {
                    rules.reset_opacity(cloud, |_| true)?;
                    changed.opacity_reset = true;
                }
            }
            Control::Split { rules, gradients, refill } => {
                if let Some(rows) = &changed.rows {
                    *gradients = gradients.follow(rows)?;
                }
                if rules.fades_at(change.when.fades_done) {
                    rules.fade(cloud)?;
                }
                if rules.grows_at(count) {
                    keep_in_range(cloud, EXTENT)?;
                    let kept = rules.prune(cloud, |_| false)?;
                    *gradients = gradients.follow(&kept)?;
                    changed.keep(kept, cloud)?;
                    let n = cloud.len();
                    let room = rules.room(count, n, change.max) - n;
                    let room = n + ((1.0 - *refill) * room as f64) as usize;
                    let grown = rules.grow(cloud, &gradients.mean(), room)?;
                    *cloud = grown.cloud;
                    changed.then(grown.rows)?;
                    changed.order(cloud)?;
                    *gradients = ViewSpaceGradients::new(cloud.len());
                }
            }
            Control::Mcmc { rules } => {
                // The noise is as large as what it moves.
                keep_in_range(cloud, EXTENT)?;
                rules.add_noise(cloud, change.rate, rng.substream(NOISE))?;
                if rules.relocates_at(count) {
                    let moved = rules.relocate(cloud, rng.substream(GROW))?;
                    *cloud = moved.cloud;
                    changed.then(moved.rows)?;
                    let more = rules.add(cloud, change.max, rng.substream(ADD))?;
                    *cloud = more.cloud;
                    changed.then(more.rows)?;
                    changed.order(cloud)?;
                }
            }
        }
        if count.is_multiple_of(TIDY_EVERY) || changed.rows.is_some() {
            keep_in_range(cloud, EXTENT)?;
            if let Some(limit) = change.size_limit {
                limit.keep(cloud, change.cameras)?;
            }
        }
        Ok(changed)
    }

    /// What the next change depends on; `prefix` stands before the names.
    pub(super) fn push<'a>(&'a self, prefix: &str, out: &mut Vec<Tensor<'a>>) {
        if let Control::Adc { gradients, .. } | Control::Split { gradients, .. } = &self.control {
            for (name, values) in NAMES.into_iter().zip(gradients.parts()) {
                out.push(f32_tensor(format!("{prefix}{name}"), values));
            }
        }
    }

    /// Take what [`push`](Self::push) wrote, for a cloud of `n`.
    pub(super) fn take(&mut self, prefix: &str, state: &TensorMap, n: usize) -> Result<(), SystemError> {
        if let Control::Adc { gradients, .. } | Control::Split { gradients, .. } = &mut self.control {
            let [sum, views, radius] = NAMES.map(|name| take_f32(state, &format!("{prefix}{name}"), n));
            *gradients = ViewSpaceGradients::restore([sum?, views?, radius?])
                .map_err(|e| SystemError::State { name: NAMES[0].into(), problem: e.to_string() })?;
        }
        Ok(())
    }
}

/// Whether a Gaussian is as far as the sky, and not too transparent: it may have any size.
fn is_sky(cloud: &Gaussians, i: usize, opacity_min: f64) -> bool {
    let n = cloud.len();
    let squares: f32 = (0..3).map(|axis| cloud.mean[axis * n + i].powi(2)).sum();
    squares > FAR * FAR && opacity(cloud, i) >= opacity_min
}

/// Names in checkpoints: those of the first that were written.
const NAMES: [&str; 3] = ["pull.sum", "pull.views", "pull.radius"];

impl Changed {
    fn then(&mut self, rows: Rows) -> Result<(), SplatError> {
        self.rows = Some(match self.rows.take() {
            Some(before) => before.then(&rows)?,
            None => rows,
        });
        Ok(())
    }

    /// Neighbours in space become neighbours in memory.
    fn order(&mut self, cloud: &mut Gaussians) -> Result<(), SplatError> {
        let rows = morton_order(cloud)?;
        self.keep(rows, cloud)
    }

    fn drop_non_finite(&mut self, cloud: &mut Gaussians) -> Result<(), SplatError> {
        match without_non_finite(cloud)? {
            Some(rows) => self.keep(rows, cloud),
            None => Ok(()),
        }
    }

    fn keep(&mut self, rows: Rows, cloud: &mut Gaussians) -> Result<(), SplatError> {
        *cloud = rows.follow(cloud)?;
        self.then(rows)
    }
}
