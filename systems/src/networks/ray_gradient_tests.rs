//! The gradient with respect to rays against differences of the loss, for samples that are at the same distances on every ray.

use super::{Along, DisplacementShape, Footprint, Level, NetworkShape, Origin, Recipe, Tile, TwoLevel};
use crate::gradients::differences::Differences;
use crate::gradients::{ByRay, RayTargets};
use crate::papers::dynamic::d_nerf_published::DNerfNetworks;
use crate::papers::static_scenes::mip_nerf::MipNerfConfig;
use crate::papers::static_scenes::nerf::NerfConfig;
use crate::photo_model::{Codes, PhotoModel, Pixel, PixelBar};
use crate::space::{InternalRay, Space, SpaceKind};
use engine::options::Background;
use engine::system::SystemError;
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use glam::{DMat3, DVec2, DVec3};
use optim::AdamConfig;
use render_core::camera::{Camera, Pose};
use render_core::contract::{Norm, contract, contract_covariance};
use render_core::frustum::{Frustum, Moments, symmetric};
use render_core::ray::{Ray, RayBar};

/// A recipe whose samples lie at distances that do not depend on the ray.
#[derive(Clone)]
pub(super) struct Held<R>(pub(super) R);

impl<R: Recipe> Held<R> {
    fn fill(&self, space: &Space, rays: &[InternalRay], count: usize, level: &mut Level) {
        let length = if space.kind() == SpaceKind::Ndc { 1.5 } else { 2.0 };
        let t: Vec<f32> = (0..count).map(|i| 0.3 + length * i as f32 / count as f32).collect();
        level.begin();
        rays.iter().for_each(|_| level.push(&t, |dt| dt.fill(length / count as f32)));
        let n = level.t.len();
        let cone = R::FOOTPRINT == Footprint::Cone;
        level.make_room(n, if cone { 6 } else { 3 });
        let shape = if space.kind() == SpaceKind::Ndc { Frustum::Cylinder } else { Frustum::Cone };
        for (r, ray) in rays.iter().enumerate() {
            for i in r * count..(r + 1) * count {
                let moments = Moments::new(shape, level.t[i], level.t[i] + level.dt[i], ray.radius);
                let (mean, cov) = moments.covariance(ray.o, ray.d);
                let at = if cone { mean } else { ray.at(level.t[i]) };
                let (seen, var) = match space.kind() {
                    SpaceKind::Box | SpaceKind::Ndc => (mean, [cov[0], cov[3], cov[5]]),
                    SpaceKind::Contracted => {
                        let cov = contract_covariance(Norm::Max, mean, &symmetric(cov));
                        (contract(Norm::Max, mean).map(|x| 0.5 * x), [0, 1, 2].map(|a| 0.25 * cov[a][a]))
                    }
                };
                for a in 0..3 {
                    level.p[a * n + i] = at[a];
                    if cone {
                        (level.x[a * n + i], level.x[(3 + a) * n + i]) = (seen[a], var[a]);
                    }
                }
            }
        }
        level.set_directions(rays);
        // Colours see where a ray goes, however long its direction is.
        for i in 0..n {
            let length = [0, 1, 2].map(|a| level.d[a * n + i].powi(2)).iter().sum::<f32>().sqrt();
            (0..3).for_each(|a| level.d[a * n + i] /= length);
        }
        if !cone {
            self.0.place_points(space, n, level);
        }
    }
}

impl<R: Recipe> Recipe for Held<R> {
    const NAME: &'static str = R::NAME;
    const ADAM: AdamConfig = R::ADAM;
    const FOOTPRINT: Footprint = R::FOOTPRINT;
    type Position = R::Position;

    fn check(&self) -> Result<(), SystemError> {
        self.0.check()
    }

    fn networks(&self) -> usize {
        self.0.networks()
    }

    fn network(&self) -> Result<NetworkShape<R::Position>, SystemError> {
        self.0.network()
    }

    fn view_times(&self) -> &[f32] {
        self.0.view_times()
    }

    fn batch_rays(&self) -> usize {
        self.0.batch_rays()
    }

    fn learning_rate(&self, step: u64) -> f64 {
        self.0.learning_rate(step)
    }

    fn level_weight(&self, level: usize) -> f32 {
        self.0.level_weight(level)
    }

    fn sparsity(&self) -> f32 {
        self.0.sparsity()
    }

    fn density_noise(&self) -> f32 {
        self.0.density_noise()
    }

    fn density(&self, tape: &mut Tape<'_>, raw: Node) -> Result<Node, TapeError> {
        self.0.density(tape, raw)
    }

    fn density_of(&self, raw: f32) -> f32 {
        self.0.density_of(raw)
    }

    fn fill_coarse(&self, space: &Space, rays: &[InternalRay], _: Option<&Rng>, tile: &mut Tile) {
        self.fill(space, rays, 6, &mut tile.coarse);
    }

    fn fill_fine(&self, space: &Space, rays: &[InternalRay], _: Option<&Rng>, tile: &mut Tile) {
        self.fill(space, rays, 9, &mut tile.fine);
    }

    fn pull_rays(&self, space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
        self.0.pull_rays(space, along, x_bar, bars);
    }

    fn place_points(&self, space: &Space, n: usize, level: &mut Level) {
        self.0.place_points(space, n, level);
    }
}

