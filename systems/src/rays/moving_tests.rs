//! The field of a scene that moves: what is full now and then stays in sight, and finer voxels show the same scene.

use super::budget_tests::small;
use super::budget_tests::{biased, occupancy};
use super::{RayConfig, RaySystem};
use crate::fields::VoxelSettings;
use crate::samplers::OccupancyConfig;
use crate::schedule::{Course, Done};
use crate::space::{Space, SpaceKind};
use crate::warps::made::MadeSettings;
use crate::warps::{DensitySettings, Sees, TimeKind, Times};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::{Query, System, TensorData, TensorMap};
use glam::DVec3;
use render_core::ray::Ray;
use scene_io::synthetic::{OrbitOptions, orbit};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

pub(super) const TIME_STEPS: usize = 20;

/// A photo of each time step.
pub(super) fn filmed(side: u32) -> Dataset {
    filmed_in(side, TIME_STEPS)
}

/// A photo of each of so many time steps.
pub(super) fn filmed_in(side: u32, train: usize) -> Dataset {
    views(&stage_in(side, train))
}

/// A stage of which a photo of each of so many time steps is taken.
pub(super) fn stage_in(side: u32, train: usize) -> Scene {
    orbit(&OrbitOptions { width: side, height: side, train, test: 0, rays: 1, ..OrbitOptions::default() })
}

/// The training views of a scene.
pub(super) fn views(scene: &Scene) -> Dataset {
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(scene, store, scene.split(Split::Train).collect()).unwrap()
}

fn of(config: RayConfig, data: &Dataset, time: MadeSettings) -> RaySystem {
    let density = DensitySettings { sees: Sees::Time, ..time.density };
    let deform = MadeSettings { density, ..time }.deform(Times::of(data), 1);
    let space = Space::boxed(DVec3::new(0.0, 0.0, 0.3), 1.2, 0.05);
    RaySystem::new(config, space, Background::White, 1, "ngp", None, Some(deform)).unwrap()
}

/// A field that is full everywhere at one time step of [`TIME_STEPS`], or at none, and empty at all others: the density is that of the
/// time step's code.
pub(super) fn flash(full: bool) -> RaySystem {
    flash_in(full, TIME_STEPS)
}

/// [`flash`] with this many bins of time.
pub(super) fn flash_in(full: bool, occupancy_times: usize) -> RaySystem {
    let mut config = biased(SpaceKind::Box, -8.0);
    let grid = occupancy(&mut config);
    *grid = OccupancyConfig { occupancy: 16, occupancy_every: 1, occupancy_settle: 1, occupancy_times, ..*grid };
    let mut driver = of(config, &filmed(4), MadeSettings::of_time(TimeKind::Codes, 0, 1));
    let mut state: TensorMap = driver.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
    let mut write = |name: &str, values: &[(usize, f32)]| match &mut state.get_mut(name).unwrap().data {
        TensorData::F32(data) => {
            data.to_mut().fill(0.0);
            values.iter().for_each(|&(i, value)| data.to_mut()[i] = value);
        }
        TensorData::U64(_) => panic!("{name} holds counters"),
    };
    write("deform.moments", &[(7, if full { 1.0 } else { 1e-3 })]);
    // The first hidden unit takes the last input, which is the code; the first output is the log-density.
    let layers = driver.field.density.mlp().layers();
    let code = layers[0].weights.start + driver.field.density.inputs() - 1;
    write("field.density", &[(code, 1.0), (layers[1].weights.start, 10.0)]);
    driver.load_state(&state).unwrap();
    driver
}

/// Share of the occupancy grid's cells that count as empty, the worst of many updates after the grid has settled.
fn lost(mut driver: RaySystem) -> f64 {
    let mut worst = 0.0_f64;
    for step in 0..400 {
        let occupancy = driver.sampler.occupancy_mut().unwrap();
        occupancy.update(&driver.field, &driver.space, driver.seed, step);
        if step >= 100 {
            let grid = &occupancy.grid;
            let full: u32 = grid.bits().iter().map(|word| word.count_ones()).sum();
            worst = worst.max(1.0 - f64::from(full) / grid.cells() as f64);
        }
    }
    worst
}

#[test]
fn a_cell_that_is_full_at_one_time_step_in_twenty_stays_in_sight() {
    let driver = flash(true);
    let at = |k: usize| {
        let mut out = [0.0];
        driver.density(&[[0.1, 0.2, 0.3]], k as f64 / (TIME_STEPS - 1) as f64, &mut out);
        out[0]
    };
    assert!(at(7) > 5.0 && at(3) < 1e-2 && at(19) < 1e-2, "{} {} {}", at(7), at(3), at(19));
    assert_eq!(lost(driver), 0.0, "a cell is lost");
    assert!(lost(flash(false)) > 0.85, "what is never full is empty");
}

/// What an orbiting camera sees of a field at a time.
fn shown(driver: &RaySystem, data: &Dataset, time: f64) -> Vec<f32> {
    let query = Query { time, ..engine::render::plain_query([1.0; 3], 0.0) };
    let rays: Vec<Ray> = data.view(3).rays(0..24).flatten().collect();
    driver.render(&rays, &query).rgb.into_flattened()
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

#[test]
fn finer_voxels_show_the_same_scene() {
    let data = filmed(24);
    let mut config = small(SpaceKind::Box);
    config.features = Arc::new(VoxelSettings { voxels: 24, voxels_every: 0.3, features: 4, voxel_variation: 0.0 });
    config.rates.lr = 1e-2;
    (config.batch.batch_rays, config.batch.batch_samples) = (512, 1 << 13);
    let mut driver = of(config, &data, MadeSettings::of_time(TimeKind::Time, 2, 1));
    let nothing_yet = shown(&driver, &data, 0.5);
    for step in 0..60 {
        driver.step(&data, step).unwrap();
    }
    let before = shown(&driver, &data, 0.5);
    let learnt = distance(&nothing_yet, &before);
    for doublings in 1..=3_u8 {
        let params = driver.field.features.parameters().len();
        driver.field.features.refine(Done::of_share(0.3 * f64::from(doublings)));
        let more = driver.field.features.parameters().len() as f64 / params as f64;
        assert!((1.5..2.6).contains(&more), "doubling {doublings}: {more} times as many");
        let off = distance(&before, &shown(&driver, &data, 0.5));
        println!("doubling {doublings}: {off:.4} of {learnt:.4}");
        // The wider distances shrink with the voxels: the picture is not the same, but it is not forgotten.
        assert!(doublings > 1 || off < 0.75 * learnt, "the picture changes by {off}, and {learnt} was learnt");
    }
    let params = driver.field.features.parameters().len();
    driver.field.features.refine(Done::of_share(1.0));
    assert_eq!(driver.field.features.parameters().len(), params, "three times and no more");
    // It learns on, from the end of its schedule.
    driver.course = Course::new(1);
    for step in 60..64 {
        assert!(driver.step(&data, step).unwrap().nonfinite == 0);
    }
}
