//! The loops over all planes of a block of points: forward and backward.

use float_core::{Task, Vector};

use super::combine::{Dual, MAX_PLANES, Ring, Rule};
use crate::encoding::lattice::cell::{BLOCK, Lanes, side, sign, split};
use crate::encoding::lattice::features::{Features, Packed};
use crate::encoding::lattice::kernel::block;

/// Most axes there are: space and time.
pub(super) const MAX_AXES: usize = 4;

/// One number for each corner of each point's cell; bit 0 = up the first axis, bit 1 = up the second.
type Corners<T> = [[T; BLOCK]; 4];

/// A plane in the table: `[second axis][first axis][features]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// The axes it spans.
    pub(super) axes: [usize; 2],
    /// Where it starts, floats.
    pub(super) offset: u32,
    /// From a vertex to the next along each axis, floats; 0 along an axis of one vertex.
    pub(super) steps: [u32; 2],
}

/// What both kernels work on.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) planes: &'a [Plane],
    pub(super) rule: Rule,
    /// Vertices along each axis.
    pub(super) resolution: &'a [u32],
    /// Floats of the whole table.
    pub(super) params: usize,
    /// Features of a vertex.
    pub(super) features: usize,
    /// The first of the features that the kernel works on.
    pub(super) first: usize,
    /// Samples.
    pub(super) n: usize,
    pub(super) table: &'a [f32],
    /// `[axes][n]`.
    pub(super) x: &'a [f32],
    /// Direction of the derivative; `None` for values.
    pub(super) x_dot: Option<&'a [f32]>,
}

/// Features, or their derivative.
pub(super) struct Forward<'a, 'o, const F: usize> {
    pub(super) place: Place<'a>,
    pub(super) out: [&'o mut [f32]; F],
}

/// Gradients of `<out_bar, read>` with respect to the table and the positions, where wanted.
pub(super) struct Backward<'a, 'o, const F: usize> {
    pub(super) place: Place<'a>,
    pub(super) out_bar: [&'a [f32]; F],
    pub(super) table_bar: Option<&'o mut [f32]>,
    pub(super) x_bar: Option<&'o mut [f32]>,
}

/// Where sixteen points lie along one axis.
#[derive(Clone, Copy)]
struct Along {
    cell: [u32; BLOCK],
    /// Weight of the upper side.
    upper: Lanes,
    /// Its derivative with respect to the coordinate; 0 where that was clamped.
    derivative: Lanes,
    /// The same times the direction.
    dot: Lanes,
}

/// Sixteen points in one plane.
#[derive(Clone, Copy)]
struct Cells {
    along: [Along; 2],
    starts: Corners<u32>,
}

impl Along {
    const NONE: Self = Self { cell: [0; BLOCK], upper: [0.0; BLOCK], derivative: [0.0; BLOCK], dot: [0.0; BLOCK] };

    #[inline(always)]
    fn locate(resolution: u32, x: &Lanes, x_dot: &Lanes) -> Self {
        let mut along = Self::NONE;
        let half = f64::from(resolution - 1) * 0.5;
        let last = f64::from(resolution.saturating_sub(2));
        for i in 0..BLOCK {
            let x = x[i];
            let derivative = if (-1.0..=1.0).contains(&x) { half as f32 } else { 0.0 };
            let x = if x > -1.0 { x } else { -1.0 };
            let x = if x < 1.0 { x } else { 1.0 };
            let (cell, upper) = split((f64::from(x) + 1.0) * half, last);
            along.cell[i] = cell;
            along.upper[i] = upper;
            along.derivative[i] = derivative;
            // A direction does not count past the border, however large.
            along.dot[i] = if derivative == 0.0 { 0.0 } else { derivative * x_dot[i] };
        }
        along
    }
}

impl Cells {
    #[inline(always)]
    fn new(plane: &Plane, features: usize, along: &[Along; MAX_AXES]) -> Self {
        let along = plane.axes.map(|a| along[a]);
        let mut starts = [[0; BLOCK]; 4];
        for (c, starts) in starts.iter_mut().enumerate() {
            let corner = plane.offset + (c as u32 & 1) * plane.steps[0] + (c as u32 >> 1) * plane.steps[1];
            // Cells along an axis of one vertex are 0, as are their steps.
            for ((start, a), b) in starts.iter_mut().zip(&along[0].cell).zip(&along[1].cell) {
                *start = corner + a * features as u32 + b * plane.steps[1];
            }
        }
        Self { along, starts }
    }

    #[inline(always)]
    fn weights(&self) -> Corners<f32> {
        let [a, b] = &self.along;
        core::array::from_fn(|c| core::array::from_fn(|i| side(c, a.upper[i]) * side(c >> 1, b.upper[i])))
    }

