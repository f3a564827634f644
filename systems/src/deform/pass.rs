//! A deformation of many points: there, and back. In tiles whose activations stay in the cache.

use super::record::{Moved, Warps};
use super::{Deform, Moments};
use field_core::tape::{Arena, Tape, TapeError};
use std::sync::atomic::{AtomicU64, Ordering};

/// Points of a tile.
const TILE: usize = 480;

/// Points and their moments.
#[derive(Clone, Copy)]
pub(crate) struct Points<'a> {
    /// `[3][n]`, in the unit cube.
    pub(crate) x: &'a [f32],
    /// `[n]`, which of the moments each belongs to.
    pub(crate) which: &'a [u32],
    /// The moments.
    pub(crate) moments: &'a Moments,
}

impl Points<'_> {
    /// Whether a point is not moved: nothing is at its moment.
    #[inline(always)]
    fn rests(&self, i: u32) -> bool {
        self.moments.still[self.which[i as usize] as usize]
    }
}

/// Where gradients of a deformation go.
#[derive(Clone, Debug, Default)]
pub(crate) struct DeformGrad {
    /// As the networks' parameters.
    pub(super) params: Vec<f32>,
    /// `[moments][dims]`
    pub(super) moments: Vec<f32>,
}

/// Work space.
#[derive(Default)]
pub(crate) struct DeformScratch {
    pub(super) arena: Arena,
    pub(super) columns: Vec<u32>,
    pub(super) x: Vec<f32>,
    pub(super) moment: Vec<f32>,
    pub(super) t: Vec<f32>,
    pub(super) x_bar: Vec<f32>,
    pub(super) seen_bar: Vec<f32>,
}

impl DeformScratch {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.arena.memory_bytes() + 4 * (self.x.capacity() + self.moment.capacity() + self.columns.capacity())
    }
}

/// Points that were asked for, and those that had to be warped.
#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(crate) all: AtomicU64,
    pub(crate) warped: AtomicU64,
    /// Points that an elastic loss looked at, and those of them where it saw space folded over itself.
    pub(crate) looked: AtomicU64,
    pub(crate) folded: AtomicU64,
    /// Octaves of windows, once for each point that was asked for, and those of them that were closed.
    pub(crate) octaves: AtomicU64,
    pub(crate) closed: AtomicU64,
}

/// The tape is built of shapes that fit: an error is a mistake in this module.
pub(super) fn recorded<T>(result: Result<T, TapeError>) -> T {
    result.unwrap_or_else(|e| panic!("the record does not fit: {e}"))
}

impl DeformGrad {
    /// All zero, for the moments of the training views.
    pub(crate) fn begin(&mut self, deform: &Deform) {
        self.begin_at(deform, &deform.moments);
    }

    /// All zero, for other moments.
    pub(crate) fn begin_at(&mut self, deform: &Deform, moments: &Moments) {
        for (buffer, len) in [(&mut self.params, deform.params.len()), (&mut self.moments, moments.rows.len())] {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
    }
}

/// Columns `columns` of the rows of `from`, `[rows][n]`, to `out`, `[rows][columns]`.
fn gather(from: &[f32], n: usize, columns: &[u32], out: &mut Vec<f32>) {
    out.clear();
    for row in from.chunks_exact(n) {
        out.extend(columns.iter().map(|&i| row[i as usize]));
    }
}

/// The way back: write `from` `[rows][columns]` over the columns of `out`, `[rows][n]`.
fn scatter(from: &[f32], n: usize, columns: &[u32], out: &mut [f32]) {
    for (from, out) in from.chunks_exact(columns.len()).zip(out.chunks_exact_mut(n)) {
        for (value, &i) in from.iter().zip(columns) {
            out[i as usize] = *value;
        }
    }
}

impl Deform {
    /// Whether each point has to be asked for, or only those that are moved.
    fn columns(&self, points: &Points<'_>, columns: &mut Vec<u32>) {
        columns.clear();
        let everywhere = self.seen_rows() > 0;
        columns.extend((0..points.which.len() as u32).filter(|&i| everywhere || !points.rests(i)));
    }

    /// Some points had the octaves of windows before them.
    pub(super) fn count_octaves(&self, points: usize, warps: Warps) {
        let warp = if warps == Warps::Yes { &self.warp_window[..] } else { &[] };
        let windows = warp.iter().chain(&self.ambient_window);
        let closed = windows.clone().filter(|w| **w == 0.0).count();
        self.counts.octaves.fetch_add((points * windows.count()) as u64, Ordering::Relaxed);
        self.counts.closed.fetch_add((points * closed) as u64, Ordering::Relaxed);
    }

    /// Whether nothing of the ambient coordinates has come in yet.
    pub(super) fn ambient_is_closed(&self) -> bool {
        self.ambient_window.iter().all(|&w| w == 0.0)
    }

