//! Reverse mode: gradients of all nodes that a loss depends on.

use super::arena::{Arena, span};
use super::args::{BackwardArgs, Bar, Demand, MAX_INPUTS, View};
use super::error::TapeError;
use super::forward::{Source, add, mul_add, mul_sub};
use super::op::{Binary, Entry, NONE, Op};
use super::product::{Product, Start, Transpose, sum};
use super::shape::Node;
use super::state::Tape;
use super::unary;
use alloc::vec::Vec;
use float_core::{Simd, Task, Vector};

impl Tape<'_> {
    /// Gradient of `sum(<seed, node>)` over the seeds: parameter gradients are **added** to `grad`, as long as the flat
    /// parameter vector; gradients of other nodes are read with [`gradient`](Self::gradient).
    ///
    /// May be called again, with other seeds: then `gradient` answers for the last call.
    ///
    /// # Errors
    /// [`TapeError::Length`] when `grad` or a seed has the wrong length, [`TapeError::ForeignNode`], or what the backward
    /// pass of a custom operation refuses.
    ///
    /// # Panics
    /// If the backward pass of a custom operation does.
    pub fn backward(&mut self, seeds: &[(Node, &[f32])], grad: &mut [f32]) -> Result<(), TapeError> {
        const OP: &str = "backward";
        if grad.len() != self.params.len() {
            return Err(TapeError::Length { op: OP, what: "grad", want: self.params.len(), got: grad.len() });
        }
        for (node, seed) in seeds {
            let want = self.entry(OP, *node)?.shape.len();
            if seed.len() != want {
                return Err(TapeError::Length { op: OP, what: "seed", want, got: seed.len() });
            }
        }
        let arena = &mut *self.arena;
        if arena.bars.len() < arena.values.len() {
            arena.bars.resize(arena.values.len(), 0.0);
        }
        arena.reached.clear();
        arena.reached.resize(arena.entries.len(), false);
        // The gradient of an input that the loss ignores is zero, not unknown.
        for id in 0..arena.entries.len() {
            if matches!(arena.entries[id].op, Op::Leaf) {
                arena.reach(id as u32);
            }
        }
        let mut last = None;
        for &(node, seed) in seeds {
            let entry = arena.entries[node.id as usize];
            if entry.needs {
                arena.reach(node.id);
                let (range, is_param) = span(&entry);
                add(seed, if is_param { &mut grad[range] } else { &mut arena.bars[range] });
                last = last.max(Some(node.id));
            }
        }
        for id in (0..last.map_or(0, |last| last + 1)).rev() {
            let entry = self.arena.entries[id as usize];
            if self.arena.reached[id as usize] && !matches!(entry.op, Op::Leaf | Op::Alias { .. }) {
                self.step(entry, grad)?;
            }
        }
        Ok(())
    }

    /// [`backward`](Self::backward) of one number: `loss` is `[1 x 1]`, its seed 1.
    ///
    /// # Errors
    /// As [`backward`](Self::backward).
    ///
    /// # Panics
    /// As [`backward`](Self::backward).
    pub fn backward_from(&mut self, loss: Node, grad: &mut [f32]) -> Result<(), TapeError> {
        self.backward(&[(loss, &[1.0])], grad)
    }

    /// Gradient with respect to `node`, `[rows][cols]`, after [`backward`](Self::backward).
    ///
    /// # Errors
    /// [`TapeError::NoGradient`] for constants, parameters (theirs is in the caller's buffer) and nodes other than
    /// inputs that the loss does not depend on; [`TapeError::ForeignNode`].
    pub fn gradient(&self, node: Node) -> Result<&[f32], TapeError> {
        let entry = self.entry("gradient", node)?;
        let (range, is_param) = span(entry);
        let root = self.arena.root(node.id) as usize;
        if is_param || !entry.needs || !self.arena.reached.get(root).is_some_and(|&r| r) {
            return Err(TapeError::NoGradient);
        }
        Ok(&self.arena.bars[range])
    }

    /// Add to the gradients of the inputs of one node.
    fn step(&mut self, entry: Entry, grad: &mut [f32]) -> Result<(), TapeError> {
        let arena = &mut *self.arena;
        arena.reach_inputs(entry.op);
        let Arena { values, bars, entries, links, work, simd, .. } = arena;
        let source = Source { entries, links, customs: &self.customs, values, params: self.params };
        let range = span(&entry).0;
        let (before, rest) = bars.split_at_mut(range.start);
        let g = &rest[..range.len()];
        let y = &values[range.clone()];
        let mut bars = Bars { entries: source.entries, before, grad };
        match entry.op {
            Op::Linear { w, b, x } => linear(Linear { w, b, x }, source, g, &mut bars, work, *simd),
            Op::Unary { f, x } => {
                if let Some(x_bar) = bars.of(x) {
                    simd.run(unary::Backward { f, x: source.get(x), y, y_bar: g, x_bar });
                }
            }
            Op::Custom { op, first, count, saved } => {
                let links = source.links(first, count);
                let views = &source.views(links)[..links.len()];
                let mut shapes = [entry.shape; MAX_INPUTS];
                shapes.iter_mut().zip(views).for_each(|(shape, view)| *shape = view.shape());
                let op = source.customs[op as usize];
                let len = op.scratch_len(&shapes[..links.len()]);
                let saved = &values[range.end..range.end + saved as usize];
                let bars = &mut bars.disjoint(links)[..links.len()];
                let args = BackwardArgs { inputs: views, out: y, saved, out_bar: g };
                op.backward(args, grown(work, len), bars)?;
            }
            op => simd.run(Rows { op, source, y, g, n: entry.shape.cols, bars: &mut bars }),
        }
        Ok(())
    }
}

