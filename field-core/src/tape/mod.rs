//! Reverse-mode automatic differentiation over matrices `[features x samples]`, with tangents.
//!
//! A [`Tape`] records coarse operations as they are computed: a linear layer, an activation, an encoding, a whole network.
//! [`Tape::backward`] walks the record back. [`Tape::jvp`] records *tangents* (directional derivatives) as ordinary tape
//! operations, so that reverse mode through them gives exact second-order gradients: of a loss on normals
//! `d sigma / dx`, or on the Jacobian of a deformation.
//!
//! Everything lies feature-major (a row is one feature of all samples) in one [`Arena`], which a tape borrows for one tile
//! of samples and the next tape borrows again: after the first tile of a shape nothing is allocated. Parameters are not
//! copied: leaves look into the caller's flat parameter vector, and their gradients are added to a flat buffer of the same
//! length.
//!
//! # A radiance field
//! A tiny NeRF: encoded position to density and features, features and direction to colour; the loss is on colour, density
//! and the length of the density's gradient.
//!
//! ```
//! use field_core::tape::{Arena, Node, Tape, TapeError};
//!
//! /// `w x + b` with the parameters from `at` on: weights `[out][in]`, then biases `[out]`.
//! fn dense(tape: &mut Tape, at: &mut usize, x: Node, out: usize) -> Result<Node, TapeError> {
//!     let rows = tape.shape(x)?.rows;
//!     let w = tape.param(*at, out, rows)?;
//!     let b = tape.param(*at + out * rows, out, 1)?;
//!     *at += out * (rows + 1);
//!     tape.linear(w, Some(b), x)
//! }
//!
//! /// Octaves of sines and cosines.
//! fn encode(tape: &mut Tape, x: Node) -> Result<Node, TapeError> {
//!     let mut parts = vec![x];
//!     for octave in 0..4 {
//!         let scaled = tape.scale(x, f32::from(1_u16 << octave))?;
//!         parts.push(tape.sin(scaled)?);
//!         parts.push(tape.cos(scaled)?);
//!     }
//!     tape.concat(&parts)
//! }
//!
//! let params: Vec<f32> = (0..2500).map(|i| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) * 0.4).collect();
//! let mut grad = vec![0.0; params.len()];
//! let mut arena = Arena::new();
//! let samples = 5;
//! let (points, directions, truth) = (vec![0.3; 3 * samples], vec![0.577; 3 * samples], vec![0.5; 3 * samples]);
//!
//! for _tile in 0..2 {
//!     let mut tape = Tape::new(&mut arena, &params);
//!     let x = tape.input(3, samples, &points)?;
//!     let d = tape.constant(3, samples, &directions)?;
//!     let at = &mut 0;
//!
//!     let features = encode(&mut tape, x)?;
//!     let hidden = dense(&mut tape, at, features, 32)?;
//!     let hidden = tape.softplus(hidden, 0.0)?;
//!     let raw = dense(&mut tape, at, hidden, 1)?;
//!     let sigma = tape.softplus(raw, -1.0)?;
//!     let directions = encode(&mut tape, d)?;
//!     let colour = tape.concat(&[hidden, directions])?;
//!     let colour = dense(&mut tape, at, colour, 3)?;
//!     let rgb = tape.logistic(colour)?;
//!
//!     // d sigma / dx, three rows, as part of the same record.
//!     let normal = tape.jacobian(sigma, x)?;
//!
//!     let truth = tape.constant(3, samples, &truth)?;
//!     let error = tape.sub(rgb, truth)?;
//!     let error = tape.dot(error, error)?;
//!     let steepness = tape.dot(normal, normal)?;
//!     let steepness = tape.scale(steepness, 0.1)?;
//!     let loss = tape.add(error, steepness)?;
//!     let loss = tape.mean_samples(loss)?;
//!     tape.backward_from(loss, &mut grad)?;
//!     assert_eq!(tape.gradient(x)?.len(), 3 * samples);
//! }
//! assert!(grad.iter().any(|&g| g != 0.0) && grad.iter().all(|g| g.is_finite()));
//! # Ok::<(), TapeError>(())
//! ```
//!
//! # Function pairs
//! Whole pairs enter through [`CustomOp`]; the tape borrows the operation, which is why it is declared before the tape.
//! Ready-made: [`EncodingOp`] for the encodings of this crate, [`MlpOp`] for a fused network ([`layers`] records one layer
//! by layer). The same field with them:
//!
//! ```
//! use field_core::encoding::frequency::{Base, Frequency, Identity};
//! use field_core::mlp::{Activation, Mlp, MlpConfig, Packed};
//! use field_core::tape::{Arena, EncodingOp, MlpOp, Tape, TapeError};
//! use float_core::Simd;
//!
//! let simd = Simd::best();
//! let encoding = EncodingOp::new(Frequency::new(3, 4, Base::One, Identity::Include)?, simd);
//! let config = MlpConfig::new(27, vec![32, 32], 4).with_hidden_activation(Activation::SOFTPLUS);
//! let mlp = Mlp::new(&config).unwrap();
//! let params: Vec<f32> = (0..mlp.param_count()).map(|i| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) * 0.4).collect();
//! let mut packed = Packed::default();
//! mlp.pack(&params, &mut packed);
//! let network = MlpOp { mlp: &mlp, packed: &packed, simd };
//!
//! let mut arena = Arena::new();
//! let mut grad = vec![0.0; params.len()];
//! let mut tape = Tape::new(&mut arena, &params);
//! let x = tape.input(3, 2, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6])?;
//! let weights = tape.param(0, params.len(), 1)?;
//! let features = tape.custom(&encoding, &[x])?;
//! let raw = tape.custom(&network, &[features, weights])?;
//! let (sigma, rgb) = (tape.slice(raw, 0..1)?, tape.slice(raw, 1..4)?);
//! let (sigma, rgb) = (tape.trunc_exp(sigma)?, tape.logistic(rgb)?);
//! let normal = tape.jacobian(sigma, x)?;
//! tape.backward(&[(rgb, &[1.0; 6]), (normal, &[0.1; 6])], &mut grad)?;
//! assert_eq!(tape.gradient(x)?.len(), 6);
//! # Ok::<(), TapeError>(())
//! ```
//!
//! # Numerics
//! `exp`, `trunc_exp`, logistic and softplus use the vector exponential (relative error below 3e-7), which clamps its
//! argument to `[-87, 88]`: results are never infinite. Sums over samples run in `f64`. NaN is passed on, never hidden.
//! The same bits on one machine however often a tile is repeated; SIMD levels differ by fused rounding.

