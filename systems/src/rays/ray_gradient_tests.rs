//! The gradient with respect to rays against differences of the loss: of the same samples on rays that are moved.

use super::budget_tests::{occupancy, proposals, randomised_with, table};
use super::chunk::{Chunk, fill_codes};
use super::context::StepContext;
use super::gradient_tests::{TERMS, VIEWS, coded, planes, tiny};
use super::moving_tests::filmed;
use super::{HeadConfig, MixtureKind, RayConfig, RaySystem, SamplerConfig};
use crate::buffers::sized;
use crate::fields::{HashGridSettings, VoxelSettings, When};
use crate::gradients::differences::Differences;
use crate::gradients::{ByRay, RayTargets};
use crate::photo_model::PhotoModel;
use crate::plan::HASH_GRID;
use crate::samplers::ProposalConfig;
use crate::schedule::Done;
use crate::space::{Space, SpaceKind};
use crate::warps::made::MadeSettings;
use crate::warps::{Deform, Motion, Origin, TimeKind, Times, WarpSettings};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::System;
use glam::{DMat3, DQuat, DVec2, DVec3};
use render_core::camera::{Camera, Lens, Pose};
use render_core::ray::{Ray, RayBar};
use std::ops::Range;

/// Rays that are moved at most, and how many there are in all.
const MOVED: usize = 6;
const RAYS: usize = 40;
/// Of differences: few samples cross a cell's face within it.
const STEP: f64 = 5e-5;

impl Chunk {
    /// Where the samples are at the same distances along other rays.
    fn place_again(&mut self, ctx: &StepContext<'_>, rays: Range<usize>) {
        let (field, n) = (ctx.field, self.n);
        for (old, ray) in self.rays.iter_mut().zip(&ctx.rays[rays.clone()]) {
            let new = ctx.space.internal_ray(ray);
            // Colours see where a ray goes, however long its direction is.
            (old.o, old.d, old.view) = (new.o, new.d, ray.d.normalize().as_vec3().to_array());
        }
        let dims = ctx.appearance.map_or(0, |codes| codes.dims);
        let codes = field.basis(&self.rays, dims, &mut self.views, &mut self.basis);
        if let Some(table) = ctx.appearance {
            fill_codes(table, ctx.batch, rays, 1, codes);
        }
        let mut p = vec![0.0; 3 * n];
        for (ray, ends) in self.rays.iter().zip(self.offsets.windows(2)) {
            for i in ends[0] as usize..ends[1] as usize {
                let at = ray.at(self.t[i]);
                (p[i], p[n + i], p[2 * n + i]) = (at[0], at[1], at[2]);
            }
        }
        let x = &mut self.x[..3 * n];
        ctx.space.grid_positions(field.simd, &p, x);
        if field.deform.is_some() {
            sized(&mut self.was, 3 * n).copy_from_slice(x);
        }
        let when = When { time_steps: field.time_steps(), which: &self.which };
        field.seen(x, when, sized(&mut self.features, field.rows() * n), &mut Default::default());
    }
}

/// The loss of the samples that the last gradient was of, on rays that are elsewhere.
fn loss_of(driver: &mut RaySystem, targets: &RayTargets<'_>) -> f64 {
    let (inputs, plan) = driver.batch_of(targets);
    let mut chunks = std::mem::take(&mut driver.work.chunks);
    let ctx = driver.ray_context(&plan, &inputs);
    let (n, count) = (targets.rays.len(), chunks.len());
    for (c, chunk) in chunks.iter_mut().enumerate() {
        let span = c * n / count..(c + 1) * n / count;
        chunk.stats = Default::default();
        chunk.place_again(&ctx, span.clone());
        chunk.learn(&ctx, span);
    }
    let loss = chunks.iter().map(|chunk| chunk.stats.loss).sum::<f64>() * f64::from(plan.share);
    driver.work.chunks = chunks;
    loss
}

