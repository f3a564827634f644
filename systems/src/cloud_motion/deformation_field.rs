//! The motion of a cloud: features of each Gaussian's place and the time, networks that turn them into offsets of its parameters, and the
//! gradient back to all of them and to the place.

use super::coherence::Coherence;
use super::decoder::{Decoder, DecoderScratch, PackedGradients};
use super::rest::is_due;
use super::settings::MotionSettings;
use super::unit_box::UnitBox;
use crate::buffers::sized;
use crate::cloud_layers::MASK_ROWS;
use crate::fields::{Detail, Features, Names, Part, Places};
use crate::schedule::Done;
use crate::views::{CloudMotion, CloudParameters, Learns};
use engine::system::{SystemError, Tensor, TensorMap, take_counts, u64_tensor};
use field_core::rng::Rng;
use float_core::Simd;
use rayon::prelude::*;
use splat_core::{Field, Gaussians};
use std::ops::Range;

/// Gaussians per task.
pub(super) const CHUNK: usize = 1024;
/// Name of the steps that are done in checkpoints, and that of the features.
const DONE: &str = "motion.done";
const FEATURES: &str = "motion.features";
/// That of how often it was looked for what rests; nothing is written where nothing may.
const LOOKS: &str = "motion.looks";
/// Stream of random numbers.
const STREAM: u64 = 0x6d6f_7469_6f6e;

/// What moves one cloud of a picture.
pub(crate) struct DeformationField {
    pub(super) settings: MotionSettings,
    /// Steps of the schedule.
    horizon: u64,
    /// The number of the cloud that it moves.
    cloud: usize,
    cube: UnitBox,
    pub(super) features: Box<dyn Features>,
    pub(super) decoder: Decoder,
    simd: Simd,
    /// Steps of the schedule that are done.
    done: u64,
    /// What the last photo said, for the next step.
    held: Vec<Held>,
    /// How often it was looked for what rests.
    looks: u64,
}

/// What a chunk of Gaussians brings to the gradient.
struct Held {
    /// `[3][n]`, places in the unit cube, and their times.
    x: Vec<f32>,
    times: Vec<f32>,
    /// As [`Features::pull`] gives it.
    raw_bar: Vec<f32>,
    networks: PackedGradients,
    /// `[3][n]`, the gradient with respect to places in the unit cube.
    x_bar: Vec<f32>,
}

/// Buffers of a chunk.
#[derive(Default)]
pub(super) struct Scratch {
    features: Vec<f32>,
    features_bar: Vec<f32>,
    raw: Vec<f32>,
    networks: DecoderScratch,
}

/// Gaussians of a chunk: where they are in the unit cube, and when.
pub(super) struct Chunk {
    x: Vec<f32>,
    pub(super) times: Vec<f32>,
}

impl Chunk {
    fn places(&self) -> Places<'_> {
        Places { x: &self.x, times: &self.times }
    }
}

impl DeformationField {
    /// What moves cloud number `cloud`, of spherical harmonics of `degree`, whose features lie in `cube`; its schedule is of `horizon` steps.
    ///
    /// # Errors
    /// [`SystemError::Config`] for networks that cannot be.
    pub(crate) fn new(
        settings: MotionSettings,
        features: Box<dyn Features>,
        cube: UnitBox,
        cloud: usize,
        degree: usize,
        horizon: u64,
        seed: u64,
    ) -> Result<Self, SystemError> {
        settings.check()?;
        let mut fields = vec![Field::Mean, Field::LogScale, Field::Wxyz];
        fields.extend(settings.motion_opacity.then_some(Field::Logit));
        fields.extend(settings.motion_colour.then_some([Field::Dc, Field::Rest]).into_iter().flatten());
        let MotionSettings { motion_width, motion_layers, .. } = settings;
        let rng = Rng::new(seed, STREAM);
        let masks = if settings.motion_masks { MASK_ROWS } else { 0 };
        let decoder = Decoder::new(features.rows(), motion_width, motion_layers, &fields, degree, masks, rng)?;
        let simd = Simd::best();
        Ok(Self { settings, horizon, cloud, cube, features, decoder, simd, done: 0, held: Vec::new(), looks: 0 })
    }

    #[cfg(test)]
    pub(super) fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    #[cfg(test)]
    pub(super) fn decoder_mut(&mut self) -> &mut Decoder {
        &mut self.decoder
    }

    #[cfg(test)]
    pub(super) fn features(&self) -> &dyn Features {
        &*self.features
    }

    #[cfg(test)]
    pub(super) fn features_mut(&mut self) -> &mut dyn Features {
        &mut *self.features
    }

    /// What is held for the next step: gradients of features and networks.
    #[cfg(test)]
    pub(super) fn gradients(&self) -> (Vec<f32>, Vec<f32>) {
        let mut table = vec![0.0; self.features.parameters().len()];
        for held in &self.held {
            let places = Places { x: &held.x, times: &held.times };
            self.features.scatter(&Part { places, raw_bar: &held.raw_bar }, &mut table);
        }
        let networks: Vec<&PackedGradients> = self.held.iter().map(|held| &held.networks).collect();
        (table, self.decoder.gradient(&networks))
    }

