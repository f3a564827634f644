//! How nodes get onto a tape: leaves, custom operations, and what every other operation records itself with.

use super::arena::{Arena, read, span};
use super::args::{MAX_INPUTS, View};
use super::custom::CustomOp;
use super::error::TapeError;
use super::forward::{Source, compute};
use super::op::{Entry, NONE, Op, Place};
use super::shape::{Node, Shape};
use super::state::Tape;
use core::fmt;

impl<'a> Tape<'a> {
    /// An empty tape in the memory of `arena`, over a flat parameter vector.
    #[must_use]
    pub fn new(arena: &'a mut Arena, params: &'a [f32]) -> Self {
        arena.reset();
        let customs = arena.customs.take();
        Self { arena, params, customs }
    }

    /// `rows * cols` parameters from `start` on, as a matrix `[rows][cols]`. Weights of a layer are `[out][in]`, biases
    /// `[out][1]`. Not copied.
    ///
    /// # Errors
    /// [`TapeError::Parameters`] when there are fewer.
    pub fn param(&mut self, start: usize, rows: usize, cols: usize) -> Result<Node, TapeError> {
        let shape = Shape::new(rows, cols);
        let available = self.params.len();
        match rows.checked_mul(cols).and_then(|len| len.checked_add(start)) {
            Some(end) if end <= available => Ok(self.record(Op::Leaf, Place::Params(start), shape, true)),
            _ => Err(TapeError::Parameters { start, len: rows.saturating_mul(cols), available }),
        }
    }

    /// A matrix whose gradient is wanted, `[rows][cols]`. Copied.
    ///
    /// # Errors
    /// [`TapeError::Length`] unless `data` holds `rows * cols` numbers.
    pub fn input(&mut self, rows: usize, cols: usize, data: &[f32]) -> Result<Node, TapeError> {
        self.leaf("input", Shape::new(rows, cols), data, true)
    }

    /// A matrix without gradient, `[rows][cols]`. Copied.
    ///
    /// # Errors
    /// [`TapeError::Length`] unless `data` holds `rows * cols` numbers.
    pub fn constant(&mut self, rows: usize, cols: usize, data: &[f32]) -> Result<Node, TapeError> {
        self.leaf("constant", Shape::new(rows, cols), data, false)
    }

    /// A constant matrix of one number.
    ///
    /// # Panics
    /// If there is no memory for `rows * cols` numbers.
    pub fn fill(&mut self, rows: usize, cols: usize, value: f32) -> Node {
        let shape = Shape::new(rows, cols);
        let start = self.arena.reserve(shape.len());
        self.arena.values[start..start + shape.len()].fill(value);
        self.record(Op::Leaf, Place::Arena(start), shape, false)
    }

    /// A constant with row `row` all 1, the others 0: the seed of the tangent along one coordinate.
    ///
    /// # Errors
    /// [`TapeError::Rows`] when there is no such row.
    ///
    /// # Panics
    /// As [`fill`](Self::fill).
    pub fn unit_row(&mut self, rows: usize, cols: usize, row: usize) -> Result<Node, TapeError> {
        if row >= rows {
            return Err(TapeError::Rows { start: row, end: row + 1, rows });
        }
        let node = self.fill(rows, cols, 0.0);
        let start = self.arena.used - rows * cols;
        self.arena.values[start + row * cols..start + (row + 1) * cols].fill(1.0);
        Ok(node)
    }