/// Rays, their colours and their views.
struct Shot {
    rays: Vec<Ray>,
    rgb: Vec<[f32; 3]>,
    view: Vec<u32>,
}

impl Shot {
    /// Rays of colours that have nothing to do with them.
    fn new(rays: Vec<Ray>, view: Vec<u32>) -> Self {
        let rgb = (0..rays.len()).map(|i| [0, 1, 2].map(|c| ((5 * i + 3 * c) % 7) as f32 / 7.0)).collect();
        Self { rays, rgb, view }
    }

    /// Rays of the training views.
    fn of(data: &Dataset) -> Self {
        let all: Vec<Vec<Ray>> =
            data.views().iter().map(|view| view.rays(0..view.camera.height).flatten().collect()).collect();
        let (mut rays, mut views) = (Vec::new(), Vec::new());
        for i in 0..RAYS {
            let view = i % all.len();
            rays.push(all[view][(7 * i + 3) % all[view].len()]);
            views.push(view as u32);
        }
        Self::new(rays, views)
    }

    fn targets(&self) -> RayTargets<'_> {
        RayTargets { rays: &self.rays, rgb: &self.rgb, view: &self.view, radii: &[], background: [1.0; 3] }
    }

    /// The loss with component `k` of ray `r` moved, origin first.
    fn loss_at(&self, driver: &mut RaySystem, [r, k]: [usize; 2], by: f64) -> f64 {
        let mut rays = self.rays.clone();
        let ray = &mut rays[r];
        if k < 3 {
            ray.o[k] += by
        } else {
            ray.d[k - 3] += by
        }
        loss_of(driver, &RayTargets { rays: &rays, ..self.targets() })
    }
}

/// Origin and direction of each gradient.
fn flat(bars: &[RayBar]) -> Vec<[f64; 6]> {
    bars.iter().map(|bar| [bar.o.x, bar.o.y, bar.o.z, bar.d.x, bar.d.y, bar.d.z]).collect()
}

/// Compare the gradient with differences, ray by ray.
fn check(mut driver: RaySystem, data: &Dataset) {
    check_shot(&mut driver, &Shot::of(data));
}

fn check_shot(driver: &mut RaySystem, shot: &Shot) {
    let got = driver.ray_gradients(&shot.targets()).unwrap();
    let same = loss_of(driver, &shot.targets());
    assert!((got.loss - same).abs() < 1e-6 * same, "{} {same}: not the same samples", got.loss);
    let bars = flat(&got.bars);
    let largest = bars.iter().flatten().fold(0.0_f64, |m, g| m.max(g.abs()));
    let strong: Vec<usize> = (0..RAYS).filter(|&r| bars[r].iter().any(|g| g.abs() > 0.05 * largest)).collect();
    assert!(largest > 1e-4 && strong.len() >= MOVED, "{largest}, {} rays of some size", strong.len());
    let mut differences = Differences::new(largest, 1e-2);
    for r in strong.iter().copied().step_by(strong.len() / MOVED) {
        for (k, got) in bars[r].into_iter().enumerate() {
            let [above, below] = [STEP, -STEP].map(|h| (shot.loss_at(driver, [r, k], h) - same) / h);
            differences.compare(format_args!("ray {r}, {k}"), got, [above, below], 0.5 * (above + below));
        }
    }
    differences.end();
}

/// A system of random parameters.
fn random(config: RayConfig, photo_model: bool) -> RaySystem {
    randomised_with(config, 5, photo_model.then(|| Box::new(coded(false)) as Box<dyn PhotoModel>))
}

#[test]
fn of_a_hash_grid_in_a_box_and_in_contracted_space() {
    for kind in [SpaceKind::Box, SpaceKind::Contracted] {
        for photo_model in [false, true] {
            check(random(tiny(kind), photo_model), &table().1);
        }
    }
}

