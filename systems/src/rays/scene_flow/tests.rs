//! What is seen in the frames beside, and what is known of these.

use super::film::{BEYOND, Film, FramePriors, HERE, NEXT, PREVIOUS};
use crate::papers::dynamic::{dynamic_nerf, nsff};
use crate::rays::budget_tests::{randomised, table};
use crate::rays::gradient_tests::{known, tiny, with_moving_part, with_scene_flow};
use crate::rays::moving_tests::filmed;
use crate::rays::step::Plan;
use crate::rays::{RayConfig, RaySystem};
use crate::space::SpaceKind;
use engine::data::Dataset;
use scene_io::synthetic::{OrbitOptions, orbit};
use scene_io::{BitMask, Disparity, ImageStore, Split, StoreOptions};
use std::sync::Arc;

/// Photos of this many times.
pub(super) fn of_times(train: usize) -> Dataset {
    let scene = orbit(&OrbitOptions { width: 8, height: 8, train, test: 0, rays: 1, ..OrbitOptions::default() });
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap()
}

/// A batch of a field of random numbers, after a step's gradients were found: its samples move everywhere.
fn seen(config: RayConfig, data: &Dataset, priors: Vec<FramePriors>, step: u64) -> RaySystem {
    let mut driver = randomised(config, 5);
    driver.set_film(Film::with(data, priors));
    after(&mut driver, data, step);
    driver
}

fn after(driver: &mut RaySystem, data: &Dataset, step: u64) {
    driver.rays = 48;
    driver.draw(data, step, 1).unwrap();
    let plan = Plan { step, per_pixel: 1, share: 1.0 / 48.0, by_ray: false };
    driver.each_chunk(&plan, |chunk, ctx, pixels| {
        chunk.sample(ctx, pixels.clone());
        chunk.learn(ctx, pixels);
    });
    driver.learn_flow(&plan);
}

pub(super) fn nothing(data: &Dataset) -> Vec<FramePriors> {
    vec![FramePriors::default(); data.len()]
}

#[test]
fn a_field_that_neither_flows_nor_knows_the_time_looks_the_same_in_all_frames() {
    let film = filmed(8);
    let still = tiny(SpaceKind::Box);
    let flow = with_scene_flow(&film, nsff::flow, true).moving.unwrap().flow.unwrap();
    let mut config = with_moving_part(still.clone(), still.features);
    config.moving = config.moving.map(|moving| moving.with_flow(flow));
    let mut driver = randomised(config, 5);
    driver.set_film(Film::with(&film, nothing(&film)));
    let part = driver.field.moving.as_mut().unwrap();
    let last = part.network.layers().last().map(|last| (last.weights.clone(), last.inputs)).unwrap();
    let first = last.0.start + (part.still_rows() + 1) * last.1;
    part.params[first..last.0.end].fill(0.0);
    part.pack();
    after(&mut driver, &film, 2);
    let mut rays = 0;
    for flow in driver.work.chunks.iter().map(|chunk| &chunk.flow) {
        let here = &flow.passes[HERE].seen;
        rays += flow.rays.len();
        assert!(here.flow.iter().all(|s| *s == 0.0) && here.hidden.iter().all(|p| *p == 0.5));
        for pass in [NEXT, PREVIOUS, BEYOND] {
            let there = &flow.passes[pass].seen;
            assert_eq!((&there.colour, &there.w, &there.flow), (&here.colour, &here.w, &here.flow), "pass {pass}");
        }
    }
    assert!(rays > 20, "{rays} rays");
}

#[test]
fn frames_have_those_beside_them_and_the_first_and_the_last_lack_one() {
    let data = of_times(4);
    let film = Film::with(&data, known(&data));
    let beside = |view| film.frames(view, Some(NEXT)).beside;
    assert_eq!(beside(0), [Some(0), Some(1), None, Some(2)]);
    assert_eq!(beside(2), [Some(2), Some(3), Some(1), None]);
    assert_eq!(film.frames(3, Some(PREVIOUS)).beside, [Some(3), None, Some(2), Some(1)]);
    assert_eq!(film.frames(3, None).beside[BEYOND], None);
    // Flow goes to the frame beside, and there is none beyond the ends.
    assert_eq!(film.flow(1, NEXT, [3, 3]), Some([0.7, -0.4]));
    assert_eq!(film.flow(1, PREVIOUS, [3, 3]), Some([-1.1, 0.3]));
    assert_eq!((film.flow(1, NEXT, [0, 3]), film.flow(1, NEXT, [99, 3])), (None, None));
    assert_eq!((film.flow(0, PREVIOUS, [3, 3]), film.flow(3, NEXT, [3, 3])), (None, None));
    assert_eq!((film.moves(1, [0, 0]), film.moves(1, [7, 0])), (Some(true), Some(false)));
}

#[test]
fn plans_say_what_is_not_known() {
    let data = of_times(3);
    let lines = Film::with(&data, nothing(&data)).lines().join("\n");
    for said in ["no optical flow", "no disparities", "no motion masks"] {
        assert!(lines.contains(said), "{lines}");
    }
    let lines = Film::with(&data, known(&data)).lines().join("\n");
    assert!(lines.contains("flow of 3 of 3") && lines.contains("disparities of 3 of 3"), "{lines}");
    let (_, alone) = table();
    let lines = Film::with(&alone, nothing(&alone)).lines().join("\n");
    assert!(lines.contains("all of one time"), "{lines}");
}

