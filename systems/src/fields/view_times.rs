//! The times of training views, for features that know the time.

use engine::data::Dataset;
use std::sync::Arc;

/// The times of photos in `[-1, 1]`, of all views in their order; none where all show the same time.
pub(crate) fn view_times(data: &Dataset) -> Arc<[f32]> {
    let mut times: Vec<f32> = data.views().iter().map(|view| (2.0 * view.time - 1.0) as f32).collect();
    if times.windows(2).all(|pair| pair[0] == pair[1]) {
        times.clear();
    }
    times.into()
}

/// The different ones of some times, in order.
pub(crate) fn different_times(times: &[f32]) -> Vec<f32> {
    let mut times = times.to_vec();
    times.sort_unstable_by(f32::total_cmp);
    times.dedup();
    times
}

/// How many different times there are.
pub(crate) fn count_of_times(times: &[f32]) -> u32 {
    different_times(times).len() as u32
}

/// Steps along the time where nothing else is asked for: half as many as there are times, at least two.
pub(super) fn steps_of_time(times: &[f32]) -> u32 {
    count_of_times(times).div_ceil(2).max(2)
}
