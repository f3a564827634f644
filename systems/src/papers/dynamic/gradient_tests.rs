//! Each deformation, as it is wired, against its equations in `f64`: values, and the gradients of parameters and points against
//! central differences, number by number, with windows half open; and what a changed distance between neighbours costs.

use super::{d_nerf, endo_nerf, hyper_nerf, nerfies, t_nerf, tineuvox};
use crate::settings::Settings;
use crate::warps::{Deform, DeformGrad, DeformScratch, Points, Times, neighbour};
use engine::options::{RunOptions, parse_set};
use engine::system::SystemError;
use field_core::rng::Rng;
use testkit::gradient::{Tolerance, central_difference, compare};
use testkit::reference::network::{Bias, Network};

/// Settings with which every number can be moved; a system takes those that it has.
const SMALL: &[&str] = &[
    "warp_width=5",
    "warp_depth=2",
    "warp_octaves=2",
    "warp_anneal=1.0",
    "time_octaves=2",
    "time_code_dims=3",
    "planes=[2,3]",
    "plane_features=2",
    "plane_times=3",
    "ambient=2",
    "ambient_octaves=2",
    "ambient_width=4",
    "ambient_depth=2",
    "ambient_from=0.2",
    "ambient_anneal=1.0",
    "sees_octaves=2",
    // Stretches that are not small, between points that are not near.
    "coherence_reach=0.1",
    "coherence_scale=0.5",
];
const WIDTH: usize = 5;
const DIMS: usize = 3;
const FEATURES: usize = 2;
const TIME_CELLS: usize = 3;
/// Of neighbours, as above.
const REACH: f32 = 0.1;
const SCALE: f64 = 0.5;
/// Parameters of all planes: three in space and three in time, of 2 and of 3 cells.
const PLANES: usize = FEATURES * 3 * ((4 + 2 * TIME_CELLS) + (9 + 3 * TIME_CELLS));
/// Parameters of the ambient network: 12 octaves and a code, two layers of 4, two coordinates.
const AMBIENT: usize = (12 + DIMS + 1) * 4 + (4 + 1) * 4 + (4 + 1) * 2;
/// With this share of the schedule over the windows are half open.
const DONE: f64 = 0.7;
/// Times of the training views; nothing moves at the first, where a deformation has a canonical time.
const TIMES: [f64; 3] = [0.0, 0.375, 1.0];

type NewDeform = fn(&mut Settings<'_>, Times, u64) -> Result<Deform, SystemError>;

/// Everything that a deformation depends on.
struct Numbers<'p> {
    /// Of networks and planes.
    params: &'p [f64],
    /// Codes, or the network of the time.
    learned: &'p [f64],
}

/// A point of the unit cube at a time step.
#[derive(Clone, Copy)]
struct Sample {
    x: [f64; 3],
    step: usize,
}