#[test]
fn plans_say_which_priors_say_nothing() {
    let data = of_times(3);
    let lines = |change: &dyn Fn(&mut FramePriors)| {
        let mut priors = known(&data);
        priors.iter_mut().for_each(change);
        Film::with(&data, priors).lines().join("\n")
    };
    let flat = |prior: &mut FramePriors| prior.disparity = Disparity::new(8, 8, vec![4.0; 64]);
    assert!(lines(&flat).contains("disparities of 3 of 3 photos are the same everywhere"), "{}", lines(&flat));
    let lost = |prior: &mut FramePriors| prior.disparity = Disparity::new(8, 8, vec![f32::NAN; 64]);
    assert!(lines(&lost).contains("nothing is held to them"), "{}", lines(&lost));
    let hidden = |prior: &mut FramePriors| {
        [&mut prior.flow.forward, &mut prior.flow.backward].into_iter().flatten().for_each(|flow| {
            flow.seen = BitMask::new(8, 8);
        });
    };
    assert!(lines(&hidden).contains("no optical flow"), "{}", lines(&hidden));
    for (moves, said) in [(true, "movers: everything"), (false, "movers: none")] {
        let mask = |prior: &mut FramePriors| prior.moves = Some(BitMask::from_fn(8, 8, |_, _| moves));
        assert!(lines(&mask).contains(said), "{}", lines(&mask));
    }
    let same = |_: &mut FramePriors| {};
    assert!(lines(&same).contains("movers: as the motion masks of all photos say"), "{}", lines(&same));
}

#[test]
fn degenerate_films_have_finite_gradients() {
    for frames in [1, 2, 3] {
        let data = of_times(frames);
        let all = |moves: bool, disparity: f32| -> Vec<FramePriors> {
            known(&data)
                .into_iter()
                .map(|prior| FramePriors {
                    moves: Some(BitMask::from_fn(8, 8, |_, _| moves)),
                    disparity: Disparity::new(8, 8, vec![disparity; 64]),
                    ..prior
                })
                .collect()
        };
        for priors in [nothing(&data), known(&data), all(true, 3.0), all(false, 0.0), all(true, f32::NAN)] {
            for (flow, hides) in [(nsff::flow as crate::plan::NewFlow, true), (dynamic_nerf::flow, false)] {
                let mut config = with_scene_flow(&filmed(8), flow, hides);
                // Features of the times of these photos.
                config.moving = config.moving.map(|moving| {
                    let features = crate::rays::gradient_tests::planes(&data, "hybrid").features;
                    crate::rays::MovingConfig { features, ..moving }
                });
                for step in [2, 3] {
                    let driver = seen(config.clone(), &data, priors.clone(), step);
                    for chunk in &driver.work.chunks {
                        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
                        assert!(chunk.stats.loss.is_finite(), "{frames} frames");
                        assert!(finite(&chunk.moving_bars.network) && finite(&chunk.colour_grad), "{frames} frames");
                    }
                }
            }
        }
    }
}

#[test]
fn constant_disparities_cost_nothing() {
    let data = filmed(8);
    let loss = |disparity: Option<Disparity>| -> f64 {
        let priors = nothing(&data).into_iter().map(|prior| FramePriors { disparity: disparity.clone(), ..prior });
        let driver = seen(with_scene_flow(&data, nsff::flow, true), &data, priors.collect(), 2);
        driver.work.chunks.iter().map(|chunk| chunk.stats.loss).sum()
    };
    assert_eq!(loss(None), loss(Disparity::new(8, 8, vec![2.5; 64])));
}

#[test]
fn the_share_of_rays_is_that_of_the_picture() {
    let film = filmed(8);
    let driver = seen(with_scene_flow(&film, dynamic_nerf::flow, false), &film, nothing(&film), 2);
    let (mut rays, mut most) = (0, 0.0_f32);
    for flow in driver.work.chunks.iter().map(|chunk| &chunk.flow) {
        let (chosen, here) = (&flow.rays, &flow.passes[HERE].seen);
        let shares = &here.moving_share;
        assert_eq!(shares.len(), chosen.len());
        for (r, share) in shares.iter().enumerate() {
            let (mut trans, mut want) = (1.0, 0.0);
            let mut movers = chosen.movers(r).peekable();
            for i in chosen.span(r) {
                let tau = f64::from(chosen.tau[i]);
                // What of the matter that was rendered is not the still part's.
                let moving = movers
                    .next_if(|&k| chosen.at[k] as usize == i)
                    .map_or(0.0, |k| tau - (1.0 - f64::from(here.blend[k])) * f64::from(chosen.still[i]));
                want += trans * (1.0 - (-tau).exp()) * if tau > 0.0 { moving / tau } else { 0.0 };
                trans *= (-tau).exp();
            }
            assert!((f64::from(*share) - want).abs() < 1e-3, "ray {r}: {share} for {want}");
        }
        assert!(shares.iter().all(|share| (0.0..=1.0 + 1e-5).contains(share)), "{shares:?}");
        assert!([NEXT, PREVIOUS, BEYOND].iter().all(|&pass| flow.passes[pass].seen.moving_share.is_empty()));
        rays += shares.len();
        most = shares.iter().fold(most, |most, share| most.max(*share));
    }
    assert!(rays > 20 && most > 0.1, "{rays} rays, at most {most}");
}
