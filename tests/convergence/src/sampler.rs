//! Where the samples of a study lie.

use crate::method::Method;
use crate::study::{Study, uniform};
use core::ops::ControlFlow;
use render_core::occupancy::{GridSettings, OccupancyGrid, RaySpan, StepRule};
use render_core::quadrature::{LastInterval, Samples, weights};
use render_core::sample::{
    Spacing, bin_edges, dt_from_points, invert_cdf, invert_linear, merge_sorted, stratified_bins,
};
use std::time::Instant;
use testkit::analytic::Field;

/// How samples are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sampler {
    /// Equally spaced, nothing random.
    Uniform,
    /// One at random in each of equal bins. The rules that join samples get the ends of the ray as well.
    Stratified,
    /// A third equally spaced, the rest where their weights are: NeRF's two passes, without random numbers.
    CoarseToFine,
    /// The same with samples that follow the density, linear between the coarse ones.
    CoarseToFineLinear,
    /// Equally spaced steps, taken only in the occupied cells of a grid of 64 along the span of the field.
    Occupancy,
}

/// Samples of a batch of rays.
pub(super) struct Rays {
    pub(super) offsets: Vec<u32>,
    pub(super) t: Vec<f32>,
    pub(super) dt: Vec<f32>,
    /// Times that the field was or will be asked.
    pub(super) asked: usize,
}

impl Rays {
    fn new() -> Self {
        Self { offsets: vec![0], t: vec![], dt: vec![], asked: 0 }
    }

    /// Points with an interval from each to the next, and from the last one to `far`.
    fn push_points(&mut self, t: &[f32], far: f32) {
        let mut dt = vec![0.0; t.len()];
        dt_from_points(t, far, &mut dt);
        self.push(t, &dt);
    }

    /// The mid-points of bins.
    fn push_bins(&mut self, edges: &[f32]) {
        let (t, dt): (Vec<f32>, Vec<f32>) = edges.windows(2).map(|e| (0.5 * (e[0] + e[1]), e[1] - e[0])).unzip();
        self.push(&t, &dt);
    }

    fn push(&mut self, t: &[f32], dt: &[f32]) {
        self.t.extend(t);
        self.dt.extend(dt);
        self.asked += t.len();
        self.offsets.push(self.t.len() as u32);
    }
}

impl Sampler {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Uniform, Self::Stratified, Self::CoarseToFine, Self::CoarseToFineLinear, Self::Occupancy];

    /// For tables: no spaces.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Stratified => "stratified",
            Self::CoarseToFine => "coarse-to-fine",
            Self::CoarseToFineLinear => "coarse-to-fine-linear",
            Self::Occupancy => "occupancy",
        }
    }

    /// About `n` samples for each ray. Adds the time that takes, without that of asking the field.
    pub(super) fn place(
        self,
        study: &Study,
        field: &Field,
        spans: &[[f32; 2]],
        method: Method,
        n: usize,
        seconds: &mut f64,
    ) -> Rays {
        let mut rays = Rays::new();
        let grid = (self == Self::Occupancy).then(|| occupancy(field));
        for (r, &span) in spans.iter().enumerate() {
            // Random numbers of their own for each ray and number of samples.
            let u = |k: usize| uniform(study.seed ^ (n as u64) << 32, (r * 4096 + k) as u64 + 0x1000_0000);
            match (self, &grid) {
                (Self::Occupancy, Some(grid)) => march(&mut rays, grid, field, span, method, n, seconds),
                (Self::CoarseToFine | Self::CoarseToFineLinear, _) => {
                    self.two_passes(&mut rays, study, field, span, method, n, seconds);
                }
                (Self::Stratified, _) => stratified(&mut rays, span, method, n, u, seconds),
                _ => timed(seconds, || {
                    if method == Method::MidPoint {
                        rays.push_bins(&edges(span, n));
                    } else {
                        rays.push_points(&nodes(span, method, n), span[1]);
                    }
                }),
            }
        }
        rays
    }

    #[expect(clippy::too_many_arguments, reason = "private, and called once")]
    fn two_passes(
        self,
        rays: &mut Rays,
        study: &Study,
        field: &Field,
        span: [f32; 2],
        method: Method,
        n: usize,
        seconds: &mut f64,
    ) {
        let coarse = n / 3;
        let fine = n - coarse;
        // What the coarse pass sees, and for mid-points throws away.
        let linear = self == Self::CoarseToFineLinear;
        let bins = edges(span, coarse);
        let seen: Vec<f32> = if linear {
            nodes(span, Method::Trapezoid, coarse.max(2))
        } else {
            bins.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect()
        };
        let sigma: Vec<f32> = seen.iter().map(|&t| field.density.at(t.into()) as f32).collect();
        rays.asked += seen.len();
        timed(seconds, || {
            let wanted = if method == Method::MidPoint { fine - 1 } else { fine };
            let u: Vec<f32> = (0..wanted).map(|k| (k as f32 + 0.5) / wanted as f32).collect();
            let mut drawn = vec![0.0; wanted];
            if linear {
                invert_linear(&seen, &sigma, &u, &mut vec![0.0; seen.len()], &mut drawn);
            } else {
                let tau: Vec<f32> = sigma.iter().zip(bins.windows(2)).map(|(s, e)| s * (e[1] - e[0])).collect();
                let (mut w, mut end) = (vec![0.0; coarse], [0.0]);
                let samples = Samples { offsets: &[0, coarse as u32], tau: &tau, last: LastInterval::Finite };
                weights(study.simd, samples, &mut w, &mut end);
                // Ten thousandths for the empty bins: what the coarse pass missed is not missed for good.
                invert_cdf(&bins, &w, 1e-4, &u, &mut vec![0.0; coarse + 1], &mut drawn);
            }
            if method == Method::MidPoint {
                let mut edges = vec![span[0]];
                edges.extend(&drawn);
                edges.push(span[1]);
                rays.push_bins(&edges);
            } else {
                let mut t = vec![0.0; seen.len() + drawn.len()];
                merge_sorted(&seen, &drawn, &mut t);
                rays.asked -= seen.len();
                if !linear && method != Method::LeftPoint {
                    t.insert(0, span[0]);
                    t.push(span[1]);
                }
                rays.push_points(&t, span[1]);
            }
        });
    }
}

