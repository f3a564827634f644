//! The looks at which a cloud's motion finds what rests, and which Gaussians these are: a row of its parameters says so.

use super::deformation_field::{CHUNK, DeformationField, Scratch};
use super::rest::{Offsets, times_of};
use crate::views::CloudParameters;
use rayon::prelude::*;
use splat_core::{Field, Gaussians};
use std::ops::Range;

impl DeformationField {
    /// Whether Gaussians may rest.
    pub(super) fn may_rest(&self) -> bool {
        self.settings.rows_at_rest() > 0
    }

    /// Where the row of a cloud of `n` Gaussians lies that says which of them rest: 1, others 0.
    fn rest_row(&self, n: usize) -> Range<usize> {
        let first = self.decoder.extra().len() * n;
        first..first + n
    }

    /// That row; nothing where none may rest.
    pub(super) fn resting<'a>(&self, cloud: &'a CloudParameters) -> &'a [f32] {
        let row = if self.may_rest() { cloud.extra.get(self.rest_row(cloud.len())) } else { None };
        row.unwrap_or_default()
    }

    /// The Gaussians that are asked where they are.
    pub(super) fn asked(&self, cloud: &CloudParameters) -> Vec<u32> {
        let resting = self.resting(cloud);
        let rests = |i: &u32| resting.get(*i as usize).is_some_and(|rests| *rests > 0.0);
        (0..cloud.len() as u32).filter(|i| !rests(i)).collect()
    }

    /// How the offsets of Gaussians `rows` differ over the film.
    fn over_time(&self, cloud: &Gaussians, rows: &[u32], times: &[f32], scratch: &mut Scratch) -> Offsets {
        let mut all = Offsets::new(self.decoder.rows(), rows.len());
        let mut chunk = self.chunk(cloud, rows, 0.0);
        for time in times {
            chunk.times.fill(*time);
            all.see(&self.offsets(&chunk, scratch));
        }
        all
    }

    /// Find what rests among the Gaussians that are still asked: it keeps the mean of its offsets, and is asked no more.
    pub(super) fn look(&self, canonical: &mut CloudParameters) {
        let times = times_of(self.features.view_times());
        if times.is_empty() || self.resting(canonical).is_empty() {
            return;
        }
        let asked = self.asked(canonical);
        let fields: Vec<(Field, Range<usize>)> = self.decoder.fields().collect();
        let found: Vec<(Vec<u32>, Vec<f32>)> = asked
            .par_chunks(CHUNK)
            .map_init(Scratch::default, |scratch, rows| {
                let (cloud, share) = (&canonical.gaussians, self.settings.motion_rest);
                let offsets = self.over_time(cloud, rows, &times, scratch);
                let rests = |k: &usize| offsets.rests(*k, cloud, rows[*k] as usize, &fields, share);
                let resting: Vec<usize> = (0..rows.len()).filter(rests).collect();
                (resting.iter().map(|k| rows[*k]).collect(), offsets.means(&resting))
            })
            .collect();
        let row = self.rest_row(canonical.len());
        for (resting, means) in found {
            self.add(canonical, &resting, &means);
            resting.iter().for_each(|&i| canonical.extra[row.start + i as usize] = 1.0);
        }
    }
}
