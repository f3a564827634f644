//! A cloud that is trained: its parameters, their gradients, its optimiser and its density control.

use super::cloud_parameters::{CloudParameters, joined};
use super::config::{CloudConfig, CloudRates, ExtraRows};
use super::density_control::{Change, ChangeTime, DensityControl, DensityRules};
use super::drawing::{DrawnCloud, SeenGaussians};
use super::memory;
use super::optimiser::Optimiser;
use super::uses::{UsePruning, Uses};
use engine::system::{SystemError, Tensor, TensorData, TensorMap, f32_tensor, take_numbers};
use float_core::Simd;
use splat_core::density::{Rows, morton_order};
use splat_core::{Gaussians, SplatError};

/// How a cloud is trained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CloudTraining {
    pub(crate) cloud: CloudConfig,
    pub(crate) rates: CloudRates,
    pub(crate) density: DensityRules,
    /// Rows beyond those of every Gaussian.
    pub(crate) extra: ExtraRows,
    /// When those are dropped that no photo needs.
    pub(crate) pruning: UsePruning,
}

/// A cloud that is trained.
#[derive(Clone, Debug)]
pub(crate) struct TrainedCloud {
    pub(crate) training: CloudTraining,
    /// Number of the cloud in its picture.
    index: usize,
    pub(crate) parameters: CloudParameters,
    pub(crate) gradient: CloudParameters,
    optimiser: Optimiser,
    density: DensityControl,
    uses: Uses,
}

impl TrainedCloud {
    /// Cloud number `index` of a picture at its start, of the frame of training.
    ///
    /// # Errors
    /// [`SplatError`] for fields of the wrong length.
    pub(crate) fn new(training: CloudTraining, index: usize, start: &Gaussians) -> Result<Self, SplatError> {
        let gaussians = morton_order(start).and_then(|rows| rows.follow(start))?;
        let extra = training.extra.at_start(&gaussians);
        let parameters = CloudParameters { extra, ..CloudParameters::new(gaussians, training.extra.rows) };
        Ok(Self::restored(training, index, parameters))
    }