    /// Steps of the schedule before anything moves.
    fn begin(&self) -> u64 {
        (self.settings.motion_from * self.horizon as f64) as u64
    }

    /// The share of the steps that something moves in which step `step` is at.
    fn share(&self, step: u64) -> f64 {
        let begin = self.begin();
        (step.saturating_sub(begin) as f64 / self.horizon.saturating_sub(begin).max(1) as f64).min(1.0)
    }

    fn moves(&self, cloud: usize) -> bool {
        cloud == self.cloud && self.done >= self.begin()
    }

    /// Add offsets `[rows][which]` to Gaussians `which` of a cloud.
    pub(super) fn add(&self, cloud: &mut CloudParameters, which: &[u32], offsets: &[f32]) {
        let n = cloud.len().max(1);
        let add = |rows: Range<usize>, values: &mut [f32]| {
            for (row, values) in rows.zip(values.chunks_exact_mut(n)) {
                let offsets = &offsets[row * which.len()..][..which.len()];
                which.iter().zip(offsets).for_each(|(&i, offset)| values[i as usize] += offset);
            }
        };
        let mut fields = cloud.gaussians.fields_mut();
        for (field, rows) in self.decoder.fields() {
            let Some((_, values)) = fields.iter_mut().find(|(name, _)| *name == field) else { continue };
            add(rows, values);
        }
        add(self.decoder.extra(), &mut cloud.extra);
    }

    /// Gaussians `rows` of a cloud at a time.
    pub(super) fn chunk(&self, cloud: &Gaussians, rows: &[u32], time: f64) -> Chunk {
        let n = cloud.len();
        let along = |axis: usize| {
            let mean = &cloud.mean[axis * n..][..n];
            rows.iter().map(move |&i| self.cube.unit(axis, mean[i as usize]))
        };
        let count = rows.len();
        let time = (2.0 * time - 1.0).clamp(-1.0, 1.0) as f32;
        Chunk { x: (0..3).flat_map(along).collect(), times: vec![time; count] }
    }

    /// Offsets `[rows][n]` of the Gaussians of a chunk.
    pub(super) fn offsets(&self, chunk: &Chunk, scratch: &mut Scratch) -> Vec<f32> {
        let n = chunk.times.len();
        let Scratch { features: buffer, raw, networks, .. } = scratch;
        let features = sized(buffer, self.features.rows() * n);
        self.features.encode(chunk.places(), features, raw);
        let mut offsets = vec![0.0; self.decoder.rows() * n];
        self.decoder.offsets(self.simd, features, n, &mut offsets, networks);
        offsets
    }

    /// What a chunk brings to the gradient, where that with respect to its offsets is `bar` `[rows][n]`.
    fn backward(&self, chunk: Chunk, bar: &[f32], scratch: &mut Scratch) -> Held {
        let n = chunk.times.len();
        let rows = self.features.rows();
        let Scratch { features: buffer, features_bar, raw, networks } = scratch;
        let features = sized(buffer, rows * n);
        self.features.encode(chunk.places(), features, raw);
        let features_bar = sized(features_bar, rows * n);
        features_bar.fill(0.0);
        let networks = self.decoder.backward(self.simd, features, n, bar, features_bar, networks);
        let raw_bar = self.features.pull(features, n, features_bar, raw).to_vec();
        let mut x_bar = vec![0.0; 3 * n];
        self.features.pull_positions(chunk.places(), &raw_bar, Detail::All, &mut x_bar);
        Held { x: chunk.x, times: chunk.times, raw_bar, networks, x_bar }
    }

    /// Add to `bar` `[rows][n]`, with respect to the offsets of a chunk of `of` Gaussians in all, what neighbours move otherwise.
    fn cohere(
        &self,
        cloud: &Gaussians,
        rows: &[u32],
        chunk: &Chunk,
        of: usize,
        bar: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let MotionSettings { motion_coherence: factor, motion_reach: reach, .. } = self.settings;
        if factor > 0.0 {
            let offsets = self.offsets(chunk, scratch);
            let n = cloud.len();
            let places: Vec<f32> =
                (0..3).flat_map(|axis| rows.iter().map(move |&i| cloud.mean[axis * n + i as usize])).collect();
            Coherence { factor, reach }.add(&places, &offsets, rows.len(), of, bar);
        }
    }

    /// The Gaussians whose parameters at the time have a gradient: what a photo does not show teaches nothing.
    fn taught(&self, canonical: &CloudParameters, bar: &CloudParameters) -> Vec<u32> {
        let n = bar.len();
        let fields = bar.gaussians.fields();
        let moved: Vec<&[f32]> = self
            .decoder
            .fields()
            .filter_map(|(field, _)| Some(fields.iter().find(|(name, _)| *name == field)?.1))
            .chain((!self.decoder.extra().is_empty()).then_some(&bar.extra[..]))
            .collect();
        self.asked(canonical)
            .into_par_iter()
            .filter(|&i| moved.iter().any(|rows| rows.chunks_exact(n).any(|row| row[i as usize] != 0.0)))
            .collect()
    }

