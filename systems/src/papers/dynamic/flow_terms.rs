//! What scene flow costs in NSFF (Li et al., 2021) and DynamicNeRF (Gao et al., 2021): a struct for each term.
//!
//! Letters: `S` scene flow of a moving sample to a frame beside, `p` whether it is hidden there, `w` its weight in the render of the moving
//! part, `m` the blend weight; `j` a frame beside frame `i`; `D` the moving part's share of what a ray shows, `Z` a disparity; `M` the
//! pixels that a mask says move.
//!
//! ```text
//! renders   |C - C_i|^2 + sum_j W_j |C_j - C_i|^2         W_j = sum_k sg(w_k) (1 - p_k)      NSFF, photometric; p = 0 in DynamicNeRF
//!           times sg(D) later                             NSFF, code
//! entropy   -w ln w                                       DynamicNeRF, sparsity
//! hidden    p                                             NSFF, its prior
//! cycle     (1 - p) |S_ij + S_ji(x + S_ij)|               both, code
//! optical   |pi_j(sum w (x + S)) - u - F|                 NSFF, geometric consistency; DynamicNeRF, motion matching
//! small     |S|                                           NSFF, minimal; DynamicNeRF, slow
//! spatial   |S_k - S_(k + 1)| in the world, along a ray   both, code
//! steady    |S_next + S_previous|^2 in the world          both, smooth in time; of paths that go on from the frames beside, too
//! order     (Z - sg(Z_still))^2 where M = 0               DynamicNeRF, depth order
//! still     m where M = 0                                 DynamicNeRF, rigidity
//! mask      |D - M|                                       DynamicNeRF, code
//! ```
//!
//! The first two stand in `render_terms`, the last three in `mask_terms`. Means over pixels, or over the samples of pixels, of all rays
//! that take part; what has no moving sample costs nothing.

use super::mask_terms::{Mask, Order, Still};
use super::render_terms::{Entropy, Renders};
use crate::rays::{FlowRays, FlowTerm, HERE, NEXT, PASSES, PREVIOUS, SeenBars};
use crate::settings::Settings;
use engine::system::SystemError;
use losses::kernel::Kernel;
use losses::scene_flow::{self, CycleBar, Near, SPATIAL_SHARE, TEMPORAL_SHARE};
use losses::variation;
use render_core::induced_flow::{
    Coordinates, Neighbours, Rest, expected_points, expected_points_backward, induced_flow, induced_flow_backward,
};
use render_core::space_map::SpaceMap;
use serde::{Deserialize, Serialize};

/// Nothing is seen nearer to a camera, world units.
const Z_MIN: f64 = 1e-6;

/// Factors of the terms; 0: the term is not there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FlowWeights {
    /// Factor of the errors of the moving part alone, here and in the frames beside.
    pub(super) flow_renders: f32,
    /// Factor of what is said to be hidden; only where the system says that.
    pub(super) flow_hidden: f32,
    /// Factor of scene flow that does not come back.
    pub(super) flow_cycle: f32,
    /// Factor of the distance to optical flow, pixels.
    pub(super) flow_optical: f32,
    /// Factor of all scene flow.
    pub(super) flow_small: f32,
    /// Factor of differences of scene flow along a ray.
    pub(super) flow_spatial: f32,
    /// Factor of squared accelerations.
    pub(super) flow_steady: f32,
    /// Factor of squared distances between the disparities of both parts where a mask says that nothing moves.
    pub(super) flow_order: f32,
    /// Factor of the moving part's blend weights there, until the factors of priors fall for the first time.
    pub(super) flow_still: f32,
    /// Factor of the distance of the moving part's share of a ray from 1 where a mask says that something moves, from 0 where it says
    /// that nothing does; as long.
    pub(super) flow_mask: f32,
    /// Factor of the entropy of the weights in the render of the moving part.
    pub(super) flow_entropy: f32,
    /// Whether errors of renders count by the moving part's share of the ray, once the factors of priors have fallen for the first time.
    pub(super) flow_by_share: bool,
}

