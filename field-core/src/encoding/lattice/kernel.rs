//! The loops over one level: gather, scatter, and the dots that position gradients need.

use float_core::{Task, Vector};

use super::cell::{BLOCK, Cells, Corners, Lanes, Weights};
use super::features::{Features, Packed};
use super::{Interpolation, Lattice};

/// Floats of one block of parameters that are touched together: 64 bytes, a cache line.
pub const BLOCK_FLOATS: usize = 16;

/// Rows of a batch: one slice for each axis, equally long.
pub(crate) type Axes<'a> = [&'a [f32]; 3];

/// What every kernel works on.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    pub(crate) lattice: Lattice,
    /// Floats from an entry to the next.
    pub(crate) stride: usize,
    /// Features of an entry, at most `stride`.
    pub(crate) features: usize,
    /// The first of the features that the kernel works on.
    pub(crate) first: usize,
    pub(crate) interpolation: Interpolation,
    pub(crate) x: Axes<'a>,
    /// Direction of the derivative; `None` for values.
    pub(crate) x_dot: Option<Axes<'a>>,
}

/// `out[f][i] = sum over corners of weight * table[entry][f]`.
pub(crate) struct Gather<'a, 'o, const F: usize> {
    pub(crate) place: Place<'a>,
    pub(crate) table: &'a [f32],
    pub(crate) out: [&'o mut [f32]; F],
}

/// `grad[entry][f] += weight * out_bar[f][i]`, samples in order, corners in order.
pub(crate) struct Scatter<'a, 'o, const F: usize> {
    pub(crate) place: Place<'a>,
    pub(crate) out_bar: [&'a [f32]; F],
    pub(crate) grad: &'o mut [f32],
    pub(crate) touched: Option<&'o mut [u64]>,
}

/// `x_bar[a][i] += d / d x_a of <out_bar, out>`.
pub(crate) struct PositionGradient<'a, 'o, const F: usize> {
    pub(crate) place: Place<'a>,
    pub(crate) table: &'a [f32],
    pub(crate) out_bar: [&'a [f32]; F],
    pub(crate) x_bar: [&'o mut [f32]; 3],
}

/// Sixteen points of a batch, starting at `at`; short blocks are filled up with 0.
#[inline(always)]
pub(crate) fn block<const N: usize>(rows: &[&[f32]; N], at: usize) -> [Lanes; N] {
    let mut out = [[0.0; BLOCK]; N];
    for (out, row) in out.iter_mut().zip(rows) {
        let row = &row[at..];
        match row.first_chunk::<BLOCK>() {
            Some(full) => *out = *full,
            None => copy_short(row, &mut out[..row.len()]),
        }
    }
    out
}

/// Copy less than a block. Out of line: else this and the copy of a whole block become one call that copies as many as there are, for each
/// row of each block.
#[cold]
#[inline(never)]
fn copy_short(from: &[f32], to: &mut [f32]) {
    to.copy_from_slice(from);
}

/// Ask for the cache line of `p`. Any address will do.
#[inline(always)]
fn prefetch(p: *const f32) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    // SAFETY: a hint of baseline x86-64; it does not access memory and does not fault.
    unsafe {
        use core::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(p.cast());
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = p;
}

/// A number for each of the `C` vertices that each sample of a block reads.
pub(crate) type Vertices<T, const C: usize> = [[T; BLOCK]; C];

/// Where the entries of these vertices start, and their weights.
#[derive(Clone, Copy)]
pub(crate) struct Read<const C: usize> {
    pub(crate) starts: Vertices<u32, C>,
    pub(crate) weights: Vertices<f32, C>,
}

impl<const C: usize> Read<C> {
    /// Before anything was located.
    pub(crate) const NOTHING: Self = Self { starts: [[0; BLOCK]; C], weights: [[0.0; BLOCK]; C] };
}

/// Ask for entries of `table` that lie `first` numbers behind these starts: large tables come from far away. `table` is only a hint.
#[inline(always)]
fn prefetch_entries<const C: usize>(table: *const f32, first: usize, starts: &Vertices<u32, C>) {
    for &start in starts.as_flattened() {
        prefetch(table.wrapping_add(start as usize + first));
    }
}

/// Call `body` with the start of each block of `n` samples and what `locate` wrote of it over what it was given, `nothing` at first. A block is
/// located before the one before it is worked on: what it reads is on its way into the cache by then.
#[inline(always)]
fn one_block_ahead<T: Copy>(n: usize, nothing: T, locate: impl Fn(usize, &mut T), mut body: impl FnMut(usize, &T)) {
    // Two that take turns: they are too large to be copied for each block.
    let [now, next] = &mut [nothing; 2];
    let (mut now, mut next) = (now, next);
    // One call of each: what is called twice may not be compiled for the vectors of the level that this is inlined into.
    for at in (0..n + BLOCK).step_by(BLOCK) {
        if at < n {
            locate(at, next);
        }
        if at > 0 {
            body(at - BLOCK, now);
        }
        core::mem::swap(&mut now, &mut next);
    }
}

/// Call `body` with the start and the vertices of each block of `n` samples, which `locate` writes over what it is given, while the entries of the
/// next block are on their way into the cache. Entries of `table` lie `first` numbers behind their starts.
#[inline(always)]
pub(crate) fn for_each_block<const C: usize>(
    n: usize,
    table: *const f32,
    first: usize,
    locate: impl Fn(usize, &mut Read<C>),
    body: impl FnMut(usize, &Read<C>),
) {
    let locate = |at, next: &mut Read<C>| {
        locate(at, next);
        prefetch_entries(table, first, &next.starts);
    };
    one_block_ahead(n, Read::NOTHING, locate, body);
}

/// The weighted sum over the vertices of each sample of a block: `[F][BLOCK]`.
///
/// # Safety
/// `table` has to hold `F` numbers `first` behind each start of `read`.
#[inline(always)]
pub(crate) unsafe fn gather_block<const F: usize, const C: usize>(
    table: &[f32],
    first: usize,
    read: &Read<C>,
) -> [Lanes; F]
where
    Packed: Features<F>,
{
    let Read { starts, weights } = read;
    let mut out = [[0.0; BLOCK]; F];
    for i in 0..BLOCK {
        let mut acc = Packed::zero();
        for c in 0..C {
            let start = starts[c][i] as usize + first;
            debug_assert!(start + F <= table.len());
            // SAFETY: the caller vouches for `F` numbers at `start`.
            let e = unsafe { Packed::load(table.as_ptr().add(start)) };
            acc = Packed::add_scaled(acc, weights[c][i], e);
        }
        let acc = Packed::unpack(acc);
        for f in 0..F {
            out[f][i] = acc[f];
        }
    }
    out
}

/// Add the gradients `out_bar` of the first `samples` of a block to the vertices that [`gather_block`] read, samples in order, vertices in order.
///
/// # Safety
/// `grad` has to hold `F` numbers `first` behind each start of `read`.
#[inline(always)]
pub(crate) unsafe fn scatter_block<const F: usize, const C: usize>(
    grad: &mut [f32],
    first: usize,
    read: &Read<C>,
    out_bar: &[Lanes; F],
    samples: usize,
) where
    Packed: Features<F>,
{
    let Read { starts, weights } = read;
    for i in 0..samples.min(BLOCK) {
        let out_bar = Packed::pack(core::array::from_fn(|f| out_bar[f][i]));
        for c in 0..C {
            let start = starts[c][i] as usize + first;
            debug_assert!(start + F <= grad.len());
            // SAFETY: the caller vouches for `F` numbers at `start`.
            unsafe {
                let e = grad.as_mut_ptr().add(start);
                Packed::store(Packed::add_scaled(Packed::load(e), weights[c][i], out_bar), e);
            }
        }
    }
}

/// Mark the blocks of parameters that [`scatter_block`] wrote to. Entries that `straddle` may lie in two.
#[inline(always)]
pub(crate) fn touch_block<const F: usize, const C: usize>(
    touched: &mut [u64],
    first: usize,
    starts: &Vertices<u32, C>,
    samples: usize,
    straddle: bool,
) {
    for i in 0..samples.min(BLOCK) {
        for starts in starts {
            let first = starts[i] as usize + first;
            let block = first / BLOCK_FLOATS;
            touched[block / 64] |= 1 << (block % 64);
            if straddle {
                let block = (first + F - 1) / BLOCK_FLOATS;
                touched[block / 64] |= 1 << (block % 64);
            }
        }
    }
}

/// Write a block to the rows of a batch from `at` on; what is past their end is left out.
#[inline(always)]
pub(crate) fn write_block<const F: usize>(rows: &mut [&mut [f32]; F], at: usize, out: &[Lanes; F]) {
    for (row, out) in rows.iter_mut().zip(out) {
        let row = &mut row[at..];
        let len = row.len();
        match row.first_chunk_mut::<BLOCK>() {
            Some(full) => *full = *out,
            None => copy_short(&out[..len], row),
        }
    }
}

impl Place<'_> {
    /// What the block at `at` reads, written over `out`.
    #[inline(always)]
    fn locate(&self, at: usize, out: &mut Read<8>) {
        let cells = Cells::locate(&self.lattice, self.interpolation, &block(&self.x, at));
        match &self.x_dot {
            None => cells.weights(Weights::Value, &mut out.weights),
            Some(x_dot) => cells.weights(Weights::Tangent(&block(x_dot, at)), &mut out.weights),
        }
        cells.starts(&self.lattice, self.stride as u32, &mut out.starts);
    }

    /// As [`for_each_block`].
    #[inline(always)]
    fn for_each_block(&self, table: *const f32, body: impl FnMut(usize, &Read<8>)) {
        for_each_block(self.x[0].len(), table, self.first, |at, out| self.locate(at, out), body);
    }

    #[inline(always)]
    fn check<const F: usize>(&self, table: &[f32]) {
        // The `unsafe` below relies on these: no wrapping, also where `usize` has 32 bits.
        let last = (self.lattice.entries as usize).checked_sub(1).and_then(|last| last.checked_mul(self.stride));
        let end = last.and_then(|last| last.checked_add(self.features)).unwrap_or(usize::MAX);
        assert!(table.len() >= end, "a grid's table has the wrong length");
        assert!(
            self.first <= self.features && F <= self.features - self.first && end <= u32::MAX as usize,
            "a grid's features do not exist"
        );
    }
}

impl<const F: usize> Task for Gather<'_, '_, F>
where
    Packed: Features<F>,
{
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.place.check::<F>(self.table);
        let Self { place, table, out: mut rows } = self;
        place.for_each_block(table.as_ptr(), |at, read| {
            // SAFETY: starts are at most (entries - 1) * stride; `check` saw that the table holds `features` more, and that
            // first + F <= features.
            let out = unsafe { gather_block::<F, 8>(table, place.first, read) };
            write_block(&mut rows, at, &out);
        });
    }
}

impl<const F: usize> Task for Scatter<'_, '_, F>
where
    Packed: Features<F>,
{
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.place.check::<F>(self.grad);
        let Self { place, out_bar: rows, grad, mut touched } = self;
        let n = place.x[0].len();
        // Groups that do not start at multiples of their size may lie in two blocks.
        let straddles = !BLOCK_FLOATS.is_multiple_of(F) || !(place.stride | place.first).is_multiple_of(F);
        place.for_each_block(grad.as_ptr(), |at, read| {
            let out_bar = block(&rows, at);
            // SAFETY: starts are at most (entries - 1) * stride; `check` saw that the gradient holds `features` more, and that
            // first + F <= features.
            unsafe { scatter_block::<F, 8>(grad, place.first, read, &out_bar, n - at) };
            if let Some(touched) = &mut touched {
                touch_block::<F, 8>(touched, place.first, &read.starts, n - at, straddles);
            }
        });
    }
}

impl<const F: usize> Task for PositionGradient<'_, '_, F>
where
    Packed: Features<F>,
{
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        self.place.check::<F>(self.table);
        let Self { place, table, out_bar: rows, x_bar: mut x_bars } = self;
        let locate = |at, (cells, starts): &mut (Cells, Corners<u32>)| {
            *cells = Cells::locate(&place.lattice, place.interpolation, &block(&place.x, at));
            cells.starts(&place.lattice, place.stride as u32, starts);
            prefetch_entries(table.as_ptr(), place.first, starts);
        };
        one_block_ahead(place.x[0].len(), (Cells::NOTHING, [[0; BLOCK]; 8]), locate, |at, (cells, starts)| {
            let out_bar = block(&rows, at);
            let by_x = match &place.x_dot {
                None => cells.weights_by_x(Weights::Value),
                Some(x_dot) => cells.weights_by_x(Weights::Tangent(&block(x_dot, at))),
            };
            let mut x_bar = [[0.0; BLOCK]; 3];
            if F < 4 {
                // Few features: their dot with the cotangents first, then all coordinates, sixteen samples at a time.
                let mut dots = [[0.0; BLOCK]; 8];
                for i in 0..BLOCK {
                    for c in 0..8 {
                        let start = starts[c][i] as usize + place.first;
                        for (f, e) in table[start..start + F].iter().enumerate() {
                            dots[c][i] += out_bar[f][i] * e;
                        }
                    }
                }
                for (dots, by_x) in dots.iter().zip(&by_x) {
                    for i in 0..BLOCK {
                        for a in 0..3 {
                            x_bar[a][i] += dots[i] * by_x[a][i];
                        }
                    }
                }
            } else {
                // Many: the derivatives of all features of a sample first.
                for i in 0..BLOCK {
                    let mut derivatives = [Packed::zero(); 3];
                    for c in 0..8 {
                        let start = starts[c][i] as usize + place.first;
                        debug_assert!(start + F <= table.len());
                        // SAFETY: as for `Gather`.
                        let e = unsafe { Packed::load(table.as_ptr().add(start)) };
                        for a in 0..3 {
                            derivatives[a] = Packed::add_scaled(derivatives[a], by_x[c][a][i], e);
                        }
                    }
                    for a in 0..3 {
                        let derivative = Packed::unpack(derivatives[a]);
                        x_bar[a][i] = out_bar.iter().zip(&derivative).fold(0.0, |sum, (bar, s)| sum + bar[i] * s);
                    }
                }
            }
            for (row, x_bar) in x_bars.iter_mut().zip(&x_bar) {
                for (out, x) in row[at..].iter_mut().zip(x_bar) {
                    *out += x;
                }
            }
        });
    }
}
