//! The gradient of a step as wired, from pixels to every learned number, against differences of the loss in f64.

use super::budget_tests::{biased, randomised_moving, randomised_with, small, table};
use super::moving_tests::{filmed, filmed_in};
use super::scene_flow::{Film, FlowConfig, FramePriors};
use super::step::Plan;
use super::{HeadConfig, MixtureKind, MovingConfig, MovingSettings, RayConfig, RaySystem};
use crate::fields::{FeatureSource, HashGridSettings, NetworkConfig, VoxelSettings, fold_gradients};
use crate::papers::dynamic::{dynamic_nerf, k_planes, nsff};
use crate::photo_model::{Codes, PhotoModel, Pixel, PixelBar};
use crate::plan::{HASH_GRID, NewFlow};
use crate::settings::Settings;
use crate::space::SpaceKind;
use crate::terms::TermConfig;
use crate::warps::made::MadeSettings;
use crate::warps::{Motion, TimeKind, Times};
use engine::data::{Dataset, View};
use engine::options::RunOptions;
use field_core::rng::Rng;
use scene_io::{BitMask, Disparity, Flow, FlowPrior};
use std::sync::Arc;

/// Photos of the scene.
pub(super) const VIEWS: usize = 3;

/// Codes of each photo, and a loss that every number of a pixel has a part in.
#[derive(Clone)]
pub(super) struct Coded {
    appearance: Vec<f32>,
    transient: Option<Vec<f32>>,
}

impl PhotoModel for Coded {
    fn name(&self) -> &'static str {
        "coded"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        Some(Codes { dims: self.appearance.len() / VIEWS, rows: &self.appearance })
    }

    fn transient(&self) -> Option<Codes<'_>> {
        self.transient.as_ref().map(|rows| Codes { dims: rows.len() / VIEWS, rows })
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let weight = [0.5, 1.0, 0.25][i % 3];
        let e = [0, 1, 2].map(|c| pixel.rgb[c] - truth[c]);
        let squares: f32 = e.iter().map(|e| e * e).sum();
        let loss = weight * squares + 0.3 * pixel.beta * pixel.beta + 0.2 * pixel.sigma_t;
        (loss, PixelBar { rgb: e.map(|e| 2.0 * weight * e), beta: 0.6 * pixel.beta, sigma_t: 0.2 })
    }
}

pub(super) fn coded(transient: bool) -> Coded {
    let row = |k: usize| ((5 * k + 3) % 7) as f32 / 7.0 - 0.4;
    Coded {
        appearance: (0..2 * VIEWS).map(row).collect(),
        transient: transient.then(|| (0..3 * VIEWS).map(row).collect()),
    }
}

/// A field of few numbers, none of whose samples is left out.
pub(super) fn tiny(kind: SpaceKind) -> RayConfig {
    let mut config = small(kind);
    config.features =
        Arc::new(HashGridSettings { levels: 2, features: 2, log2_table: 6, n_min: 2, n_max: 5, ..HASH_GRID });
    config.networks = NetworkConfig { width: 8, geometry: 5, sh_degree: 2, ..biased(kind, -1.0).networks };
    (config.batch.train_stop, config.batch.train_faint) = (0.0, 0.0);
    (config.batch.batch_rays, config.batch.batch_samples) = (64, 1500);
    config
}

pub(super) const TERMS: TermConfig =
    TermConfig { distortion: 0.3, sparsity: 0.05, background_entropy: 0.2, point_colour: 0.0 };

