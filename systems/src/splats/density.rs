//! When Gaussians come and go during a training, and what else has to follow.

use super::config::{DensityKind, SplatConfig};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_f32};
use field_core::rng::Rng;
use splat_core::density::{Adc, Mcmc, Rows, ViewSpaceGradients, keep_in_range, morton_order, without_non_finite};
use splat_core::{Gaussians, ProjectedGaussian, ProjectedGradient, SplatError};

/// Stream of random numbers, and those of its uses in a step.
const STREAM: u64 = 0x6465_6e73;
const GROW: u64 = 0;
const ADD: u64 = 1;
const STIR: u64 = 2;
/// Steps between two looks at what is out of range.
const TIDY_EVERY: u64 = 10;
/// Extent of the scene, internal units.
const EXTENT: f64 = 1.0;

/// The rules of a training, and what they have seen.
#[derive(Clone, Debug)]
pub(super) enum Density {
    /// Clone, split, prune, fade.
    Adc {
        /// Constants.
        rules: Adc,
        /// Gradients since the last change.
        pull: ViewSpaceGradients,
    },
    /// Relocate, add, stir.
    Mcmc {
        /// Constants.
        rules: Mcmc,
    },
}

/// What became of the rows of a cloud in a step.
#[derive(Debug, Default)]
pub(super) struct Changed {
    /// Where each row comes from; `None`: nothing moved.
    pub(super) rows: Option<Rows>,
    /// Opacities were set anew.
    pub(super) faded: bool,
}

impl Density {
    /// Rules for a cloud of `n`.
    pub(super) fn new(config: &SplatConfig, n: usize) -> Self {
        let (after, until, every) = (config.densify_from, config.densify_until, config.densify_every);
        match config.density {
            DensityKind::Adc => {
                let rules = Adc::DEFAULT
                    .with_after(after)
                    .with_until(until)
                    .with_every(every)
                    .with_reset_every(if config.reset_every == 0 { u64::MAX } else { config.reset_every })
                    .with_size_after(config.reset_every)
                    .with_size_max(if config.prune_size > 0.0 { config.prune_size.into() } else { f64::INFINITY })
                    .with_gradient_threshold(config.densify_gradient);
                Self::Adc { rules, pull: ViewSpaceGradients::new(n) }
            }
            DensityKind::Mcmc => {
                let cost = f64::from(config.mcmc_cost);
                let rules = Mcmc::DEFAULT
                    .with_after(after)
                    .with_until(until)
                    .with_every(every)
                    .with_noise(f64::from(config.mcmc_noise))
                    .with_opacity_weight(cost)
                    .with_scale_weight(cost);
                Self::Mcmc { rules }
            }
        }
    }

    /// A photo of `size` was seen in step `step`, counted from 0.
    pub(super) fn see<const K: usize>(
        &mut self,
        step: u64,
        size: [usize; 2],
        footprints: &[ProjectedGaussian],
        records: &[ProjectedGradient<K>],
    ) -> Result<(), SplatError> {
        match self {
            Self::Adc { rules, pull } if step + 1 < rules.until => pull.add(footprints, size, |k| records[k].uv),
            _ => Ok(()),
        }
    }

    /// What opacity and size cost: added to the gradient. Returns the cost.
    pub(super) fn price(&self, cloud: &Gaussians, grad: &mut Gaussians) -> Result<f64, SplatError> {
        match self {
            Self::Adc { .. } => Ok(0.0),
            Self::Mcmc { rules } => rules.regularise(cloud, grad),
        }
    }

    /// What happens after the optimiser's step number `step`, counted from 0; `lr` was the rate of the centres. `floaters` says which
    /// rows are left without them, if any are.
    pub(super) fn change(
        &mut self,
        (seed, step): (u64, u64),
        (max, lr): (usize, f64),
        cloud: &mut Gaussians,
        bad: usize,
        floaters: impl FnOnce(&Gaussians) -> Result<Option<Rows>, SplatError>,
    ) -> Result<Changed, SplatError> {
        // The published schedules count from 1.
        let count = step + 1;
        let rng = Rng::new(seed, STREAM).substream(step);
        let mut changed = Changed::default();
        if bad > 0 {
            changed.drop_non_finite(cloud)?;
        }
        if let Some(rows) = floaters(cloud)? {
            changed.keep(rows, cloud)?;
        }
        match self {
            Self::Adc { rules, pull } => {
                if let Some(rows) = &changed.rows {
                    *pull = pull.follow(rows)?;
                }
                if rules.grows_at(count) {
                    // Children are drawn from their parents: not from what has no end.
                    keep_in_range(cloud, EXTENT)?;
                    let grown = rules.grow(cloud, &pull.mean(), EXTENT, max, rng.substream(GROW))?;
                    *cloud = grown.cloud;
                    changed.then(grown.rows)?;
                    let kept = rules.prune(cloud, EXTENT, count, |_| false)?;
                    *cloud = kept.follow(cloud)?;
                    changed.then(kept)?;
                    changed.order(cloud)?;
                    *pull = ViewSpaceGradients::new(cloud.len());
                }
                if rules.resets_at(count) {
                    rules.reset_opacity(cloud, |_| true)?;
                    changed.faded = true;
                }
            }
            Self::Mcmc { rules } => {
                // The noise is as large as what it moves.
                keep_in_range(cloud, EXTENT)?;
                rules.add_noise(cloud, lr, rng.substream(STIR))?;
                if rules.relocates_at(count) {
                    let moved = rules.relocate(cloud, rng.substream(GROW))?;
                    *cloud = moved.cloud;
                    changed.then(moved.rows)?;
                    let more = rules.add(cloud, max, rng.substream(ADD))?;
                    *cloud = more.cloud;
                    changed.then(more.rows)?;
                    changed.order(cloud)?;
                }
            }
        }
        if count.is_multiple_of(TIDY_EVERY) || changed.rows.is_some() {
            keep_in_range(cloud, EXTENT)?;
        }
        Ok(changed)
    }

    pub(super) fn push<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        if let Self::Adc { pull, .. } = self {
            for (name, numbers) in NAMES.into_iter().zip(pull.parts()) {
                out.push(f32_tensor(name, numbers));
            }
        }
    }

    /// What [`push`](Self::push) wrote, for a cloud of `n`.
    pub(super) fn take(state: &TensorMap, config: &SplatConfig, n: usize) -> Result<Self, SystemError> {
        let mut new = Self::new(config, n);
        if let Self::Adc { pull, .. } = &mut new {
            let [sum, views, radius] = NAMES.map(|name| take_f32(state, name, n));
            *pull = ViewSpaceGradients::restore([sum?, views?, radius?])
                .map_err(|e| SystemError::State { name: NAMES[0].into(), problem: e.to_string() })?;
        }
        Ok(new)
    }
}

/// Names in checkpoints.
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
