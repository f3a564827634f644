//! Points at which something moves: which of a batch's they are, what the moving part sees of them, and their gradients.

use super::moving_part::MovingPart;
use super::placing::{Placing, When};
use super::{Detail, Part, Places};
use crate::buffers::sized;
use crate::warps::{Points, TimeSteps};
use std::ops::Range;

/// Those of some points at which something moves.
#[derive(Default)]
pub(crate) struct MovingPoints {
    /// Which of the points they are, in order.
    pub(crate) columns: Vec<u32>,
    /// `[3][m]`, where they are, and where in the canonical scene.
    pub(crate) was: Vec<f32>,
    pub(crate) x: Vec<f32>,
    /// `[m]`, which time step each belongs to.
    pub(crate) which: Vec<u32>,
    /// `[m]`, times; only where the features know them.
    pub(crate) times: Vec<f32>,
    /// `[rows][m]`
    pub(crate) features: Vec<f32>,
    placing: Placing,
}

impl MovingPoints {
    /// Find them among points `x` `[3][n]` of the unit cube, and what the moving part sees of them.
    pub(crate) fn find(&mut self, part: &MovingPart, x: &[f32], when: When<'_>) {
        part.cells.columns(x, &mut self.columns);
        let m = self.columns.len();
        self.was.clear();
        self.which.clear();
        if m > 0 {
            for row in x.chunks_exact(x.len() / 3) {
                self.was.extend(self.columns.iter().map(|&i| row[i as usize]));
            }
        }
        // Where nothing depends on the time, nobody says which step a point belongs to.
        if !when.which.is_empty() {
            self.which.extend(self.columns.iter().map(|&i| when.which[i as usize]));
        }
        self.x.clone_from(&self.was);
        let when = When { time_steps: when.time_steps, which: &self.which };
        let out = sized(&mut self.features, part.rows() * m);
        part.seen(&mut self.x, when, &mut self.times, out, &mut self.placing);
    }

    /// All of them.
    pub(crate) fn all(&self) -> MovingColumns<'_> {
        let m = self.columns.len();
        MovingColumns { columns: &self.columns, offset: 0, features: &self.features, first: 0, stride: m }
    }

    /// Those of the points `span`, which are counted from its beginning.
    pub(crate) fn within(&self, span: Range<usize>) -> MovingColumns<'_> {
        let [first, last] = [span.start, span.end].map(|end| self.columns.partition_point(|&i| (i as usize) < end));
        MovingColumns { columns: &self.columns[first..last], offset: span.start, first, ..self.all() }
    }

    /// Where they are in the canonical scene, and when.
    pub(crate) fn places(&self) -> Places<'_> {
        Places { x: &self.x, times: &self.times }
    }

    /// Where they are at their times.
    pub(crate) fn points<'a>(&'a self, time_steps: &'a TimeSteps) -> Points<'a> {
        Points { x: &self.was, which: &self.which, time_steps }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let floats = self.was.capacity() + self.x.capacity() + self.times.capacity() + self.features.capacity();
        4 * (floats + self.columns.capacity() + self.which.capacity()) + self.placing.bytes()
    }
}

/// Some of the points of [`MovingPoints`].
#[derive(Clone, Copy)]
pub(crate) struct MovingColumns<'a> {
    /// Which points they are, with `offset` more than counted here.
    columns: &'a [u32],
    offset: usize,
    /// `[rows][stride]`; theirs begin at `first`.
    pub(super) features: &'a [f32],
    pub(super) first: usize,
    pub(super) stride: usize,
}

impl MovingColumns<'_> {
    /// Number of points.
    pub(crate) fn len(&self) -> usize {
        self.columns.len()
    }

    pub(super) fn at(&self) -> impl Iterator<Item = usize> {
        self.columns.iter().map(|&i| i as usize - self.offset)
    }

    /// Their columns of `from` `[rows][n]`, written over `out` `[rows][len]`.
    pub(super) fn gather(&self, from: &[f32], n: usize, out: &mut [f32]) {
        for (from, out) in from.chunks_exact(n).zip(out.chunks_exact_mut(self.len())) {
            out.iter_mut().zip(self.at()).for_each(|(out, i)| *out = from[i]);
        }
    }

    /// The other direction.
    pub(super) fn scatter(&self, from: &[f32], out: &mut [f32], n: usize) {
        for (from, out) in from.chunks_exact(self.len()).zip(out.chunks_exact_mut(n)) {
            from.iter().zip(self.at()).for_each(|(from, i)| out[i] = *from);
        }
    }
}

/// The gradients of the moving part of a chunk.
#[derive(Default)]
pub(crate) struct MovingBars {
    /// `[rows][m]`, of what its network saw.
    pub(crate) features: Vec<f32>,
    raw: Vec<f32>,
    /// `[3][m]`, of where its points are in the canonical scene.
    x: Vec<f32>,
    /// Of its network, packed.
    pub(crate) network: Vec<f32>,
}

impl MovingBars {
    /// All zero, for `m` points.
    pub(crate) fn begin(&mut self, part: &MovingPart, m: usize) {
        sized(&mut self.features, part.rows() * m).fill(0.0);
        self.network.clear();
        self.network.resize(part.network.packed_grad_len(), 0.0);
    }

    /// Bring the gradients of what the network saw back to the table; returned are those of canonical
    /// positions `[3][m]` first, then those of what a deformation added.
    pub(crate) fn pull(&mut self, part: &MovingPart, points: &MovingPoints, detail: Detail) -> (&mut [f32], &[f32]) {
        let (m, rows) = (points.columns.len(), part.features.rows());
        let x = sized(&mut self.x, 3 * m);
        x.fill(0.0);
        let (bars, seen) = self.features[..part.rows() * m].split_at_mut(rows * m);
        let raw = part.features.pull(&points.features[..rows * m], m, bars, &mut self.raw);
        // Gradients of positions are read by deformations, and by gradients of rays.
        let warps = part.deform.as_ref().is_some_and(|deform| deform.warps());
        if warps || detail == Detail::All {
            part.features.pull_positions(points.places(), raw, detail, x);
        }
        (x, seen)
    }

    /// Add the gradients of where its points are, as a deformation left them after [`MovingBars::pull`], to those of all points: `x_bar`
    /// `[3][n]`.
    pub(crate) fn add_to(&self, points: &MovingPoints, x_bar: &mut [f32]) {
        let (n, m) = (x_bar.len() / 3, points.columns.len());
        for (row, bars) in x_bar.chunks_exact_mut(n.max(1)).zip(self.x[..3 * m].chunks_exact(m.max(1))) {
            points.columns.iter().zip(bars).for_each(|(&i, bar)| row[i as usize] += bar);
        }
    }

    /// What a chunk brings to the gradient of the features.
    pub(crate) fn part<'a>(&'a self, pulls_in_place: bool, points: &'a MovingPoints) -> Part<'a> {
        let raw_bar = if pulls_in_place { &self.features } else { &self.raw };
        Part { places: points.places(), raw_bar }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        4 * (self.features.capacity() + self.raw.capacity() + self.x.capacity() + self.network.capacity())
    }
}