impl Arena {
    /// Mark a node that a gradient flows to, and clear its gradient at the first visit.
    fn reach(&mut self, node: u32) {
        let root = self.root(node);
        let entry = self.entries[root as usize];
        if !entry.needs || self.reached[root as usize] {
            return;
        }
        self.reached[root as usize] = true;
        if let (range, false) = span(&entry) {
            self.bars[range].fill(0.0);
        }
    }

    fn reach_inputs(&mut self, op: Op) {
        // The closure cannot borrow the arena while it walks the links: take them out and put them back.
        let links = core::mem::take(&mut self.links);
        op.for_each_input(&links, |input| self.reach(input));
        self.links = links;
    }
}

/// Gradients of earlier nodes.
struct Bars<'b> {
    entries: &'b [Entry],
    before: &'b mut [f32],
    grad: &'b mut [f32],
}

impl<'b> Bars<'b> {
    /// Gradient of one node; `None` where it is not needed.
    #[inline(always)]
    fn of(&mut self, node: u32) -> Option<&mut [f32]> {
        let entry = &self.entries[node as usize];
        let (range, is_param) = span(entry);
        entry.needs.then(|| if is_param { &mut self.grad[range] } else { &mut self.before[range] })
    }

    /// Gradients of several nodes whose memory does not overlap.
    fn disjoint(&mut self, nodes: &[u32]) -> [Bar<'_>; MAX_INPUTS] {
        let mut bars: [Bar<'_>; MAX_INPUTS] = core::array::from_fn(|_| Bar { data: &mut [], demand: Demand::Ignored });
        let mut order: [usize; MAX_INPUTS] = core::array::from_fn(|i| i);
        let order = &mut order[..nodes.len()];
        order.sort_unstable_by_key(|&i| span(&self.entries[nodes[i] as usize]).0.start);
        for (of_params, mut rest) in [(false, &mut *self.before), (true, &mut *self.grad)] {
            let mut done = 0;
            for &i in &*order {
                let (range, is_param) = span(&self.entries[nodes[i] as usize]);
                if is_param != of_params {
                    continue;
                }
                bars[i].demand = if self.entries[nodes[i] as usize].needs { Demand::Wanted } else { Demand::Ignored };
                if range.is_empty() {
                    continue;
                }
                let (_, tail) = rest.split_at_mut(range.start - done);
                let (data, tail) = tail.split_at_mut(range.len());
                bars[i].data = data;
                rest = tail;
                done = range.end;
            }
        }
        bars
    }
}

/// The first `len` numbers of a buffer that only grows.
fn grown(buffer: &mut Vec<f32>, len: usize) -> &mut [f32] {
    if buffer.len() < len {
        buffer.resize(len, 0.0);
    }
    &mut buffer[..len]
}

/// Nodes of `y = w x + b`; `b` may be [`NONE`].
struct Linear {
    w: u32,
    b: u32,
    x: u32,
}

fn linear(op: Linear, source: Source<'_>, g: &[f32], bars: &mut Bars<'_>, work: &mut Vec<f32>, simd: Simd) {
    let Linear { w, b, x } = op;
    let View { rows: k, cols: n, data } = source.view(x);
    let m = source.shape(w).rows;
    if let Some(out) = bars.of(w) {
        // w_bar = g x^T: with x work once, the same product kernel runs over the inputs.
        let xt = grown(work, k * n);
        simd.run(Transpose { x: data, rows: k, cols: n, out: xt });
        simd.run(Product { a: g, a_row: n, a_column: 1, b: xt, m, k: n, n: k, start: Start::Add, out });
    }
    if b != NONE
        && let Some(out) = bars.of(b)
    {
        for (r, out) in out.iter_mut().enumerate() {
            *out += sum(&g[r * n..(r + 1) * n]);
        }
    }
    if let Some(out) = bars.of(x) {
        simd.run(Product { a: source.get(w), a_row: 1, a_column: k, b: g, m: k, k: m, n, start: Start::Add, out });
    }
}

/// The operations that are plain loops; the compiler vectorises them for each level.
struct Rows<'a, 'b> {
    op: Op,
    source: Source<'a>,
    y: &'a [f32],
    g: &'a [f32],
    /// Samples of the output.
    n: usize,
    bars: &'a mut Bars<'b>,
}

impl Task for Rows<'_, '_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { op, source, y, g, n, bars } = self;
        let get = |node| source.get(node);
        match op {
            Op::Binary { f, a, b } => binary(f, a, b, source, y, g, bars),
            Op::MulRow { x, w } => {
                let rows = source.shape(x).rows;
                if let Some(x_bar) = bars.of(x) {
                    let w = get(w);
                    (0..rows).for_each(|r| mul_add(&g[r * n..(r + 1) * n], w, &mut x_bar[r * n..(r + 1) * n]));
                }
                if let Some(w_bar) = bars.of(w) {
                    let x = get(x);
                    (0..rows).for_each(|r| mul_add(&g[r * n..(r + 1) * n], &x[r * n..(r + 1) * n], w_bar));
                }
            }
            Op::Concat { first, count } => {
                let mut rest = g;
                for &node in source.links(first, count) {
                    let (head, tail) = rest.split_at(source.shape(node).len());
                    if let Some(bar) = bars.of(node) {
                        add(head, bar);
                    }
                    rest = tail;
                }
            }
            Op::BroadcastFeatures { x } => {
                if let Some(x_bar) = bars.of(x) {
                    g.chunks_exact(n.max(1)).for_each(|row| add(row, x_bar));
                }
            }
            Op::BroadcastSamples { x } => {
                if let Some(x_bar) = bars.of(x) {
                    for (r, x_bar) in x_bar.iter_mut().enumerate() {
                        *x_bar += sum(&g[r * n..(r + 1) * n]);
                    }
                }
            }
            Op::SumFeatures { x } => {
                if let Some(x_bar) = bars.of(x) {
                    x_bar.chunks_exact_mut(n.max(1)).for_each(|row| add(g, row));
                }
            }
            Op::SumSamples { x } => {
                let n = source.shape(x).cols;
                if let Some(x_bar) = bars.of(x) {
                    for (row, &g) in x_bar.chunks_exact_mut(n.max(1)).zip(g) {
                        row.iter_mut().for_each(|x_bar| *x_bar += g);
                    }
                }
            }
            Op::Dot { a, b } => {
                for (to, other) in [(a, b), (b, a)] {
                    if let Some(bar) = bars.of(to) {
                        let other = get(other).chunks_exact(n.max(1));
                        bar.chunks_exact_mut(n.max(1)).zip(other).for_each(|(bar, other)| mul_add(g, other, bar));
                    }
                }
            }
            Op::Cross { a, b } => {
                // a_bar += b x g, b_bar += g x a.
                let row = |x: usize| x * n..(x + 1) * n;
                for (to, other, of_a) in [(a, b, true), (b, a, false)] {
                    let Some(bar) = bars.of(to) else { continue };
                    let other = get(other);
                    for r in 0..3 {
                        let (i, j) = if of_a { ((r + 1) % 3, (r + 2) % 3) } else { ((r + 2) % 3, (r + 1) % 3) };
                        mul_add(&other[row(i)], &g[row(j)], &mut bar[row(r)]);
                        mul_sub(&other[row(j)], &g[row(i)], &mut bar[row(r)]);
                    }
                }
            }
            Op::MatVec { m, v } => {
                let (inner, rows) = (source.shape(v).rows, g.len().checked_div(n).unwrap_or(0));
                let pairs = || (0..rows).flat_map(move |r| (0..inner).map(move |c| (r, c)));
                let row = |r: usize| r * n..(r + 1) * n;
                if let Some(m_bar) = bars.of(m) {
                    let v = get(v);
                    pairs().for_each(|(r, c)| mul_add(&g[row(r)], &v[row(c)], &mut m_bar[row(r * inner + c)]));
                }
                if let Some(v_bar) = bars.of(v) {
                    let m = get(m);
                    pairs().for_each(|(r, c)| mul_add(&g[row(r)], &m[row(r * inner + c)], &mut v_bar[row(c)]));
                }
            }
            Op::Leaf | Op::Alias { .. } | Op::Linear { .. } | Op::Unary { .. } | Op::Custom { .. } => {}
        }
    }
}

