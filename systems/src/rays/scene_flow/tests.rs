//! What is seen in the frames beside, and what is known of these.

use super::chosen::Chosen;
use super::film::{BEYOND, Film, FramePriors, HERE, NEXT, PASSES, PREVIOUS};
use super::term::{FlowRays, FlowTerm, Seen, SeenBars};
use crate::papers::dynamic::{dynamic_nerf, nsff};
use crate::rays::budget_tests::{randomised, table};
use crate::rays::gradient_tests::{known, tiny, with_moving_part, with_scene_flow};
use crate::rays::moving_tests::filmed;
use crate::rays::step::Plan;
use crate::rays::{RayConfig, RaySystem};
use crate::space::SpaceKind;
use engine::data::Dataset;
use field_core::rng::Rng;
use glam::DVec3;
use render_core::space_map::SpaceMap;
use scene_io::synthetic::{OrbitOptions, orbit};
use scene_io::{BitMask, Disparity, ImageStore, Split, StoreOptions};
use std::sync::Arc;

/// Photos of this many times.
fn of_times(train: usize) -> Dataset {
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

fn nothing(data: &Dataset) -> Vec<FramePriors> {
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
fn tiles_move_where_enough_of_their_pixels_do() {
    let data = of_times(2);
    let film = Film::with(&data, known(&data));
    let tiles = film.tiles(0, 4);
    assert_eq!(tiles.iter().map(|tile| tile.moves).collect::<Vec<_>>(), [true, false, true, false]);
    assert_eq!(tiles[3].middle, [6, 6]);
    assert!(Film::with(&data, nothing(&data)).tiles(0, 4).is_empty());
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

/// Two rays of three and two samples, of which two and one move, and what is seen along them in all frames.
#[derive(Clone)]
struct Made {
    rays: Vec<f32>,
    /// `[passes][6][m]`, `[passes][rays][3]`, `[passes][n]`
    flow: [Vec<f32>; PASSES],
    colour: [Vec<f32>; PASSES],
    w: [Vec<f32>; PASSES],
    hidden: Vec<f32>,
    blend: Vec<f32>,
}

const OFFSETS: [u32; 3] = [0, 3, 5];
const MOVING: [u32; 3] = [0, 2, 3];
const AT: [u32; 3] = [0, 2, 4];
const N: usize = 5;
const M: usize = 3;

fn uniform(len: usize, stream: u64, low: f32, high: f32) -> Vec<f32> {
    let mut out = vec![0.0; len];
    Rng::new(11, stream).fill_uniform(0, &mut out);
    out.iter().map(|u| low + (high - low) * u).collect()
}

impl Made {
    fn new() -> Self {
        let of = |len: usize, from: u64, low: f32, high: f32| {
            std::array::from_fn(|pass| uniform(len, from + pass as u64, low, high))
        };
        Self {
            rays: uniform(3 * N, 1, 0.4, 0.6),
            flow: of(6 * M, 10, -0.08, 0.08),
            colour: of(6, 20, 0.0, 1.0),
            w: of(N, 30, 0.1, 0.4),
            hidden: uniform(2 * M, 40, 0.1, 0.9),
            blend: uniform(M, 41, 0.1, 0.9),
        }
    }

    fn chosen(&self, film: &Film) -> Chosen {
        Chosen {
            rays: vec![0, 1],
            offsets: OFFSETS.into(),
            moving: MOVING.into(),
            at: AT.into(),
            x: self.rays.clone(),
            dt: uniform(N, 2, 0.1, 0.2),
            still: uniform(N, 3, 0.1, 0.9),
            disparity: uniform(N, 4, 0.1, 0.9),
            frames: vec![film.frames(1, Some(NEXT)), film.frames(2, Some(NEXT))],
            place: vec![[6, 2], [1, 5]],
            pixel: vec![[6.5, 2.5], [1.5, 5.5]],
            truth: vec![[0.1, 0.5, 0.9], [0.3, 0.2, 0.7]],
            factor: vec![1.0, 0.5],
            ..Chosen::default()
        }
    }

    fn seen(&self, rays: &Chosen) -> [Seen; PASSES] {
        let mut x = Vec::new();
        rays.gather(&self.rays, &mut x);
        let moved = |from: &[f32], flow: &[f32]| from.iter().zip(flow).map(|(x, s)| x + s).collect::<Vec<f32>>();
        let next = moved(&x, &self.flow[HERE][..3 * M]);
        let previous = moved(&x, &self.flow[HERE][3 * M..]);
        let beyond = moved(&next, &self.flow[NEXT][..3 * M]);
        let mut places = [x, next, previous, beyond].into_iter();
        std::array::from_fn(|pass| Seen {
            known: rays.frames.iter().map(|frames| frames.beside[pass].is_some()).collect(),
            x: places.next().unwrap(),
            flow: self.flow[pass].clone(),
            hidden: self.hidden.clone(),
            blend: self.blend.clone(),
            colour: self.colour[pass].clone(),
            w: self.w[pass].clone(),
        })
    }

    /// What a term costs, and the derivatives that it says.
    fn cost(&self, film: &Film, term: &dyn FlowTerm) -> (f64, [SeenBars; PASSES]) {
        let rays = self.chosen(film);
        let seen = self.seen(&rays);
        let mut bars: [SeenBars; PASSES] = Default::default();
        bars.iter_mut().zip(&seen).for_each(|(bars, seen)| bars.begin(seen));
        let of = FlowRays {
            rays: &rays,
            seen: seen.each_ref(),
            chained: Some(NEXT),
            film,
            map: SpaceMap::Box { centre: DVec3::new(0.0, 0.0, 0.3), radius: 1.2 },
            unit: 1.2,
            fade: 1.0,
            share: 0.25,
            per_sample: 0.4,
        };
        let mut loss = 0.0;
        term.add(&of, &mut bars, &mut loss);
        (loss, bars)
    }
}

#[test]
fn gradients_of_terms_are_those_of_differences() {
    let data = of_times(4);
    let film = Film::with(&data, known(&data));
    let flow = with_scene_flow(&data, dynamic_nerf::flow, true).moving.unwrap().flow.unwrap();
    let with_hidden = with_scene_flow(&data, nsff::flow, true).moving.unwrap().flow.unwrap();
    let made = Made::new();
    let (mut checked, mut learning, mut kinks) = (0, 0, 0);
    for term in flow.terms.iter().chain(with_hidden.terms.iter()) {
        let name = format!("{term:?}");
        let (_, bars) = made.cost(&film, &**term);
        let mut check = |what: &str, got: f32, shift: &dyn Fn(&mut Made, f32)| {
            let at = |h: f32| {
                let mut made = made.clone();
                shift(&mut made, h);
                made.cost(&film, &**term).0
            };
            let slope = |h: f32| 0.25 * (at(h) - at(-h)) / (2.0 * f64::from(h));
            let (wide, want) = (slope(2e-3), slope(1e-3));
            checked += 1;
            // Where a distance changes its sign it has no derivative.
            if (wide - want).abs() > 1e-3 * want.abs().max(0.05) {
                kinks += 1;
                return;
            }
            let off = (f64::from(got) - want).abs();
            assert!(off < 3e-3 * want.abs().max(0.05), "{name}, {what}: {got} for {want}");
            learning += usize::from(got != 0.0);
        };
        for (pass, bars) in bars.iter().enumerate() {
            // Where the second flow of a chain leads is no term's: it is brought back with the pass.
            for (i, got) in bars.flow.iter().enumerate() {
                check(&format!("flow {i} of pass {pass}"), *got, &|made, h| made.flow[pass][i] += h);
            }
            for (i, got) in bars.colour.iter().enumerate() {
                check(&format!("colour {i} of pass {pass}"), *got, &|made, h| made.colour[pass][i] += h);
            }
        }
        let SeenBars { hidden, blend, w, .. } = &bars[HERE];
        for (i, got) in hidden.iter().enumerate() {
            check(&format!("hidden {i}"), *got, &|made, h| made.hidden[i] += h);
        }
        for (i, got) in blend.iter().enumerate() {
            check(&format!("blend {i}"), *got, &|made, h| made.blend[i] += h);
        }
        // The weights that a render is believed by are held.
        for (i, got) in w.iter().enumerate() {
            check(&format!("weight {i}"), *got, &|made, h| made.w[HERE][i] += h);
        }
    }
    assert!(checked > 500 && learning > 100 && 20 * kinks < checked, "{learning} of {checked}, {kinks} at kinks");
}
