//! Time is continuous: what a system with a warp shows at `t = 0` is what it shows beside it, whatever its networks say.

use super::{d_nerf, endo_nerf, hyper_nerf, nerfies};
use crate::claims::Claim;
use crate::plan::made::{Points, camera, film};
use crate::plan::{Ask, Built};
use engine::options::{Background, RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::system::{Query, System, TensorData, TensorMap};
use field_core::rng::Rng;

/// Times beside `t = 0`, and how far the picture may be from that at `t = 0`, as a share of how far that in the middle of the time is.
/// Networks of random parameters are much steeper in time than trained ones.
const BESIDE: [(f64, f64); 2] = [(1e-3, 0.3), (1e-4, 0.05)];

/// A small system whose parameters are all of some size: its warp is not near zero anywhere.
fn randomised(claim: Claim, build: fn(Ask<'_>) -> Built, set: &[&str]) -> Box<dyn System> {
    let (scene, data) = film(Points::None);
    let small = ["levels=4", "log2_table=10", "n_max=32", "planes=[4]", "density_bias=1.0"];
    let set = small.iter().chain(set).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 1, background: Some(Background::White), error_budget: Some(0.0), stop: None, set };
    let (mut system, _) = build(Ask::new(claim, &scene, &data, &run)).unwrap();
    let mut state: TensorMap = system.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
    for (k, (name, size)) in [("deform.networks", 0.3), ("field.grid", 2.0)].into_iter().enumerate() {
        let TensorData::F32(values) = &mut state.get_mut(name).unwrap().data else { panic!("{name}: floats") };
        let mut noise = vec![0.0; values.len()];
        Rng::new(7, k as u64).fill_uniform(0, &mut noise);
        values.to_mut().iter_mut().zip(noise).for_each(|(value, u)| *value += size * (u - 0.5));
    }
    system.load_state(&state).unwrap();
    system
}

/// What a camera sees at a time.
fn shown(system: &dyn System, time: f64) -> Vec<f32> {
    render(system, &camera(3), &Query { time, ..plain_query([1.0; 3], 0.0) }).layers.rgb.into_flattened()
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (sum / a.len() as f64).sqrt()
}

/// How far the pictures of [`BESIDE`] are from that at `t = 0`, as a share of how far that in the middle of the time is.
fn jumps(claim: Claim, build: fn(Ask<'_>) -> Built, set: &[&str]) -> [f64; 2] {
    let system = randomised(claim, build, set);
    let [at, later] = [0.0, 0.5].map(|time| shown(system.as_ref(), time));
    let far = distance(&at, &later);
    assert!(far > 1e-3, "{}: nothing moves", claim.name);
    let jumps = BESIDE.map(|(time, _)| distance(&at, &shown(system.as_ref(), time)) / far);
    println!("{} {set:?}: {jumps:?} of {far:.5}", claim.name);
    jumps
}

/// A system whose warp leads to a canonical scene, with settings that give it an origin where it has none by itself.
type Warped = (Claim, fn(Ask<'_>) -> Built, &'static [&'static str]);

#[test]
fn what_is_shown_at_the_origin_is_what_is_shown_beside_it() {
    let systems: [Warped; 5] = [
        (d_nerf::CLAIM, d_nerf::build, &[]),
        (d_nerf::CLAIM, d_nerf::build, &["origin=tied"]),
        (endo_nerf::CLAIM, endo_nerf::build, &[]),
        (nerfies::CLAIM, nerfies::build, &["time_input=time", "origin=tied"]),
        (hyper_nerf::CLAIM, hyper_nerf::build, &["time_input=time", "origin=tied"]),
    ];
    for (claim, build, set) in systems {
        for (jump, (time, most)) in jumps(claim, build, set).into_iter().zip(BESIDE) {
            assert!(jump < most, "{}: at t = 0 the picture is another one than at {time}: {jump}", claim.name);
        }
    }
}

#[test]
fn as_published_the_scene_jumps_at_the_origin() {
    let jumps = jumps(d_nerf::CLAIM, d_nerf::build, &["origin=exact"]);
    assert!(jumps[1] > 0.3, "{jumps:?}: the test sees no jump where there is one");
}