#[inline(always)]
fn binary(f: Binary, a: u32, b: u32, source: Source<'_>, y: &[f32], g: &[f32], bars: &mut Bars<'_>) {
    let (av, bv) = (source.get(a), source.get(b));
    if !matches!(f, Binary::Gate(_))
        && let Some(out) = bars.of(a)
    {
        match f {
            Binary::Add | Binary::Sub => add(g, out),
            Binary::Mul => mul_add(g, bv, out),
            Binary::Div => fold(g, bv, out, |g, b| g / b),
            Binary::Gate(_) => {}
        }
    }
    if let Some(out) = bars.of(b) {
        match f {
            Binary::Add => add(g, out),
            Binary::Sub => out.iter_mut().zip(g).for_each(|(out, g)| *out -= g),
            Binary::Mul => mul_add(g, av, out),
            Binary::Div => {
                for (((out, &g), &y), &b) in out.iter_mut().zip(g).zip(y).zip(bv) {
                    *out -= g * y / b;
                }
            }
            Binary::Gate(0.0) => fold(g, av, out, |g, a| if a <= 0.0 { 0.0 } else { g }),
            Binary::Gate(slope) => fold(g, av, out, |g, a| if a <= 0.0 { slope * g } else { g }),
        }
    }
}

/// `out[i] += f(g[i], x[i])`.
#[inline(always)]
fn fold(g: &[f32], x: &[f32], out: &mut [f32], f: impl Fn(f32, f32) -> f32) {
    for ((out, &g), &x) in out.iter_mut().zip(g).zip(x) {
        *out += f(g, x);
    }
}
