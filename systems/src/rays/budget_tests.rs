//! Renders against the full sum, over random fields, occupancy grids, spaces and rays.

use super::render::render_trial;
use super::{RayConfig, RaySystem};
use crate::fields::{Columns, HashGridSettings};
use crate::photo_model::PhotoModel;
use crate::plan::{Ground, HASH_GRID, field_settings};
use crate::samplers::{OccupancyConfig, ProposalField, Sampler};
use crate::space::{Space, SpaceConfig, SpaceKind};
use crate::warps::Deform;
use engine::data::Dataset;
use engine::eval::skips::{MeasuredSkips, measure};
use engine::halt::Halt;
use engine::options::{Background, RunOptions};
use engine::system::{Appearance, EmptyCells, LayerRequest, Layers, Normals, Query, System, Trial};
use field_core::rng::Rng;
use glam::DVec3;
use proptest::prelude::*;
use render_core::budget::{Skip, SkipSet};
use render_core::occupancy::OccupancyGrid;
use render_core::ray::Ray;
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;

const RAYS: usize = 24;

/// A scene of a few pixels, and its training views.
pub(super) fn table() -> (Scene, Dataset) {
    let options = TabletopOptions { width: 8, height: 8, train: 3, test: 1, rays: 1, ..TabletopOptions::default() };
    let scene = tabletop(&options);
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    let data = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    (scene, data)
}

/// The settings of the occupancy grid.
pub(super) fn occupancy(config: &mut RayConfig) -> &mut OccupancyConfig {
    config.occupancy_mut().expect("an occupancy grid")
}

/// A hash grid so small that the full sum is quick.
const SMALL: HashGridSettings = HashGridSettings { levels: 4, log2_table: 10, n_min: 4, n_max: 32, ..HASH_GRID };

/// Settings of a field so small that the full sum is quick.
pub(super) fn small(kind: SpaceKind) -> RayConfig {
    let (scene, data) = table();
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: Default::default() };
    let mut config = field_settings(&mut Ground::of(&scene, &data, &run).unwrap(), &data);
    let contracted = kind == SpaceKind::Contracted;
    let cascades = if contracted { 3 } else { 1 };
    config.space = SpaceConfig { space: kind, centre: [0.0; 3], radius: 1.0, near: 0.01, cascades };
    config.features = Arc::new(SMALL);
    config.networks.width = 16;
    let grid = occupancy(&mut config);
    *grid = OccupancyConfig {
        occupancy: 16,
        step_min: 0.04,
        step_cone: if contracted { 0.04 } else { 0.0 },
        sky: contracted,
        ..*grid
    };
    config
}

/// The same with another bias of the log-density.
pub(super) fn biased(kind: SpaceKind, density_bias: f32) -> RayConfig {
    let mut config = small(kind);
    config.networks.density_bias = density_bias;
    config
}

/// A field of random parameters: from mist to walls, with cells that count as empty and cells the cameras rule out.
fn random_field(seed: u64, kind: SpaceKind, density_bias: f32) -> RaySystem {
    randomised(biased(kind, density_bias), seed)
}

/// Random parameters for these settings.
pub(super) fn randomised(config: RayConfig, seed: u64) -> RaySystem {
    randomised_with(config, seed, None)
}

/// Random parameters for these settings and a photo model.
pub(super) fn randomised_with(config: RayConfig, seed: u64, photo_model: Option<Box<dyn PhotoModel>>) -> RaySystem {
    randomised_moving(config, seed, photo_model, None)
}