    /// Derivatives of the weights along the direction.
    #[inline(always)]
    fn weights_dot(&self) -> Corners<f32> {
        let [a, b] = &self.along;
        core::array::from_fn(|c| {
            core::array::from_fn(|i| {
                sign(c) * a.dot[i] * side(c >> 1, b.upper[i]) + side(c, a.upper[i]) * (sign(c >> 1) * b.dot[i])
            })
        })
    }

    /// Adds the gradient of `sum over corners of dots * weights` with respect to both coordinates.
    #[inline(always)]
    fn weights_backward(&self, dots: &Corners<f32>, bars: [&mut Lanes; 2]) {
        let [a, b] = &self.along;
        for (c, dots) in dots.iter().enumerate() {
            for i in 0..BLOCK {
                bars[0][i] += dots[i] * (sign(c) * a.derivative[i] * side(c >> 1, b.upper[i]));
                bars[1][i] += dots[i] * (side(c, a.upper[i]) * (sign(c >> 1) * b.derivative[i]));
            }
        }
    }

    /// The same of `sum over corners of dots * weights_dot`: a cell has mixed second derivatives only.
    #[inline(always)]
    fn weights_dot_backward(&self, dots: &Corners<f32>, bars: [&mut Lanes; 2]) {
        let [a, b] = &self.along;
        for (c, dots) in dots.iter().enumerate() {
            let sign = sign(c) * sign(c >> 1);
            for i in 0..BLOCK {
                bars[0][i] += dots[i] * (sign * a.derivative[i] * b.dot[i]);
                bars[1][i] += dots[i] * (sign * b.derivative[i] * a.dot[i]);
            }
        }
    }

    /// `sum over corners of weights * table`.
    #[inline(always)]
    fn gather<const F: usize>(&self, place: &Place<'_>, weights: &Corners<f32>) -> [Lanes; F]
    where
        Packed: Features<F>,
    {
        let mut out = [[0.0; BLOCK]; F];
        for i in 0..BLOCK {
            let mut sum = Packed::zero();
            for (starts, weights) in self.starts.iter().zip(weights) {
                let start = starts[i] as usize + place.first;
                debug_assert!(start + F <= place.table.len());
                // SAFETY: cells are at most two below the resolution, so `starts` are at most the plane's last vertex;
                // `Place::check` saw that the table holds all planes, and that first + F <= features.
                let e = unsafe { Packed::load(place.table.as_ptr().add(start)) };
                sum = Packed::add_scaled(sum, weights[i], e);
            }
            let sum = Packed::unpack(sum);
            for f in 0..F {
                out[f][i] = sum[f];
            }
        }
        out
    }

    /// `table_bar += weights * bar` for the first `len` points.
    #[inline(always)]
    fn scatter<const F: usize>(
        &self,
        place: &Place<'_>,
        len: usize,
        weights: &Corners<f32>,
        bar: &[Lanes; F],
        table_bar: &mut [f32],
    ) where
        Packed: Features<F>,
    {
        for i in 0..len {
            let bar = Packed::pack(core::array::from_fn(|f| bar[f][i]));
            for (starts, weights) in self.starts.iter().zip(weights) {
                let start = starts[i] as usize + place.first;
                debug_assert!(start + F <= table_bar.len());
                // SAFETY: as in `gather`; `Backward::run` saw that `table_bar` is as long as the table.
                unsafe {
                    let e = table_bar.as_mut_ptr().add(start);
                    Packed::store(Packed::add_scaled(Packed::load(e), weights[i], bar), e);
                }
            }
        }
    }

    /// `<bar, table>` at each corner of the first `len` points.
    #[inline(always)]
    fn dots<const F: usize>(&self, place: &Place<'_>, len: usize, bar: &[Lanes; F]) -> Corners<f32> {
        let mut dots = [[0.0; BLOCK]; 4];
        for i in 0..len {
            for (starts, dots) in self.starts.iter().zip(&mut dots) {
                let start = starts[i] as usize + place.first;
                for (f, e) in place.table[start..start + F].iter().enumerate() {
                    dots[i] += bar[f][i] * e;
                }
            }
        }
        dots
    }
}

impl Place<'_> {
    #[inline(always)]
    fn check<const F: usize>(&self) {
        assert!(self.table.len() == self.params && self.first + F <= self.features, "a plane's features do not exist");
    }

