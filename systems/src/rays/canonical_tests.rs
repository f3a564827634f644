//! Canonical points of rays: where a known warp sends them, nowhere for rays that hit nothing, the same bits always.

use super::budget_tests::{query, random_rays, randomised, small};
use super::driver::RaySystem;
use crate::space::SpaceKind;
use crate::warps::made::MadeSettings;
use crate::warps::{Motion, Origin, TimeKind, Times, WarpSettings};
use engine::system::{Canonical, FlowSource, LayerRequest, Layers, NOWHERE, Query, System, TensorData, TensorMap};
use glam::DVec3;
use render_core::ray::Ray;

/// Way of every point of the cube `[-1, 1]^3`.
const WAY: [f32; 3] = [0.1, -0.2, 0.05];

/// Random parameters in a space, whose points all go [`WAY`] at all times but 0.
fn shifted(kind: SpaceKind, seed: u64) -> RaySystem {
    let nothing = MadeSettings::of_time(TimeKind::Time, 2, 1);
    let warp = WarpSettings { motion: Motion::Translation, origin: Origin::Exact, ..nothing.warp };
    let mut deform = MadeSettings { warp, ..nothing }.deform(Times::of(&super::budget_tests::table().1), seed);
    let mut state: TensorMap = deform.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
    let TensorData::F32(networks) = &mut state.get_mut("deform.networks").unwrap().data else { panic!("floats") };
    let networks = networks.to_mut();
    networks.fill(0.0);
    // The biases of the last layer come last.
    let last = networks.len() - 3;
    networks[last..].copy_from_slice(&WAY);
    deform.load_state(&state).unwrap();
    let mut driver = still(kind, seed);
    driver.field.deform = Some(deform);
    driver
}

fn still(kind: SpaceKind, seed: u64) -> RaySystem {
    let mut config = small(kind);
    // Thin enough for rays that hit nothing.
    config.networks.density_bias = if kind == SpaceKind::Contracted { -4.0 } else { 0.5 };
    randomised(config, seed)
}

fn rays() -> Vec<Ray> {
    (0..40).flat_map(random_rays).collect()
}

fn asked(time: f64) -> Query {
    let layers = LayerRequest { canonical: Canonical::Compute, ..LayerRequest::default() };
    Query { time, layers, ..query([1.0; 3], 0.0) }
}

/// Each ray's point and its canonical one; the others must be nowhere. Most of them hit something, some do not.
fn pairs(rays: &[Ray], layers: &Layers) -> Vec<(DVec3, DVec3)> {
    assert_eq!(layers.canonical.len(), rays.len());
    let (mut hit, mut missed) = (Vec::new(), 0);
    for ((ray, &t), &there) in rays.iter().zip(&layers.median_depth).zip(&layers.canonical) {
        if t.is_finite() {
            hit.push((ray.at(f64::from(t)), DVec3::from(there)));
        } else {
            assert_eq!(there, NOWHERE);
            missed += 1;
        }
    }
    assert!(hit.len() > 100 && missed > 10, "{} {missed}", hit.len());
    hit
}

#[test]
fn what_nothing_warps_is_canonical_where_it_is_and_only_when_asked_for() {
    let rays = rays();
    for kind in [SpaceKind::Box, SpaceKind::Contracted] {
        let driver = still(kind, 3);
        let layers = driver.render(&rays, &asked(0.5));
        assert!(pairs(&rays, &layers).iter().all(|(x, there)| x == there), "{kind:?}");
        let plain = driver.render(&rays, &Query { time: 0.5, ..query([1.0; 3], 0.0) });
        assert!(plain.canonical.is_empty());
        assert!(Layers { canonical: Vec::new(), ..layers } == plain, "the other layers do not change");
    }
}