mod arena;
mod backward;
mod custom;
mod elementwise;
mod encode;
mod error;
mod forward;
mod grids;
mod matrix;
mod network;
mod op;
mod product;
mod tangent;
mod unary;
mod waves;

pub use arena::Arena;
pub use custom::{BackwardArgs, Bar, CustomOp, Demand, MAX_INPUTS, View};
pub use encode::{Encoder, EncodingOp};
pub use error::TapeError;
pub use grids::HashGridTable;
pub use network::{MlpOp, activate, layers};
pub use waves::Windowed;

use alloc::vec::Vec;
use core::fmt;
use op::{Entry, Op, Place};

/// Rows (features) and columns (samples) of a matrix.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Shape {
    /// Features.
    pub rows: usize,
    /// Samples.
    pub cols: usize,
}

impl Shape {
    /// `rows` features by `cols` samples.
    #[must_use]
    pub const fn new(rows: usize, cols: usize) -> Self {
        Self { rows, cols }
    }

    /// Numbers held; the most that can be counted where there are more.
    #[must_use]
    pub const fn len(self) -> usize {
        self.rows.saturating_mul(self.cols)
    }

    /// Whether no number is held.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{} x {}]", self.rows, self.cols)
    }
}

/// One matrix on a tape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Node {
    id: u32,
    /// Tape of the arena it was recorded on.
    generation: u32,
}

/// A record of operations over one tile of samples. See the [module](self) for what it does and an example.
///
/// # Panics
/// Functions that record nodes do so past `2^32 - 1` of them, and where there is no memory for a result.
pub struct Tape<'a> {
    arena: &'a mut Arena,
    params: &'a [f32],
    customs: Vec<&'a dyn CustomOp>,
}

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
        Ok(View { rows, cols, data: arena::read(entry, &self.arena.values, self.params) })
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
        let (a, a_param) = arena::span(&self.arena.entries[a.id as usize]);
        let (b, b_param) = arena::span(&self.arena.entries[b.id as usize]);
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
        assert!(id < op::NONE as usize, "a tape holds at most {} nodes", op::NONE);
        self.arena.entries.push(Entry { op, place, shape, needs });
        Node { id: id as u32, generation: self.arena.generation }
    }

    /// Compute and record one operation whose shapes have been checked.
    fn emit(&mut self, op: Op, shape: Shape) -> Result<Node, TapeError> {
        let saved = if let Op::Custom { saved, .. } = op { saved as usize } else { 0 };
        let len = shape.len();
        let start = self.arena.reserve(len + saved);
        let Arena { values, entries, links, simd, .. } = &mut *self.arena;
        let (before, out) = values.split_at_mut(start);
        let source = forward::Source { entries, links, customs: &self.customs, values: before, params: self.params };
        let (out, saved) = out[..len + saved].split_at_mut(len);
        forward::compute(op, source, shape, *simd, out, saved)?;
        let mut needs = false;
        op.for_each_input(links, |input| needs |= entries[input as usize].needs);
        if let Op::Unary { f, .. } = op {
            needs &= !f.is_flat();
        }
        Ok(self.record(op, Place::Arena(start), shape, needs))
    }

    /// Rows of a node, sharing its memory.
    fn alias(&mut self, parent: Node, offset: usize, shape: Shape) -> Node {
        let entry = self.arena.entries[parent.id as usize];
        let place = match entry.place {
            Place::Arena(start) => Place::Arena(start + offset),
            Place::Params(start) => Place::Params(start + offset),
        };
        self.record(Op::Alias { parent: parent.id, offset: offset as u32 }, place, shape, entry.needs)
    }

    fn entry(&self, op: &'static str, node: Node) -> Result<&Entry, TapeError> {
        match self.arena.entries.get(node.id as usize) {
            Some(entry) if node.generation == self.arena.generation => Ok(entry),
            _ => Err(TapeError::ForeignNode { op }),
        }
    }

    /// The node with a number already known to be on this tape.
    fn node(&self, id: u32) -> Node {
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
