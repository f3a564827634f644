//! Empty space by time: rays pass over what is full at other times only, and nothing is lost at its own.

use super::RaySystem;
use super::budget_tests::{occupancy, query, random_rays, randomised, small};
use super::gradient_tests::{planes, with_moving_part};
use super::moving_tests::{TIME_STEPS, filmed, flash, flash_in};
use super::render::render_trial;
use super::step::Plan;
use crate::fields::MovingCells;
use crate::space::SpaceKind;
use engine::system::{Query, System, TensorData, TensorMap, Trial};
use render_core::budget::{Skip, SkipSet};
use render_core::occupancy::CellBits;
use std::ops::Range;

/// When the field of [`flash`] is full, and how many updates make a period of its bins.
const FULL: usize = 7;
const PERIOD: u64 = 40;

/// Updates of the grid alone, before these steps.
pub(super) fn update(driver: &mut RaySystem, steps: Range<u64>) {
    for step in steps {
        let occupancy = driver.sampler.occupancy_mut().unwrap();
        occupancy.update(&driver.field, &driver.space, driver.seed, step);
    }
}

/// The times of the photos, in `[-1, 1]`, ascending.
pub(super) fn times(driver: &RaySystem) -> Vec<f32> {
    let mut times = driver.field.time_steps().times.clone();
    times.sort_by(f32::total_cmp);
    times.dedup();
    assert_eq!(times.len(), TIME_STEPS);
    times
}

/// What is visible at each of them.
fn visible(driver: &RaySystem) -> Vec<CellBits> {
    let occupancy = driver.sampler.occupancy().unwrap();
    times(driver).into_iter().map(|time| occupancy.cells_at(Some(time)).clone()).collect()
}

/// What a checkpoint holds.
pub(super) fn state(driver: &RaySystem) -> TensorMap {
    driver.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

/// Whether a time is that of [`FULL`] or one beside it.
fn is_near(k: usize) -> bool {
    k.abs_diff(FULL) <= 1
}

#[test]
fn what_is_full_at_one_time_is_seen_around_it_always_and_not_at_other_times() {
    let mut driver = flash(true);
    for step in 0..300 {
        update(&mut driver, step..step + 1);
        let grid = &driver.sampler.occupancy().unwrap().grid;
        let (cells, occupied) = (grid.cells() as u64, grid.occupied_cells());
        for (k, visible) in visible(&driver).iter().enumerate() {
            match step + 1 {
                // Nothing is known yet.
                ..PERIOD => assert_eq!(visible.count(), occupied, "time {k}, step {step}"),
                // The field is found, and what no probe of the first update could tell from it is forgotten.
                101.. => assert_eq!(visible.count(), if is_near(k) { cells } else { 0 }, "time {k}, step {step}"),
                _ => {}
            }
        }
    }
    // Beyond the photos, and where no time is given, it is as the grid has it.
    let occupancy = driver.sampler.occupancy().unwrap();
    for time in [Some(-1.5), Some(1.5), Some(f32::NAN), None] {
        assert_eq!(occupancy.cells_at(time), occupancy.grid.occupied_set());
    }
}

#[test]
fn renders_and_densities_are_those_of_their_time_and_budgets_keep_their_meaning() {
    let mut driver = flash(true);
    update(&mut driver, 0..200);
    let (rays, times) = (random_rays(3), times(&driver));
    let time = |k: usize| 0.5 * (f64::from(times[k]) + 1.0);
    for k in [FULL, 15] {
        let query = |error_budget| Query { time: time(k), ..query([0.2, 0.5, 1.0], error_budget) };
        let trial = Trial { skips: SkipSet::only(Skip::Empty), ..Trial::USUAL };
        let (layers, ledger) = render_trial(&driver, &rays, &query(1.0 / 255.0), &trial);
        let empty = ledger.entry(Skip::Empty);
        assert!(empty.total > 0 && (empty.skipped == empty.total) != is_near(k), "time {k}: {empty:?}");
        assert_eq!(layers.rgb, driver.render(&rays, &query(0.0)).rgb, "time {k}: passing over empty cells is exact");
        let mut density = [0.0];
        driver.density(&[[0.1, 0.2, 0.3]], time(k), &mut density);
        assert!(if is_near(k) { density[0] > 5.0 } else { density[0] == 0.0 }, "time {k}: {density:?}");
    }
}

#[test]
fn training_rays_have_samples_where_something_is_at_their_time() {
    let (data, mut driver) = (filmed(4), flash(true));
    update(&mut driver, 0..200);
    driver.draw(&data, 0, 1).unwrap();
    driver.each_chunk(&Plan::PICTURE, |chunk, ctx, pixels| chunk.sample(ctx, pixels));
    let (times, of_views) = (times(&driver), &driver.field.time_steps().times);
    let mut samples = [0; TIME_STEPS];
    let counts = driver.work.chunks.iter().flat_map(|chunk| chunk.offsets.windows(2).map(|ends| ends[1] - ends[0]));
    for (count, &view) in counts.zip(&driver.work.inputs.batch.view) {
        samples[times.partition_point(|time| *time < of_views[view as usize])] += count;
    }
    for (k, count) in samples.into_iter().enumerate() {
        assert_eq!(count > 0, is_near(k), "time {k}: {samples:?}");
    }
}

#[test]
fn bits_are_the_same_with_1_2_and_4_threads_and_after_a_resume() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut driver = flash(true);
            update(&mut driver, 0..130);
            (state(&driver), visible(&driver))
        })
    };
    let one = on(1);
    assert!(one.0.contains_key("occupancy.now"));
    assert!(on(2) == one && on(4) == one);
    // In the first period, at the end of one, and within the third.
    for at in [13, PERIOD, 2 * PERIOD + 5] {
        let mut whole = flash(true);
        update(&mut whole, 0..at);
        let mut resumed = flash(true);
        resumed.load_state(&state(&whole)).unwrap();
        assert!(visible(&resumed) == visible(&whole), "loaded at {at}");
        update(&mut resumed, at..130);
        assert!((state(&resumed), visible(&resumed)) == one, "resumed at {at}");
    }
}

