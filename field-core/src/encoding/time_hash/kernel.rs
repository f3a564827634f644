//! The loops over one level: where samples lie, what they gather, and where their gradients go.

use float_core::{Task, Vector};

use super::{TIME_PRIME, TimeLevel};
use crate::encoding::lattice::PRIMES;
use crate::encoding::lattice::cell::BLOCK as LANES;
use crate::encoding::lattice::features::{Features, Packed};
use crate::encoding::lattice::kernel::{
    Read, block, for_each_block, gather_block, scatter_block, touch_block, write_block,
};

/// Vertices of a simplex.
const CORNERS: usize = 5;
/// Which pairs are put in order one after the other, so that four numbers are in order at the end.
const SORT: [[usize; 2]; 5] = [[0, 1], [2, 3], [0, 2], [1, 3], [1, 2]];

/// What every kernel works on: a level, positions `[3][n]` and times `[n]`.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) level: TimeLevel,
    /// x, y, z and t, equally long.
    pub(super) rows: [&'a [f32]; 4],
}

/// `out[f][i] = sum over the vertices of a simplex of weight * table[entry][f]`.
pub(super) struct Gather<'a, 'o, const F: usize> {
    pub(super) place: Place<'a>,
    pub(super) table: &'a [f32],
    pub(super) out: [&'o mut [f32]; F],
}

/// `grad[entry][f] += weight * out_bar[f][i]`, samples in order, vertices in order.
pub(super) struct Scatter<'a, 'o, const F: usize> {
    pub(super) place: Place<'a>,
    pub(super) out_bar: [&'a [f32]; F],
    pub(super) grad: &'o mut [f32],
    pub(super) touched: &'o mut [u64],
}

/// `x_bar[a][i] += d / d x_a of <out_bar, out>`.
pub(super) struct PositionGradient<'a, 'o, const F: usize> {
    pub(super) place: Place<'a>,
    pub(super) table: &'a [f32],
    pub(super) out_bar: [&'a [f32]; F],
    pub(super) x_bar: [&'o mut [f32]; 3],
}

/// Where a block of samples lies.
struct Cells {
    /// Number of the cell along each axis.
    low: [[u32; LANES]; 4],
    /// Place in the cell along each axis, `0..=1`.
    at: [[f32; LANES]; 4],
}

impl Place<'_> {
    fn len(&self) -> usize {
        self.rows[3].len()
    }

    /// Cells along an axis.
    #[inline(always)]
    fn cells(&self, axis: usize) -> f32 {
        self.level.cells[axis / 3] as f32
    }

    /// Where the sixteen samples from `from` on lie; short blocks are filled up with 0.
    #[inline(always)]
    fn locate(&self, from: usize) -> Cells {
        let mut cells = Cells { low: [[0; LANES]; 4], at: [[0.0; LANES]; 4] };
        for (axis, x) in block(&self.rows, from).iter().enumerate() {
            let (count, last) = (self.cells(axis), self.cells(axis) - 1.0);
            for lane in 0..LANES {
                // Not `clamp`, which keeps NaN.
                let x = if x[lane] > 0.0 { x[lane] } else { 0.0 };
                let p = if x < 1.0 { x } else { 1.0 } * count;
                // Signed: what vector instructions convert.
                let low = (p as i32 as f32).min(last);
                cells.low[axis][lane] = low as i32 as u32;
                cells.at[axis][lane] = p - low;
            }
        }
        cells
    }

    /// Where the `F` numbers of each vertex of the simplices that samples lie in start, and its weight, written over `out`. From the lowest corner of the cell an edge leads along the
    /// axis on which the sample is farthest, then along the next, to the corner opposite.
    #[inline(always)]
    fn simplices<const F: usize>(&self, cells: &Cells, out: &mut Read<CORNERS>) {
        let TimeLevel { cells: [side, _], entries, dense, .. } = self.level;
        let r = side + 1;
        let factors = if dense { [1, r, r * r, r * r * r] } else { [1, PRIMES[0], PRIMES[1], TIME_PRIME] };
        let (mut first, mut step, mut at) = ([0_u32; LANES], [[0_u32; LANES]; 4], cells.at);
        for axis in 0..4 {
            for lane in 0..LANES {
                let low = cells.low[axis][lane].wrapping_mul(factors[axis]);
                let high = low.wrapping_add(factors[axis]);
                // What leads from one side of the cell to the other: added, or flipped in a hash.
                (first[lane], step[axis][lane]) =
                    if dense { (first[lane] + low, factors[axis]) } else { (first[lane] ^ low, low ^ high) };
            }
        }
        for [a, b] in SORT {
            for lane in 0..LANES {
                let swap = at[a][lane] < at[b][lane];
                let (x, y, u, v) = (at[a][lane], at[b][lane], step[a][lane], step[b][lane]);
                (at[a][lane], at[b][lane]) = if swap { (y, x) } else { (x, y) };
                (step[a][lane], step[b][lane]) = if swap { (v, u) } else { (u, v) };
            }
        }
        let Read { starts, weights: weight } = out;
        let mask = if dense { u32::MAX } else { entries - 1 };
        for lane in 0..LANES {
            let mut vertex = first[lane];
            starts[0][lane] = (vertex & mask) * F as u32;
            weight[0][lane] = 1.0 - at[0][lane];
            for k in 0..4 {
                vertex = if dense { vertex + step[k][lane] } else { vertex ^ step[k][lane] };
                starts[k + 1][lane] = (vertex & mask) * F as u32;
                weight[k + 1][lane] = if k < 3 { at[k][lane] - at[k + 1][lane] } else { at[3][lane] };
            }
        }
    }

    /// Refuses a table too short for an entry that [`Place::simplices`] may give: the `unsafe` below relies on it.
    fn check<const F: usize>(&self, table: &[f32]) {
        let TimeLevel { cells: [side, times], entries, dense, .. } = self.level;
        // Those of levels that are hashed would not fit `u64`.
        let vertices = (u128::from(side) + 1).pow(3) * (u128::from(times) + 1);
        let fits = if dense { vertices <= u128::from(entries) } else { entries.is_power_of_two() };
        assert!(fits, "a level of another shape");
        let numbers = u64::from(entries) * F as u64;
        assert!(
            numbers <= u64::from(u32::MAX) && table.len() as u64 >= numbers,
            "a level's table has the wrong length"
        );
    }

    /// As [`for_each_block`], with entries of `F` numbers.
    #[inline(always)]
    fn for_each_block<const F: usize>(&self, table: *const f32, body: impl FnMut(usize, &Read<CORNERS>)) {
        let locate = |from, out: &mut _| self.simplices::<F>(&self.locate(from), out);
        for_each_block(self.len(), table, 0, locate, body);
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
        place.for_each_block::<F>(table.as_ptr(), |from, read| {
            // SAFETY: `check` saw that the table holds the `F` numbers of every entry that there is.
            let out = unsafe { gather_block::<F, CORNERS>(table, 0, read) };
            write_block(&mut rows, from, &out);
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
        let Self { place, out_bar: rows, grad, touched } = self;
        let n = place.len();
        place.for_each_block::<F>(grad.as_ptr(), |from, read| {
            let out_bar = block(&rows, from);
            // SAFETY: `check` saw that the gradient holds the `F` numbers of every entry that there is.
            unsafe { scatter_block::<F, CORNERS>(grad, 0, read, &out_bar, n - from) };
            // 1, 2, 4 or 8 numbers from a multiple of themselves: in one block of 16.
            touch_block::<F, CORNERS>(touched, 0, &read.starts, n - from, false);
        });
    }
}

impl<const F: usize> Task for PositionGradient<'_, '_, F> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let (table, _) = self.table.as_chunks::<F>();
        let n = self.place.len();
        let mut read = Read::NOTHING;
        for from in (0..n).step_by(LANES) {
            let cells = self.place.locate(from);
            self.place.simplices::<1>(&cells, &mut read);
            for lane in 0..LANES.min(n - from) {
                let dot = |corner: usize| {
                    let value = &table[read.starts[corner][lane] as usize];
                    (0..F).map(|f| value[f] * self.out_bar[f][from + lane]).sum::<f32>()
                };
                // The axes in the order of the edges: as the kernels sort them.
                let mut axes = [0, 1, 2, 3];
                for [a, b] in SORT {
                    if cells.at[axes[a]][lane] < cells.at[axes[b]][lane] {
                        axes.swap(a, b);
                    }
                }
                for (edge, axis) in axes.into_iter().enumerate().filter(|(_, axis)| *axis < 3) {
                    // What was clamped does not move.
                    if (0.0..=1.0).contains(&self.place.rows[axis][from + lane]) {
                        self.x_bar[axis][from + lane] += self.place.cells(axis) * (dot(edge + 1) - dot(edge));
                    }
                }
            }
        }
    }
}