    /// Points, rows and times of some columns.
    pub(super) fn fill_tile(
        points: &Points<'_>,
        columns: &[u32],
        x: &mut Vec<f32>,
        moment: &mut Vec<f32>,
        t: &mut Vec<f32>,
    ) {
        gather(points.x, points.which.len(), columns, x);
        let Moments { dims, rows, times, .. } = points.moments;
        t.clear();
        t.extend(columns.iter().map(|&i| times[points.which[i as usize] as usize]));
        moment.clear();
        for k in 0..*dims {
            moment.extend(columns.iter().map(|&i| rows[points.which[i as usize] as usize * dims + k]));
        }
    }

    /// Canonical points, written over `x` `[3][n]`, and what the density network sees besides features, over `seen`
    /// `[seen_rows][n]`.
    pub(crate) fn place(&self, points: Points<'_>, x: &mut [f32], seen: &mut [f32], scratch: &mut DeformScratch) {
        let n = points.which.len();
        x.copy_from_slice(points.x);
        let DeformScratch { arena, columns, x: tile_x, moment, t, .. } = scratch;
        let ops = self.ops();
        self.counts.all.fetch_add(n as u64, Ordering::Relaxed);
        for warps in [Warps::Yes, Warps::No] {
            // What rests is asked only for what else is seen of it.
            let moves = warps == Warps::Yes;
            columns.clear();
            if moves || self.seen_rows() > 0 {
                columns.extend((0..n as u32).filter(|&i| points.rests(i) != moves));
            }
            if moves {
                self.counts.warped.fetch_add(columns.len() as u64, Ordering::Relaxed);
            }
            self.count_octaves(columns.len(), warps);
            for columns in columns.chunks(TILE) {
                let m = columns.len();
                Self::fill_tile(&points, columns, tile_x, moment, t);
                let mut tape = Tape::new(arena, &self.params);
                let at = recorded(tape.constant(3, m, tile_x));
                let when = recorded(tape.constant(points.moments.dims, m, moment));
                let record = self.record(&ops, &mut tape, at, (when, t), warps);
                let Moved { x: there, seen: more } = recorded(record);
                if self.warp.is_some() && moves {
                    scatter(recorded(tape.value(there)).data, n, columns, x);
                }
                if let Some(more) = more {
                    scatter(recorded(tape.value(more)).data, n, columns, seen);
                }
            }
        }
    }

    /// Bring the gradients of [`Deform::place`]'s outputs, `[3][n]` and `[seen_rows][n]`, back: added to `grad`, and those of
    /// the points written over `x_bar`.
    pub(crate) fn learn(
        &self,
        points: Points<'_>,
        x_bar: &mut [f32],
        seen_bar: &[f32],
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) {
        let n = points.which.len();
        let DeformScratch { arena, columns, x: tile_x, moment, t, x_bar: tile_bar, seen_bar: tile_seen } = scratch;
        self.columns(&points, columns);
        self.count_octaves(columns.len(), Warps::Yes);
        let ops = self.ops();
        let dims = points.moments.dims;
        for columns in columns.chunks(TILE) {
            let m = columns.len();
            Self::fill_tile(&points, columns, tile_x, moment, t);
            gather(x_bar, n, columns, tile_bar);
            gather(seen_bar, n, columns, tile_seen);
            for (k, &i) in columns.iter().enumerate() {
                if points.rests(i) {
                    (0..3).for_each(|a| tile_bar[a * m + k] = 0.0);
                }
            }
            let mut tape = Tape::new(arena, &self.params);
            let at = recorded(tape.input(3, m, tile_x));
            let when = recorded(tape.input(dims, m, moment));
            let Moved { x, seen } = recorded(self.record(&ops, &mut tape, at, (when, t), Warps::Yes));
            let mut seeds = Vec::with_capacity(2);
            if self.warp.is_some() {
                seeds.push((x, &tile_bar[..]));
            }
            seeds.extend(seen.map(|seen| (seen, &tile_seen[..])));
            recorded(tape.backward(&seeds, &mut grad.params));
            let bars = recorded(tape.gradient(when));
            for (k, &i) in columns.iter().enumerate() {
                let out = &mut grad.moments[points.which[i as usize] as usize * dims..][..dims];
                out.iter_mut().enumerate().for_each(|(d, sum)| *sum += bars[d * m + k]);
            }
            let bars = recorded(tape.gradient(at));
            for (k, &i) in columns.iter().enumerate() {
                // A point that was not moved keeps its gradient, besides that of what else was seen of it.
                let moved = self.warp.is_some() && !points.rests(i);
                for a in 0..3 {
                    let out = &mut x_bar[a * n + i as usize];
                    *out = bars[a * m + k] + if moved { 0.0 } else { *out };
                }
            }
        }
    }
}