/// `x'` in the unit cube, and what density sees besides.
type Moved = ([f64; 3], Vec<f64>);
type Twin = fn(&Numbers<'_>, Sample) -> Moved;

impl Sample {
    /// In the cube `[-1, 1]^3`.
    fn q(self) -> [f64; 3] {
        self.x.map(|x| 2.0 * x - 1.0)
    }

    fn t(self) -> f64 {
        TIMES[self.step]
    }
}

/// `gamma`: the numbers themselves, if they are part of it, then sines and cosines of each octave by its weight.
fn gamma(x: &[f64], window: &[f64], identity: bool) -> Vec<f64> {
    let mut out = if identity { x.to_vec() } else { Vec::new() };
    for (k, w) in window.iter().enumerate() {
        let scale = f64::from(1 << k);
        out.extend(x.iter().map(|x| w * (scale * x).sin()));
        out.extend(x.iter().map(|x| w * (scale * x).cos()));
    }
    out
}

/// Nerfies, section 3.5.
fn window(alpha: f64) -> [f64; 2] {
    [0.0, 1.0].map(|k| (1.0 - (std::f64::consts::PI * (alpha - k).clamp(0.0, 1.0)).cos()) / 2.0)
}

/// The window of the warp: open over the whole schedule, two octaves.
fn warp_window() -> [f64; 2] {
    window(DONE * 2.0)
}

/// That of the ambient coordinates: half of it is over, one octave.
fn ambient_window() -> [f64; 1] {
    [window(0.5)[0]]
}

/// A network at the head of `params`, which is moved past it.
fn network(params: &mut &[f64], widths: &[usize], x: &[f64]) -> Vec<f64> {
    let network = Network { widths, skips: &[], bias: Bias::Each };
    let (own, rest) = params.split_at(network.param_count());
    *params = rest;
    network.forward(own, x)
}

/// Products of planes of place and time, of both sets (K-Planes, equation 1).
fn planes(params: &[f64], at: Sample) -> Vec<f64> {
    let [x, y, z] = at.q();
    let at = [x, y, z, 2.0 * at.t() - 1.0];
    let mut table = &params[params.len() - PLANES..];
    let mut out = Vec::new();
    for cells in [2, 3] {
        let resolution = [cells, cells, cells, TIME_CELLS];
        let mut features = [1.0; FEATURES];
        for [a, b] in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
            let [wide, high] = [resolution[a], resolution[b]];
            let (plane, rest) = table.split_at(wide * high * FEATURES);
            table = rest;
            let place = |axis: usize, n: usize| {
                let u = (at[axis] + 1.0) / 2.0 * (n - 1) as f64;
                let cell = (u as usize).min(n - 2);
                (cell, u - cell as f64)
            };
            let ((i, u), (j, v)) = (place(a, wide), place(b, high));
            for (f, feature) in features.iter_mut().enumerate() {
                let value = |i: usize, j: usize| plane[(j * wide + i) * FEATURES + f];
                let low = (1.0 - u) * value(i, j) + u * value(i + 1, j);
                let top = (1.0 - u) * value(i, j + 1) + u * value(i + 1, j + 1);
                *feature *= (1.0 - v) * low + v * top;
            }
        }
        out.extend(features);
    }
    out
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `exp(omega) x + V(omega) v` by the formulas of Rodrigues.
fn rigid(x: [f64; 3], omega: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    let angle = omega.iter().map(|o| o * o).sum::<f64>().sqrt();
    let (c1, c2) = (angle.sin() / angle, (1.0 - angle.cos()) / angle.powi(2));
    let c3 = (angle - angle.sin()) / angle.powi(3);
    let (x1, v1) = (cross(omega, x), cross(omega, v));
    let (x2, v2) = (cross(omega, x1), cross(omega, v1));
    [0, 1, 2].map(|i| x[i] + c1 * x1[i] + c2 * x2[i] + v[i] + c2 * v1[i] + c3 * v2[i])
}

fn three(x: &[f64]) -> [f64; 3] {
    [x[0], x[1], x[2]]
}

/// Back to the unit cube.
fn unit(x: [f64; 3]) -> [f64; 3] {
    x.map(|x| 0.5 * x + 0.5)
}

fn time(at: Sample) -> Vec<f64> {
    gamma(&[at.t()], &[1.0; 2], true)
}

/// The same point at the time to which the canonical scene is tied.
fn origin(at: Sample) -> Sample {
    Sample { step: 0, ..at }
}

fn t_nerf(numbers: &Numbers<'_>, at: Sample) -> Moved {
    (at.x, [time(at), planes(numbers.params, at)].concat())
}

fn d_nerf(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let delta = psi_t(numbers, at);
    (unit([0, 1, 2].map(|i| at.q()[i] + delta[i])), planes(numbers.params, at))
}

fn d_nerf_tied(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let (now, then) = (psi_t(numbers, at), psi_t(numbers, origin(at)));
    (unit([0, 1, 2].map(|i| at.q()[i] + now[i] - then[i])), planes(numbers.params, at))
}

/// Equation 3 as published.
fn d_nerf_exact(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let delta = if at.t() == 0.0 { vec![0.0; 3] } else { psi_t(numbers, at) };
    (unit([0, 1, 2].map(|i| at.q()[i] + delta[i])), planes(numbers.params, at))
}

/// What the displacement's network says of a point at its time.
fn psi_t(numbers: &Numbers<'_>, at: Sample) -> Vec<f64> {
    let input = [gamma(&at.q(), &warp_window(), true), time(at), planes(numbers.params, at)].concat();
    network(&mut { numbers.params }, &[input.len(), WIDTH, WIDTH, 3], &input)
}

/// `T(x, w_i)`, and the parameters behind its network.
fn rigid_motion<'p>(numbers: &Numbers<'p>, code: &[f64], at: Sample) -> ([f64; 3], &'p [f64]) {
    let mut params = numbers.params;
    let input = [&gamma(&at.q(), &warp_window(), true), code, &planes(params, at)].concat();
    let twist = network(&mut params, &[input.len(), WIDTH, WIDTH, 6], &input);
    (unit(rigid(at.q(), three(&twist), three(&twist[3..]))), params)
}

fn nerfies(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let code = &numbers.learned[at.step * DIMS..][..DIMS];
    (rigid_motion(numbers, code, at).0, Vec::new())
}

