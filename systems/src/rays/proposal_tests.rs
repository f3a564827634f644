//! Sampling by proposals: where samples lie, what renders skip, and the gradient of the proposals' own loss.

use super::budget_tests::{biased, largest_difference, proposals, query, random_rays, randomised};
use super::{RaySystem, SamplerConfig};
use crate::fields::When;
use crate::samplers::{Draw, ProposalConfig, Proposed, RaysInSpace};
use crate::space::{InternalRay, SpaceKind};
use engine::system::{System, Trial};
use field_core::rng::Rng;
use proptest::prelude::*;
use render_core::budget::Skip;
use render_core::ray::Ray;

fn proposing(seed: u64, kind: SpaceKind, density_bias: f32, counts: &[usize]) -> RaySystem {
    let mut config = biased(kind, density_bias);
    config.sampler = SamplerConfig::Proposals(ProposalConfig { proposal_samples: counts.to_vec(), final_samples: 12 });
    randomised(config, seed)
}

/// Middles, lengths and offsets of a render's samples.
fn cut(driver: &RaySystem, rays: &[InternalRay]) -> (Vec<f32>, Vec<f32>, Vec<u32>) {
    let (mut proposed, mut out) = (Proposed::default(), Default::default());
    let at = RaysInSpace { simd: driver.field.simd, space: &driver.space, rays };
    proposed.sample(driver.sampler.proposals().unwrap(), &at, |_| true, |_| 0.0, Draw::Render);
    let (t, dt, offsets) = &mut out;
    proposed.intervals(rays.len(), t, dt, offsets);
    out
}

fn internal(driver: &RaySystem, rays: &[Ray]) -> Vec<InternalRay> {
    rays.iter().map(|r| driver.space.internal_ray(r)).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(12))]

    #[test]
    fn samples_follow_each_other_within_the_ray(
        seed in any::<u64>(), contracted in any::<bool>(), bias in -3.0..4.0_f32,
    ) {
        let kind = if contracted { SpaceKind::Contracted } else { SpaceKind::Box };
        let driver = proposing(seed, kind, bias, &[16, 8]);
        let rays = internal(&driver, &random_rays(seed));
        let (t, dt, offsets) = cut(&driver, &rays);
        for (r, ray) in rays.iter().enumerate() {
            let span = offsets[r] as usize..offsets[r + 1] as usize;
            prop_assert_eq!(span.len(), if ray.end > ray.start { 12 } else { 0 });
            let slack = 1e-4 * ray.end.max(1.0);
            let mut end = ray.start;
            for i in span.clone() {
                prop_assert!(dt[i] >= 0.0 && t[i] - 0.5 * dt[i] >= end - slack, "{} after {end}", t[i]);
                prop_assert!(i == span.start || (t[i] - 0.5 * dt[i] - end).abs() <= slack, "a gap at {end}");
                end = t[i] + 0.5 * dt[i];
            }
            prop_assert!(end <= ray.end + slack);
        }
    }

    #[test]
    fn the_picture_is_the_sum_over_the_samples_within_its_budget(
        seed in any::<u64>(), contracted in any::<bool>(), bias in -3.0..4.0_f32,
        background in [0.0..1.0_f32, 0.0..1.0, 0.0..1.0],
    ) {
        let kind = if contracted { SpaceKind::Contracted } else { SpaceKind::Box };
        let (driver, rays) = (proposing(seed, kind, bias, &[16, 8]), random_rays(seed));
        let full = driver.render(&rays, &query(background, 0.0));
        let inner = internal(&driver, &rays);
        let (t, dt, offsets) = cut(&driver, &inner);
        for (r, ray) in inner.iter().enumerate() {
            let depth: f32 = (offsets[r] as usize..offsets[r + 1] as usize)
                .map(|i| {
                    let (mut x, mut density) = ([0.0; 3], [0.0]);
                    driver.space.grid_positions(driver.field.simd, &ray.at(t[i]), &mut x);
                    let when = When { time_steps: driver.field.time_steps(), which: &[] };
                    driver.field.densities(&mut x, when, &mut density, &mut Default::default());
                    density[0] * dt[i]
                })
                .sum();
            prop_assert!((full.opacity[r] + (-depth).exp_m1()).abs() < 1e-5);
        }
        for eps in [1.0 / 255.0, 0.1] {
            let (layers, ledger) = driver.render_trial(&rays, &query(background, eps), &Trial::USUAL).unwrap();
            let error = largest_difference(&layers, &full);
            prop_assert!(error <= eps, "{error} > {eps}");
            prop_assert_eq!(ledger.entry(Skip::Empty).skipped, 0);
        }
    }
}

