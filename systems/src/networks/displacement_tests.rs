//! The network that moves points, as it is wired: the gradient of a step against differences of its equations in `f64`, nothing at
//! `t = 0`, and a known motion that is found.

use super::chunk::{Chunk, Context, Inputs, Pass};
use super::ray_gradient_tests::Held;
use super::{DisplacementShape, Origin, Recipe, TwoLevel};
use crate::papers::dynamic::d_nerf_published::DNerfNetworks;
use crate::papers::static_scenes::nerf::{Nerf, NerfConfig};
use crate::plan::made;
use crate::space::{InternalRay, Space, SpaceKind};
use engine::data::{Batch, Dataset};
use engine::options::Background;
use engine::render::plain_query;
use engine::system::{LayerRequest, Normals, Query, System};
use field_core::rng::Rng;
use glam::{DMat3, DVec2, DVec3};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;
use testkit::gradient::{Tolerance, central_difference, compare};
use testkit::reference::network::{Bias, Network};

const BOTH: [Origin; 2] = [Origin::Tied, Origin::Exact];
/// Width of all layers, and rows of a point and of a time with one octave.
const WIDTH: usize = 4;
const POINT: usize = 9;
const TIME: usize = 3;
/// Parameters of the canonical trunk: two layers.
const TRUNK: usize = (POINT + 1) * WIDTH + (WIDTH + 1) * WIDTH;
/// Six layers: the encoded point comes in once more.
const SHAPE: DisplacementShape =
    DisplacementShape { origin: Origin::Tied, octaves: 1, time_octaves: 1, width: WIDTH, depth: 6 };

/// The network of the canonical scene: `octaves` of the point, two layers.
fn canonical(octaves: usize, width: usize) -> NerfConfig {
    let mut config = NerfConfig::published(SpaceKind::Box);
    let network = &mut config.levels.network;
    (network.position_octaves, network.direction_octaves, network.width, network.depth) = (octaves, 1, width, 2);
    (config.levels.rays.coarse, config.levels.rays.fine) = (16, 16);
    config
}

fn space() -> Space {
    Space::boxed(DVec3::new(0.1, 0.0, 1.5), 1.6, 0.01)
}

/// Rays that cross the space.
fn rays(n: usize) -> Vec<Ray> {
    let pose = Pose { r: DMat3::IDENTITY, c: DVec3::new(0.2, 0.1, 0.2) };
    let camera = Camera::pinhole(16, 12, 15.0, 15.0, 8.0, 6.0, pose);
    let pixel = |i: usize| DVec2::new(0.5 + (5 * i % 16) as f64, 0.5 + (7 * i % 12) as f64);
    (0..n).map(|i| camera.ray(pixel(i)).unwrap()).collect()
}

/// Other parameters, with which there is matter.
fn randomise<R: Recipe>(system: &mut TwoLevel<R>, width: usize, trunk: usize) {
    for (i, p) in system.trained.params.iter_mut().enumerate() {
        *p += 0.8 * (Rng::new(9, 1).uniform_at(i as u64) - 0.5);
    }
    // The layer of the density, which is behind the trunk: matter everywhere, here more and there less.
    system.trained.params[trunk..trunk + width].iter_mut().for_each(|w| *w *= 0.3);
    system.trained.params[trunk + width] = 1.0;
    system.pack();
}

/// A ray of the twin.
struct TwinRay {
    o: [f64; 3],
    d: [f64; 3],
    view: [f64; 3],
    t: f64,
    truth: [f64; 3],
}

fn gamma(x: &[f64]) -> Vec<f64> {
    let octave = x.iter().map(|x| x.sin()).chain(x.iter().map(|x| x.cos()));
    x.iter().copied().chain(octave).collect()
}

fn relu(x: Vec<f64>) -> Vec<f64> {
    x.into_iter().map(|x| x.max(0.0)).collect()
}

/// A network at the head of `params`, which is moved past it.
fn network(params: &mut &[f64], widths: &[usize], x: &[f64]) -> Vec<f64> {
    let network = Network { widths, skips: &[], bias: Bias::Each };
    let (own, rest) = params.split_at(network.param_count());
    *params = rest;
    network.forward(own, x)
}

/// `Psi(x, t)`.
fn psi(mut params: &[f64], x: &[f64], t: f64) -> Vec<f64> {
    let input = [gamma(x), gamma(&[t])].concat();
    let hidden = relu(network(&mut params, &[POINT + TIME, WIDTH, WIDTH, WIDTH, WIDTH, WIDTH], &input));
    network(&mut params, &[POINT + WIDTH, WIDTH, 3], &[gamma(x), hidden].concat())
}