#[test]
fn of_a_hash_grid_with_all_terms_a_transient_head_and_levels_that_come_in() {
    let mut config = tiny(SpaceKind::Box);
    config.terms = TERMS;
    check(random(config.clone(), true), &table().1);
    config.head = Some(HeadConfig { head_width: 8, head_bias: -1.0, mixture: MixtureKind::Paper });
    check(randomised_with(config, 5, Some(Box::new(coded(true)))), &table().1);
    let mut config = tiny(SpaceKind::Box);
    let levels = HashGridSettings { levels: 2, features: 2, log2_table: 6, n_min: 2, n_max: 5, ..HASH_GRID };
    config.features = std::sync::Arc::new(HashGridSettings { levels_anneal: 10, levels_first: 1, ..levels });
    let mut driver = random(config, false);
    driver.field.features.refine(Done { steps: 6, share: 0.0 });
    check(driver, &table().1);
}

#[test]
fn of_samples_that_proposals_place() {
    let mut config = tiny(SpaceKind::Box);
    config.sampler = SamplerConfig::Proposals(ProposalConfig { proposal_samples: vec![12], final_samples: 10 });
    let mut driver = random(config, false);
    assert_eq!(proposals(&mut driver).len(), 1);
    check(driver, &table().1);
}

#[test]
fn of_voxels() {
    for photo_model in [false, true] {
        let mut config = tiny(SpaceKind::Box);
        config.features =
            std::sync::Arc::new(VoxelSettings { voxels: 8, voxels_every: 1.0, features: 2, voxel_variation: 0.0 });
        check(random(config, photo_model), &table().1);
    }
}

#[test]
fn of_planes_of_space_and_of_planes_of_time() {
    for decoder in ["hybrid", "explicit"] {
        for photo_model in [false, true] {
            let (_, still) = table();
            check(random(planes(&still, decoder), photo_model), &still);
        }
        let film = filmed(8);
        check(random(planes(&film, decoder), false), &film);
    }
}

/// A field that a network moves.
fn warped(data: &Dataset) -> RaySystem {
    let mut made = MadeSettings::of_time(TimeKind::Time, 2, 1);
    made.warp = WarpSettings { motion: Motion::Translation, origin: Origin::Free, octaves: 2, anneal: 0.0, depth: 2 };
    let mut deform: Deform = made.deform(Times::of(data), 1);
    deform.randomise(0.5);
    let mut config = tiny(SpaceKind::Box);
    occupancy(&mut config).step_min = 0.08;
    let space = Space::boxed(DVec3::new(0.0, 0.0, 0.3), 1.2, 0.05);
    let random = random(config.clone(), false);
    let mut driver = RaySystem::new(config, space, Background::White, 1, "ngp", None, Some(deform)).unwrap();
    driver.field.features.parameters_mut().copy_from_slice(random.field.features.parameters());
    driver.field.density_params.copy_from_slice(&random.field.density_params);
    driver.field.colour_params.copy_from_slice(&random.field.colour_params);
    driver.field.pack();
    driver
}

#[test]
fn of_a_field_that_is_warped() {
    let film = filmed(8);
    let driver = warped(&film);
    assert!(driver.field.deform.as_ref().unwrap().warps());
    check(driver, &film);
}

#[test]
fn of_rays_of_a_space_of_normalised_device_coordinates() {
    let pose = |x: f64| Pose { r: DMat3::IDENTITY, c: DVec3::new(x, 0.05 * x, 0.0) };
    let cameras = [-0.2, 0.0, 0.3].map(|x| Camera::pinhole(16, 12, 15.0, 15.0, 8.0, 6.0, pose(x)));
    let mut driver = random(tiny(SpaceKind::Box), false);
    driver.space = Space::ndc(pose(0.0), 1.0, &cameras).unwrap();
    let pixel = |i: usize| DVec2::new(0.5 + (5 * i % 16) as f64, 0.5 + (7 * i % 12) as f64);
    let rays = (0..RAYS).map(|i| cameras[i % 3].ray(pixel(i)).unwrap()).collect();
    check_shot(&mut driver, &Shot::new(rays, vec![0; RAYS]));
}

