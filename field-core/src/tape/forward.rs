//! Values of a node from the values of its inputs.

use super::arena::read;
use super::args::{MAX_INPUTS, View};
use super::custom::CustomOp;
use super::error::TapeError;
use super::op::{Binary, Entry, NONE, Op};
use super::product::{Product, Start, sum};
use super::shape::Shape;
use super::unary;
use float_core::{Simd, Task, Vector};

/// All earlier nodes.
#[derive(Clone, Copy)]
pub(super) struct Source<'s> {
    pub(super) entries: &'s [Entry],
    pub(super) links: &'s [u32],
    pub(super) customs: &'s [&'s dyn CustomOp],
    pub(super) values: &'s [f32],
    pub(super) params: &'s [f32],
}

impl<'s> Source<'s> {
    #[inline]
    pub(super) fn get(&self, node: u32) -> &'s [f32] {
        read(&self.entries[node as usize], self.values, self.params)
    }

    #[inline]
    pub(super) fn shape(&self, node: u32) -> Shape {
        self.entries[node as usize].shape
    }

    pub(super) fn view(&self, node: u32) -> View<'s> {
        let shape = self.shape(node);
        View { rows: shape.rows, cols: shape.cols, data: self.get(node) }
    }

    pub(super) fn links(&self, first: u32, count: u32) -> &'s [u32] {
        &self.links[first as usize..(first + count) as usize]
    }

    /// Views of the inputs of a custom operation; entries past `links.len()` are empty.
    pub(super) fn views(&self, links: &[u32]) -> [View<'s>; MAX_INPUTS] {
        let mut views = [View { rows: 0, cols: 0, data: &[] }; MAX_INPUTS];
        for (view, &node) in views.iter_mut().zip(links) {
            *view = self.view(node);
        }
        views
    }
}

/// Write the values of `op` to `out`, all of them, and what it keeps to `saved`.
pub(super) fn compute(
    op: Op,
    source: Source<'_>,
    shape: Shape,
    simd: Simd,
    out: &mut [f32],
    saved: &mut [f32],
) -> Result<(), TapeError> {
    match op {
        Op::Leaf | Op::Alias { .. } => {}
        Op::Linear { w, b, x } => {
            let k = source.shape(x).rows;
            let start = if b == NONE { Start::Zero } else { Start::Bias(source.get(b)) };
            let (a, b) = (source.get(w), source.get(x));
            simd.run(Product { a, a_row: k, a_column: 1, b, m: shape.rows, k, n: shape.cols, start, out });
        }
        Op::Unary { f, x } => simd.run(unary::Forward { f, x: source.get(x), y: out }),
        Op::Concat { first, count } => {
            let mut rest = out;
            for &node in source.links(first, count) {
                let x = source.get(node);
                let (head, tail) = rest.split_at_mut(x.len());
                head.copy_from_slice(x);
                rest = tail;
            }
        }
        Op::Custom { op, first, count, .. } => {
            let links = source.links(first, count);
            out.fill(0.0);
            source.customs[op as usize].forward(&source.views(links)[..links.len()], out, saved)?;
        }
        _ => simd.run(Rows { op, source, shape, out }),
    }
    Ok(())
}

/// The operations that are plain loops; the compiler vectorises them for each level.
struct Rows<'a> {
    op: Op,
    source: Source<'a>,
    shape: Shape,
    out: &'a mut [f32],
}

impl Task for Rows<'_> {
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { op, source, shape: Shape { rows, cols: n }, out } = self;
        let get = |node| source.get(node);
        match op {
            Op::Binary { f, a, b } => {
                let (a, b) = (get(a), get(b));
                match f {
                    Binary::Add => zip(a, b, out, |a, b| a + b),
                    Binary::Sub => zip(a, b, out, |a, b| a - b),
                    Binary::Mul => zip(a, b, out, |a, b| a * b),
                    Binary::Div => zip(a, b, out, |a, b| a / b),
                    Binary::Gate(0.0) => zip(a, b, out, |a, b| if a <= 0.0 { 0.0 } else { b }),
                    Binary::Gate(slope) => zip(a, b, out, |a, b| if a <= 0.0 { slope * b } else { b }),
                }
            }
            Op::MulRow { x, w } => {
                let (x, w) = (get(x), get(w));
                for r in 0..rows {
                    zip(&x[r * n..(r + 1) * n], w, &mut out[r * n..(r + 1) * n], |x, w| x * w);
                }
            }
            Op::BroadcastFeatures { x } => {
                let x = get(x);
                (0..rows).for_each(|r| out[r * n..(r + 1) * n].copy_from_slice(x));
            }
            Op::BroadcastSamples { x } => {
                let x = get(x);
                (0..rows).for_each(|r| out[r * n..(r + 1) * n].fill(x[r]));
            }
            Op::SumFeatures { x } => {
                let (inner, x) = (source.shape(x).rows, get(x));
                out.fill(0.0);
                for r in 0..inner {
                    add(&x[r * n..(r + 1) * n], out);
                }
            }
            Op::SumSamples { x } => {
                let (n, x) = (source.shape(x).cols, get(x));
                for (r, out) in out.iter_mut().enumerate() {
                    *out = sum(&x[r * n..(r + 1) * n]);
                }
            }
            Op::Dot { a, b } => {
                let (inner, a, b) = (source.shape(a).rows, get(a), get(b));
                out.fill(0.0);
                for r in 0..inner {
                    mul_add(&a[r * n..(r + 1) * n], &b[r * n..(r + 1) * n], out);
                }
            }
            Op::Cross { a, b } => {
                let (a, b) = (get(a), get(b));
                for r in 0..3 {
                    let (i, j) = ((r + 1) % 3, (r + 2) % 3);
                    let row = |x: usize| x * n..(x + 1) * n;
                    zip(&a[row(i)], &b[row(j)], &mut out[row(r)], |a, b| a * b);
                    mul_sub(&a[row(j)], &b[row(i)], &mut out[row(r)]);
                }
            }
            Op::MatVec { m, v } => {
                let (inner, m, v) = (source.shape(v).rows, get(m), get(v));
                out.fill(0.0);
                for r in 0..rows {
                    for c in 0..inner {
                        let at = r * inner + c;
                        mul_add(&m[at * n..(at + 1) * n], &v[c * n..(c + 1) * n], &mut out[r * n..(r + 1) * n]);
                    }
                }
            }
            Op::Leaf
            | Op::Alias { .. }
            | Op::Linear { .. }
            | Op::Unary { .. }
            | Op::Concat { .. }
            | Op::Custom { .. } => {}
        }
    }
}

#[inline(always)]
fn zip(a: &[f32], b: &[f32], out: &mut [f32], f: impl Fn(f32, f32) -> f32) {
    for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
        *out = f(a, b);
    }
}

/// `out += x`.
#[inline(always)]
pub(super) fn add(x: &[f32], out: &mut [f32]) {
    for (out, &x) in out.iter_mut().zip(x) {
        *out += x;
    }
}

/// `out -= a * b`.
#[inline(always)]
pub(super) fn mul_sub(a: &[f32], b: &[f32], out: &mut [f32]) {
    for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
        *out -= a * b;
    }
}

/// `out += a * b`.
#[inline(always)]
pub(super) fn mul_add(a: &[f32], b: &[f32], out: &mut [f32]) {
    for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
        *out += a * b;
    }
}