fn nerf(kind: SpaceKind) -> NerfConfig {
    let mut config = NerfConfig::published(kind);
    let network = &mut config.levels.network;
    (network.position_octaves, network.direction_octaves, network.width, network.depth) = (2, 2, 12, 3);
    (network.density_noise, config.training.sparsity) = (1.0, 0.1);
    config
}

fn mip_nerf(kind: SpaceKind) -> MipNerfConfig {
    let mut config = MipNerfConfig::published(kind);
    let network = &mut config.levels.network;
    (network.position_octaves, network.direction_octaves, network.width, network.depth) = (3, 2, 12, 3);
    config
}

/// Codes of two photos.
struct Coded(Vec<f32>);

impl PhotoModel for Coded {
    fn name(&self) -> &'static str {
        "coded"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        Some(Codes { dims: 2, rows: &self.0 })
    }

    fn loss(&self, _: usize, _: &Pixel, _: [f32; 3]) -> (f32, PixelBar) {
        panic!("a photo model judges batches of its own")
    }
}

const RAYS: usize = 70;

/// Compare with differences; all rays cross the space wherever they are moved.
fn check<R: Recipe>(config: R, kind: SpaceKind, coded: bool) {
    let pose = |x: f64| Pose { r: DMat3::IDENTITY, c: DVec3::new(x, 0.1 * x, 0.2) };
    let cameras = [-0.2, 0.3].map(|x| Camera::pinhole(16, 12, 15.0, 15.0, 8.0, 6.0, pose(x)));
    let space = match kind {
        SpaceKind::Box => Space::boxed(DVec3::new(0.1, 0.0, 1.5), 1.6, 0.01),
        SpaceKind::Contracted => Space::contracted(DVec3::new(0.1, 0.0, 1.0), 0.7, 8.0, 0.01),
        SpaceKind::Ndc => Space::ndc(pose(0.0), 0.5, &cameras).unwrap(),
    };
    let photo_model = coded.then(|| Box::new(Coded(vec![0.3, -0.2, -0.5, 0.4])) as Box<dyn PhotoModel>);
    let mut system = TwoLevel::with_photo_model(Held(config), space, Background::White, 3, photo_model).unwrap();
    // Numbers that leave units of these small networks alive.
    let seed = if system.config.view_times().is_empty() { 9 } else { 10 };
    for (i, p) in system.trained.params.iter_mut().enumerate() {
        *p += 0.4 * (Rng::new(seed, 1).uniform_at(i as u64) - 0.5);
    }
    system.pack();
    let pixel = |i: usize| DVec2::new(0.5 + (5 * i % 16) as f64, 0.5 + (7 * i % 12) as f64);
    let mut rays: Vec<Ray> = (0..RAYS).map(|i| cameras[i % 2].ray(pixel(i)).unwrap()).collect();
    let rgb: Vec<[f32; 3]> = (0..RAYS).map(|i| [0, 1, 2].map(|c| ((5 * i + 3 * c) % 7) as f32 / 7.0)).collect();
    // Wide where space is contracted: second derivatives of the contraction count.
    let radius = if kind == SpaceKind::Contracted { 0.3 } else { 0.03 };
    let (view, radii) = ((0..RAYS).map(|i| i as u32 % 2).collect::<Vec<_>>(), [radius; RAYS]);
    let background = [1.0; 3];
    let got =
        system.ray_gradients(&RayTargets { rays: &rays, rgb: &rgb, view: &view, radii: &radii, background }).unwrap();
    let largest = got.bars.iter().fold(0.0_f64, |m, b| m.max(b.o.abs().max_element()).max(b.d.abs().max_element()));
    assert!(largest > 1e-5, "{largest}");
    let mut differences = Differences::new(largest, 1.5e-2);
    for r in (0..RAYS).step_by(9) {
        let ray = rays[r];
        for k in 0..6 {
            let mut along = |h: f64| {
                let mut at = ray;
                if k < 3 {
                    at.o[k] += h
                } else {
                    at.d[k - 3] += h
                }
                rays[r] = at;
                let targets = RayTargets { rays: &rays, rgb: &rgb, view: &view, radii: &radii, background };
                let loss = system.ray_gradients(&targets).unwrap().loss;
                rays[r] = ray;
                loss
            };
            let mut slope = |h: f64| (along(h) - along(-h)) / (2.0 * h);
            let (wide, narrow) = (slope(1e-3), slope(5e-4));
            let got = if k < 3 { got.bars[r].o[k] } else { got.bars[r].d[k - 3] };
            differences.compare(format_args!("{kind:?}, ray {r}, {k}"), got, [wide, narrow], narrow);
        }
    }
    differences.end();
}

#[test]
fn of_networks_of_points() {
    for kind in [SpaceKind::Box, SpaceKind::Contracted, SpaceKind::Ndc] {
        check(nerf(kind), kind, false);
    }
    check(nerf(SpaceKind::Box), SpaceKind::Box, true);
}

#[test]
fn of_networks_that_move_points() {
    for origin in [Origin::Tied, Origin::Exact] {
        let shape = DisplacementShape { origin, octaves: 2, time_octaves: 1, width: 8, depth: 2 };
        // Every other ray is of the time at which nothing moves.
        check(DNerfNetworks::small(nerf(SpaceKind::Box), shape, &[0.0, 0.6]), SpaceKind::Box, false);
    }
}

#[test]
fn of_networks_of_cones() {
    for kind in [SpaceKind::Box, SpaceKind::Contracted, SpaceKind::Ndc] {
        check(mip_nerf(kind), kind, false);
    }
}