impl FlowWeights {
    /// After `--set`.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(super) fn asked(&self, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let asked: Self = settings.of(self)?;
        for (field, value) in [
            ("flow_renders", asked.flow_renders),
            ("flow_hidden", asked.flow_hidden),
            ("flow_cycle", asked.flow_cycle),
            ("flow_optical", asked.flow_optical),
            ("flow_small", asked.flow_small),
            ("flow_spatial", asked.flow_spatial),
            ("flow_steady", asked.flow_steady),
            ("flow_order", asked.flow_order),
            ("flow_still", asked.flow_still),
            ("flow_mask", asked.flow_mask),
            ("flow_entropy", asked.flow_entropy),
        ] {
            if !(0.0..=10.0).contains(&value) {
                let problem = "must be in 0..=10".into();
                return Err(SystemError::Config { field, value: value.to_string(), problem });
            }
        }
        Ok(asked)
    }

    /// The terms whose factors are not 0.
    pub(super) fn terms(&self) -> Vec<Box<dyn FlowTerm>> {
        let of = |factor: f32, term: fn(f64) -> Box<dyn FlowTerm>| (factor > 0.0).then(|| term(f64::from(factor)));
        let Self { flow_renders, flow_by_share: by_share, .. } = *self;
        let renders = (flow_renders > 0.0)
            .then(|| Box::new(Renders { factor: f64::from(flow_renders), by_share }) as Box<dyn FlowTerm>);
        [
            renders,
            of(self.flow_hidden, |factor| Box::new(Hidden { factor })),
            of(self.flow_cycle, |factor| Box::new(Cycle { factor })),
            of(self.flow_optical, |factor| Box::new(Optical { factor })),
            of(self.flow_small, |factor| Box::new(Small { factor })),
            of(self.flow_spatial, |factor| Box::new(Spatial { factor })),
            of(self.flow_steady, |factor| Box::new(Steady { factor })),
            of(self.flow_order, |factor| Box::new(Order { factor })),
            of(self.flow_still, |factor| Box::new(Still { factor })),
            of(self.flow_mask, |factor| Box::new(Mask { factor })),
            of(self.flow_entropy, |factor| Box::new(Entropy { factor })),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// A result that cannot be an error: rows are as long as there are samples, and the kernels are usable.
fn fits<T>(result: Result<T, losses::LossError>) -> T {
    result.expect("rows are as long as there are samples")
}

/// Where the scene flow to a pass lies among `[6][m]`, and what is hidden there among `[2][m]`.
fn halves(pass: usize, m: usize) -> [std::ops::Range<usize>; 2] {
    if pass == NEXT { [0..3 * m, 0..m] } else { [3 * m..6 * m, m..2 * m] }
}

/// What is hidden.
#[derive(Debug)]
struct Hidden {
    factor: f64,
}

impl FlowTerm for Hidden {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let factor = self.factor * seen.per_sample;
        *loss += factor * seen.seen[HERE].hidden.iter().map(|&p| f64::from(p)).sum::<f64>();
        bars[HERE].hidden.iter_mut().for_each(|bar| *bar += (f64::from(seen.share) * factor) as f32);
    }
}

/// There and back again.
#[derive(Debug)]
struct Cycle {
    factor: f64,
}

impl FlowTerm for Cycle {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (rays, [_, m], here) = (seen.rays, seen.rays.samples(), seen.seen[HERE]);
        let factor = self.factor * seen.per_sample;
        for (pass, back) in [(NEXT, PREVIOUS), (PREVIOUS, NEXT)] {
            let other = seen.seen[pass];
            let ([there, hidden], [back, _]) = (halves(pass, m), halves(back, m));
            let mut w = vec![0.0; m];
            for r in (0..rays.len()).filter(|&r| other.known[r]) {
                for k in rays.movers(r) {
                    w[k] = 1.0 - here.hidden.get(hidden.start + k).copied().unwrap_or(0.0);
                }
            }
            *loss +=
                factor * fits(scene_flow::cycle(&here.flow[there.clone()], &other.flow[back.clone()], &w, Kernel::L1));
            let mut w_bar = vec![0.0; m];
            let [of_here, of_beside @ ..] = bars;
            let bar = CycleBar {
                there: &mut of_here.flow[there.clone()],
                back: &mut of_beside[pass - NEXT].flow[back.clone()],
                w: &mut w_bar,
            };
            let loss_bar = factor * f64::from(seen.share);
            fits(scene_flow::cycle_backward(&here.flow[there], &other.flow[back], &w, Kernel::L1, loss_bar, bar));
            for r in (0..rays.len()).filter(|&r| other.known[r] && !here.hidden.is_empty()) {
                rays.movers(r).for_each(|k| of_here.hidden[hidden.start + k] -= w_bar[k]);
            }
        }
    }
}