#[test]
fn canonical_points_are_where_the_warp_sends_them() {
    let rays = rays();
    let driver = shifted(SpaceKind::Box, 3);
    // The radius of the box is 1.
    let way = DVec3::from(WAY.map(f64::from));
    for (x, there) in pairs(&rays, &driver.render(&rays, &asked(0.5))) {
        assert!((there - x - way).length() < 1e-5, "{x} to {there}");
    }
    // Nothing is warped at the canonical time: not a bit.
    assert!(pairs(&rays, &driver.render(&rays, &asked(0.0))).iter().all(|(x, there)| x == there));
    let asked_directly = |point: DVec3| {
        let mut out = [[0.0; 3]];
        driver.canonical(&[point.to_array()], 0.5, &mut out);
        DVec3::from(out[0])
    };
    // A canonical point may lie beyond the box; what the space does not reach stays.
    assert!((asked_directly(DVec3::new(0.99, 0.0, 0.0)).x - 1.09).abs() < 1e-5);
    assert_eq!(asked_directly(DVec3::new(3.0, 0.0, 0.0)), DVec3::new(3.0, 0.0, 0.0));
    driver.canonical(&[], 0.5, &mut []);
}

#[test]
fn points_go_where_their_canonical_place_is_then() {
    let driver = shifted(SpaceKind::Box, 3);
    let ways = |driver: &RaySystem, from: f64, to: f64| {
        let mut out = [None; 2];
        driver.scene_flow(&[[0.1, 0.2, -0.3], [-0.5, 0.4, 0.0]], from, to, &mut out);
        out.map(|way| DVec3::from(way.unwrap()))
    };
    // All have gone the way back at time 0, and stand still between two others.
    let way = DVec3::from(WAY.map(f64::from));
    assert!(ways(&driver, 0.5, 0.0).iter().all(|got| (*got - way).length() < 1e-4));
    assert!(ways(&driver, 0.0, 0.5).iter().all(|got| (*got + way).length() < 1e-4));
    assert_eq!(ways(&driver, 0.3, 0.7), [DVec3::ZERO; 2]);
    let still = still(SpaceKind::Box, 3);
    assert_eq!(ways(&still, 0.0, 1.0), [DVec3::ZERO; 2]);
    assert_eq!([driver.flow_source(), still.flow_source()], [FlowSource::Canonical, FlowSource::Nothing]);
}

#[test]
fn a_warp_of_contracted_space_is_brought_back_to_the_world() {
    let rays = rays();
    let driver = shifted(SpaceKind::Contracted, 3);
    let layers = driver.render(&rays, &asked(0.5));
    let pairs = pairs(&rays, &layers);
    // In the contracted cube [-2, 2]^3 the way is twice as long; inside the inner cube contraction does nothing.
    let way = 2.0 * DVec3::from(WAY.map(f64::from));
    let inner = |x: &DVec3| x.abs().max_element() < 0.6;
    let close = pairs.iter().filter(|(x, _)| inner(x));
    assert!(close.clone().count() > 10);
    for (x, there) in close {
        assert!((*there - *x - way).length() < 1e-5, "{x} to {there}");
    }
    assert!(pairs.iter().all(|(_, there)| there.is_finite()));
}

#[test]
fn canonical_points_have_the_same_bits_with_1_2_and_4_threads() {
    let rays = rays();
    let driver = shifted(SpaceKind::Box, 5);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| driver.render(&rays, &asked(0.7)))
    };
    let one = on(1);
    assert!(on(2) == one && on(4) == one);
}

#[test]
fn scene_flow_is_the_way_there_and_back_again_and_nothing_without_a_warp() {
    let points = [[0.1, 0.2, -0.3], [0.0; 3], [-0.4, 0.3, 0.5]];
    let says = |driver: &RaySystem, from: f64, to: f64| {
        let mut out = [None; 3];
        if driver.flow_source() != FlowSource::Nothing {
            driver.scene_flow(&points, from, to, &mut out);
        }
        out.map(|flow| flow.map(DVec3::from))
    };
    let (driver, way) = (shifted(SpaceKind::Box, 3), DVec3::from(WAY.map(f64::from)));
    // Nothing is warped at 0, and all goes the same way at any other time.
    for (from, to, want) in [(0.0, 0.5, -way), (0.5, 0.0, way), (0.3, 0.7, DVec3::ZERO)] {
        for flow in says(&driver, from, to) {
            assert!((flow.unwrap() - want).length() < 1e-5, "{flow:?} from {from} to {to}, not {want}");
        }
    }
    let still = still(SpaceKind::Box, 3);
    assert_eq!(says(&still, 0.0, 0.5), [None; 3], "not that nothing moves: it says nothing");
}