    /// Values of a node.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn value(&self, node: Node) -> Result<View<'_>, TapeError> {
        let entry = self.entry("value", node)?;
        let Shape { rows, cols } = entry.shape;
        Ok(View { rows, cols, data: read(entry, &self.arena.values, self.params) })
    }

    /// Shape of a node.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn shape(&self, node: Node) -> Result<Shape, TapeError> {
        Ok(self.entry("shape", node)?.shape)
    }

    /// Number of nodes recorded.
    #[must_use]
    pub fn len(&self) -> usize {
        self.arena.entries.len()
    }

    /// Whether nothing was recorded.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A custom operation over nodes. `op` is borrowed as long as the tape lives.
    ///
    /// # Errors
    /// [`TapeError::Inputs`], [`TapeError::ForeignNode`], or what the operation refuses.
    ///
    /// # Panics
    /// If the operation does, or there is no memory for what it makes.
    pub fn custom(&mut self, op: &'a dyn CustomOp, inputs: &[Node]) -> Result<Node, TapeError> {
        let name = op.name();
        if inputs.is_empty() || inputs.len() > MAX_INPUTS {
            return Err(TapeError::Inputs { op: name, got: inputs.len() });
        }
        let mut shapes = [Shape::new(0, 0); MAX_INPUTS];
        for (shape, &node) in shapes.iter_mut().zip(inputs) {
            *shape = self.entry(name, node)?.shape;
        }
        let shape = op.shape(&shapes[..inputs.len()])?;
        let mut nodes = [inputs[0]; MAX_INPUTS];
        for (i, &node) in inputs.iter().enumerate() {
            // Gradients of the inputs must not overlap.
            let shared = nodes[..i].iter().any(|&other| self.overlap(other, node));
            nodes[i] = if shared { self.affine(node, 1.0, 0.0)? } else { node };
        }
        let first = self.arena.links.len();
        self.arena.links.extend(nodes[..inputs.len()].iter().map(|node| node.id));
        self.customs.push(op);
        let custom = self.customs.len() - 1;
        let saved = op.saved_len(&shapes[..inputs.len()]);
        let Ok(saved) = u32::try_from(saved) else {
            return Err(TapeError::Custom { op: name, reason: "too many numbers to keep" });
        };
        let (op, first, count) = (custom as u32, first as u32, inputs.len() as u32);
        self.emit(Op::Custom { op, first, count, saved }, shape)
    }

    fn overlap(&self, a: Node, b: Node) -> bool {
        let (a, a_param) = span(&self.arena.entries[a.id as usize]);
        let (b, b_param) = span(&self.arena.entries[b.id as usize]);
        a_param == b_param && a.start.max(b.start) < a.end.min(b.end)
    }

    fn leaf(&mut self, op: &'static str, shape: Shape, data: &[f32], needs: bool) -> Result<Node, TapeError> {
        let want = shape.rows.saturating_mul(shape.cols);
        if data.len() != want {
            return Err(TapeError::Length { op, what: "data", want, got: data.len() });
        }
        let start = self.arena.reserve(want);
        self.arena.values[start..start + want].copy_from_slice(data);
        Ok(self.record(Op::Leaf, Place::Arena(start), shape, needs))
    }

    fn record(&mut self, op: Op, place: Place, shape: Shape, needs: bool) -> Node {
        let id = self.arena.entries.len();
        assert!(id < NONE as usize, "a tape holds at most {} nodes", NONE);
        self.arena.entries.push(Entry { op, place, shape, needs });
        Node { id: id as u32, generation: self.arena.generation }
    }

    /// Compute and record one operation whose shapes have been checked.
    pub(super) fn emit(&mut self, op: Op, shape: Shape) -> Result<Node, TapeError> {
        let saved = if let Op::Custom { saved, .. } = op { saved as usize } else { 0 };
        let len = shape.len();
        let start = self.arena.reserve(len + saved);
        let Arena { values, entries, links, simd, .. } = &mut *self.arena;
        let (before, out) = values.split_at_mut(start);
        let source = Source { entries, links, customs: &self.customs, values: before, params: self.params };
        let (out, saved) = out[..len + saved].split_at_mut(len);
        compute(op, source, shape, *simd, out, saved)?;
        let mut needs = false;
        op.for_each_input(links, |input| needs |= entries[input as usize].needs);
        if let Op::Unary { f, .. } = op {
            needs &= !f.is_flat();
        }
        Ok(self.record(op, Place::Arena(start), shape, needs))
    }

    /// Rows of a node, sharing its memory.
    pub(super) fn alias(&mut self, parent: Node, offset: usize, shape: Shape) -> Node {
        let entry = self.arena.entries[parent.id as usize];
        let place = match entry.place {
            Place::Arena(start) => Place::Arena(start + offset),
            Place::Params(start) => Place::Params(start + offset),
        };
        self.record(Op::Alias { parent: parent.id, offset: offset as u32 }, place, shape, entry.needs)
    }

    pub(super) fn entry(&self, op: &'static str, node: Node) -> Result<&Entry, TapeError> {
        match self.arena.entries.get(node.id as usize) {
            Some(entry) if node.generation == self.arena.generation => Ok(entry),
            _ => Err(TapeError::ForeignNode { op }),
        }
    }

    /// The node with a number already known to be on this tape.
    pub(super) fn node(&self, id: u32) -> Node {
        Node { id, generation: self.arena.generation }
    }
}

impl Drop for Tape<'_> {
    fn drop(&mut self) {
        self.arena.customs.give(core::mem::take(&mut self.customs));
    }
}

impl fmt::Debug for Tape<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Tape").field("nodes", &self.len()).field("params", &self.params.len()).finish()
    }
}