/// Gradients of where samples are in the frame of `pass`, `[3][m]`, are those of scene flow, but where a sample is held in space.
fn add_to_flow(seen: &FlowRays<'_>, pass: usize, x_bar: &[f32], bars: &mut SeenBars) {
    let [_, m] = seen.rays.samples();
    let flow_bar = bars.flow[halves(pass, m)[0].clone()].iter_mut();
    for (sum, (bar, x)) in flow_bar.zip(x_bar.iter().zip(&seen.seen[pass].x)) {
        if *x > 0.0 && *x < 1.0 {
            *sum += bar;
        }
    }
}

/// Optical flow.
#[derive(Debug)]
struct Optical {
    factor: f64,
}

impl FlowTerm for Optical {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (rays, [n, _], count) = (seen.rays, seen.rays.samples(), seen.rays.len());
        let factor = self.factor * seen.fade;
        for pass in [NEXT, PREVIOUS] {
            let prior: Vec<Option<[f32; 2]>> =
                (0..count).map(|r| seen.film.flow(rays.frames[r].view, pass, rays.place[r])).collect();
            if prior.iter().all(Option::is_none) {
                continue;
            }
            let mut x = rays.x.clone();
            rays.scatter(&seen.seen[pass].x, &mut x);
            let (w, mut p) = (&seen.seen[HERE].w, vec![0.0; 3 * count]);
            expected_points(&rays.offsets, &x, w, Rest::Shared, &mut p);
            let of_ray: Vec<u32> = rays.frames.iter().map(|f| f.beside[pass].unwrap_or(f.view)).collect();
            let neighbours = Neighbours { cameras: seen.film.cameras(), of_ray: &of_ray, z_min: Z_MIN };
            let unit = Coordinates::Unit(&seen.map);
            let (mut flow, mut is_seen) = (vec![[0.0; 2]; count], vec![false; count]);
            induced_flow(&p, unit, neighbours, &rays.pixel, &mut flow, &mut is_seen);
            let mut flow_bar = vec![[0.0; 2]; count];
            for r in (0..count).filter(|&r| is_seen[r]) {
                let Some(prior) = prior[r] else { continue };
                // The mean over both coordinates.
                let of_ray = 0.5 * factor * f64::from(rays.factor[r]);
                for (a, prior) in prior.into_iter().enumerate() {
                    *loss += of_ray * f64::from(Kernel::L1.value(flow[r][a], prior));
                    let derivative = f64::from(Kernel::L1.derivative(flow[r][a], prior));
                    flow_bar[r][a] = (f64::from(seen.share) * of_ray * derivative) as f32;
                }
            }
            let mut p_bar = vec![0.0; 3 * count];
            induced_flow_backward(&p, unit, neighbours, &flow_bar, &mut p_bar, &mut []);
            let mut x_bar = vec![0.0; 3 * n];
            expected_points_backward(&rays.offsets, &x, w, Rest::Shared, &p_bar, &mut x_bar, &mut bars[HERE].w);
            let mut of_moving = Vec::new();
            rays.gather(&x_bar, &mut of_moving);
            add_to_flow(seen, pass, &of_moving, &mut bars[HERE]);
        }
    }
}