/// The same with a deformation, whose parameters stay as they are.
pub(super) fn randomised_moving(
    config: RayConfig,
    seed: u64,
    photo_model: Option<Box<dyn PhotoModel>>,
    deform: Option<Deform>,
) -> RaySystem {
    let kind = config.space.space;
    let space = match kind {
        SpaceKind::Contracted => Space::contracted(DVec3::ZERO, 1.0, 4.0, 0.01),
        _ => Space::boxed(DVec3::ZERO, 1.0, 0.01),
    };
    let mut driver = RaySystem::new(config, space, Background::White, seed, "ngp", photo_model, deform).unwrap();
    let uniform = |stream: u64, i: usize| Rng::new(seed, stream).uniform_at(i as u64);
    for (i, x) in driver.field.features.parameters_mut().iter_mut().enumerate() {
        *x = 4.0 * (uniform(1, i) - 0.5);
    }
    for (i, x) in driver.field.density_params.iter_mut().enumerate() {
        *x = 3.0 * (uniform(2, i) - 0.5);
    }
    for (i, x) in driver.field.colour_params.iter_mut().enumerate() {
        *x = 3.0 * (uniform(3, i) - 0.5);
    }
    driver.field.pack();
    if driver.movers.is_some() {
        driver.move_everywhere();
    }
    for proposal in proposals(&mut driver) {
        for (i, x) in proposal.features.parameters_mut().iter_mut().enumerate() {
            *x = 4.0 * (uniform(5, i) - 0.5);
        }
        for (i, x) in proposal.mlp_params.iter_mut().enumerate() {
            *x = 3.0 * (uniform(6, i) - 0.5);
        }
        proposal.pack();
    }
    if let Some(occupancy) = driver.sampler.occupancy_mut() {
        occupancy.stretch = 1.0;
        let grid = &occupancy.grid;
        let thickness: Vec<f32> = (0..grid.cells())
            .map(|i| match uniform(4, i) {
                u if u < 0.1 => -1.0,
                u if u < 0.5 => 0.0,
                _ => 1.0,
            })
            .collect();
        occupancy.grid = OccupancyGrid::from_state(grid.settings(), &thickness, 1).unwrap();
    }
    driver
}

/// The proposals' fields; none where an occupancy grid places samples.
pub(super) fn proposals(driver: &mut RaySystem) -> &mut [ProposalField] {
    match &mut driver.sampler {
        Sampler::Occupancy(_) => &mut [],
        Sampler::Proposals(proposals) => &mut proposals.fields,
    }
}

/// Rays from in and around the scene.
pub(super) fn random_rays(seed: u64) -> Vec<Ray> {
    let rng = Rng::new(seed, 9);
    let v = |i: usize| DVec3::from([0, 1, 2].map(|a| f64::from(rng.uniform_at(3 * i as u64 + a)) - 0.5));
    let ray = |i: usize| {
        let (o, target) = (5.0 * v(2 * i), 2.0 * v(2 * i + 1));
        Ray { o, d: (target - o).try_normalize().unwrap_or(DVec3::Z) }
    };
    (0..RAYS).map(ray).collect()
}

pub(super) fn query(background: [f32; 3], error_budget: f32) -> Query {
    Query {
        background,
        layers: LayerRequest::default(),
        error_budget,
        appearance: Appearance::Mean,
        time: 0.0,
        halt: Halt::NEVER,
    }
}

/// The sum over all samples of a ray, one at a time, straight from the definition.
fn naive(driver: &RaySystem, ray: &Ray, background: [f32; 3], empty: EmptyCells) -> [f32; 3] {
    let (field, ray) = (&driver.field, driver.space.internal_ray(ray));
    let occupancy = driver.sampler.occupancy().unwrap();
    let marcher = occupancy.marcher();
    let all = OccupancyGrid::new(occupancy.grid.settings()).unwrap();
    let (mut samples, mut occupied) = (Vec::new(), Vec::new());
    marcher.march(&all, &ray, 0.5, |t, dt| samples.push((t, dt)));
    marcher.march(&occupancy.grid, &ray, 0.5, |t, _| occupied.push(t));
    let (mut depth, mut rgb) = (0.0_f64, [0.0_f64; 3]);
    for (t, dt) in samples {
        let p = ray.at(t);
        if empty == EmptyCells::Nothing && !occupied.contains(&t) {
            continue;
        }
        let mut x = [0.0; 3];
        driver.space.grid_positions(field.simd, &p, &mut x);
        let mut features = vec![0.0; field.features.rows()];
        field.features.encode(crate::fields::Places::still(&x), &mut features, &mut Vec::new());
        let mut input = vec![0.0; field.colour.inputs()];
        let mut scratch = vec![0.0; field.density.infer_scratch_len().max(field.colour.infer_scratch_len())];
        field.density.infer(field.simd, &field.density_packed, &features, 1, 1, &mut input, 1, &mut scratch);
        let tau = field.density_of(input[0]) * dt;
        field.harmonics.encode(field.simd, &ray.view, &mut input[field.density.outputs()..]).unwrap();
        let mut colour = [0.0; 3];
        field.colour.infer(field.simd, &field.colour_packed, &input, 1, Columns::Each, &mut colour, &mut scratch);
        let w = (-depth).exp() as f32 * -(-tau).exp_m1();
        for (sum, c) in rgb.iter_mut().zip(colour) {
            *sum += f64::from(w) * f64::from(c);
        }
        depth += f64::from(tau);
    }
    [0, 1, 2].map(|c| (rgb[c] + (-depth).exp() * f64::from(background[c])) as f32)
}

