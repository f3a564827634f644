//! What terms of scene flow cost, of two rays that are made up, and their derivatives.

use super::chosen::Chosen;
use super::film::{BEYOND, Film, HERE, NEXT, PASSES};
use super::term::{FlowRays, FlowTerm, Seen, SeenBars};
use super::tests::{nothing, of_times};
use crate::papers::dynamic::{dynamic_nerf, nsff};
use crate::rays::gradient_tests::{known, with_scene_flow};
use engine::data::Dataset;
use field_core::rng::Rng;
use glam::DVec3;
use render_core::space_map::SpaceMap;

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
    /// `[rays]`
    moving_share: Vec<f32>,
    fade: f64,
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
            moving_share: uniform(2, 42, 0.1, 0.9),
            fade: 1.0,
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
            moving_share: if pass == HERE { self.moving_share.clone() } else { Vec::new() },
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
            fade: self.fade,
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
        let SeenBars { hidden, blend, w, moving_share, .. } = &bars[HERE];
        for (i, got) in hidden.iter().enumerate() {
            check(&format!("hidden {i}"), *got, &|made, h| made.hidden[i] += h);
        }
        for (i, got) in blend.iter().enumerate() {
            check(&format!("blend {i}"), *got, &|made, h| made.blend[i] += h);
        }
        for (i, got) in moving_share.iter().enumerate() {
            check(&format!("moving share {i}"), *got, &|made, h| made.moving_share[i] += h);
        }
        // The weights that a render is believed by are held.
        for (i, got) in w.iter().enumerate() {
            check(&format!("weight {i}"), *got, &|made, h| made.w[HERE][i] += h);
        }
    }
    assert!(checked > 500 && learning > 100 && 20 * kinks < checked, "{learning} of {checked}, {kinks} at kinks");
}

/// The only term of a system whose name, as it debugs, begins so.
fn term(name: &str, flow: crate::plan::NewFlow, data: &Dataset) -> impl Fn(&Made, &Film) -> (f64, [SeenBars; PASSES]) {
    let flow = with_scene_flow(data, flow, true).moving.unwrap().flow.unwrap();
    let at = flow.terms.iter().position(|term| format!("{term:?}").starts_with(name)).unwrap();
    move |made, film| made.cost(film, &*flow.terms[at])
}

#[test]
fn renders_count_by_the_share_that_moves_once_priors_fade_and_the_share_is_held() {
    let data = of_times(4);
    let film = Film::with(&data, nothing(&data));
    let made = Made::new();
    for (name, flow, by_share) in
        [("nsff", nsff::flow as crate::plan::NewFlow, true), ("dynamic-nerf", dynamic_nerf::flow, false)]
    {
        let renders = term("Renders", flow, &data);
        let at = |fade: f64, shares: [f32; 2]| {
            let made = Made { fade, moving_share: shares.into(), ..made.clone() };
            renders(&made, &film)
        };
        let (first, bars) = at(1.0, [0.5, 0.25]);
        let (later, later_bars) = at(0.1, [0.5, 0.25]);
        assert_eq!(first, at(1.0, [0.1, 0.9]).0, "{name}: nothing counts by its share yet");
        assert_eq!(later, at(0.01, [0.5, 0.25]).0, "{name}: the factor itself does not fade");
        assert!(later_bars[HERE].moving_share.iter().all(|bar| *bar == 0.0), "{name}");
        let counts: [f32; 2] = if by_share { [0.5, 0.25] } else { [1.0; 2] };
        for (pass, (bars, later)) in bars.iter().zip(&later_bars).enumerate() {
            for (i, (bar, later)) in bars.colour.iter().zip(&later.colour).enumerate() {
                assert!((later - counts[i / 3] * bar).abs() <= 1e-6 * bar.abs(), "{name}, colour {i} of pass {pass}");
            }
            for (i, (bar, later)) in bars.hidden.iter().zip(&later.hidden).enumerate() {
                let ray = usize::from(i % M >= MOVING[1] as usize);
                assert!((later - counts[ray] * bar).abs() <= 1e-6 * bar.abs(), "{name}, hidden {i}");
            }
        }
        // What does not move at all has no dynamic render to learn from.
        assert_eq!(at(0.1, [0.0; 2]).0 == 0.0, by_share, "{name}");
    }
}

#[test]
fn what_is_wholly_hidden_is_believed_nowhere_but_costs_its_prior() {
    let data = of_times(4);
    let film = Film::with(&data, nothing(&data));
    // All weight is on what moves.
    let w = vec![0.4, 0.0, 0.2, 0.0, 0.3];
    let made = Made { hidden: vec![1.0; 2 * M], w: std::array::from_fn(|_| w.clone()), ..Made::new() };
    let renders = term("Renders", nsff::flow, &data);
    let (cost, bars) = renders(&made, &film);
    assert!(bars[NEXT].colour.iter().chain(&bars[BEYOND].colour).all(|bar| bar.abs() < 1e-7), "{bars:?}");
    assert!(cost > 0.0 && bars[HERE].colour.iter().any(|bar| *bar != 0.0), "its own render costs");
    let (most, _) = term("Hidden", nsff::flow, &data)(&made, &film);
    let (least, _) = term("Hidden", nsff::flow, &data)(&Made { hidden: vec![0.0; 2 * M], ..made }, &film);
    assert!(most > 0.0 && least == 0.0, "{most} and {least}");
}