/// All scene flow.
#[derive(Debug)]
struct Small {
    factor: f64,
}

impl FlowTerm for Small {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (factor, flow) = (self.factor * seen.per_sample, &seen.seen[HERE].flow);
        *loss += factor * fits(variation::magnitude(flow, Kernel::L1));
        let loss_bar = factor * f64::from(seen.share);
        fits(variation::magnitude_backward(flow, Kernel::L1, loss_bar, &mut bars[HERE].flow));
    }
}

/// Scene flow to a pass in the world, in units of half its side: `[3][m]`.
fn world_flow(seen: &FlowRays<'_>, pass: usize) -> Vec<f32> {
    let [from, to] = [HERE, pass].map(|pass| {
        let x = &seen.seen[pass].x;
        let mut out = vec![0.0; x.len()];
        seen.map.world(x, &mut out);
        out
    });
    to.iter().zip(&from).map(|(to, from)| ((f64::from(*to) - f64::from(*from)) / seen.unit) as f32).collect()
}

/// The way back of [`world_flow`].
fn world_flow_backward(seen: &FlowRays<'_>, pass: usize, flow_bar: &[f32], bars: &mut SeenBars) {
    let world_bar: Vec<f32> = flow_bar.iter().map(|bar| (f64::from(*bar) / seen.unit) as f32).collect();
    let mut x_bar = vec![0.0; world_bar.len()];
    seen.map.world_backward(&seen.seen[pass].x, &world_bar, &mut x_bar);
    add_to_flow(seen, pass, &x_bar, bars);
}

/// The moving samples of rays; in normalised device coordinates without the last, which are at infinity.
fn near<'a>(seen: &FlowRays<'a>, share: f64) -> Near<'a> {
    let share = if matches!(seen.map, SpaceMap::Ndc { .. }) { share } else { 1.0 };
    Near { offsets: &seen.rays.moving, share }
}

/// Differences along a ray.
#[derive(Debug)]
struct Spatial {
    factor: f64,
}

impl FlowTerm for Spatial {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let near = near(seen, SPATIAL_SHARE);
        let factor = self.factor * seen.per_sample;
        for pass in [NEXT, PREVIOUS] {
            let flow = world_flow(seen, pass);
            *loss += factor * fits(scene_flow::spatial(&flow, near, Kernel::L1));
            let mut bar = vec![0.0; flow.len()];
            let loss_bar = factor * f64::from(seen.share);
            fits(scene_flow::spatial_backward(&flow, near, Kernel::L1, loss_bar, &mut bar));
            world_flow_backward(seen, pass, &bar, &mut bars[HERE]);
        }
    }
}

/// Accelerations: where a path comes from and where it goes to, here and in the frames beside.
#[derive(Debug)]
struct Steady {
    factor: f64,
}

impl FlowTerm for Steady {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let near = near(seen, TEMPORAL_SHARE);
        let factor = self.factor * seen.per_sample;
        let [next, previous] = [NEXT, PREVIOUS].map(|pass| world_flow(seen, pass));
        *loss += factor * fits(scene_flow::temporal(&next, &previous, near, Kernel::Squared));
        let (mut next_bar, mut previous_bar) = (vec![0.0; next.len()], vec![0.0; next.len()]);
        let loss_bar = factor * f64::from(seen.share);
        let [a, b] = [&mut next_bar, &mut previous_bar];
        fits(scene_flow::temporal_backward(&next, &previous, near, Kernel::Squared, loss_bar, a, b));
        world_flow_backward(seen, NEXT, &next_bar, &mut bars[HERE]);
        world_flow_backward(seen, PREVIOUS, &previous_bar, &mut bars[HERE]);
        for pass in [NEXT, PREVIOUS] {
            let path = Onward::new(seen, pass);
            *loss += factor * fits(scene_flow::temporal(&path.on, &path.back, near, Kernel::Squared));
            // Both have the same gradient, as their sum costs.
            let (mut on_bar, mut back_bar) = (vec![0.0; path.on.len()], vec![0.0; path.on.len()]);
            let [a, b] = [&mut on_bar, &mut back_bar];
            fits(scene_flow::temporal_backward(&path.on, &path.back, near, Kernel::Squared, loss_bar, a, b));
            path.backward(seen, &on_bar, &back_bar, bars);
        }
    }
}

