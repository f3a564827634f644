//! Gaussians that stand still are found, keep what they have, and are asked no more.

use super::MotionSettings;
use super::deformation_field::DeformationField;
use super::tests::{SETTINGS, busy_in, cloud, field_in, map};
use crate::views::{CloudMotion, CloudParameters, Learns};
use float_core::Simd;

/// Steps of the schedule, of which a fifth are done before it is looked what rests.
const HORIZON: u64 = 500;
/// The times of the photos, 0 to 1.
const PHOTOS: [f64; 3] = [0.0, 0.5, 1.0];

/// A cloud of the tests with a row that says what rests.
fn with_row() -> CloudParameters {
    let mut cloud = cloud();
    cloud.rows += 1;
    cloud.extra.resize(cloud.rows * cloud.len(), 0.0);
    cloud
}

/// Networks and planes of noise, or of nothing, after `steps` steps.
fn after(made: fn(MotionSettings, u64) -> DeformationField, motion_rest: f32, steps: u64) -> DeformationField {
    let mut field = made(MotionSettings { motion_rest, ..SETTINGS }, HORIZON);
    field.step(Simd::best(), steps - 1);
    field
}

/// All numbers of a cloud but the row that says what rests.
fn numbers(cloud: &CloudParameters) -> Vec<f32> {
    let row = (cloud.rows - 1) * cloud.len();
    let fields = cloud.gaussians.fields();
    fields.iter().flat_map(|(_, values)| values.iter()).chain(&cloud.extra[..row]).copied().collect()
}

#[test]
fn what_rests_is_where_it_was_on_average_and_teaches_nothing() {
    let mut field = after(busy_in, 10.0, 100);
    let before = with_row();
    let mut cloud = before.clone();
    // Everything differs by less than ten times itself, but for one small Gaussian.
    let n = cloud.len();
    for axis in 0..3 {
        cloud.gaussians.log_scale[axis * n + 2] = -20.0;
    }
    let then: Vec<Vec<f32>> = PHOTOS.iter().map(|time| numbers(&field.cloud_at(*time, 0, &cloud))).collect();
    field.settle(0, &mut cloud);
    assert_eq!(field.at_rest(0, &cloud), n - 1);
    for time in [0.2, 0.9] {
        let now = field.cloud_at(time, 0, &cloud);
        for (i, x) in numbers(&now).iter().enumerate().filter(|(i, _)| i % n != 2) {
            let mean = then.iter().map(|then| then[i]).sum::<f32>() / PHOTOS.len() as f32;
            assert!((x - mean).abs() < 1e-5 * (1.0 + mean.abs()), "number {i}: {x}, {mean}");
        }
    }
    assert_ne!(field.cloud_at(0.2, 0, &cloud).gaussians.mean[2], field.cloud_at(0.9, 0, &cloud).gaussians.mean[2]);
    // The gradient is that of the Gaussian that moves, alone.
    let gradients = |of: &mut DeformationField, teaching: &dyn Fn(usize) -> bool| {
        let mut bar = before.clone();
        for (_, values) in bar.gaussians.fields_mut() {
            values.iter_mut().enumerate().filter(|(i, _)| !teaching(i % n)).for_each(|(_, bar)| *bar = 0.0);
        }
        bar.extra.fill(0.0);
        of.pull_back(0.3, 0, &cloud, &mut bar);
        let gradients = of.gradients();
        of.forget();
        gradients
    };
    assert_eq!(gradients(&mut field, &|_| true), gradients(&mut field, &|i| i == 2));
    assert_eq!(gradients(&mut field, &|i| i != 2).0.iter().filter(|g| **g != 0.0).count(), 0);
}

#[test]
fn all_of_a_cloud_that_moves_nowhere_rests_and_nothing_changes() {
    let mut field = after(field_in, 0.1, 100);
    let mut cloud = with_row();
    let before = cloud.clone();
    field.settle(0, &mut cloud);
    assert_eq!(field.at_rest(0, &cloud), cloud.len());
    assert_eq!(numbers(&cloud), numbers(&before));
    assert_eq!(field.cloud_at(0.7, 0, &cloud), cloud);
}

#[test]
fn nothing_rests_where_all_moves_before_it_is_time_in_another_cloud_or_where_none_may() {
    for (rest, steps, index, row) in
        [(1e-6, 100, 0, true), (10.0, 99, 0, true), (10.0, 100, 1, true), (0.0, 100, 0, true), (10.0, 100, 0, false)]
    {
        let mut field = after(busy_in, rest, steps);
        let mut cloud = if row { with_row() } else { cloud() };
        let before = cloud.clone();
        field.settle(index, &mut cloud);
        assert_eq!((field.at_rest(index, &cloud), &cloud), (0, &before), "{rest}, {steps}, {index}");
    }
    let empty = |row: bool| CloudParameters::new(splat_core::Gaussians::new(0, 1).unwrap(), 3 + usize::from(row));
    for row in [false, true] {
        let mut nothing = empty(row);
        after(busy_in, 10.0, 100).settle(0, &mut nothing);
        assert_eq!(nothing, empty(row));
    }
}

#[test]
fn a_checkpoint_knows_how_often_it_was_looked() {
    let mut whole = after(busy_in, 1e-6, 100);
    whole.settle(0, &mut with_row());
    let state = map(whole.state());
    let mut resumed = field_in(MotionSettings { motion_rest: 10.0, ..SETTINGS }, HORIZON);
    resumed.load(&state).unwrap();
    let mut cloud = with_row();
    resumed.settle(0, &mut cloud);
    assert_eq!(resumed.at_rest(0, &cloud), 0, "the second look is later");
    resumed.step(Simd::best(), 174);
    resumed.settle(0, &mut cloud);
    assert!(resumed.at_rest(0, &cloud) > 0);
    let mut without = state;
    without.remove("motion.looks");
    assert!(resumed.load(&without).unwrap_err().to_string().contains("motion.looks"));
    assert!(!map(field_in(SETTINGS, HORIZON).state()).contains_key("motion.looks"));
}
