//! A deformation of many points, forwards and backwards, in tiles whose activations stay in the cache.

use super::at::{At, Moved, Moves, TILE};
use super::deform::Deform;
use super::points::{DeformGrad, DeformScratch, Points, gather, scatter};
use super::time::TimeSteps;
use field_core::tape::{Node, Tape, TapeError};
use std::sync::atomic::Ordering;

/// The tape is built of shapes that fit: an error is a mistake in a deformation.
pub(super) fn recorded<T>(result: Result<T, TapeError>) -> T {
    result.unwrap_or_else(|e| panic!("the record does not fit: {e}"))
}

impl DeformGrad {
    /// All zero, for the time steps of the training views.
    pub(crate) fn begin(&mut self, deform: &Deform) {
        self.begin_at(deform, &deform.steps);
    }

    /// All zero, for other time steps.
    pub(crate) fn begin_at(&mut self, deform: &Deform, steps: &TimeSteps) {
        for (buffer, len) in [(&mut self.params, deform.params.len()), (&mut self.times, steps.rows.len())] {
            buffer.clear();
            buffer.resize(len, 0.0);
        }
    }
}

impl Deform {
    /// Record the deformation of points `x` `[3 x n]` of the unit cube at times `time` `[dims x n]`, which are `t` `[n]` in
    /// `[-1, 1]`. Canonical points are in the unit cube.
    pub(super) fn record<'a>(
        &'a self,
        tape: &mut Tape<'a>,
        x: Node,
        time: Node,
        t: &[f32],
        moves: Moves,
    ) -> Result<Moved, TapeError> {
        let x = tape.affine(x, 2.0, -1.0)?;
        let origin = match &self.origin {
            Some(row) if moves == Moves::Yes => {
                let row = tape.constant(row.len(), 1, row)?;
                Some(tape.broadcast_samples(row, t.len())?)
            }
            _ => None,
        };
        let mut moved = self.deformation.record(tape, At { x, time, t, moves, origin })?;
        if let Some(x) = &mut moved.x {
            *x = tape.affine(*x, 0.5, 0.5)?;
        }
        Ok(moved)
    }

    /// Count the octaves of windows that some points had before them.
    pub(super) fn count_octaves(&self, points: usize, moves: Moves) {
        let windows = self.deformation.windows();
        let warp = if moves == Moves::Yes { windows.warp } else { &[] };
        let windows = warp.iter().chain(windows.ambient);
        let closed = windows.clone().filter(|w| **w == 0.0).count();
        self.counts.octaves.fetch_add((points * windows.count()) as u64, Ordering::Relaxed);
        self.counts.closed.fetch_add((points * closed) as u64, Ordering::Relaxed);
    }

    /// Canonical points, written over `x` `[3][n]`, and what the density network sees besides features, over `seen`
    /// `[seen_rows][n]`.
    pub(crate) fn place(&self, points: Points<'_>, x: &mut [f32], seen: &mut [f32], scratch: &mut DeformScratch) {
        let n = points.which.len();
        x.copy_from_slice(points.x);
        let DeformScratch { tape: arena, columns, x: tile_x, time, t, .. } = scratch;
        self.counts.all.fetch_add(n as u64, Ordering::Relaxed);
        for moves in [Moves::Yes, Moves::No] {
            // Points that rest are recorded only for what else is seen of them.
            let moving = moves == Moves::Yes;
            columns.clear();
            if moving || self.seen_rows() > 0 {
                columns.extend((0..n as u32).filter(|&i| points.rests(i) != moving));
            }
            if moving {
                self.counts.warped.fetch_add(columns.len() as u64, Ordering::Relaxed);
            }
            self.count_octaves(columns.len(), moves);
            for columns in columns.chunks(TILE) {
                let m = columns.len();
                points.gather(columns, tile_x, time, t);
                let mut tape = Tape::new(arena, &self.params);
                let at = recorded(tape.constant(3, m, tile_x));
                let when = recorded(tape.constant(points.time_steps.dims, m, time));
                let moved = recorded(self.record(&mut tape, at, when, t, moves));
                if let Some(there) = moved.x {
                    scatter(recorded(tape.value(there)).data, n, columns, x);
                }
                if let Some(more) = moved.seen {
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
        let DeformScratch { tape: arena, columns, x: tile_x, time, t, x_bar: tile_bar, seen_bar: tile_seen, .. } =
            scratch;
        let everywhere = self.seen_rows() > 0;
        columns.clear();
        columns.extend((0..n as u32).filter(|&i| everywhere || !points.rests(i)));
        self.count_octaves(columns.len(), Moves::Yes);
        let dims = points.time_steps.dims;
        for columns in columns.chunks(TILE) {
            let m = columns.len();
            points.gather(columns, tile_x, time, t);
            gather(x_bar, n, columns, tile_bar);
            gather(seen_bar, n, columns, tile_seen);
            for (k, &i) in columns.iter().enumerate() {
                if points.rests(i) {
                    (0..3).for_each(|a| tile_bar[a * m + k] = 0.0);
                }
            }
            let mut tape = Tape::new(arena, &self.params);
            let at = recorded(tape.input(3, m, tile_x));
            let when = recorded(tape.input(dims, m, time));
            let moved = recorded(self.record(&mut tape, at, when, t, Moves::Yes));
            let mut seeds = Vec::with_capacity(2);
            seeds.extend(moved.x.map(|x| (x, &tile_bar[..])));
            seeds.extend(moved.seen.map(|seen| (seen, &tile_seen[..])));
            recorded(tape.backward(&seeds, &mut grad.params));
            grad.add_times(&points, columns, recorded(tape.gradient(when)));
            let bars = recorded(tape.gradient(at));
            for (k, &i) in columns.iter().enumerate() {
                // A point that was not moved keeps its gradient, besides that of what else was seen of it.
                let moved = moved.x.is_some() && !points.rests(i);
                for a in 0..3 {
                    let out = &mut x_bar[a * n + i as usize];
                    *out = bars[a * m + k] + if moved { 0.0 } else { *out };
                }
            }
        }
    }
}
