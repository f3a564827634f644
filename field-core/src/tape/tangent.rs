//! Forward mode, recorded: the tangent of a node as new nodes.

use super::arena::Arena;
use super::args::MAX_INPUTS;
use super::error::TapeError;
use super::op::{Binary, NONE, Op};
use super::shape::{Node, Shape};
use super::state::Tape;
use super::unary::{TRUNC_EXP_LIMIT, Unary};

/// The nodes below `count`, each with its tangent and whether an output depends on it, in the arena's scratch.
#[derive(Clone, Copy)]
struct Frame {
    base: usize,
    count: usize,
}

impl Tape<'_> {
    /// Tangents of `outputs` when the nodes of `seeds` move by the tangents given with them: the Jacobian times a vector,
    /// as new nodes. Reverse mode through them gives exact second-order gradients.
    ///
    /// A seed is any node, not only a leaf; what lies before it does not matter. A seed's tangent has its shape. Outputs
    /// that no seed reaches have tangent zero.
    ///
    /// # Errors
    /// [`TapeError::Shape`], [`TapeError::ForeignNode`], and [`TapeError::NoTangent`] when the way from a seed to an output
    /// leads through a custom operation without tangent rule.
    ///
    /// # Panics
    /// If the tangent rule of a custom operation does, or there is no memory for the tangents.
    pub fn jvp<const K: usize>(&mut self, outputs: [Node; K], seeds: &[(Node, Node)]) -> Result<[Node; K], TapeError> {
        let mut tangents = outputs;
        self.jvp_into(&outputs, seeds, &mut tangents)?;
        Ok(tangents)
    }

    /// [`jvp`](Self::jvp) of a list whose length is known at run time.
    ///
    /// # Errors
    /// As [`jvp`](Self::jvp), and [`TapeError::Length`] unless `tangents` is as long as `outputs`.
    ///
    /// # Panics
    /// As [`jvp`](Self::jvp).
    pub fn jvp_into(
        &mut self,
        outputs: &[Node],
        seeds: &[(Node, Node)],
        tangents: &mut [Node],
    ) -> Result<(), TapeError> {
        const OP: &str = "jvp";
        if tangents.len() != outputs.len() {
            return Err(TapeError::Length { op: OP, what: "tangents", want: outputs.len(), got: tangents.len() });
        }
        for &(node, tangent) in seeds {
            let want = self.entry(OP, node)?.shape;
            let got = self.entry(OP, tangent)?.shape;
            if got != want {
                return Err(TapeError::Shape { op: OP, what: "seed", want, got });
            }
        }
        let mut count = 0;
        for &output in outputs {
            self.entry(OP, output)?;
            count = count.max(output.id as usize + 1);
        }
        let base = self.arena.scratch.len();
        self.arena.scratch.resize(base + 2 * count, NONE);
        let frame = Frame { base, count };
        let done = self.propagate(frame, outputs, seeds);
        if done.is_ok() {
            for (tangent, output) in tangents.iter_mut().zip(outputs) {
                *tangent = match self.tangent_at(frame, output.id) {
                    Some(tangent) => tangent,
                    None => self.zeros_like(*output),
                };
            }
        }
        self.arena.scratch.truncate(base);
        done
    }

    /// Jacobian of `output` `[r x n]` with respect to `input` `[c x n]`, sample by sample: `[r * c x n]`, row `i * c + j`
    /// is the derivative of output `i` along input `j`. Of a density, this is its gradient in space, `[3 x n]`.
    ///
    /// Costs one tangent pass for each row of `input`. Correct where samples do not mix between input and output.
    ///
    /// # Errors
    /// As [`jvp`](Self::jvp); [`TapeError::Shape`] unless both have the same samples.
    ///
    /// # Panics
    /// As [`jvp`](Self::jvp).
    pub fn jacobian(&mut self, output: Node, input: Node) -> Result<Node, TapeError> {
        let Shape { rows, cols } = self.entry("jacobian", output)?.shape;
        let inputs = self.entry("jacobian", input)?.shape;
        if inputs.cols != cols {
            let want = Shape::new(inputs.rows, cols);
            return Err(TapeError::Shape { op: "jacobian", what: "input", want, got: inputs });
        }
        let base = self.arena.scratch.len();
        for j in 0..inputs.rows {
            let seed = self.unit_row(inputs.rows, cols, j)?;
            match self.jvp([output], &[(input, seed)]) {
                Ok([column]) => self.arena.scratch.push(column.id),
                Err(error) => {
                    self.arena.scratch.truncate(base);
                    return Err(error);
                }
            }
        }
        let mut rank = 0;
        if rows > 1 {
            // Columns to rows.
            for i in 0..rows {
                for j in 0..inputs.rows {
                    let column = self.node(self.arena.scratch[base + j]);
                    let row = self.slice(column, i..i + 1)?;
                    self.arena.scratch.push(row.id);
                }
            }
            rank = inputs.rows;
        }
        let first = self.arena.links.len() as u32;
        let Arena { links, scratch, .. } = &mut *self.arena;
        links.extend_from_slice(&scratch[base + rank..]);
        scratch.truncate(base);
        let count = links.len() as u32 - first;
        self.emit(Op::Concat { first, count }, Shape::new(rows * inputs.rows, cols))
    }

    fn propagate(&mut self, frame: Frame, outputs: &[Node], seeds: &[(Node, Node)]) -> Result<(), TapeError> {
        // Upper half of the frame: whether an output depends on the node.
        let marks = frame.base + frame.count;
        for output in outputs {
            self.arena.scratch[marks + output.id as usize] = 1;
        }
        for &(node, tangent) in seeds {
            if (node.id as usize) < frame.count {
                self.arena.scratch[frame.base + node.id as usize] = tangent.id;
            }
        }
        for id in (0..frame.count).rev() {
            let Arena { entries, links, scratch, .. } = &mut *self.arena;
            let seeded = scratch[frame.base + id] != NONE;
            if scratch[marks + id] == 1 && !seeded {
                entries[id].op.for_each_input(links, |input| scratch[marks + input as usize] = 1);
            }
        }
        for id in 0..frame.count {
            let seeded = self.arena.scratch[frame.base + id] != NONE;
            if self.arena.scratch[marks + id] == 1
                && !seeded
                && let Some(tangent) = self.rule(frame, id as u32)?
            {
                self.arena.scratch[frame.base + id] = tangent.id;
            }
        }
        Ok(())
    }

    fn tangent_at(&self, frame: Frame, id: u32) -> Option<Node> {
        match self.arena.scratch[frame.base + id as usize] {
            NONE => None,
            tangent => Some(self.node(tangent)),
        }
    }

    fn zeros_like(&mut self, node: Node) -> Node {
        let Shape { rows, cols } = self.arena.entries[node.id as usize].shape;
        self.fill(rows, cols, 0.0)
    }

    /// Tangent of one node from those of its inputs; `None` stands for zero.
    fn rule(&mut self, frame: Frame, id: u32) -> Result<Option<Node>, TapeError> {
        let entry = self.arena.entries[id as usize];
        let (y, Shape { rows, cols }) = (self.node(id), entry.shape);
        let dot = |tape: &Self, node: u32| tape.tangent_at(frame, node);
        Ok(match entry.op {
            Op::Leaf => None,
            Op::Alias { parent, offset } => {
                dot(self, parent).map(|tangent| self.alias(tangent, offset as usize, entry.shape))
            }
            Op::Linear { w, b, x } => {
                let (w_dot, x_dot) = (dot(self, w), dot(self, x));
                let b_dot = if b == NONE { None } else { dot(self, b) };
                let along_x = match x_dot {
                    Some(x_dot) => Some(self.linear(self.node(w), None, x_dot)?),
                    None => None,
                };
                let along_w = match (w_dot, b_dot) {
                    (Some(w_dot), b_dot) => Some(self.linear(w_dot, b_dot, self.node(x))?),
                    (None, Some(b_dot)) => Some(self.broadcast_samples(b_dot, cols)?),
                    (None, None) => None,
                };
                self.add_some(along_x, along_w)?
            }
            Op::Unary { f, x } => match dot(self, x) {
                Some(x_dot) if !f.is_flat() => Some(self.unary_rule(f, self.node(x), y, x_dot)?),
                _ => None,
            },
            Op::Binary { f, a, b } => {
                let (a_dot, b_dot) = (dot(self, a), dot(self, b));
                self.binary_rule(f, self.node(a), a_dot, self.node(b), b_dot, y)?
            }
            Op::MulRow { x, w } => {
                let (x_dot, w_dot) = (dot(self, x), dot(self, w));
                let left = x_dot.map(|x_dot| self.mul_row(x_dot, self.node(w))).transpose()?;
                let right = w_dot.map(|w_dot| self.mul_row(self.node(x), w_dot)).transpose()?;
                self.add_some(left, right)?
            }
            Op::Concat { first, count } => self.concat_rule(frame, first, count, cols)?,
            Op::BroadcastFeatures { x } => {
                dot(self, x).map(|x_dot| self.broadcast_features(x_dot, rows)).transpose()?
            }
            Op::BroadcastSamples { x } => dot(self, x).map(|x_dot| self.broadcast_samples(x_dot, cols)).transpose()?,
            Op::SumFeatures { x } => dot(self, x).map(|x_dot| self.sum_features(x_dot)).transpose()?,
            Op::SumSamples { x } => dot(self, x).map(|x_dot| self.sum_samples(x_dot)).transpose()?,
            Op::Dot { a, b } if a == b => match dot(self, a) {
                Some(a_dot) => {
                    let half = self.dot(self.node(a), a_dot)?;
                    Some(self.scale(half, 2.0)?)
                }
                None => None,
            },
            Op::Dot { a, b } => {
                let (a_dot, b_dot) = (dot(self, a), dot(self, b));
                let left = a_dot.map(|a_dot| self.dot(a_dot, self.node(b))).transpose()?;
                let right = b_dot.map(|b_dot| self.dot(self.node(a), b_dot)).transpose()?;
                self.add_some(left, right)?
            }
            Op::Cross { a, b } => {
                let (a_dot, b_dot) = (dot(self, a), dot(self, b));
                let left = a_dot.map(|a_dot| self.cross(a_dot, self.node(b))).transpose()?;
                let right = b_dot.map(|b_dot| self.cross(self.node(a), b_dot)).transpose()?;
                self.add_some(left, right)?
            }
            Op::MatVec { m, v } => {
                let (m_dot, v_dot) = (dot(self, m), dot(self, v));
                let left = m_dot.map(|m_dot| self.mat_vec(m_dot, self.node(v))).transpose()?;
                let right = v_dot.map(|v_dot| self.mat_vec(self.node(m), v_dot)).transpose()?;
                self.add_some(left, right)?
            }
            Op::Custom { op, first, count, .. } => self.custom_rule(frame, op, first, count, y)?,
        })
    }

    fn unary_rule(&mut self, f: Unary, x: Node, y: Node, x_dot: Node) -> Result<Node, TapeError> {
        let derivative = match f {
            Unary::Affine(scale, _) => return if scale == 1.0 { Ok(x_dot) } else { self.scale(x_dot, scale) },
            Unary::Relu => return self.gate(x, x_dot, 0.0),
            Unary::LeakyRelu(slope) => return self.gate(x, x_dot, slope),
            Unary::Log => return self.div(x_dot, x),
            Unary::Square => self.scale(x, 2.0)?,
            Unary::Sqrt => {
                let inverse = self.rsqrt(x)?;
                self.scale(inverse, 0.5)?
            }
            Unary::Rsqrt => {
                let square = self.square(y)?;
                let cube = self.mul(square, y)?;
                self.scale(cube, -0.5)?
            }
            Unary::Recip => {
                let square = self.square(y)?;
                self.neg(square)?
            }
            Unary::Exp => y,
            Unary::TruncExp => {
                let clamped = self.clamp(x, -TRUNC_EXP_LIMIT, TRUNC_EXP_LIMIT)?;
                self.exp(clamped)?
            }
            Unary::Sin => self.cos(x)?,
            Unary::Cos => {
                let sin = self.sin(x)?;
                self.neg(sin)?
            }
            Unary::Softplus(shift) => {
                let shifted = if shift == 0.0 { x } else { self.affine(x, 1.0, shift)? };
                self.logistic(shifted)?
            }
            Unary::Logistic => self.logistic_derivative(x)?,
            Unary::LogisticDerivative => {
                let logistic = self.logistic(x)?;
                let odd = self.affine(logistic, -2.0, 1.0)?;
                self.mul(y, odd)?
            }
            Unary::Tanh => {
                let doubled = self.scale(x, 2.0)?;
                let quarter = self.logistic_derivative(doubled)?;
                self.scale(quarter, 4.0)?
            }
            Unary::Abs => self.sign(x)?,
            Unary::Pow(0.0) => return self.scale(x_dot, 0.0),
            Unary::Pow(p) => {
                let lower = self.pow(x, p - 1.0)?;
                self.scale(lower, p)?
            }
            Unary::Clamp(low, high) => self.inside(x, low, high)?,
            Unary::Stumpff(k, order) => self.stumpff_derivative(x, k, order + 1)?,
            Unary::Sign | Unary::Inside(..) | Unary::Detach => return Ok(self.zeros_like(x)),
        };
        self.mul(derivative, x_dot)
    }

    fn binary_rule(
        &mut self,
        f: Binary,
        a: Node,
        a_dot: Option<Node>,
        b: Node,
        b_dot: Option<Node>,
        y: Node,
    ) -> Result<Option<Node>, TapeError> {
        match f {
            Binary::Add => self.add_some(a_dot, b_dot),
            Binary::Sub => match (a_dot, b_dot) {
                (Some(a_dot), Some(b_dot)) => self.sub(a_dot, b_dot).map(Some),
                (a_dot, None) => Ok(a_dot),
                (None, Some(b_dot)) => self.neg(b_dot).map(Some),
            },
            Binary::Mul => {
                let left = a_dot.map(|a_dot| self.mul(a_dot, b)).transpose()?;
                let right = b_dot.map(|b_dot| self.mul(a, b_dot)).transpose()?;
                self.add_some(left, right)
            }
            Binary::Div => {
                // (a_dot - y b_dot) / b
                let right = b_dot.map(|b_dot| self.mul(y, b_dot)).transpose()?;
                let Some(top) = self.binary_rule(Binary::Sub, a, a_dot, b, right, y)? else { return Ok(None) };
                self.div(top, b).map(Some)
            }
            Binary::Gate(slope) => b_dot.map(|b_dot| self.gate(a, b_dot, slope)).transpose(),
        }
    }

    fn concat_rule(&mut self, frame: Frame, first: u32, count: u32, cols: usize) -> Result<Option<Node>, TapeError> {
        let links = first as usize..(first + count) as usize;
        let base = self.arena.scratch.len();
        let moving = links.clone().any(|link| self.tangent_at(frame, self.arena.links[link]).is_some());
        if !moving {
            return Ok(None);
        }
        let mut rows = 0;
        for link in links {
            let part = self.node(self.arena.links[link]);
            rows += self.arena.entries[part.id as usize].shape.rows;
            let tangent = match self.tangent_at(frame, part.id) {
                Some(tangent) => tangent,
                None => self.zeros_like(part),
            };
            self.arena.scratch.push(tangent.id);
        }
        let first = self.arena.links.len() as u32;
        let Arena { links, scratch, .. } = &mut *self.arena;
        links.extend_from_slice(&scratch[base..]);
        scratch.truncate(base);
        self.emit(Op::Concat { first, count }, Shape::new(rows, cols)).map(Some)
    }

    fn custom_rule(
        &mut self,
        frame: Frame,
        op: u32,
        first: u32,
        count: u32,
        y: Node,
    ) -> Result<Option<Node>, TapeError> {
        let count = count as usize;
        let (mut inputs, mut tangents) = ([y; MAX_INPUTS], [None; MAX_INPUTS]);
        for i in 0..count {
            let input = self.arena.links[first as usize + i];
            inputs[i] = self.node(input);
            tangents[i] = self.tangent_at(frame, input);
        }
        if tangents.iter().all(Option::is_none) {
            return Ok(None);
        }
        let op = self.customs[op as usize];
        let want = self.arena.entries[y.id as usize].shape;
        let tangent = op.tangent(self, &inputs[..count], &tangents[..count], y)?;
        let got = self.entry(op.name(), tangent)?.shape;
        if got != want {
            return Err(TapeError::Shape { op: op.name(), what: "tangent", want, got });
        }
        Ok(Some(tangent))
    }

    fn add_some(&mut self, a: Option<Node>, b: Option<Node>) -> Result<Option<Node>, TapeError> {
        match (a, b) {
            (Some(a), Some(b)) => self.add(a, b).map(Some),
            (a, b) => Ok(a.or(b)),
        }
    }
}
