//! The gradient of coherence as wired, from the samples of rays to networks and codes of a deformation, against differences of the loss.

use super::budget_tests::randomised_moving;
use super::gradient_tests::{VIEWS, check_group, coded, loss, tiny, with_moving_part};
use super::moving_tests::filmed_in;
use super::step::Plan;
use super::{RayConfig, RaySystem};
use crate::space::SpaceKind;
use crate::warps::made::MadeSettings;
use crate::warps::{CoherenceSettings, Deform, Motion, TimeKind, Times};
use engine::data::Dataset;

/// Losses of stretches that are not small, between points that are not near.
const COHERENCE: CoherenceSettings = CoherenceSettings { coherence: 0.5, coherence_reach: 0.1, coherence_scale: 0.5 };

/// Numbers that the warp's network sees, 15 of the point and 2 of a code, its hidden units, and what moves a point rigidly.
const INPUTS: usize = 17;
const UNITS: usize = 8;
const OUTPUTS: usize = 6;
/// More than any hidden unit is moved by what the network sees.
const OPEN: f32 = 8.0;

/// Rigid motions of each point and time, by a network of one hidden layer whose rectified units are open everywhere: differences meet no
/// kink.
fn smooth(data: &Dataset) -> Deform {
    let mut made = MadeSettings::of_time(TimeKind::Codes, 0, 2);
    (made.warp.motion, made.warp.depth, made.time.width) = (Motion::Rigid, 1, UNITS);
    let mut deform = made.deform(Times::of(data), 1);
    deform.randomise(1.0);
    let last = (INPUTS + 1) * UNITS;
    let params = deform.parameters().0.to_vec();
    assert_eq!(params.len(), last + OUTPUTS * (UNITS + 1));
    (0..UNITS).for_each(|unit| deform.shift(false, INPUTS * UNITS + unit, OPEN));
    for r in 0..OUTPUTS {
        let more: f32 = params[last + r * UNITS..][..UNITS].iter().map(|w| OPEN * w).sum();
        deform.shift(false, last + OUTPUTS * UNITS + r, -more);
    }
    deform
}

/// A field of one density everywhere whose points move: the weights of its samples, which the loss holds, do not depend on the motion, nor
/// does any other loss.
fn even(config: RayConfig, data: &Dataset, coherence: CoherenceSettings) -> RaySystem {
    let deform = smooth(data).with_coherence(coherence).unwrap();
    let mut driver = randomised_moving(config, 5, None, Some(deform));
    driver.field.features.parameters_mut().fill(0.0);
    if let Some(part) = &mut driver.field.moving {
        part.features.parameters_mut().fill(0.0);
    }
    driver.field.pack();
    driver.rays = 48;
    driver
}

/// Settings of a field that is dense enough for rays to end in it.
fn dense() -> RayConfig {
    let mut config = tiny(SpaceKind::Box);
    config.networks.density_bias = 3.0;
    config
}

/// Pixels of a batch, and how it is gone through.
fn drawn(driver: &mut RaySystem, data: &Dataset) -> Plan {
    let per_pixel = (driver.config.batch.rays_per_side * driver.config.batch.rays_per_side) as usize;
    driver.draw(data, 3, per_pixel).unwrap();
    let counted: f32 = driver.work.inputs.batch.weight.iter().sum();
    Plan { step: 3, per_pixel, share: 1.0 / counted.max(1.0), by_ray: false }
}

/// The gradients of the deformation's parameters and of its codes, from all chunks.
fn gradients(driver: &RaySystem) -> [Vec<f32>; 2] {
    let deform = driver.field.deform().unwrap();
    let (params, learned) = deform.parameters();
    let mut sums = [vec![0.0; params.len()], vec![0.0; learned.len()]];
    for chunk in &driver.work.chunks {
        let (params, learned) = deform.gradients(&chunk.deform_grad);
        for (sum, part) in sums.iter_mut().zip([params, learned]) {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }
    sums
}

#[test]
fn of_neighbours_that_are_held_together() {
    let film = filmed_in(8, VIEWS);
    let mut four_rays = dense();
    four_rays.batch.rays_per_side = 2;
    let beside_a_still_part = with_moving_part(dense(), dense().features);
    for (what, config) in [("a ray", dense()), ("four rays", four_rays), ("a moving part", beside_a_still_part)] {
        println!("{what}");
        let mut driver = even(config, &film, COHERENCE);
        let plan = drawn(&mut driver, &film);
        loss(&mut driver, &plan);
        let [params, codes] = gradients(&driver);
        check_group(&mut driver, &mut coded(false), &plan, "deformation", &params);
        check_group(&mut driver, &mut coded(false), &plan, "times", &codes);
    }
}

#[test]
fn without_a_factor_nothing_is_held_and_no_weights_are_kept() {
    let film = filmed_in(8, VIEWS);
    let off = CoherenceSettings { coherence: 0.0, ..COHERENCE };
    let [mut with, mut without] = [COHERENCE, off].map(|coherence| even(dense(), &film, coherence));
    let [more, less] = [&mut with, &mut without].map(|driver| {
        let plan = drawn(driver, &film);
        loss(driver, &plan)
    });
    assert!(more > less + 1e-5, "{more} {less}");
    // Nothing else tells the deformation anything: the field is the same everywhere.
    assert!(gradients(&without).iter().flatten().all(|&g| g == 0.0));
    assert!(without.work.chunks.iter().all(|chunk| chunk.w.is_empty() && chunk.judged.is_empty()));
    assert!(gradients(&with)[0].iter().any(|&g| g != 0.0));
}