/// The parameters of the displacement, behind those of the canonical scene.
fn displacement_of(params: &[f64]) -> &[f64] {
    &params[TRUNK + (WIDTH + 1) + (WIDTH + 1) * WIDTH + (WIDTH + POINT + 1) * (WIDTH / 2) + (WIDTH / 2 + 1) * 3..]
}

/// Raw density and colour of a point of the canonical scene.
fn canonical_at(mut params: &[f64], x: &[f64], view: &[f64]) -> (f64, Vec<f64>) {
    let h = relu(network(&mut params, &[POINT, WIDTH, WIDTH], &gamma(x)));
    let raw = network(&mut params, &[WIDTH, 1], &h)[0];
    let features = network(&mut params, &[WIDTH, WIDTH], &h);
    let colour = network(&mut params, &[WIDTH + POINT, WIDTH / 2, 3], &[features, gamma(view)].concat());
    (raw, colour.into_iter().map(|c| 1.0 / (1.0 + (-c).exp())).collect())
}

/// The squared error of a ray at a level of so many samples, mean over channels.
fn level(params: &[f64], ray: &TwinRay, origin: Origin, count: usize) -> f64 {
    let dt = 2.0 / count as f64;
    let (mut trans, mut rgb) = (1.0, [0.0; 3]);
    for i in 0..count {
        let at = 0.3 + dt * i as f64;
        let mut x: Vec<f64> = (0..3).map(|a| ray.o[a] + at * ray.d[a]).collect();
        if ray.t != 0.0 {
            let mut dx = psi(displacement_of(params), &x, ray.t);
            if origin == Origin::Tied {
                let rest = psi(displacement_of(params), &x, 0.0);
                dx.iter_mut().zip(rest).for_each(|(dx, rest)| *dx -= rest);
            }
            x.iter_mut().zip(dx).for_each(|(x, dx)| *x += dx);
        }
        let (raw, colour) = canonical_at(params, &x, &ray.view);
        let alpha = 1.0 - (-raw.max(0.0) * dt).exp();
        (0..3).for_each(|c| rgb[c] += trans * alpha * colour[c]);
        trans *= 1.0 - alpha;
    }
    // Before white.
    (0..3).map(|c| (rgb[c] + trans - ray.truth[c]).powi(2)).sum::<f64>() / 3.0
}

/// The loss of a batch: both levels, mean over rays.
fn loss(params: &[f64], rays: &[TwinRay], origin: Origin) -> f64 {
    let of = |ray: &TwinRay| level(params, ray, origin, 6) + level(params, ray, origin, 9);
    rays.iter().map(of).sum::<f64>() / rays.len() as f64
}

/// Compare loss and gradient of a step with the twin's; two views of these times. Returns the gradient of the displacement.
fn check(origin: Origin, times: [f64; 2]) -> Vec<f32> {
    const RAYS: usize = 6;
    let recipe = DNerfNetworks::small(canonical(1, WIDTH), DisplacementShape { origin, ..SHAPE }, &times);
    let mut system = TwoLevel::new(Held(recipe), space(), Background::White, 3).unwrap();
    randomise(&mut system, WIDTH, TRUNK);
    let rays = rays(RAYS);
    let rgb: Vec<[f32; 3]> = (0..RAYS).map(|i| [0, 1, 2].map(|c| ((5 * i + 3 * c) % 7) as f32 / 7.0)).collect();
    let mut inputs = Inputs { batch: Batch::of_rays(&rays, &rgb), ..Inputs::default() };
    inputs.batch.view.iter_mut().enumerate().for_each(|(i, view)| *view = i as u32 % 2);
    inputs.put_on(|_| [1.0; 3]);
    let internal: Vec<InternalRay> = rays.iter().map(|ray| system.space.internal_ray(ray)).collect();
    let (ops, mut chunk, hit) = (system.ops(), Chunk::default(), Vec::from_iter(0..RAYS));
    let share = 1.0 / RAYS as f32;
    let ctx = Context { share, pass: Pass::Learn, ..system.context(&ops, &inputs) };
    system.run_rays(&ctx, 0..RAYS, &internal, &hit, &mut chunk);

    let wide = |x: [f32; 3]| x.map(f64::from);
    let twins: Vec<TwinRay> = (0..RAYS)
        .map(|i| TwinRay {
            o: wide(internal[i].o),
            d: wide(internal[i].d),
            view: wide(internal[i].view),
            t: f64::from(times[i % 2] as f32),
            truth: wide(rgb[i]),
        })
        .collect();
    let params: Vec<f64> = system.trained.params.iter().map(|&p| f64::from(p)).collect();
    let (got, want) = (chunk.sums.loss / RAYS as f64, loss(&params, &twins, origin));
    assert!((got - want).abs() < 1e-4 * want, "{origin:?} {times:?}: loss {got}, by its equations {want}");
    let want = central_difference(&params, |params| loss(params, &twins, origin));
    let canonical = system.shapes.canonical_count();
    assert_eq!(displacement_of(&params).len(), params.len() - canonical);
    for (what, range) in [("canonical", 0..canonical), ("displacement", canonical..params.len())] {
        let (got, want) = (&chunk.grad[range.clone()], &want[range]);
        // Differences across the kinks of rectified units are off by a part of one sample's share.
        compare("gradient", got, want, Tolerance::new(3e-3, 1e-6))
            .unwrap_or_else(|e| panic!("{origin:?} {times:?}, {what}: {e}"));
        let largest = want.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        let rests = what == "displacement" && times == [0.0; 2];
        assert!(rests || largest > 1e-4, "{what}: next to no gradient: {largest}");
    }
    chunk.grad[canonical..].to_vec()
}