    /// The block at `at`, in each plane.
    #[inline(always)]
    fn cells(&self, at: usize) -> [Cells; MAX_PLANES] {
        let mut along = [Along::NONE; MAX_AXES];
        for (a, &resolution) in self.resolution.iter().enumerate() {
            let row = |x: &[f32]| block::<1>(&[&x[a * self.n..(a + 1) * self.n]], at)[0];
            along[a] = Along::locate(resolution, &row(self.x), &self.x_dot.map_or([0.0; BLOCK], row));
        }
        let mut cells = [Cells { along: [Along::NONE; 2], starts: [[0; BLOCK]; 4] }; MAX_PLANES];
        for (cells, plane) in cells.iter_mut().zip(self.planes) {
            *cells = Cells::new(plane, self.features, &along);
        }
        cells
    }
}

impl<const F: usize> Task for Forward<'_, '_, F>
where
    Packed: Features<F>,
{
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { place, out: mut rows } = self;
        place.check::<F>();
        let count = place.planes.len();
        let (mut values, mut dots) = ([[[0.0; BLOCK]; F]; MAX_PLANES], [[[0.0; BLOCK]; F]; MAX_PLANES]);
        for at in (0..place.n).step_by(BLOCK) {
            let cells = place.cells(at);
            for (p, cells) in cells[..count].iter().enumerate() {
                values[p] = cells.gather(&place, &cells.weights());
                if place.x_dot.is_some() {
                    dots[p] = cells.gather(&place, &cells.weights_dot());
                }
            }
            for (f, row) in rows.iter_mut().enumerate() {
                let out = if place.x_dot.is_some() {
                    let v: [_; MAX_PLANES] = core::array::from_fn(|p| Dual { value: values[p][f], dot: dots[p][f] });
                    place.rule.combine(&v[..count]).dot
                } else {
                    let v: [_; MAX_PLANES] = core::array::from_fn(|p| values[p][f]);
                    place.rule.combine(&v[..count])
                };
                for (row, out) in row[at..].iter_mut().zip(&out) {
                    *row = *out;
                }
            }
        }
    }
}

impl<const F: usize> Task for Backward<'_, '_, F>
where
    Packed: Features<F>,
{
    type Output = ();
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { place, out_bar: rows, mut table_bar, mut x_bar } = self;
        place.check::<F>();
        assert!(table_bar.as_ref().is_none_or(|bar| bar.len() == place.params), "a gradient has the wrong length");
        let count = place.planes.len();
        let zero = [[[0.0; BLOCK]; F]; MAX_PLANES];
        // Gradients of what was read from each plane, and of its derivative.
        let (mut bars, mut dot_bars) = (zero, zero);
        let (mut values, mut dots) = (zero, zero);
        for at in (0..place.n).step_by(BLOCK) {
            let len = BLOCK.min(place.n - at);
            let cells = place.cells(at);
            for (p, cells) in cells[..count].iter().enumerate() {
                values[p] = cells.gather(&place, &cells.weights());
                if place.x_dot.is_some() {
                    dots[p] = cells.gather(&place, &cells.weights_dot());
                }
            }
            for (f, out_bar) in block(&rows, at).into_iter().enumerate() {
                if place.x_dot.is_some() {
                    let v: [_; MAX_PLANES] = core::array::from_fn(|p| Dual { value: values[p][f], dot: dots[p][f] });
                    // <bar, dot of combine>: by the plane's derivative its partial, by its value the partial's derivative.
                    for (p, d) in place.rule.partials(&v[..count]).iter().enumerate() {
                        bars[p][f] = out_bar.mul(d.dot);
                        dot_bars[p][f] = out_bar.mul(d.value);
                    }
                } else {
                    let v: [_; MAX_PLANES] = core::array::from_fn(|p| values[p][f]);
                    for (p, d) in place.rule.partials(&v[..count]).iter().enumerate() {
                        bars[p][f] = out_bar.mul(*d);
                    }
                }
            }
            let mut x_bars = [[0.0; BLOCK]; MAX_AXES];
            for (p, cells) in cells[..count].iter().enumerate() {
                if let Some(table_bar) = table_bar.as_deref_mut() {
                    cells.scatter(&place, len, &cells.weights(), &bars[p], table_bar);
                    if place.x_dot.is_some() {
                        cells.scatter(&place, len, &cells.weights_dot(), &dot_bars[p], table_bar);
                    }
                }
                if x_bar.is_some() {
                    let [a, b] = place.planes[p].axes;
                    // The first axis of a pair is the smaller.
                    let (low, high) = x_bars.split_at_mut(b);
                    cells.weights_backward(&cells.dots(&place, len, &bars[p]), [&mut low[a], &mut high[0]]);
                    if place.x_dot.is_some() {
                        let dots = cells.dots(&place, len, &dot_bars[p]);
                        cells.weights_dot_backward(&dots, [&mut low[a], &mut high[0]]);
                    }
                }
            }
            if let Some(x_bar) = x_bar.as_deref_mut() {
                for (a, gradient) in x_bars[..place.resolution.len()].iter().enumerate() {
                    for (bar, gradient) in x_bar[a * place.n + at..][..len].iter_mut().zip(gradient) {
                        *bar += gradient;
                    }
                }
            }
        }
    }
}