#[test]
fn what_is_occupied_at_any_time_does_not_depend_on_bins_and_fields_that_know_no_time_have_none() {
    let [mut with, mut without] = [24, 0].map(|bins| flash_in(true, bins));
    for driver in [&mut with, &mut without] {
        update(driver, 0..100);
    }
    let [mut with, without] = [state(&with), state(&without)];
    for name in ["occupancy.times", "occupancy.now", "occupancy.before", "occupancy.period"] {
        assert!(with.remove(name).is_some() && !without.contains_key(name), "{name}");
    }
    assert!(with == without);
    let mut still = randomised(small(SpaceKind::Box), 3);
    update(&mut still, 0..60);
    assert!(!state(&still).contains_key("occupancy.times"));
    let occupancy = still.sampler.occupancy().unwrap();
    assert_eq!(occupancy.cells_at(Some(0.3)), occupancy.grid.occupied_set());
}

#[test]
fn what_stands_still_is_full_in_all_bins() {
    let film = filmed(8);
    let mut config = with_moving_part(small(SpaceKind::Box), planes(&film, "hybrid").features);
    occupancy(&mut config).occupancy_times = 24;
    let mut driver = randomised(config, 4);
    let found = |driver: &RaySystem| match &state(driver)["occupancy.now"].data {
        TensorData::U64(words) => words.to_vec(),
        TensorData::F32(_) => panic!("words"),
    };
    let alike = |words: &[u64]| words.chunks(words.len() / TIME_STEPS).all(|bin| *bin == words[..bin.len()]);
    // Everything moves.
    update(&mut driver, 0..6);
    assert!(!alike(&found(&driver)));
    // Nothing does.
    driver.field.moving.as_mut().unwrap().cells = MovingCells::none();
    update(&mut driver, 6..PERIOD);
    update(&mut driver, PERIOD..PERIOD + 6);
    let words = found(&driver);
    assert!(alike(&words) && words.iter().any(|word| *word != 0));
}

#[test]
fn cells_in_which_something_moves_are_opened_for_all_times() {
    let mut driver = flash(true);
    let counts = |driver: &RaySystem| visible(driver).iter().map(CellBits::count).collect::<Vec<u64>>();
    update(&mut driver, 0..5 * PERIOD);
    let occupancy = driver.sampler.occupancy_mut().unwrap();
    let cells = occupancy.grid.cells() as u64;
    let usual: Vec<u64> = (0..TIME_STEPS).map(|k| if is_near(k) { cells } else { 0 }).collect();
    occupancy.reopen(&MovingCells::everywhere(), &driver.space);
    assert_eq!(counts(&driver), [cells; TIME_STEPS]);
    update(&mut driver, 5 * PERIOD..7 * PERIOD - 1);
    assert_eq!(counts(&driver), [cells; TIME_STEPS], "until the next period is over");
    update(&mut driver, 7 * PERIOD - 1..7 * PERIOD);
    assert_eq!(counts(&driver), usual);
}