#[test]
fn the_gradient_of_a_step_is_that_of_differences() {
    for origin in BOTH {
        check(origin, [0.4, 0.9]);
        // Rays of both kinds in one tile.
        check(origin, [0.0, 0.7]);
    }
}

#[test]
fn what_does_not_move_teaches_the_displacement_nothing_at_all() {
    for origin in BOTH {
        assert!(check(origin, [0.0; 2]).iter().all(|g| *g == 0.0), "{origin:?}");
    }
}

fn query(time: f64) -> Query {
    let layers = LayerRequest { normals: Normals::Compute, ..LayerRequest::default() };
    Query { time, layers, ..plain_query([1.0; 3], 0.0) }
}

#[test]
fn at_time_0_the_canonical_network_is_seen_bit_for_bit() {
    for origin in BOTH {
        let recipe = DNerfNetworks::small(canonical(1, WIDTH), DisplacementShape { origin, ..SHAPE }, &[0.0, 1.0]);
        let mut warped = TwoLevel::new(recipe, space(), Background::White, 3).unwrap();
        randomise(&mut warped, WIDTH, TRUNK);
        let mut still = Nerf::new(canonical(1, WIDTH), space(), Background::White, 3).unwrap();
        let n = still.shapes.param_count();
        for network in still.trained.params.chunks_exact_mut(n) {
            network.copy_from_slice(&warped.trained.params[..n]);
        }
        still.pack();
        let rays = rays(60);
        assert!(warped.render(&rays, &query(0.0)) == still.render(&rays, &query(0.0)), "{origin:?}");
        assert!(warped.render(&rays, &query(0.5)) != still.render(&rays, &query(0.5)), "{origin:?}: nothing moves");

        let points: Vec<[f64; 3]> = (0..40).map(|k| [0.02 * f64::from(k) - 0.3, 0.1, 1.5]).collect();
        let way = |time: f64| {
            let mut there = vec![[0.0; 3]; points.len()];
            warped.canonical(&points, time, &mut there);
            let ways = points.iter().zip(&there).map(|(from, to)| DVec3::from(*to).distance(DVec3::from(*from)));
            ways.fold(0.0, f64::max)
        };
        assert_eq!(way(0.0), 0.0);
        // Right after it one moves hardly, the other jumps.
        let soon = way(1e-6);
        assert!(if origin == Origin::Tied { soon < 1e-4 } else { soon > 1e-3 }, "{origin:?}: {soon}");
        let [mut then, mut at_0, mut known] = [[0.0; 40]; 3];
        warped.density(&points, 0.5, &mut then);
        warped.density(&points, 0.0, &mut at_0);
        still.density(&points, 0.0, &mut known);
        assert!(at_0 == known && then != known, "{origin:?}");
    }
}

/// The way of every point from time 1 to time 0, in the cube `[-1, 1]^3`, which is the world here.
const WAY: [f32; 3] = [0.2, -0.15, 0.1];
const TEACHER: DisplacementShape =
    DisplacementShape { origin: Origin::Tied, octaves: 2, time_octaves: 1, width: 16, depth: 2 };