    /// The gradient with respect to the offsets of Gaussians `rows`, `[rows][n]`.
    fn offsets_bar(&self, bar: &CloudParameters, rows: &[u32]) -> Vec<f32> {
        let n = bar.len();
        let fields = bar.gaussians.fields();
        let mut out = Vec::with_capacity(self.decoder.rows() * rows.len());
        for (field, _) in self.decoder.fields() {
            let values = fields.iter().find(|(name, _)| *name == field).map_or(&[][..], |(_, values)| values);
            for row in values.chunks_exact(n.max(1)) {
                out.extend(rows.iter().map(|&i| row[i as usize]));
            }
        }
        // A cloud that has no extra rows learns nothing of them.
        for k in 0..self.decoder.extra().len() {
            out.extend(rows.iter().map(|&i| bar.extra.get(k * n + i as usize).copied().unwrap_or(0.0)));
        }
        out
    }
}

impl CloudMotion for DeformationField {
    fn cloud_at(&self, time: f64, index: usize, canonical: &CloudParameters) -> CloudParameters {
        let mut at = canonical.clone();
        if !self.moves(index) {
            return at;
        }
        let asked = self.asked(canonical);
        let chunks: Vec<Vec<f32>> = asked
            .par_chunks(CHUNK)
            .map_init(Scratch::default, |scratch, rows| {
                self.offsets(&self.chunk(&canonical.gaussians, rows, time), scratch)
            })
            .collect();
        asked.chunks(CHUNK).zip(&chunks).for_each(|(rows, offsets)| self.add(&mut at, rows, offsets));
        at
    }

    fn pull_back(&mut self, time: f64, index: usize, canonical: &CloudParameters, bar: &mut CloudParameters) {
        if !self.moves(index) {
            return;
        }
        let taught = self.taught(canonical, bar);
        let held: Vec<Held> = taught
            .par_chunks(CHUNK)
            .map_init(Scratch::default, |scratch, rows| {
                let cloud = &canonical.gaussians;
                let chunk = self.chunk(cloud, rows, time);
                let mut offsets_bar = self.offsets_bar(bar, rows);
                self.cohere(cloud, rows, &chunk, taught.len(), &mut offsets_bar, scratch);
                self.backward(chunk, &offsets_bar, scratch)
            })
            .collect();
        let n = bar.len();
        for (rows, held) in taught.chunks(CHUNK).zip(&held) {
            for (axis, x_bar) in held.x_bar.chunks_exact(rows.len()).enumerate() {
                let per_length = self.cube.unit_per_length(axis);
                for (&i, x_bar) in rows.iter().zip(x_bar) {
                    bar.gaussians.mean[axis * n + i as usize] += per_length * x_bar;
                }
            }
        }
        self.held.extend(held);
    }

    fn settle(&mut self, index: usize, canonical: &mut CloudParameters) {
        let steps = self.done.saturating_sub(self.begin());
        if self.may_rest() && self.moves(index) && is_due(self.looks, steps, self.share(self.done)) {
            self.looks += 1;
            self.look(canonical);
        }
    }

    fn at_rest(&self, index: usize, canonical: &CloudParameters) -> usize {
        let resting = if self.moves(index) { self.resting(canonical) } else { &[] };
        resting.iter().filter(|rests| **rests > 0.0).count()
    }
}

impl Learns for DeformationField {
    fn step(&mut self, simd: Simd, step: u64) -> usize {
        let held = std::mem::take(&mut self.held);
        self.done = step + 1;
        if held.is_empty() {
            return 0;
        }
        let [networks, features] = self.settings.rates(self.share(step));
        let parts: Vec<Part<'_>> = held
            .iter()
            .map(|held| Part { places: Places { x: &held.x, times: &held.times }, raw_bar: &held.raw_bar })
            .collect();
        let bad = self.features.step(features, &parts);
        let gradients: Vec<&PackedGradients> = held.iter().map(|held| &held.networks).collect();
        bad + self.decoder.step(simd, networks, &gradients)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = vec![u64_tensor(DONE, vec![self.done])];
        self.features.push_state(&Names::new(FEATURES, FEATURES), &mut out);
        out.extend(self.decoder.state());
        out.extend(self.may_rest().then(|| u64_tensor(LOOKS, vec![self.looks])));
        out
    }

    fn forget(&mut self) {
        self.held.clear();
    }

    fn load(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let done = take_counts(state, DONE, 1)?[0];
        let looks = if self.may_rest() { take_counts(state, LOOKS, 1)?[0] } else { 0 };
        let share = done as f64 / self.horizon.max(1) as f64;
        let names = Names::new(FEATURES, FEATURES);
        let features = self.features.restored(&names, state, Done { steps: done, share: share.min(1.0) })?;
        self.decoder.load(state)?;
        (self.done, self.features, self.looks) = (done, features, looks);
        self.held.clear();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.features.parameters().len() + self.decoder.param_count()
    }
}
