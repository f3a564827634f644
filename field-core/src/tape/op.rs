//! The record: what a node is and which nodes it was made from.

use super::shape::Shape;
use super::unary::Unary;

/// Input number that stands for "none".
pub(super) const NONE: u32 = u32::MAX;

/// Two matrices of one shape to a third.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    /// `b` where `a > 0`, else `slope * b`; derivative only with respect to `b`. The tangent of ReLU.
    Gate(f32),
}

/// One operation and its inputs, node numbers.
#[derive(Clone, Copy, Debug)]
pub(super) enum Op {
    /// Parameter, input or constant.
    Leaf,
    /// Rows of another node, without a copy: values and gradient are shared.
    Alias {
        parent: u32,
        offset: u32,
    },
    /// `w x + b`; `b` may be [`NONE`].
    Linear {
        w: u32,
        b: u32,
        x: u32,
    },
    Unary {
        f: Unary,
        x: u32,
    },
    Binary {
        f: Binary,
        a: u32,
        b: u32,
    },
    /// Every row of `x` times the one row of `w`.
    MulRow {
        x: u32,
        w: u32,
    },
    /// Rows one after another; inputs `links[first..first + count]`.
    Concat {
        first: u32,
        count: u32,
    },
    BroadcastFeatures {
        x: u32,
    },
    BroadcastSamples {
        x: u32,
    },
    SumFeatures {
        x: u32,
    },
    SumSamples {
        x: u32,
    },
    Dot {
        a: u32,
        b: u32,
    },
    /// Cross product of each sample's `[3]` vectors.
    Cross {
        a: u32,
        b: u32,
    },
    MatVec {
        m: u32,
        v: u32,
    },
    /// `saved` numbers lie behind the output.
    Custom {
        op: u32,
        first: u32,
        count: u32,
        saved: u32,
    },
}

/// Whose memory a node's values are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    Arena(usize),
    Params(usize),
}

/// One node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) op: Op,
    pub(super) place: Place,
    pub(super) shape: Shape,
    /// Whether a gradient has to flow into it.
    pub(super) needs: bool,
}

impl Op {
    /// Call `f` with each input that a derivative can flow to.
    pub(super) fn for_each_input(self, links: &[u32], mut f: impl FnMut(u32)) {
        match self {
            Self::Leaf => {}
            Self::Alias { parent: x, .. }
            | Self::Unary { x, .. }
            | Self::BroadcastFeatures { x }
            | Self::BroadcastSamples { x }
            | Self::SumFeatures { x }
            | Self::SumSamples { x }
            | Self::Binary { f: Binary::Gate(_), b: x, .. } => f(x),
            Self::Linear { w, b, x } => {
                f(w);
                if b != NONE {
                    f(b);
                }
                f(x);
            }
            Self::Binary { a, b, .. }
            | Self::MulRow { x: a, w: b }
            | Self::Dot { a, b }
            | Self::Cross { a, b }
            | Self::MatVec { m: a, v: b } => {
                f(a);
                f(b);
            }
            Self::Concat { first, count } | Self::Custom { first, count, .. } => {
                links[first as usize..(first + count) as usize].iter().for_each(|&i| f(i));
            }
        }
    }
}