/// A random scene all of whose points go [`WAY`], steadily.
fn teacher(space: Space, times: &[f64]) -> TwoLevel<DNerfNetworks> {
    let (width, rows) = (TEACHER.width, 15 + TIME);
    let mut system =
        TwoLevel::new(DNerfNetworks::small(canonical(2, width), TEACHER, times), space, Background::White, 3).unwrap();
    randomise(&mut system, width, 16 * width + (width + 1) * width);
    let at = system.shapes.canonical_count();
    let params = &mut system.trained.params[at..];
    params.fill(0.0);
    // The first unit of each layer holds the time.
    let (second, last) = ((rows + 1) * width, (rows + 1) * width + (width + 1) * width);
    (params[15], params[second]) = (1.0, 1.0);
    (0..3).for_each(|a| params[last + a * width] = WAY[a]);
    system.pack();
    system
}

/// What a camera sees of a system at a time.
fn photo(system: &TwoLevel<DNerfNetworks>, k: usize, time: f64) -> Vec<[f32; 3]> {
    let (camera, side) = (made::camera(k), 0..made::SIDE);
    let pixels = side.clone().flat_map(|y| side.clone().map(move |x| DVec2::new(x.into(), y.into())));
    let rays: Vec<Ray> = pixels.map(|p| camera.ray(p + 0.5).unwrap()).collect();
    system.render(&rays, &Query { time, ..plain_query([1.0; 3], 0.0) }).rgb
}

/// Photos of a system at these times, each by all cameras.
fn filmed(system: &TwoLevel<DNerfNetworks>, times: &[f64]) -> Dataset {
    let frames = times.iter().flat_map(|&time| {
        let photos: Vec<_> = (0..12).map(|k| photo(system, k, time)).collect();
        let colour = |k: usize, x: u32, y: u32| {
            let [r, g, b] = photos[k][(y * made::SIDE + x) as usize].map(|c| (255.0 * c).round() as u8);
            [r, g, b, 255]
        };
        let mut frames = made::frames(3, colour);
        frames.iter_mut().for_each(|frame| frame.time = Some(time));
        frames
    });
    made::scene(frames.collect(), Vec::new()).1
}

/// How far canonical points of time 1 are from where they should be, mean over points, as a share of the way.
fn off(system: &TwoLevel<DNerfNetworks>) -> f64 {
    let axis = || (0..4).map(|i| 0.3 * f64::from(i) - 0.45);
    let points: Vec<[f64; 3]> = axis().flat_map(|x| axis().flat_map(move |y| axis().map(move |z| [x, y, z]))).collect();
    let mut there = vec![[0.0; 3]; points.len()];
    system.canonical(&points, 1.0, &mut there);
    let way = DVec3::from(WAY.map(f64::from));
    let off = points.iter().zip(&there).map(|(from, to)| (DVec3::from(*to) - DVec3::from(*from) - way).length());
    off.sum::<f64>() / points.len() as f64 / way.length()
}

#[test]
fn a_known_translation_is_found_where_the_canonical_scene_is_known() {
    let (space, times) = (Space::boxed(DVec3::ZERO, 1.0, 0.01), [0.0, 0.5, 1.0]);
    let of_views: Vec<f64> = times.iter().flat_map(|t| [*t; 12]).collect();
    let teacher = teacher(space, &of_views);
    assert!(off(&teacher) < 1e-4, "{}", off(&teacher));
    let data = filmed(&teacher, &times);
    let recipe = DNerfNetworks::small(canonical(2, TEACHER.width), TEACHER, &of_views);
    let mut student = TwoLevel::new(recipe, space, Background::White, 4).unwrap();
    let known = &teacher.trained.params[..teacher.shapes.canonical_count()];
    let truth: Vec<f32> = photo(&teacher, 0, 1.0).into_flattened();
    let error = |student: &TwoLevel<DNerfNetworks>| {
        let seen = photo(student, 0, 1.0).into_flattened();
        seen.iter().zip(&truth).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / truth.len() as f64
    };
    let give_canonical = |student: &mut TwoLevel<DNerfNetworks>| {
        student.trained.params[..known.len()].copy_from_slice(known);
        student.pack();
    };
    give_canonical(&mut student);
    // What stays where it is is as far off as the way is long.
    let (off_before, error_before) = (off(&student), error(&student));
    assert!(off_before > 0.95 && error_before > 1e-5, "{off_before} {error_before}");
    for step in 0..500 {
        student.step(&data, step).unwrap();
        give_canonical(&mut student);
    }
    let (off, error) = (off(&student), error(&student));
    println!("off by {off_before:.3}, then {off:.3} of the way; squared error {error_before:.2e}, then {error:.2e}");
    assert!(off < 0.5 && error < 0.3 * error_before, "{off}, {error_before} {error}");
}
