//! Rays that miss what their photo shows open the grid again, around their time alone.

use super::RaySystem;
use super::moving_tests::{filmed, flash};
use super::time_bins_tests::{state, times, update};
use crate::space::InternalRay;
use engine::system::{System, TensorData};
use std::ops::Range;

/// A ray through the middle of the unit box.
fn ray() -> InternalRay {
    let d = [1.0, 0.0, 0.0];
    InternalRay { o: [-1.5, 0.1, 0.1], d, start: 0.2, end: 3.0, view: d, radius: 0.0 }
}

/// The same system with a grid of which all cells are empty, and in which nothing was found at any time.
fn emptied(mut driver: RaySystem) -> RaySystem {
    let mut state = state(&driver);
    for name in ["occupancy.thickness", "occupancy.now", "occupancy.before"] {
        match &mut state.get_mut(name).unwrap().data {
            TensorData::F32(numbers) => numbers.to_mut().fill(0.0),
            TensorData::U64(words) => words.to_mut().fill(0),
        }
    }
    driver.load_state(&state).unwrap();
    driver
}

/// Samples along the ray at a time.
fn samples(driver: &RaySystem, time: f32) -> usize {
    let occupancy = driver.sampler.occupancy().unwrap();
    let mut count = 0;
    occupancy.marcher().march_in(&occupancy.grid, occupancy.cells_at(Some(time)), &ray(), 0.5, |_, _| count += 1);
    count
}

#[test]
fn cells_along_a_ray_that_misses_are_opened_around_its_time() {
    let mut driver = flash(false);
    // Three periods are over: it is known what is empty when.
    update(&mut driver, 0..120);
    let mut driver = emptied(driver);
    let times = times(&driver);
    assert!(times.iter().all(|&time| samples(&driver, time) == 0));
    driver.sampler.occupancy_mut().unwrap().reopen_along(&[(ray(), times[9])]);
    for (k, &time) in times.iter().enumerate() {
        assert_eq!(samples(&driver, time) > 0, k.abs_diff(9) <= 1, "time {k}");
    }
    // Nothing is found there in two periods: it is out of sight again.
    update(&mut driver, 120..220);
    assert!(times.iter().all(|&time| samples(&driver, time) == 0));
}

/// The system after these steps.
fn trained(mut driver: RaySystem, steps: Range<u64>) -> RaySystem {
    let data = filmed(4);
    for step in steps {
        driver.step(&data, step).unwrap();
    }
    driver
}

#[test]
fn a_field_that_shows_nothing_of_opaque_photos_gets_cells_again_and_a_resume_the_same_ones() {
    let whole = trained(flash(false), 0..6);
    let occupancy = whole.sampler.occupancy().unwrap();
    // The mist that the field is holds a thousandth of that.
    let fullest = occupancy.grid.thickness().iter().copied().fold(0.0, f32::max);
    assert!(fullest > occupancy.config().occupancy_threshold, "nothing was opened: {fullest}");
    for at in 1..6 {
        let mut resumed = flash(false);
        resumed.load_state(&state(&trained(flash(false), 0..at))).unwrap();
        assert!(state(&trained(resumed, at..6)) == state(&whole), "resumed at {at}");
    }
}