fn kinds() -> impl Strategy<Value = SpaceKind> {
    prop_oneof![Just(SpaceKind::Box), Just(SpaceKind::Contracted)]
}

pub(super) fn largest_difference(a: &Layers, b: &Layers) -> f32 {
    let channels = |l: &Layers| l.rgb.iter().flatten().copied().collect::<Vec<f32>>();
    channels(a).into_iter().zip(channels(b)).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

proptest! {
    #![proptest_config(testkit::property::cases(12))]

    #[test]
    fn a_budget_of_0_is_the_full_sum_bit_for_bit(
        seed in any::<u64>(), kind in kinds(), bias in -3.0..4.0_f32, background in [0.0..1.0_f32, 0.0..1.0, 0.0..1.0],
    ) {
        let (driver, rays) = (random_field(seed, kind, bias), random_rays(seed));
        let (layers, ledger) = render_trial(&driver, &rays, &query(background, 0.0), &Trial::USUAL);
        for (rgb, ray) in layers.rgb.iter().zip(&rays) {
            prop_assert_eq!(*rgb, naive(&driver, ray, background, EmptyCells::Nothing));
        }
        for skip in Skip::ALL {
            prop_assert_eq!((ledger.entry(skip).skipped, ledger.entry(skip).spent()), (0, 0.0));
        }
        // Allowing the skips by name does not help where there is no budget; forbidding them is the same as no budget.
        let forbidden = Trial { skips: SkipSet::NONE, ..Trial::USUAL };
        prop_assert_eq!(&render_trial(&driver, &rays, &query(background, 0.1), &forbidden).0.rgb, &layers.rgb);
    }

    #[test]
    fn the_picture_stays_inside_its_budget(
        seed in any::<u64>(), kind in kinds(), bias in -3.0..4.0_f32, background in [0.0..1.0_f32, 0.0..1.0, 0.0..1.0],
    ) {
        let (driver, rays) = (random_field(seed, kind, bias), random_rays(seed));
        let full = driver.render(&rays, &query(background, 0.0));
        for eps in [1.0 / 2048.0, 1.0 / 255.0, 1e-2, 0.1] {
            for skips in [SkipSet::ALL, SkipSet::only(Skip::Behind), SkipSet::only(Skip::Faint), SkipSet::only(Skip::Empty)] {
                let trial = Trial { skips, ..Trial::USUAL };
                let (layers, ledger) = render_trial(&driver, &rays, &query(background, eps), &trial);
                let error = largest_difference(&layers, &full);
                prop_assert!(error <= eps, "{error} > {eps}");
                let promised = Skip::ALL.map(|s| ledger.entry(s).most()).iter().sum::<f64>();
                prop_assert!(f64::from(error) <= promised + 5e-7, "{error} > {promised}");
                // Passing over empty cells is exact.
                if skips == SkipSet::only(Skip::Empty) {
                    prop_assert_eq!(&layers.rgb, &full.rgb);
                    prop_assert!(ledger.entry(Skip::Empty).skipped > 0);
                }
            }
        }
    }
}

#[test]
fn what_the_field_holds_in_empty_cells_is_within_its_thickness_of_the_model() {
    for seed in 0..4 {
        let (mut driver, rays) = (random_field(seed, SpaceKind::Box, -2.0), random_rays(seed));
        let model = driver.render(&rays, &query([1.0; 3], 0.0));
        let field = Trial { skips: SkipSet::NONE, empty: EmptyCells::Field };
        let (seen, ledger) = render_trial(&driver, &rays, &query([1.0; 3], 0.0), &field);
        let (error, bound) = (largest_difference(&seen, &model), ledger.entry(Skip::Empty).most());
        assert!(error > 1e-3 && f64::from(error) <= bound + 1e-6, "{error}, {bound}");
        // Nothing ruled out: the field everywhere.
        let grid = &mut driver.sampler.occupancy_mut().unwrap().grid;
        let thickness: Vec<f32> = grid.thickness().iter().map(|t| t.max(0.0)).collect();
        *grid = OccupancyGrid::from_state(grid.settings(), &thickness, 1).unwrap();
        let (seen, _) = render_trial(&driver, &rays, &query([1.0; 3], 0.0), &field);
        for (rgb, ray) in seen.rgb.iter().zip(&rays) {
            assert_eq!(*rgb, naive(&driver, ray, [1.0; 3], EmptyCells::Field));
        }
    }
}

#[test]
fn renders_have_the_same_bits_with_1_2_and_4_threads() {
    let driver = random_field(7, SpaceKind::Contracted, 0.0);
    let rays: Vec<Ray> = (0..20).flat_map(random_rays).collect();
    let layers = LayerRequest { normals: Normals::Compute, ..LayerRequest::default() };
    for eps in [0.0, 1.0 / 255.0] {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let query = Query { layers, ..query([0.2, 0.5, 1.0], eps) };
            pool.install(|| render_trial(&driver, &rays, &query, &Trial::USUAL))
        };
        let one = on(1);
        assert!(on(2) == one && on(4) == one);
        // Colours do not depend on what else is asked for, nor on what the rays are rendered with.
        let plain = driver.render(&rays, &query([0.2, 0.5, 1.0], eps));
        assert_eq!(plain.rgb, one.0.rgb);
        assert_eq!(driver.render(&rays[333..334], &query([0.2, 0.5, 1.0], eps)).rgb[0], plain.rgb[333]);
    }
}

