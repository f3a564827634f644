//! Rays that miss what their photo shows open the grid again, around their time alone.

use super::RaySystem;
use super::moving_tests::{TIME_STEPS, filmed, flash};
use crate::space::InternalRay;
use engine::system::{System, TensorData, TensorMap};

/// A ray through the middle of the unit box.
fn ray() -> InternalRay {
    let d = [1.0, 0.0, 0.0];
    InternalRay { o: [-1.5, 0.1, 0.1], d, start: 0.2, end: 3.0, view: d, radius: 0.0 }
}

/// The same system with a grid of which all cells are empty.
fn emptied(mut driver: RaySystem) -> RaySystem {
    let mut state: TensorMap = driver.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
    let TensorData::F32(thickness) = &mut state.get_mut("occupancy.thickness").unwrap().data else {
        panic!("thickness is of floats")
    };
    thickness.to_mut().fill(0.0);
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
    // Two periods in which nothing is found: no cell is visible at any time.
    for step in 0..120 {
        let occupancy = driver.sampler.occupancy_mut().unwrap();
        occupancy.update(&driver.field, &driver.space, driver.seed, step);
    }
    let mut driver = emptied(driver);
    let mut times = driver.field.time_steps().times.clone();
    times.sort_by(f32::total_cmp);
    times.dedup();
    assert_eq!(times.len(), TIME_STEPS);
    assert!(times.iter().all(|&time| samples(&driver, time) == 0));
    driver.sampler.occupancy_mut().unwrap().reopen_along(&[(ray(), times[9])]);
    for (k, &time) in times.iter().enumerate() {
        assert_eq!(samples(&driver, time) > 0, k.abs_diff(9) <= 1, "time {k}");
    }
    // Nothing is found there: some updates later the cells are empty again.
    for step in 120..220 {
        let occupancy = driver.sampler.occupancy_mut().unwrap();
        occupancy.update(&driver.field, &driver.space, driver.seed, step);
    }
    assert_eq!(driver.sampler.occupancy().unwrap().grid.occupied_cells(), 0);
}

#[test]
fn a_field_that_shows_nothing_of_opaque_photos_gets_samples_again() {
    let data = filmed(4);
    let mut driver = emptied(flash(false));
    for step in 0..3 {
        driver.step(&data, step).unwrap();
    }
    assert!(driver.sampler.occupancy().unwrap().grid.occupied_cells() > 0, "nothing was opened");
}