fn hyper_nerf(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let code = &numbers.learned[at.step * DIMS..][..DIMS];
    let (x, mut params) = rigid_motion(numbers, code, at);
    let input = [&gamma(&at.q(), &[1.0; 2], false), code].concat();
    let a = network(&mut params, &[input.len(), 4, 4, 2], &input);
    (x, gamma(&a, &ambient_window(), false))
}

fn tineuvox(numbers: &Numbers<'_>, at: Sample) -> Moved {
    let t = time(at);
    let t = network(&mut { numbers.learned }, &[t.len(), WIDTH, DIMS], &t);
    let input = [gamma(&at.q(), &warp_window(), true), t.clone()].concat();
    let delta = network(&mut { numbers.params }, &[input.len(), WIDTH, WIDTH, 3], &input);
    let seen = [t, gamma(&at.q(), &[1.0; 2], true)].concat();
    (unit([0, 1, 2].map(|i| at.q()[i] + delta[i])), seen)
}

/// A deformation of small parts, as its system wires it with `more` settings.
fn small(new: NewDeform, more: &[&str]) -> Deform {
    let of = |set: toml::Table| {
        let run = RunOptions { seed: 3, background: None, error_budget: None, stop: None, set };
        let mut settings = Settings::new(&run);
        let deform = new(&mut settings, Times::of_list(&TIMES), 3).unwrap();
        (deform, settings.all().unwrap())
    };
    let (_, known) = of(toml::Table::new());
    let set = SMALL.iter().chain(more).map(|s| parse_set(s).unwrap()).filter(|(name, _)| known.contains_key(name));
    let mut deform = of(set.collect()).0;
    deform.randomise(DONE);
    deform
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

/// `[rows][n]` of a list of columns.
fn rows_of(columns: &[Vec<f64>]) -> Vec<f64> {
    (0..columns[0].len()).flat_map(|r| columns.iter().map(move |column| column[r])).collect()
}

/// Compare a deformation with its equations at points of these time steps.
fn check(name: &str, deform: &Deform, twin: Twin, which: &[u32]) {
    let (n, seen_rows) = (which.len(), deform.seen_rows());
    let mut x = vec![0.0; 3 * n];
    Rng::new(1, 2).fill_uniform(0, &mut x);
    let points = Points { x: &x, which, time_steps: deform.time_steps() };
    // A random linear functional of what comes out.
    let (mut x_bar, mut seen_bar) = (vec![0.0; 3 * n], vec![0.0; seen_rows * n]);
    Rng::new(8, 9).fill_uniform(0, &mut x_bar);
    Rng::new(8, 10).fill_uniform(0, &mut seen_bar);
    x_bar.iter_mut().chain(&mut seen_bar).for_each(|b| *b -= 0.5);

    let (params, learned) = deform.parameters();
    let (params, learned, places) = (wide(params), wide(learned), wide(&x));
    let sample = |x: &[f64], i: usize| Sample { x: [x[i], x[n + i], x[2 * n + i]], step: which[i] as usize };
    let moved = |params: &[f64], learned: &[f64], x: &[f64]| -> (Vec<f64>, Vec<f64>) {
        let numbers = Numbers { params, learned };
        let all: Vec<Moved> = (0..n).map(|i| twin(&numbers, sample(x, i))).collect();
        let x: Vec<Vec<f64>> = all.iter().map(|(x, _)| x.to_vec()).collect();
        let seen: Vec<Vec<f64>> = all.into_iter().map(|(_, seen)| seen).collect();
        (rows_of(&x), rows_of(&seen))
    };
    let what = |part: &str, result: Result<(), testkit::gradient::Mismatch>| {
        result.unwrap_or_else(|e| panic!("{name}, time steps {which:?}, {part}: {e}"));
    };

    let (mut there, mut seen) = (vec![f32::NAN; 3 * n], vec![f32::NAN; seen_rows * n]);
    deform.place(points, &mut there, &mut seen, &mut DeformScratch::default());
    let (want_there, want_seen) = moved(&params, &learned, &places);
    let value = Tolerance::new(2e-6, 1e-6);
    what("canonical points", compare("value", &there, &want_there, value));
    what("seen", compare("value", &seen, &want_seen, value));

    let (x_bar_wide, seen_bar_wide) = (wide(&x_bar), wide(&seen_bar));
    let functional = |params: &[f64], learned: &[f64], x: &[f64]| -> f64 {
        let (there, seen) = moved(params, learned, x);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        dot(&there, &x_bar_wide) + dot(&seen, &seen_bar_wide)
    };
    let mut grad = DeformGrad::default();
    grad.begin(deform);
    deform.learn(points, &mut x_bar, &seen_bar, &mut grad, &mut DeformScratch::default());
    let (params_bar, learned_bar) = deform.gradients(&grad);

    let want = central_difference(&params, |params| functional(params, &learned, &places));
    assert!(
        which[0] == 0 || want.iter().filter(|g| g.abs() > 1e-3).count() > params.len() / 4,
        "{name}: next to no gradient"
    );
    // Each part keeps its own bound: the warp, ambient coordinates, planes.
    let planes = params.len() - if name == "tineuvox" { 0 } else { PLANES };
    let ambient = planes - if name == "hypernerf" { AMBIENT } else { 0 };
    for (part, range) in [("warp", 0..ambient), ("ambient", ambient..planes), ("planes", planes..params.len())] {
        what(part, compare("gradient", &params_bar[range.clone()], &want[range], Tolerance::SINGLE));
    }
    let want = central_difference(&learned, |learned| functional(&params, learned, &places));
    what("codes or network of the time", compare("gradient", &learned_bar, &want, Tolerance::SINGLE));
    let want = central_difference(&places, |x| functional(&params, &learned, x));
    what("points", compare("gradient", &x_bar, &want, Tolerance::SINGLE));
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// Compare what the distances of neighbours cost with their definition, at points of these time steps.
fn check_coherence(name: &str, deform: &Deform, twin: Twin, which: &[u32; 5]) {
    let (draws, n) = (Rng::new(6, 1), which.len());
    let w: [f32; 5] = [1.0, 0.25, 0.5, 0.0, 0.75];
    let mut x = vec![0.0; 3 * n];
    Rng::new(1, 2).fill_uniform(0, &mut x);
    let (params, learned) = deform.parameters();
    let (params, learned) = (wide(params), wide(learned));
    let cost = |params: &[f64], learned: &[f64]| -> f64 {
        let numbers = Numbers { params, learned };
        let of = |i: usize| {
            let here = [x[i], x[n + i], x[2 * n + i]];
            let ends = [here, neighbour(here, REACH, draws, i as u64)].map(|x| x.map(f64::from));
            let there = ends.map(|x| twin(&numbers, Sample { x, step: which[i] as usize }).0);
            let stretch = distance(there[0], there[1]) / distance(ends[0], ends[1]) - 1.0;
            f64::from(w[i]) * ((1.0 + (stretch / SCALE).powi(2)).sqrt() - 1.0)
        };
        (0..n).map(of).sum()
    };
    let what = |part: &str, result: Result<(), testkit::gradient::Mismatch>| {
        result.unwrap_or_else(|e| panic!("{name}, time steps {which:?}, coherence, {part}: {e}"));
    };
    let mut grad = DeformGrad::default();
    grad.begin(deform);
    let points = Points { x: &x, which, time_steps: deform.time_steps() };
    let sum = deform.coherence(points, &w, draws, 1.0, &mut grad, &mut DeformScratch::default());
    // Points in f32, a tenth apart: stretches of 1e-5 by rounding.
    what("value", compare("value", &[sum], &[cost(&params, &learned)], Tolerance::new(1e-3, 1e-5)));
    let (params_bar, learned_bar) = deform.gradients(&grad);
    let want = central_difference(&params, |params| cost(params, &learned));
    assert!(
        which[0] == 0 || want.iter().filter(|g| g.abs() > 1e-4).count() > params.len() / 8,
        "{name}: next to no gradient of coherence"
    );
    what("parameters", compare("gradient", &params_bar, &want, Tolerance::new(1e-3, 1e-5)));
    let want = central_difference(&learned, |learned| cost(&params, learned));
    what("codes or network of the time", compare("gradient", &learned_bar, &want, Tolerance::new(1e-3, 1e-5)));
}

#[test]
fn deformations_are_their_equations_and_gradients_are_those_of_differences() {
    let all: [(&str, NewDeform, &[&str], Twin); 8] = [
        ("t-nerf", t_nerf::deform, &[], t_nerf),
        ("d-nerf", d_nerf::deform, &[], d_nerf),
        ("d-nerf, tied", d_nerf::deform, &["origin=tied"], d_nerf_tied),
        ("d-nerf as published", d_nerf::deform, &["origin=exact"], d_nerf_exact),
        ("nerfies", nerfies::deform, &[], nerfies),
        ("hypernerf", hyper_nerf::deform, &[], hyper_nerf),
        ("tineuvox", tineuvox::deform, &[], tineuvox),
        ("endo-nerf", endo_nerf::deform, &[], d_nerf),
    ];
    for (name, new, more, twin) in all {
        let deform = small(new, more);
        // At any time, at the canonical one where there is one, and both in one tile.
        for which in [[1; 5], [0; 5], [0, 1, 2, 1, 0]] {
            check(name, &deform, twin, &which);
            if deform.warps() {
                check_coherence(name, &deform, twin, &which);
            }
        }
    }
}