/// The way of the moving samples from the frame of a pass one frame further, and back to where they are here: in the world, in units of half
/// its side, `[3][m]`; 0 along rays that have no such frame.
struct Onward {
    pass: usize,
    /// `[3][m]`, where they are one frame further, in the unit cube, and 1 where that was not held there, else 0.
    x: Vec<f32>,
    free: Vec<f32>,
    on: Vec<f32>,
    back: Vec<f32>,
}

impl Onward {
    fn new(seen: &FlowRays<'_>, pass: usize) -> Self {
        let (here, other, [_, m]) = (seen.seen[HERE], seen.seen[pass], seen.rays.samples());
        let further = || other.x.iter().zip(&other.flow[halves(pass, m)[0].clone()]).map(|(x, s)| x + s);
        let free = further().map(|x| if x > 0.0 && x < 1.0 { 1.0 } else { 0.0 }).collect();
        let x: Vec<f32> = further().map(|x| x.clamp(0.0, 1.0)).collect();
        let [from, on, back] = [&other.x, &x, &here.x].map(|x| {
            let mut out = vec![0.0; x.len()];
            seen.map.world(x, &mut out);
            out
        });
        let known: Vec<bool> =
            (0..seen.rays.len()).flat_map(|r| seen.rays.movers(r).map(move |_| other.known[r])).collect();
        let way = |to: &[f32]| -> Vec<f32> {
            let ways = to.iter().zip(&from).enumerate();
            let one = |(i, (to, from)): (usize, (&f32, &f32))| {
                if known[i % m] { ((f64::from(*to) - f64::from(*from)) / seen.unit) as f32 } else { 0.0 }
            };
            ways.map(one).collect()
        };
        let (on, back) = (way(&on), way(&back));
        Self { pass, x, free, on, back }
    }

    /// From gradients of both ways to those of the flow there, and of the flow that leads there.
    fn backward(&self, seen: &FlowRays<'_>, on_bar: &[f32], back_bar: &[f32], bars: &mut [SeenBars; PASSES]) {
        let (other, [_, m]) = (seen.seen[self.pass], seen.rays.samples());
        let scaled = |bar: f64| (bar / seen.unit) as f32;
        let there: Vec<f32> = on_bar.iter().map(|bar| scaled(f64::from(*bar))).collect();
        let from: Vec<f32> =
            on_bar.iter().zip(back_bar).map(|(on, back)| scaled(-f64::from(*on) - f64::from(*back))).collect();
        let (mut x_bar, mut from_bar) = (vec![0.0; there.len()], vec![0.0; there.len()]);
        seen.map.world_backward(&self.x, &there, &mut x_bar);
        seen.map.world_backward(&other.x, &from, &mut from_bar);
        x_bar.iter_mut().zip(&self.free).for_each(|(bar, free)| *bar *= free);
        let flow_bar = &mut bars[self.pass].flow[halves(self.pass, m)[0].clone()];
        flow_bar.iter_mut().zip(&x_bar).for_each(|(sum, bar)| *sum += bar);
        from_bar.iter_mut().zip(&x_bar).for_each(|(sum, bar)| *sum += bar);
        add_to_flow(seen, self.pass, &from_bar, &mut bars[HERE]);
    }
}