/// The loss of one proposal by its definition, for the final weights `w` in the intervals `fine`.
fn loss(round: &[(f32, f32, f64)], fine: &[(f32, f32)], w: &[f32]) -> f64 {
    let touching =
        |a: f32, b: f32| round.iter().filter(move |(s, e, _)| *e > a && *s <= b).map(|(_, _, w)| w).sum::<f64>();
    let missing = |i: usize| (f64::from(w[i]) - touching(fine[i].0, fine[i].1)).max(0.0);
    (0..w.len()).map(|i| missing(i).powi(2) / (f64::from(w[i]) + f64::from(f32::EPSILON))).sum()
}

#[test]
fn the_gradient_of_the_proposals_is_that_of_the_interlevel_loss() {
    let mut driver = proposing(5, SpaceKind::Contracted, -1.0, &[16]);
    let rays: Vec<InternalRay> =
        internal(&driver, &random_rays(5)).into_iter().filter(|ray| ray.end > ray.start).take(4).collect();
    let m = rays.len();
    assert!(m > 1);
    let jitter: Vec<f32> = (0..2 * m).map(|i| Rng::new(5, 1).uniform_at(i as u64)).collect();
    let draw = Draw::Training { jitter: &jitter, rays: m, first: 0, exponent: 1.0 };
    let simd = driver.field.simd;
    let propose = |driver: &RaySystem| {
        let mut proposed = Proposed::default();
        let at = RaysInSpace { simd, space: &driver.space, rays: &rays };
        proposed.sample(driver.sampler.proposals().unwrap(), &at, |_| true, |_| 0.0, draw);
        proposed
    };
    let mut proposed = propose(&driver);

    // Each ray keeps its first ten intervals, their weights have little to do with the proposal's.
    let offsets: Vec<u32> = (0..=m as u32).map(|r| 10 * r).collect();
    let w: Vec<f32> = (0..10 * m).map(|i| 0.1 * Rng::new(5, 2).uniform_at(i as u64)).collect();
    let fine: Vec<(f32, f32)> =
        proposed.last_posts(12).iter().flat_map(|p| p[..11].windows(2)).map(|p| (p[0], p[1])).collect();
    proposed.learn(driver.sampler.proposals().unwrap(), simd, &offsets, &w, 1.0);

    let total = |driver: &RaySystem| {
        let proposed = propose(driver);
        let rounds = proposed.weighed(0);
        (0..m).map(|r| loss(&rounds[16 * r..][..16], &fine[10 * r..][..10], &w[10 * r..][..10])).sum::<f64>()
    };
    assert!(total(&driver) > 1e-3);
    // Along the gradient itself, so that no direction is lost in rounding.
    let mut network = Vec::new();
    let field = &mut proposals(&mut driver)[0];
    network.resize(field.mlp_params.len(), 0.0);
    field.mlp.unpack_grad(proposed.mlp_grad(0), &mut network);
    let part = proposed.part(0, &*field.features);
    let mut table = vec![0.0; field.features.parameters().len()];
    field.features.scatter(&part, &mut table);
    for (what, grad) in [("network", &network), ("grid", &table)] {
        let square: f64 = grad.iter().map(|g| f64::from(*g).powi(2)).sum();
        let step = 1e-3 / square.sqrt();
        let shift = |driver: &mut RaySystem, by: f64| {
            let field = &mut proposals(driver)[0];
            let params = if what == "grid" { field.features.parameters_mut() } else { &mut field.mlp_params[..] };
            params.iter_mut().zip(grad).for_each(|(p, g)| *p += by as f32 * g);
            field.pack();
        };
        shift(&mut driver, step);
        let above = total(&driver);
        shift(&mut driver, -2.0 * step);
        let below = total(&driver);
        shift(&mut driver, step);
        let slope = (above - below) / (2.0 * step);
        assert!((slope - square).abs() < 0.02 * square, "{what}: {slope} along the gradient, its square is {square}");
    }
}