#[test]
fn the_camera_of_rays_has_the_gradient_of_differences() {
    let mut driver = random(tiny(SpaceKind::Box), false);
    let lens = Lens::Perspective { k: [0.05, 0.0, 0.0, 0.0, 0.0, 0.0], p: [1e-3, 0.0] };
    let camera = Camera { lens, ..table().1.view(1).camera };
    let pixels: Vec<DVec2> = (0..64).map(|i| DVec2::new(0.5 + f64::from(i % 8), 0.5 + f64::from(i / 8))).collect();
    let cast = |camera: &Camera| -> Vec<Ray> { pixels.iter().map(|pixel| camera.ray(*pixel).unwrap()).collect() };
    let shot = Shot::new(cast(&camera), vec![1; 64]);
    let got = driver.ray_gradients(&shot.targets()).unwrap();
    let (pose, optics) = got.to_camera(&camera.prepare(), &pixels);
    let moved = |k: usize, h: f64| {
        let mut camera = camera;
        match k {
            0..6 => {
                let mut xi = [0.0; 6];
                xi[k] = h;
                let r = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_slice(&xi)));
                camera.pose = Pose { r: r * camera.pose.r, c: r * camera.pose.c + DVec3::from_slice(&xi[3..]) };
            }
            6 => camera.fx += h,
            7 => camera.fy += h,
            8 => camera.cx += h,
            _ => camera.cy += h,
        }
        camera
    };
    let got = [&pose.twist(&camera.pose)[..], &optics.f.to_array(), &optics.c.to_array()].concat();
    let mut along =
        |k: usize, h: f64| loss_of(&mut driver, &RayTargets { rays: &cast(&moved(k, h)), ..shot.targets() });
    // Radians and world units; pixels.
    for (kind, h) in [(0..3, 2e-4), (3..6, 2e-4), (6..8, 2e-3), (8..10, 2e-3)] {
        let want: Vec<f64> = kind.clone().map(|k| (along(k, h) - along(k, -h)) / (2.0 * h)).collect();
        let largest = want.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(largest > 1e-4, "{kind:?}: {want:?}");
        for (got, want) in got[kind.clone()].iter().zip(&want) {
            assert!((got - want).abs() < 2e-2 * largest, "{kind:?}: {got} for {want} of {largest}");
        }
    }
}

#[test]
fn asking_for_rays_changes_no_bit_of_the_training() {
    let (_, data) = table();
    let shot = Shot::of(&data);
    let trained = |ask: bool| {
        let mut driver = random(tiny(SpaceKind::Box), true);
        for step in 0..4 {
            driver.step(&data, step).unwrap();
            if ask {
                driver.ray_gradients(&shot.targets()).unwrap();
            }
        }
        let f = &driver.field;
        [f.features.parameters().to_vec(), f.density_params.clone(), f.colour_params.clone()]
    };
    assert_eq!(trained(true), trained(false));
}

#[test]
fn lists_that_do_not_belong_together_are_refused() {
    let mut driver = random(tiny(SpaceKind::Box), true);
    let mut shot = Shot::of(&table().1);
    let mut refused = |targets: RayTargets<'_>| driver.ray_gradients(&targets).is_err();
    assert!(refused(RayTargets { rgb: &shot.rgb[1..], ..shot.targets() }));
    assert!(refused(RayTargets { view: &shot.view[1..], ..shot.targets() }));
    shot.view[4] = VIEWS as u32;
    assert!(refused(shot.targets()), "there are codes of three photos");
    shot.view[4] = 2;
    assert!(!refused(shot.targets()));
    assert!(!refused(RayTargets { rays: &[], rgb: &[], view: &[], radii: &[], background: [0.0; 3] }));
}
