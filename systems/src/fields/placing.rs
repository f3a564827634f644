//! Where points of a time are in the canonical scene, and what features say of them there.

use super::{Features, Places};
use crate::buffers::sized;
use crate::warps::{Deform, DeformScratch, Points, TimeSteps};

/// Time steps of these times, for features that know the time.
pub(super) fn steps_of(times: Vec<f32>) -> TimeSteps {
    TimeSteps { dims: 0, rows: Vec::new(), still: vec![true; times.len()], times }
}

/// The time steps of points: which of `time_steps` is that of each. Unused where nothing moves.
#[derive(Clone, Copy)]
pub(crate) struct When<'a> {
    pub(crate) time_steps: &'a TimeSteps,
    /// `[n]`
    pub(crate) which: &'a [u32],
}

/// Work space of [`seen`].
#[derive(Default)]
pub(crate) struct Placing {
    deform: DeformScratch,
    /// `[3][n]`, where points are, before they are canonical.
    x: Vec<f32>,
    /// Interpolated features, where these are not what the network sees.
    raw: Vec<f32>,
    /// `[n]`, times of the points.
    times: Vec<f32>,
}

impl Placing {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.deform.bytes() + 4 * (self.x.capacity() + self.raw.capacity() + self.times.capacity())
    }
}

/// Whether features depend on the time.
pub(super) fn knows_time(features: &dyn Features) -> bool {
    !features.view_times().is_empty()
}

/// Times of points, as features take them: `[n]`, or none where these know no time.
pub(super) fn fill_times(features: &dyn Features, when: When<'_>, out: &mut Vec<f32>) {
    out.clear();
    if knows_time(features) {
        out.extend(when.which.iter().map(|&i| when.time_steps.times[i as usize]));
    }
}

/// What a density network sees of points, `out` `[rows][n]`: features, and what a deformation adds. Their positions `x` `[3][n]` become
/// canonical ones.
pub(super) fn seen(
    features: &dyn Features,
    deform: Option<&Deform>,
    x: &mut [f32],
    when: When<'_>,
    out: &mut [f32],
    placing: &mut Placing,
) {
    let (rows, more) = out.split_at_mut(features.rows() * (x.len() / 3));
    if let Some(deform) = deform {
        let was = sized(&mut placing.x, x.len());
        was.copy_from_slice(x);
        let points = Points { x: was, which: when.which, time_steps: when.time_steps };
        deform.place(points, x, more, &mut placing.deform);
    }
    fill_times(features, when, &mut placing.times);
    features.encode(Places { x, times: &placing.times }, rows, &mut placing.raw);
}