fn timed(seconds: &mut f64, f: impl FnOnce()) {
    let start = Instant::now();
    f();
    *seconds += start.elapsed().as_secs_f64();
}

fn edges([near, far]: [f32; 2], n: usize) -> Vec<f32> {
    let mut edges = vec![0.0; n + 1];
    bin_edges(near, far, Spacing::Linear, &mut edges);
    edges
}

/// `n` points from `near` on: up to `far` for the rules that join them, short of it for the one that looks left.
fn nodes(span: [f32; 2], method: Method, n: usize) -> Vec<f32> {
    if method == Method::LeftPoint {
        let mut t = edges(span, n);
        t.pop();
        t
    } else {
        edges(span, n - 1)
    }
}

fn stratified(rays: &mut Rays, span: [f32; 2], method: Method, n: usize, u: impl Fn(usize) -> f32, seconds: &mut f64) {
    let joins = matches!(method, Method::Trapezoid | Method::PiecewiseLinear);
    let inside = if joins { n - 2 } else { n };
    let u: Vec<f32> = (0..inside).map(u).collect();
    timed(seconds, || {
        let mut t = vec![0.0; inside];
        stratified_bins(span[0], span[1], Spacing::Linear, &u, &mut t);
        if method == Method::MidPoint {
            let dt: Vec<f32> = edges(span, n).windows(2).map(|e| e[1] - e[0]).collect();
            rays.push(&t, &dt);
            return;
        }
        if joins {
            t.insert(0, span[0]);
            t.push(span[1]);
        }
        rays.push_points(&t, span[1]);
    });
}

/// Cells of the grid along the span of the field.
const CELLS: u32 = 64;

/// Largest optical depth that all cells which count as empty may hide together.
const HIDDEN: f64 = 1e-4;

/// A grid with the span of the field along its x axis: a row of cells is occupied where the field is.
fn occupancy(field: &Field) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(GridSettings::default().with_resolution(CELLS))
        .unwrap_or_else(|e| unreachable!("the settings make a grid: {e}"));
    let [near, far] = field.span;
    let cell = (far - near) / f64::from(CELLS);
    let occupied: Vec<f32> = (0..CELLS)
        .map(|x| {
            let from = near + f64::from(x) * cell;
            // A hair more than the cell: its faces are rounded.
            let depth = field.density.depth(from - 1e-4 * cell, from + 1.0001 * cell);
            if depth > HIDDEN / f64::from(CELLS) { 1.0 } else { 0.0 }
        })
        .collect();
    let cells: Vec<u32> = (0..CELLS.pow(3)).collect();
    let thickness: Vec<f32> = cells.iter().map(|&id| occupied[grid.coordinates(id).1[0] as usize]).collect();
    grid.update(&cells, &thickness);
    grid
}

/// Steps of one length through the occupied cells.
fn march(
    rays: &mut Rays,
    grid: &OccupancyGrid,
    field: &Field,
    [near, far]: [f32; 2],
    method: Method,
    n: usize,
    seconds: &mut f64,
) {
    timed(seconds, || {
        let step = (far - near) / n as f32;
        let [start, end] = field.span.map(|t| t as f32);
        let scale = 2.0 / (end - start);
        // Along x, inside a row of cells.
        let o = [-1.0 - start * scale, 0.01, 0.01];
        let ray = RaySpan { o, d: [scale, 0.0, 0.0], t_min: near, t_max: far };
        let jitter = if method == Method::MidPoint { 0.5 } else { 0.0 };
        let joins = matches!(method, Method::Trapezoid | Method::PiecewiseLinear);
        let mut t: Vec<f32> = vec![];
        grid.march(&ray, &StepRule::uniform(step), jitter, u32::MAX, |at, length| {
            // Where a run of steps ends, a sample closes it: the gap to the next run is joined to that one.
            if joins && t.last().is_some_and(|last| at > last + 1.5 * length) {
                t.push(t[t.len() - 1] + length);
            }
            t.push(at);
            ControlFlow::Continue(())
        });
        if joins {
            let close = t.last().map_or(far, |last| (last + step).min(far));
            t.push(close);
            rays.push_points(&t, close);
        } else {
            let dt = vec![step; t.len()];
            rays.push(&t, &dt);
        }
    });
}
