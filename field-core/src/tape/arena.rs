//! Storage of a tape: values, gradients and the record of operations, kept from tile to tile.

use super::op::{Entry, Op, Place};
use super::recycled::Recycled;
use alloc::vec::Vec;
use core::ops::Range;
use float_core::Simd;

/// Memory of a [`Tape`](super::Tape), reused from tile to tile: after the first tile of a shape nothing is allocated.
///
/// Holds 8 bytes for each value on the tape (value and gradient) at the largest tile so far, and about 50 bytes for each
/// node. One arena serves one thread at a time.
#[derive(Clone, Debug)]
pub struct Arena {
    /// Never shrinks; the first `used` entries belong to the tape that is alive.
    pub(super) values: Vec<f32>,
    pub(super) used: usize,
    /// Gradients, at the same offsets as the values.
    pub(super) bars: Vec<f32>,
    pub(super) entries: Vec<Entry>,
    /// Inputs of operations with any number of them.
    pub(super) links: Vec<u32>,
    /// Whether the backward pass got to a node.
    pub(super) reached: Vec<bool>,
    /// Node numbers a tangent pass works with; nested passes stack up.
    pub(super) scratch: Vec<u32>,
    /// What one step of the backward pass works with.
    pub(super) work: Vec<f32>,
    /// Empty; keeps the capacity of the list of custom operations.
    pub(super) customs: Recycled,
    /// Counts tapes, so that a node of an earlier tile is recognised.
    pub(super) generation: u32,
    pub(super) simd: Simd,
}

impl Arena {
    /// An empty arena at the fastest SIMD level of this CPU.
    #[must_use]
    pub fn new() -> Self {
        Self::with_simd(Simd::best())
    }

    /// An empty arena that computes at one SIMD level.
    #[must_use]
    pub fn with_simd(simd: Simd) -> Self {
        Self {
            values: Vec::new(),
            used: 0,
            bars: Vec::new(),
            entries: Vec::new(),
            links: Vec::new(),
            reached: Vec::new(),
            scratch: Vec::new(),
            work: Vec::new(),
            customs: Recycled::default(),
            generation: 0,
            simd,
        }
    }

    /// Bytes held.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        let floats = self.values.capacity() + self.bars.capacity() + self.work.capacity();
        let words = self.links.capacity() + self.scratch.capacity();
        (floats + words) * 4 + self.entries.capacity() * size_of::<Entry>() + self.reached.capacity()
    }

    /// Forget the nodes, keep the memory.
    pub(super) fn reset(&mut self) {
        self.used = 0;
        self.entries.clear();
        self.links.clear();
        self.reached.clear();
        self.scratch.clear();
        self.generation = self.generation.wrapping_add(1);
    }

    /// Offset of `len` new values. They hold whatever was there before.
    pub(super) fn reserve(&mut self, len: usize) -> usize {
        let start = self.used;
        self.used += len;
        if self.values.len() < self.used {
            self.values.resize(self.used, 0.0);
        }
        start
    }

    /// The node whose memory `node` looks into: itself unless it is a slice.
    pub(super) fn root(&self, mut node: u32) -> u32 {
        while let Op::Alias { parent, .. } = self.entries[node as usize].op {
            node = parent;
        }
        node
    }
}

impl Default for Arena {
    fn default() -> Self {
        Self::new()
    }
}

/// Where in which buffer the values of a node lie.
pub(super) fn span(entry: &Entry) -> (Range<usize>, bool) {
    let len = entry.shape.len();
    match entry.place {
        Place::Arena(start) => (start..start + len, false),
        Place::Params(start) => (start..start + len, true),
    }
}

/// Values of a node, from the arena's buffer or the flat parameters.
#[inline]
pub(super) fn read<'v>(entry: &Entry, values: &'v [f32], params: &'v [f32]) -> &'v [f32] {
    let (range, is_param) = span(entry);
    if is_param { &params[range] } else { &values[range] }
}