#[test]
fn the_measured_table_holds_every_skip_and_keeps_to_the_budget() {
    let (driver, (_, data)) = (random_field(3, SpaceKind::Box, 0.0), table());
    let eps = 1.0 / 255.0;
    let measured = measure(&driver, &data, &query([1.0; 3], eps)).unwrap();
    assert_eq!(measured.rays, 3 * 64);
    let names: Vec<&str> = measured.rows.iter().map(|r| r.what.as_str()).collect();
    let skips = [Skip::Behind, Skip::Faint, Skip::Empty].map(|s| format!("{}, alone", s.name()));
    assert_eq!(names[..3], skips);
    assert!(names.len() == 5 && names[3] == "all together" && names[4].contains("count as empty"), "{names:?}");
    for row in &measured.rows[..4] {
        let [most, mean] = row.error.unwrap();
        assert!(mean <= most && most <= f64::from(eps) && row.skipped > 0 && row.skipped <= row.total, "{row:?}");
        assert!(row.seconds_saved.is_some());
    }
    // Empty cells are passed over exactly; what the field holds in them shows.
    assert_eq!(measured.rows[2].error, Some([0.0, 0.0]));
    assert!(measured.rows[4].error.unwrap()[0] > f64::from(eps));
    let text = serde_json::to_string(&measured).unwrap();
    assert_eq!(serde_json::from_str::<MeasuredSkips>(&text).unwrap().rows.len(), 5);
    assert_eq!(measured.table().lines().count(), 7);
}

#[test]
fn no_rays_are_no_work() {
    let driver = random_field(1, SpaceKind::Box, 0.0);
    assert_eq!(driver.render(&[], &query([0.0; 3], 0.0)), Layers::default());
}