#[test]
fn masks_draw_the_share_of_a_ray_to_what_they_say_until_priors_fade() {
    let data = of_times(4);
    // The first ray is of a pixel that rests, the second of one that moves.
    let film = Film::with(&data, known(&data));
    let mask = term("Mask", dynamic_nerf::flow, &data);
    let made = |moving_share: [f32; 2], fade| Made { moving_share: moving_share.into(), fade, ..Made::new() };
    let (cost, bars) = mask(&made([0.25, 0.25], 1.0), &film);
    // Factor 0.3; the second ray counts half.
    assert!((cost - 0.3 * (0.25 + 0.5 * 0.75)).abs() < 1e-6, "{cost}");
    let want: [f32; 2] = [0.25 * 0.3, -0.25 * 0.5 * 0.3];
    assert!(bars[HERE].moving_share.iter().zip(want).all(|(bar, want)| (bar - want).abs() < 1e-6), "{bars:?}");
    assert_eq!(mask(&made([0.0, 1.0], 1.0), &film).0, 0.0, "as the mask says");
    assert_eq!(mask(&made([0.25, 0.25], 0.1), &film).0, 0.0, "later");
    assert_eq!(mask(&made([0.25, 0.25], 1.0), &Film::with(&data, nothing(&data))).0, 0.0, "without masks");
}

#[test]
fn entropy_is_that_of_the_weights_of_the_rays_and_none_where_a_ray_ends_on_one_sample() {
    let data = of_times(4);
    let film = Film::with(&data, nothing(&data));
    let entropy = term("Entropy", dynamic_nerf::flow, &data);
    let of = |w: [f32; N]| {
        let mut made = Made::new();
        made.w[HERE] = w.into();
        entropy(&made, &film)
    };
    assert_eq!(of([0.0, 1.0, 0.0, 1.0, 0.0]).0, 0.0);
    let w = [0.1, 0.2, 0.3, 0.4, 0.5_f32];
    // Factor 0.1; the second ray counts half.
    let of_ray = |w: &[f32]| -w.iter().map(|&w| f64::from(w) * f64::from(w).ln()).sum::<f64>();
    let (cost, bars) = of(w);
    assert!((cost - 0.1 * (of_ray(&w[..3]) + 0.5 * of_ray(&w[3..]))).abs() < 1e-7, "{cost}");
    assert!((f64::from(bars[HERE].w[1]) - 0.25 * 0.1 * (-f64::from(w[1]).ln() - 1.0)).abs() < 1e-7, "{bars:?}");
    for w in [[0.0; N], [1e-45; N], [1e30; N]] {
        let (cost, bars) = of(w);
        assert!(cost.is_finite() && bars[HERE].w.iter().all(|bar| bar.is_finite()), "{w:?}: {cost}");
    }
}

#[test]
fn paths_that_go_straight_on_cost_no_acceleration_here_and_in_the_frames_beside() {
    let data = of_times(6);
    let film = Film::with(&data, nothing(&data));
    let steady = term("Steady", nsff::flow, &data);
    // The same way on and back for each axis, wherever it is asked for.
    let axis = |speed: f32| [speed; M];
    let on: Vec<f32> = [0.02, -0.01, 0.03].into_iter().flat_map(axis).collect();
    let both: Vec<f32> = on.iter().copied().chain(on.iter().map(|s| -s)).collect();
    let straight = Made { flow: std::array::from_fn(|_| both.clone()), ..Made::new() };
    let (cost, bars) = steady(&straight, &film);
    assert!(cost < 1e-9 && bars.iter().all(|bars| bars.flow.iter().all(|bar| bar.abs() < 1e-5)), "{cost}");
    // The frame after turns: its own flow learns, and the flow that leads there.
    let mut turned = straight.clone();
    for k in [0, M - 1] {
        turned.flow[NEXT][k] += 0.05;
    }
    let (more, bars) = steady(&turned, &film);
    // 0.05 of a side is 0.1 of half a side; factor 0.05, 0.4 for each sample.
    assert!((more - 2.0 * 0.05 * 0.4 * 0.01).abs() < 1e-6, "{more}");
    let want: f32 = 0.25 * 0.05 * 0.4 * 2.0 * 0.1 * 2.0;
    for k in [0, M - 1] {
        let off = [bars[NEXT].flow[k] - want, bars[HERE].flow[k] + want];
        assert!(off.iter().all(|off| off.abs() < 1e-2 * want), "{bars:?}");
    }
    // At the end of a film, where the second ray is, no path goes on.
    let short = of_times(3);
    let (_, bars) = steady(&turned, &Film::with(&short, nothing(&short)));
    assert!(bars[NEXT].flow[0] > 0.0 && bars[NEXT].flow[M - 1] == 0.0, "{bars:?}");
}
