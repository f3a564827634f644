//! When all photos are compared with the field, and at what scale.

use engine::data::Dataset;

/// Rays of a survey, at most: some seconds.
const SURVEY_RAYS: u64 = 300_000;
/// The same of a field before a cloud: it is young, so that a ray takes long, and the cloud soon finds masks of its own
/// (docs/decisions/0062).
const BEFORE_CLOUD: u64 = SURVEY_RAYS / 4;

/// Whether `step` is `first`, twice as many, four times as many, and so on.
pub(crate) fn is_doubled(step: u64, first: u64) -> bool {
    step.is_multiple_of(first) && (step / first).is_power_of_two()
}

/// Pixels of a photo along a side of a square that is compared.
pub(crate) fn survey_stride(data: &Dataset) -> u32 {
    stride(data, SURVEY_RAYS)
}

/// The same for a field before a cloud.
pub(crate) fn survey_stride_before_cloud(data: &Dataset) -> u32 {
    stride(data, BEFORE_CLOUD)
}

/// Pixels of a photo along a side of a square, at most `rays` of all photos together.
fn stride(data: &Dataset, rays: u64) -> u32 {
    (data.pixel_count() as f64 / rays as f64).sqrt().ceil().max(1.0) as u32
}
