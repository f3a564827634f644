//! Operations on rows and samples.

use super::error::TapeError;
use super::op::{NONE, Op};
use super::shape::{Node, Shape};
use super::state::Tape;
use core::ops::Range;

/// Squared lengths below this count as this in [`Tape::normalise`].
const MIN_SQUARED_LENGTH: f32 = 1e-30;

impl Tape<'_> {
    /// Linear layer: `y[o][s] = sum(w[o][i] * x[i][s], i) + b[o]`.
    ///
    /// # Shapes
    /// `w` `[out x in]`, `b` `[out x 1]`, `x` `[in x n]`, result `[out x n]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn linear(&mut self, w: Node, b: Option<Node>, x: Node) -> Result<Node, TapeError> {
        const OP: &str = "linear";
        let weights = self.entry(OP, w)?.shape;
        let inputs = self.entry(OP, x)?.shape;
        if inputs.rows != weights.cols {
            let want = Shape::new(weights.cols, inputs.cols);
            return Err(TapeError::Shape { op: OP, what: "x", want, got: inputs });
        }
        if let Some(b) = b {
            self.expect(OP, "b", b, Shape::new(weights.rows, 1))?;
        }
        let b = b.map_or(NONE, |b| b.id);
        self.emit(Op::Linear { w: w.id, b, x: x.id }, Shape::new(weights.rows, inputs.cols))
    }

    /// Every row of `x` `[r x n]` times the one row `w` `[1 x n]`: a weight for each sample.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn mul_row(&mut self, x: Node, w: Node) -> Result<Node, TapeError> {
        let shape = self.entry("mul_row", x)?.shape;
        self.expect("mul_row", "w", w, Shape::new(1, shape.cols))?;
        self.emit(Op::MulRow { x: x.id, w: w.id }, shape)
    }

    /// The rows of all nodes, one after another. All have the same samples.
    ///
    /// # Errors
    /// [`TapeError::Length`] for an empty list, [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn concat(&mut self, parts: &[Node]) -> Result<Node, TapeError> {
        const OP: &str = "concat";
        let Some(&head) = parts.first() else {
            return Err(TapeError::Length { op: OP, what: "parts", want: 1, got: 0 });
        };
        let cols = self.entry(OP, head)?.shape.cols;
        let mut rows = 0;
        for &part in parts {
            let got = self.entry(OP, part)?.shape;
            if got.cols != cols {
                return Err(TapeError::Shape { op: OP, what: "parts", want: Shape::new(got.rows, cols), got });
            }
            rows += got.rows;
        }
        let first = self.arena.links.len() as u32;
        self.arena.links.extend(parts.iter().map(|part| part.id));
        self.emit(Op::Concat { first, count: parts.len() as u32 }, Shape::new(rows, cols))
    }

    /// Rows of a node, sharing its memory: costs nothing.
    ///
    /// # Errors
    /// [`TapeError::Rows`], [`TapeError::ForeignNode`].
    pub fn slice(&mut self, x: Node, rows: Range<usize>) -> Result<Node, TapeError> {
        let shape = self.entry("slice", x)?.shape;
        if rows.start > rows.end || rows.end > shape.rows {
            return Err(TapeError::Rows { start: rows.start, end: rows.end, rows: shape.rows });
        }
        Ok(self.alias(x, rows.start * shape.cols, Shape::new(rows.len(), shape.cols)))
    }

    /// One row `[1 x n]` repeated: `[rows x n]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    ///
    /// # Panics
    /// If there is no memory for a matrix of `rows` rows.
    pub fn broadcast_features(&mut self, x: Node, rows: usize) -> Result<Node, TapeError> {
        let got = self.entry("broadcast_features", x)?.shape;
        self.expect("broadcast_features", "x", x, Shape::new(1, got.cols))?;
        self.emit(Op::BroadcastFeatures { x: x.id }, Shape::new(rows, got.cols))
    }

    /// One column `[r x 1]` (a code, a learned constant) repeated: `[r x cols]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    ///
    /// # Panics
    /// If there is no memory for a matrix of `cols` columns.
    pub fn broadcast_samples(&mut self, x: Node, cols: usize) -> Result<Node, TapeError> {
        let got = self.entry("broadcast_samples", x)?.shape;
        self.expect("broadcast_samples", "x", x, Shape::new(got.rows, 1))?;
        self.emit(Op::BroadcastSamples { x: x.id }, Shape::new(got.rows, cols))
    }

    /// Sum over features: `[r x n]` to `[1 x n]`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn sum_features(&mut self, x: Node) -> Result<Node, TapeError> {
        let cols = self.entry("sum_features", x)?.shape.cols;
        self.emit(Op::SumFeatures { x: x.id }, Shape::new(1, cols))
    }

    /// Sum over samples, in `f64`: `[r x n]` to `[r x 1]`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn sum_samples(&mut self, x: Node) -> Result<Node, TapeError> {
        let rows = self.entry("sum_samples", x)?.shape.rows;
        self.emit(Op::SumSamples { x: x.id }, Shape::new(rows, 1))
    }

    /// Mean over samples: `[r x n]` to `[r x 1]`; 0 where there is no sample.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn mean_samples(&mut self, x: Node) -> Result<Node, TapeError> {
        let samples = self.entry("mean_samples", x)?.shape.cols;
        let sum = self.sum_samples(x)?;
        self.scale(sum, 1.0 / samples.max(1) as f32)
    }

    /// Weighted sum over samples: `x` `[r x n]`, `w` `[1 x n]` to `[r x 1]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn weighted_sum(&mut self, x: Node, w: Node) -> Result<Node, TapeError> {
        let weighted = self.mul_row(x, w)?;
        self.sum_samples(weighted)
    }

    /// Sum of all numbers: `[1 x 1]`.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn sum(&mut self, x: Node) -> Result<Node, TapeError> {
        let rows = self.sum_features(x)?;
        self.sum_samples(rows)
    }

    /// Dot product of each sample: `[r x n]` twice to `[1 x n]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`].
    pub fn dot(&mut self, a: Node, b: Node) -> Result<Node, TapeError> {
        let shape = self.entry("dot", a)?.shape;
        self.expect("dot", "b", b, shape)?;
        self.emit(Op::Dot { a: a.id, b: b.id }, Shape::new(1, shape.cols))
    }

    /// Each sample divided by its length. Lengths below 1e-15 count as 1e-15: a zero vector stays zero and passes its
    /// gradient on scaled by 1e15, so mask such samples out of the loss. Lengths above 1e19 overflow.
    ///
    /// # Errors
    /// [`TapeError::ForeignNode`].
    pub fn normalise(&mut self, x: Node) -> Result<Node, TapeError> {
        let squared = self.dot(x, x)?;
        let squared = self.clamp(squared, MIN_SQUARED_LENGTH, f32::INFINITY)?;
        let inverse = self.rsqrt(squared)?;
        self.mul_row(x, inverse)
    }

    /// Cross product `a x b` of each sample: `[3 x n]` twice to `[3 x n]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`] unless both have three rows and the same samples; [`TapeError::ForeignNode`].
    pub fn cross(&mut self, a: Node, b: Node) -> Result<Node, TapeError> {
        let shape = Shape::new(3, self.entry("cross", a)?.shape.cols);
        self.expect("cross", "a", a, shape)?;
        self.expect("cross", "b", b, shape)?;
        self.emit(Op::Cross { a: a.id, b: b.id }, shape)
    }

    /// A matrix for each sample times a vector for each sample: `m` `[r * c x n]`, rows of the matrix one after another,
    /// `v` `[c x n]`, result `[r x n]`.
    ///
    /// # Errors
    /// [`TapeError::Shape`] unless the rows of `m` are a multiple of those of `v`; [`TapeError::ForeignNode`].
    pub fn mat_vec(&mut self, m: Node, v: Node) -> Result<Node, TapeError> {
        let got = self.entry("mat_vec", m)?.shape;
        let vector = self.entry("mat_vec", v)?.shape;
        let rows = got.rows.checked_div(vector.rows).unwrap_or(0);
        let want = Shape::new(rows * vector.rows, vector.cols);
        if got != want {
            return Err(TapeError::Shape { op: "mat_vec", what: "m", want, got });
        }
        self.emit(Op::MatVec { m: m.id, v: v.id }, Shape::new(rows, vector.cols))
    }

    fn expect(&self, op: &'static str, what: &'static str, node: Node, want: Shape) -> Result<(), TapeError> {
        let got = self.entry(op, node)?.shape;
        if got == want { Ok(()) } else { Err(TapeError::Shape { op, what, want, got }) }
    }
}
