//! The gradient with respect to rays against differences of the loss: of the same intervals on rays that are moved.

use super::config::LastSample;
use super::driver::{Chunk, MipNerf360, fits};
use super::level::Level;
use super::ray_gradient::Aim;
use super::{MipNerf360Config, NetworksConfig};
use crate::gradients::differences::Differences;
use crate::gradients::{ByRay, RayTargets};
use crate::space::{InternalRay, Space, SpaceKind};
use engine::data::Batch;
use engine::options::Background;
use field_core::rng::Rng;
use glam::{DMat3, DVec2, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;

const RAYS: usize = 70;
/// Small beside the distance to the next corner of a rectified unit, large beside the rounding of the loss.
const STEP: f64 = 2e-4;
const BACKGROUND: [f32; 3] = [1.0; 3];

fn system(kind: SpaceKind, far: f64, last: LastSample) -> MipNerf360 {
    let mut config = MipNerf360Config::published(kind);
    config.rounds.last = last;
    (config.rounds.proposals, config.rounds.proposal_samples, config.rounds.samples) = (1, 8, 7);
    config.networks = NetworksConfig {
        octaves: 3,
        direction_octaves: 2,
        proposal_width: 8,
        proposal_depth: 2,
        width: 12,
        depth: 3,
        bottleneck: 8,
        view_width: 8,
    };
    (config.loss.distortion, config.loss.charbonnier) = (0.3, 0.1);
    let space = match kind {
        SpaceKind::Contracted => Space::contracted(DVec3::new(0.1, 0.0, 1.0), 0.7, far, 0.2),
        _ => Space::boxed(DVec3::new(0.1, 0.0, 1.5), 1.6, 0.05),
    };
    let mut system = MipNerf360::new(config, space, Background::White, 3).unwrap();
    for (i, p) in system.trained.params.iter_mut().enumerate() {
        *p += 0.4 * (Rng::new(9, 1).uniform_at(i as u64) - 0.5);
    }
    system.pack();
    system
}

/// A ray of internal coordinates, and its final intervals.
struct Held {
    ray: InternalRay,
    s: Vec<f32>,
}

impl Held {
    fn new(system: &MipNerf360, ray: &Ray, radius: f32) -> Self {
        let (ray, mut chunk) = (system.space.internal_cone(ray, radius.into()), Chunk::default());
        fits(system.render_rounds(&system.ops(), &[ray], &mut chunk.tile));
        Self { ray, s: chunk.tile.levels.last().unwrap().s.clone() }
    }

    /// The loss of ray 0 of a batch with the same intervals, at the same distances, on a ray that is elsewhere.
    fn loss(&self, system: &MipNerf360, batch: &Batch) -> f64 {
        let ray = system.space.internal_cone(&batch.rays[0], 0.0);
        // Colours see where a ray goes, however long its direction is.
        let view = batch.rays[0].d.normalize().as_vec3().to_array();
        let ray = InternalRay { view, o: ray.o, d: ray.d, ..self.ray };
        let m = self.s.len() - 1;
        let mut level = Level { s: self.s.clone(), offsets: vec![0, m as u32], ..Level::default() };
        system.place(&[ray], m, &mut level);
        let mut chunk = Chunk { grad: vec![0.0; system.trained.params.len()], ..Chunk::default() };
        chunk.tile.levels.push(level);
        let ops = system.ops();
        let aim = Aim { ops: &ops, batch, background: BACKGROUND, per_ray: 1.0 / RAYS as f64 };
        fits(system.judge_placed(&aim, &[0], &mut chunk));
        chunk.sums.loss
    }
}

/// Compare with differences, component by component.
fn check(kind: SpaceKind, far: f64, last: LastSample, radius: f32) {
    let mut system = system(kind, far, last);
    let pose = |x: f64| Pose { r: DMat3::IDENTITY, c: DVec3::new(x, 0.1 * x, 0.2) };
    let cameras = [-0.2, 0.3].map(|x| Camera::pinhole(16, 12, 15.0, 15.0, 8.0, 6.0, pose(x)));
    let pixel = |i: usize| DVec2::new(0.5 + (5 * i % 16) as f64, 0.5 + (7 * i % 12) as f64);
    let rays: Vec<Ray> = (0..RAYS).map(|i| cameras[i % 2].ray(pixel(i)).unwrap()).collect();
    let rgb: Vec<[f32; 3]> = (0..RAYS).map(|i| [0, 1, 2].map(|c| ((5 * i + 3 * c) % 7) as f32 / 7.0)).collect();
    let (view, radii) = ([0; RAYS], [radius; RAYS]);
    let targets = RayTargets { rays: &rays, rgb: &rgb, view: &view, radii: &radii, background: BACKGROUND };
    let got = system.ray_gradients(&targets).unwrap();
    let held: Vec<Held> = rays.iter().map(|ray| Held::new(&system, ray, radius)).collect();
    let alone = |r: usize| Batch::of_rays(&rays[r..=r], &rgb[r..=r]);
    let same: f64 = (0..RAYS).map(|r| held[r].loss(&system, &alone(r))).sum();
    assert!((got.loss - same).abs() < 1e-6 * same, "{} {same}: not the same intervals", got.loss);

    let largest = got.bars.iter().fold(0.0_f64, |m, b| m.max(b.o.abs().max_element()).max(b.d.abs().max_element()));
    assert!(largest > 1e-5, "{largest}");
    let mut differences = Differences::new(largest, 5e-3);
    for r in (0..RAYS).step_by(5) {
        let along = |k: usize, h: f64| {
            let mut batch = alone(r);
            let ray = &mut batch.rays[0];
            if k < 3 {
                ray.o[k] += h
            } else {
                ray.d[k - 3] += h
            }
            held[r].loss(&system, &batch)
        };
        let here = along(0, 0.0);
        for k in 0..6 {
            let [above, below] = [STEP, -STEP].map(|h| (along(k, h) - here) / h);
            let got = if k < 3 { got.bars[r].o[k] } else { got.bars[r].d[k - 3] };
            differences.compare(format_args!("{kind:?}, ray {r}, {k}"), got, [above, below], 0.5 * (above + below));
        }
    }
    differences.end();
}

#[test]
fn of_contracted_cones() {
    check(SpaceKind::Contracted, 8.0, LastSample::Finite, 0.3);
    check(SpaceKind::Contracted, 8.0, LastSample::Opaque, 0.0);
    check(SpaceKind::Contracted, 1e6, LastSample::Opaque, 0.01);
}

#[test]
fn of_cones_in_a_box() {
    check(SpaceKind::Box, 1.0, LastSample::Finite, 0.05);
}

#[test]
fn rays_that_meet_nothing_have_none_and_lists_must_belong_together() {
    let mut system = system(SpaceKind::Box, 1.0, LastSample::Finite);
    let rays = [Ray { o: DVec3::new(9.0, 0.0, 0.0), d: DVec3::Z }, Ray { o: DVec3::ZERO, d: DVec3::Z }];
    let targets = RayTargets { rays: &rays, rgb: &[[0.5; 3]; 2], view: &[0; 2], radii: &[], background: BACKGROUND };
    let got = system.ray_gradients(&targets).unwrap();
    assert_eq!(got.bars[0], Default::default());
    assert!(got.loss > 0.0 && got.bars[1] != Default::default());
    let none = RayTargets { rays: &[], rgb: &[], view: &[], ..targets };
    assert_eq!(system.ray_gradients(&none).unwrap(), Default::default());
    for wrong in [
        RayTargets { rgb: &[], ..targets },
        RayTargets { view: &[0], ..targets },
        RayTargets { radii: &[0.1; 3], ..targets },
    ] {
        assert!(system.ray_gradients(&wrong).is_err());
    }
}
