//! Memory of a tile of rays: the samples of both levels, and what they are drawn with.

use super::when::SampleTimes;
use crate::space::InternalRay;
use field_core::rng::Rng;
use field_core::tape::Arena;
use float_core::Simd;
use render_core::quadrature::{LastInterval, Samples, weights};

/// Memory of a tile.
#[derive(Default)]
pub struct Tile {
    /// The coarse level.
    pub(crate) coarse: Level,
    /// The fine level.
    pub(crate) fine: Level,
    /// Weights of the coarse samples, `[rays][coarse]`.
    pub(crate) w: Vec<f32>,
    /// Work space of the recipes: random numbers and samples of one ray.
    pub(crate) ray: RayScratch,
    pub(super) trans_end: Vec<f32>,
    pub(super) tau: Vec<f32>,
    pub(super) background: Vec<f32>,
    pub(super) bar: Vec<f32>,
    /// Codes of the photos, `[dims][n]` for the samples of one level.
    pub(super) appearance: Vec<f32>,
    pub(super) transient: Vec<f32>,
    /// Times of the samples of one level, where points move; and times beside them.
    pub(super) times: SampleTimes,
    pub(super) beside: SampleTimes,
}

/// Work space for the samples of one ray.
#[derive(Default)]
pub(crate) struct RayScratch {
    pub(crate) random: Vec<f32>,
    pub(crate) u: Vec<f32>,
    pub(crate) drawn: Vec<f32>,
    pub(crate) bins: Vec<f32>,
    pub(crate) mid: Vec<f32>,
    pub(crate) blurred: Vec<f32>,
    pub(crate) cdf: Vec<f64>,
}

/// The samples of a tile at one level. Samples stand for the intervals from `t` to `t + dt`.
#[derive(Default)]
pub struct Level {
    pub(super) arena: Arena,
    /// `[rays + 1]`
    pub(crate) offsets: Vec<u32>,
    /// `[n]`
    pub(crate) t: Vec<f32>,
    /// `[n]`
    pub(crate) dt: Vec<f32>,
    /// Positions, internal coordinates `[3][n]`.
    pub(crate) p: Vec<f32>,
    /// What the position encoding sees, `[rows][n]`; the first three rows are the position in `[-1, 1]`.
    pub(crate) x: Vec<f32>,
    /// Viewing directions, `[3][n]`.
    pub(crate) d: Vec<f32>,
    pub(super) noise: Vec<f32>,
}

impl Tile {
    /// Weights of the coarse samples from their densities.
    pub(super) fn weigh(&mut self, sigma: impl Iterator<Item = f32>, rays: usize) {
        let Self { coarse, w, trans_end, tau, .. } = self;
        tau.clear();
        tau.extend(sigma.zip(&coarse.dt).map(|(sigma, dt)| sigma * dt));
        w.resize(tau.len(), 0.0);
        trans_end.resize(rays, 0.0);
        let samples = Samples { offsets: &coarse.offsets, tau, last: LastInterval::Finite };
        weights(Simd::best(), samples, w, trans_end);
    }
}

impl Level {
    pub(crate) fn begin(&mut self) {
        self.t.clear();
        self.dt.clear();
        self.offsets.clear();
        self.offsets.push(0);
    }

    /// Add a ray's samples; `lengths` writes their `dt`.
    pub(crate) fn push(&mut self, t: &[f32], lengths: impl FnOnce(&mut [f32])) {
        let from = self.t.len();
        self.t.extend_from_slice(t);
        self.dt.resize(self.t.len(), 0.0);
        lengths(&mut self.dt[from..]);
        self.offsets.push(self.t.len() as u32);
    }

    /// Make room for `n` samples with `rows` rows of encoder input.
    pub(crate) fn make_room(&mut self, n: usize, rows: usize) {
        self.p.resize(3 * n, 0.0);
        self.x.resize(rows * n, 0.0);
        self.d.resize(3 * n, 0.0);
    }

    /// Viewing directions of all samples.
    pub(crate) fn set_directions(&mut self, rays: &[InternalRay]) {
        let n = self.t.len();
        for (r, ray) in rays.iter().enumerate() {
            for i in self.offsets[r] as usize..self.offsets[r + 1] as usize {
                for (a, view) in ray.view.into_iter().enumerate() {
                    self.d[a * n + i] = view;
                }
            }
        }
    }
}

/// Give each sample the code of its ray: `out` is `[dims][n]`.
pub(super) fn spread_codes<'c>(
    codes: impl Iterator<Item = &'c [f32]>,
    dims: usize,
    offsets: &[u32],
    out: &mut Vec<f32>,
) {
    let n = offsets.last().map_or(0, |&n| n as usize);
    out.resize(dims * n, 0.0);
    for (code, span) in codes.zip(offsets.windows(2)) {
        for (k, &value) in code.iter().enumerate() {
            out[k * n..][span[0] as usize..span[1] as usize].fill(value);
        }
    }
}

/// Backwards: add the gradients `bars` `[dims][n]` of a ray's samples to those of its code, `out` `[pixels][dims]`, at its
/// place.
pub(super) fn add_codes(bars: &[f32], offsets: &[u32], places: impl Iterator<Item = usize>, out: &mut [f32]) {
    let n = offsets.last().map_or(0, |&n| n as usize).max(1);
    let dims = bars.len() / n;
    for (place, span) in places.zip(offsets.windows(2)) {
        for (k, sum) in out[place * dims..][..dims].iter_mut().enumerate() {
            *sum += bars[k * n..][span[0] as usize..span[1] as usize].iter().sum::<f32>();
        }
    }
}

/// The random numbers of a ray from place `from` of its stream, `None` for a render.
pub(crate) fn ray_random<'u>(
    random: Option<&Rng>,
    ray: usize,
    from: u64,
    u: &'u mut Vec<f32>,
    n: usize,
) -> Option<&'u mut [f32]> {
    let rng = random?;
    u.resize(n, 0.0);
    rng.substream(ray as u64).fill_uniform(from, u);
    Some(u)
}