/// Learned numbers by name.
type Groups = Vec<(&'static str, Vec<f32>)>;

/// The loss of the batch that was drawn, mean over the pixels that count; the chunks hold the gradients afterwards.
pub(super) fn loss(driver: &mut RaySystem, plan: &Plan) -> f64 {
    driver.each_chunk(plan, |chunk, ctx, pixels| {
        chunk.sample(ctx, pixels.clone());
        chunk.learn(ctx, pixels);
    });
    driver.learn_flow(plan);
    driver.work.chunks.iter().map(|chunk| chunk.stats.loss).sum::<f64>() * f64::from(plan.share)
}

/// Gradients as a step folds them.
fn gradients(driver: &mut RaySystem, plan: &Plan) -> Groups {
    loss(driver, plan);
    let (field, chunks) = (&driver.field, &driver.work.chunks);
    let mut features = vec![0.0; field.features.parameters().len()];
    chunks.iter().for_each(|chunk| field.features.scatter(&chunk.part(&*field.features), &mut features));
    let mut packed = Vec::new();
    let mut of = |mlp, len, grads: Vec<&[f32]>| {
        let mut out = vec![0.0; len];
        fold_gradients(mlp, grads.into_iter(), &mut packed, &mut out);
        out
    };
    let density =
        of(field.density.mlp(), field.density_params.len(), chunks.iter().map(|c| &c.density_grad[..]).collect());
    let colour = of(field.colour.mlp(), field.colour_params.len(), chunks.iter().map(|c| &c.colour_grad[..]).collect());
    let mut out = vec![("features", features), ("density network", density), ("colour network", colour)];
    if let Some(head) = &driver.head {
        let grads = chunks.iter().map(|c| &c.head_grad[..]).collect();
        out.push(("transient head", of(&head.mlp, head.params.len(), grads)));
    }
    if let Some(part) = &field.moving {
        let in_place = part.features.pulls_in_place();
        let mut features = vec![0.0; part.features.parameters().len()];
        for chunk in chunks {
            part.features.scatter(&chunk.moving_bars.part(in_place, &chunk.moving), &mut features);
            chunk.flow.parts(in_place).for_each(|flow| part.features.scatter(&flow, &mut features));
        }
        let grads = chunks.iter().map(|c| &c.moving_bars.network[..]).collect();
        let network = of(&part.network, part.params.len(), grads);
        out.extend([("moving features", features), ("moving network", network)]);
    }
    let views = &driver.work.inputs.batch.view;
    for (name, transient) in [("appearance codes", false), ("transient codes", true)] {
        let Some(photo_model) = &driver.photo_model else { continue };
        let Some(codes) = (if transient { photo_model.transient() } else { photo_model.appearance() }) else {
            continue;
        };
        let mut bars = vec![0.0; codes.rows.len()];
        let of = |chunk: &super::chunk::Chunk| {
            if transient { chunk.transient_bar.clone() } else { chunk.appearance_bar.clone() }
        };
        let rays: Vec<f32> = chunks.iter().flat_map(of).collect();
        for (r, row) in rays.chunks_exact(codes.dims).enumerate() {
            let view = views[r / plan.per_pixel] as usize;
            row.iter().enumerate().for_each(|(k, bar)| bars[view * codes.dims + k] += bar);
        }
        out.push((name, bars));
    }
    out
}

/// Add to number `i` of a group.
fn shift(driver: &mut RaySystem, photo_model: &mut Coded, group: &str, i: usize, by: f32) {
    match group {
        "features" => driver.field.features.parameters_mut()[i] += by,
        "density network" => driver.field.density_params[i] += by,
        "colour network" => driver.field.colour_params[i] += by,
        "moving features" => driver.field.moving.as_mut().unwrap().features.parameters_mut()[i] += by,
        "moving network" => driver.field.moving.as_mut().unwrap().params[i] += by,
        "transient head" => driver.head.as_mut().unwrap().params[i] += by,
        "deformation" | "times" => driver.field.deform_mut().unwrap().shift(group == "times", i, by),
        "appearance codes" => photo_model.appearance[i] += by,
        "transient codes" => photo_model.transient.as_mut().unwrap()[i] += by,
        other => panic!("{other} has no numbers"),
    }
    driver.field.pack();
    driver.head.iter_mut().for_each(|head| head.pack());
    driver.field.moving.iter_mut().for_each(|part| part.pack());
    if driver.photo_model.is_some() {
        driver.photo_model = Some(Box::new(photo_model.clone()));
    }
}

/// Numbers of a group that are checked at most, spread evenly.
const CHECKED: usize = 60;

fn check(config: RayConfig, photo_model: Option<Coded>, data: &Dataset) {
    let boxed = photo_model.clone().map(|photo_model| Box::new(photo_model) as Box<dyn PhotoModel>);
    check_driver(randomised_with(config, 5, boxed), photo_model, data);
}

fn check_driver(mut driver: RaySystem, photo_model: Option<Coded>, data: &Dataset) {
    let mut photo_model = photo_model.unwrap_or_else(|| coded(false));
    let has_flow = driver.config.moving.as_ref().is_some_and(|moving| moving.flow.is_some());
    if has_flow {
        driver.set_film(Film::with(data, known(data)));
    }
    let per_pixel = (driver.config.batch.rays_per_side * driver.config.batch.rays_per_side) as usize;
    driver.rays = 48;
    driver.draw(data, 3, per_pixel).unwrap();
    let counted: f32 = driver.work.inputs.batch.weight.iter().sum();
    let plan = Plan { step: 3, per_pixel, share: 1.0 / counted.max(1.0), by_ray: false };
    let groups = gradients(&mut driver, &plan);
    for (group, gradient) in groups {
        // Colours of samples teach colours alone: the weights of the samples are held, as published.
        if driver.config.terms.point_colour > 0.0 && group != "colour network" {
            continue;
        }
        // The still part is held where scene flow looks at it.
        if has_flow && ["features", "density network"].contains(&group) {
            continue;
        }
        check_group(&mut driver, &mut photo_model, &plan, group, &gradient);
    }
}

/// Compare the gradient of a group with differences of the loss, number by number.
pub(super) fn check_group(driver: &mut RaySystem, photo_model: &mut Coded, plan: &Plan, group: &str, gradient: &[f32]) {
    let largest = gradient.iter().fold(0.0_f32, |m, g| m.max(g.abs()));
    assert!(largest > 1e-4, "{group}: nothing is learnt ({largest})");
    let mut kinks = 0;
    let learning: Vec<usize> = (0..gradient.len()).filter(|&i| gradient[i] != 0.0).collect();
    let chosen = learning.iter().copied().step_by(learning.len().div_ceil(CHECKED)).chain([0]);
    let mut checked = 0;
    for i in chosen {
        let mut slope = |h: f32| {
            shift(driver, photo_model, group, i, h);
            let above = loss(driver, plan);
            shift(driver, photo_model, group, i, -2.0 * h);
            let below = loss(driver, plan);
            shift(driver, photo_model, group, i, h);
            (above - below) / f64::from(2.0 * h)
        };
        let (wide, narrow) = (slope(4e-3), slope(2e-3));
        checked += 1;
        // A rectified unit that switches on between the two has no derivative to compare with.
        if (wide - narrow).abs() > 1e-2 * f64::from(largest) {
            kinks += 1;
            continue;
        }
        let off = (narrow - f64::from(gradient[i])).abs();
        assert!(
            off < 1e-2 * f64::from(largest),
            "{group} {i} of {}: differences say {narrow}, the gradient {} of at most {largest}",
            gradient.len(),
            gradient[i]
        );
    }
    assert!(4 * kinks < checked.max(4), "{group}: {kinks} of {checked} at kinks");
}

#[test]
fn of_pixels_alone() {
    check(tiny(SpaceKind::Box), None, &table().1);
}

#[test]
fn of_pixels_of_four_rays_with_a_huber_loss_in_contracted_space() {
    let mut config = tiny(SpaceKind::Contracted);
    (config.batch.rays_per_side, config.batch.huber) = (2, 0.1);
    check(config, None, &table().1);
}

#[test]
fn of_each_term_over_rays_and_of_all_of_them() {
    let (_, data) = table();
    let alone = [
        TermConfig { distortion: 2.0, ..TermConfig::default() },
        TermConfig { sparsity: 2.0, ..TermConfig::default() },
        TermConfig { background_entropy: 2.0, ..TermConfig::default() },
        TermConfig { point_colour: 2.0, ..TermConfig::default() },
        TERMS,
    ];
    for terms in alone {
        check(RayConfig { terms, ..tiny(SpaceKind::Box) }, None, &data);
    }
}

#[test]
fn of_appearance_codes_and_the_transient_head_with_its_first_sample() {
    let (_, data) = table();
    check(tiny(SpaceKind::Box), Some(coded(false)), &data);
    for mixture in [MixtureKind::Paper, MixtureKind::Proportional] {
        let mut config = tiny(SpaceKind::Box);
        config.head = Some(HeadConfig { head_width: 8, head_bias: -1.0, mixture });
        check(config.clone(), Some(coded(true)), &data);
        config.terms = TERMS;
        check(config, Some(coded(true)), &data);
    }
}

#[test]
fn of_appearance_codes_of_a_scene_that_moves() {
    let film = filmed_in(8, VIEWS);
    let mut made = MadeSettings::of_time(TimeKind::Codes, 0, 2);
    made.warp.motion = Motion::Rigid;
    let mut deform = made.deform(Times::of(&film), 1);
    deform.randomise(1.0);
    let boxed: Box<dyn PhotoModel> = Box::new(coded(false));
    let driver = randomised_moving(tiny(SpaceKind::Box), 5, Some(boxed), Some(deform));
    check_driver(driver, Some(coded(false)), &film);
}

#[test]
fn of_voxels() {
    let mut config = tiny(SpaceKind::Box);
    config.features = Arc::new(VoxelSettings { voxels: 8, voxels_every: 1.0, features: 2, voxel_variation: 0.0 });
    check(config, None, &table().1);
}

/// A part for what moves behind these features; nothing is looked for.
pub(super) fn with_moving_part(config: RayConfig, features: Arc<dyn FeatureSource>) -> RayConfig {
    let settings = MovingSettings { moving_from: 1.0, moving_share: 0.0, moving_entropy: 0.0 };
    RayConfig { moving: Some(MovingConfig::new(features, settings)), ..config }
}

#[test]
fn of_a_still_part_and_a_moving_one_in_one_ray() {
    let film = filmed(8);
    let still = tiny(SpaceKind::Box);
    check(with_moving_part(still.clone(), planes(&film, "hybrid").features), None, &film);
    let mut config = with_moving_part(still.clone(), still.features);
    config.terms = TermConfig { sparsity: 0.5, ..TermConfig::default() };
    check(config, None, &film);
}

/// Priors of all kinds: a steady flow, disparities that nothing has, and masks of the left half.
pub(super) fn known(data: &Dataset) -> Vec<FramePriors> {
    let of = |view: &View| {
        let (width, height) = (view.camera.width, view.camera.height);
        let flow = |vector: [f32; 2]| Flow {
            width,
            height,
            vectors: vec![vector; (width * height) as usize],
            seen: BitMask::from_fn(width, height, |x, _| x > 0),
        };
        let values = (0..width * height).map(|i| ((7 * i) % 11) as f32).collect();
        FramePriors {
            flow: FlowPrior { forward: Some(flow([0.7, -0.4])), backward: Some(flow([-1.1, 0.3])) },
            disparity: Disparity::new(width, height, values),
            moves: Some(BitMask::from_fn(width, height, |x, _| 2 * x < width)),
        }
    };
    data.views().iter().map(of).collect()
}

/// A still part, and a moving one with scene flow and all that it costs.
pub(super) fn with_scene_flow(data: &Dataset, flow: NewFlow, hides: bool) -> RayConfig {
    let mut set = toml::Table::new();
    for (name, value) in [
        ("flow_share", 1.0),
        ("flow_disparity", 0.3),
        ("flow_renders", 1.0),
        ("flow_order", 0.3),
        ("flow_mask", 0.3),
        ("flow_entropy", 0.1),
    ] {
        set.insert(name.into(), value.into());
    }
    // Two frames are looked at, too.
    set.insert("flow_chain_from".into(), 0.0.into());
    for name in ["flow_cycle", "flow_optical", "flow_small", "flow_spatial", "flow_steady", "flow_still"] {
        set.insert(name.into(), 0.05.into());
    }
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
    let mut settings = Settings::new(&run);
    let flow = flow(&mut settings).unwrap();
    settings.all().unwrap();
    let mut config = with_moving_part(tiny(SpaceKind::Box), planes(data, "hybrid").features);
    config.moving = config.moving.map(|moving| moving.with_flow(FlowConfig { hides, ..flow }));
    config
}

#[test]
fn of_scene_flow_and_what_it_costs() {
    let film = filmed(8);
    // What is hidden is left out: the weights that it is believed by are held. Its own gradient is checked with the terms.
    check(with_scene_flow(&film, nsff::flow, false), None, &film);
    check(with_scene_flow(&film, dynamic_nerf::flow, false), None, &film);
}

#[test]
fn parts_of_a_batch_add_up() {
    // What a chunk brings to the gradient is what a step folds: no sample twice, none left out.
    let mut driver = randomised_with(tiny(SpaceKind::Box), 5, None);
    driver.rays = 48;
    driver.draw(&table().1, 3, 1).unwrap();
    let plan = Plan { step: 3, ..Plan::PICTURE };
    loss(&mut driver, &plan);
    let features = &*driver.field.features;
    let samples: usize = driver.work.chunks.iter().map(|chunk| chunk.part(features).places.len()).sum();
    let placed: u64 = driver.work.chunks.iter().map(|chunk| chunk.stats.placed).sum();
    assert!(samples > 100 && samples as u64 == placed, "{samples} of {placed}");
    let mut all = vec![0.0; features.parameters().len()];
    let mut sum = all.clone();
    for chunk in &driver.work.chunks {
        let part = chunk.part(features);
        let mut one = vec![0.0; all.len()];
        features.scatter(&part, &mut one);
        features.scatter(&part, &mut all);
        sum.iter_mut().zip(one).for_each(|(sum, one)| *sum += one);
    }
    for (a, b) in all.iter().zip(sum) {
        assert!((a - b).abs() <= 1e-5 * a.abs().max(1e-3), "{a} {b}");
    }
}

/// Few planes for the times of a dataset, and small networks or linear maps behind them.
pub(super) fn planes(data: &Dataset, decoder: &str) -> RayConfig {
    let mut config = tiny(SpaceKind::Box);
    k_planes::field(&mut config, data);
    config.networks = NetworkConfig { width: 8, colour_layers: 1, ..config.networks };
    let mut set = toml::toml! {
        plane_vertices = 6
        plane_scales = [1, 2]
        plane_features = 3
    };
    set.insert("decoder".into(), decoder.into());
    if decoder == "explicit" {
        set.insert("basis_width".into(), 8.into());
        set.insert("basis_layers".into(), 1.into());
    }
    let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
    let mut settings = Settings::new(&run);
    let config = config.asked(&mut settings).unwrap();
    settings.all().unwrap();
    config
}

#[test]
fn of_planes_of_space_and_of_planes_of_time() {
    for decoder in ["hybrid", "explicit"] {
        let (_, still) = table();
        check(planes(&still, decoder), None, &still);
        let film = filmed(8);
        let config = planes(&film, decoder);
        assert!(!config.features.features(Rng::new(0, 0)).unwrap().view_times().is_empty());
        check(config, None, &film);
    }
}

#[test]
fn of_linear_maps_with_codes_terms_and_four_rays_a_pixel() {
    let (_, still) = table();
    let mut config = planes(&still, "explicit");
    // A basis of rectified units has more kinks in codes, which all samples share, than differences can step over.
    config.decoder.iter_mut().for_each(|choice| choice.explicit.basis_layers = 0);
    config.terms = TERMS;
    config.batch.rays_per_side = 2;
    check(config.clone(), Some(coded(false)), &still);
    config.batch.rays_per_side = 1;
    config.head = Some(HeadConfig { head_width: 8, head_bias: -1.0, mixture: MixtureKind::Paper });
    check(config, Some(coded(true)), &still);
}