    /// Begin anew, with another cloud of the frame of training.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(super) fn begin(&mut self, start: &Gaussians) -> Result<(), SplatError> {
        *self = Self::new(self.training, self.index, start)?;
        Ok(())
    }

    /// How many Gaussians begin from outside after `steps` steps of the schedule: their share of what room there is then.
    pub(super) fn count_from_outside(&self, steps: u64) -> usize {
        self.density.count_from_outside(steps, self.parameters.len(), self.training.cloud.max_splats)
    }

    /// Put in Gaussians of the frame of training, behind those that are there.
    ///
    /// # Errors
    /// [`SplatError`] for fields of the wrong length, or more than can be counted.
    pub(super) fn insert(&mut self, more: &Gaussians) -> Result<(), SplatError> {
        let n = self.parameters.len();
        if n == 0 {
            return self.begin(more);
        }
        let rows = Rows::and_fresh(n, more.len())?;
        self.parameters.gaussians = joined(&[&self.parameters.gaussians, more]);
        self.parameters.follow_extra(&rows)?;
        let (all, new) = (rows.len().max(1), more.len().max(1));
        let extra = self.training.extra.at_start(more);
        for (row, start) in self.parameters.extra.chunks_exact_mut(all).zip(extra.chunks_exact(new)) {
            row[n..].copy_from_slice(start);
        }
        self.optimiser.follow(&rows, self.parameters.gaussians.degree())?;
        self.density.follow(&rows)?;
        self.uses.follow(&rows)?;
        self.gradient = self.parameters.clone();
        Ok(())
    }

    fn restored(training: CloudTraining, index: usize, parameters: CloudParameters) -> Self {
        Self {
            optimiser: Optimiser::new(&parameters),
            density: DensityControl::new(&training.density, index, parameters.len()),
            uses: Uses::new(training.pruning, parameters.len()),
            gradient: parameters.clone(),
            training,
            index,
            parameters,
        }
    }

    /// As it is drawn in a step of the schedule, `parameters` at the time of the picture.
    pub(crate) fn drawn<'a>(&self, step: u64, parameters: &'a CloudParameters) -> DrawnCloud<'a> {
        DrawnCloud {
            index: self.index,
            gaussians: &parameters.gaussians,
            extra: &parameters.extra,
            composited: self.training.extra.composited,
            degree: self.training.cloud.degree(step),
        }
    }

    /// Gaussians were seen in step `step` of the schedule, in a picture of `size`.
    pub(crate) fn see(&mut self, step: u64, size: [usize; 2], seen: SeenGaussians<'_>) -> Result<(), SplatError> {
        self.density.see(step, size, seen)
    }

    /// What a photo needs of each Gaussian, `[n]`, where that is counted.
    pub(crate) fn see_uses(&mut self, uses: &[f32]) {
        self.uses.see(uses);
    }

    /// What the density control adds to the loss; its gradient is added.
    pub(crate) fn regularise(&mut self) -> Result<f64, SplatError> {
        self.density.regularise(&self.parameters.gaussians, &mut self.gradient.gaussians)
    }

    /// One step of the optimiser, that of the schedule. Returns how many entries of the gradient were not finite.
    pub(crate) fn learn(&mut self, simd: Simd, step: u64) -> usize {
        let rates = self.training.rates.at(step, self.training.extra.rate);
        let degree = self.training.cloud.degree(step);
        self.optimiser.step(simd, &rates, degree, &mut self.parameters, &mut self.gradient)
    }

    /// Gaussians come and go, and what belongs to them with them. Photos were taken from `cameras`; `floaters` says which rows are left
    /// without those where nothing is, if any are; photos are shown in turns of `photos`. Returns whether any came, went or moved to another row.
    pub(crate) fn change(
        &mut self,
        seed: u64,
        when: ChangeTime,
        non_finite: usize,
        cameras: &[[f32; 3]],
        photos: usize,
        floaters: impl FnOnce(&Gaussians) -> Result<Option<Rows>, SplatError>,
    ) -> Result<bool, SplatError> {
        let CloudTraining { cloud, rates, extra, .. } = &self.training;
        let change = Change {
            seed,
            when,
            max: cloud.max_splats,
            rate: rates.at(when.position, extra.rate).mean,
            has_non_finite: non_finite > 0,
            cameras,
            size_limit: cloud.size_limit(),
        };
        // Rows that are no numbers go first, and these are another's then.
        let left = if non_finite > 0 { None } else { self.uses.left(when.step, when.position, photos)? };
        let without = |cloud: &Gaussians| left.map_or_else(|| floaters(cloud), |rows| Ok(Some(rows)));
        let changed = self.density.change(&change, &mut self.parameters.gaussians, without)?;
        if let Some(rows) = &changed.rows {
            self.parameters.follow_extra(rows)?;
            self.optimiser.follow(rows, self.parameters.gaussians.degree())?;
            self.uses.follow(rows)?;
        }
        if changed.opacity_reset {
            self.optimiser.forget_opacity();
        }
        if self.gradient.len() != self.parameters.len() {
            self.gradient = self.parameters.clone();
        }
        Ok(changed.rows.is_some())
    }

    /// What stands before the names of its arrays in a checkpoint; the first cloud's have nothing.
    fn prefix(&self) -> String {
        if self.index == 0 { String::new() } else { format!("cloud{}.", self.index) }
    }

    /// Everything its next step depends on.
    pub(crate) fn push<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        let prefix = self.prefix();
        for (field, values) in self.parameters.gaussians.fields() {
            out.push(f32_tensor(name(&prefix, field.name()), values));
        }
        if self.parameters.rows > 0 {
            out.push(f32_tensor(name(&prefix, EXTRA), &self.parameters.extra));
        }
        self.optimiser.push(&prefix, out);
        self.density.push(&prefix, out);
        out.extend(self.uses.counted().map(|uses| f32_tensor(name(&prefix, USES), uses)));
    }

    /// What [`push`](Self::push) wrote for a cloud like this one. The number of Gaussians is that of the arrays.
    ///
    /// # Errors
    /// [`SystemError::State`] naming the array that is missing or does not fit.
    pub(crate) fn take(&self, state: &TensorMap) -> Result<Self, SystemError> {
        let prefix = self.prefix();
        let logits = name(&prefix, "logit");
        let n = match state.get(&logits).map(|t| &t.data) {
            Some(TensorData::F32(logit)) => logit.len(),
            _ => return Err(SystemError::State { name: logits, problem: "32-bit floats expected".into() }),
        };
        let refused = |e: SplatError| SystemError::State { name: name(&prefix, ""), problem: e.to_string() };
        let gaussians = Gaussians::new(n, self.training.cloud.sh_degree).map_err(refused)?;
        let mut parameters = CloudParameters::new(gaussians, self.training.extra.rows);
        for (field, values) in parameters.gaussians.fields_mut() {
            values.copy_from_slice(&take_numbers(state, &name(&prefix, field.name()), values.len())?);
        }
        if parameters.rows > 0 {
            parameters.extra = take_numbers(state, &name(&prefix, EXTRA), parameters.extra.len())?;
        }
        let mut new = Self::restored(self.training, self.index, parameters);
        new.optimiser.take(&prefix, state)?;
        new.density.take(&prefix, state, n)?;
        if new.uses.counted().is_some() {
            new.uses.put(take_numbers(state, &name(&prefix, USES), n)?);
        }
        Ok(new)
    }

    /// Number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.parameters.len() * self.parameters.per_gaussian()
    }

    /// Bytes of `gaussians` of them, at most.
    pub(crate) fn bytes(&self, gaussians: usize) -> usize {
        memory::of_gaussians(gaussians, self.parameters.per_gaussian())
    }

    /// Bytes that may come yet.
    pub(crate) fn growth_bytes(&self) -> usize {
        self.bytes(self.training.cloud.max_splats).saturating_sub(self.bytes(self.parameters.len()))
    }
}

/// Name of the extra rows in checkpoints.
const EXTRA: &str = "extra";
/// That of what photos need.
const USES: &str = "uses";

fn name(prefix: &str, field: &str) -> String {
    format!("splats.{prefix}{field}")
}
