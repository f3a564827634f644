//! Planes of features: a point is projected on pairs of axes, and the features found there are summed or multiplied.
//!
//! | encoding | axes | planes | features |
//! | --- | --- | --- | --- |
//! | tri-plane | x y z | xy, xz, yz | sum, or product |
//! | k-planes | x y z t | xy, xz, xt, yz, yt, zt | product |
//! | hex-plane | x y z t | the same | `xy zt + xz yt + xt yz` |
//!
//! Several resolutions are several [`Planes`], their outputs one below the other: [`KPlanes`] is that for products.
//!
//! Chan et al., "Efficient Geometry-aware 3D Generative Adversarial Networks", 2022, section 4.1 (tri-plane); Fridovich-Keil
//! et al., "K-Planes", 2023, equation 1; Cao & Johnson, "HexPlane", 2023, equation 4.

mod combine;
mod k_planes;
mod kernel;

pub use k_planes::{KPlanes, PlaneInfo, SPACE_INIT};

use alloc::vec::Vec;
use core::ops::Range;

use float_core::Simd;

use self::combine::{MAX_PLANES, Rule};
use self::kernel::{Backward, Forward, MAX_AXES, Place, Plane};
use super::lattice::features::{Features, Packed};
use super::lattice::groups::groups;
use super::resample::{Axis, resample};
use super::{EncodingBars, rows, rows_mut};
use crate::FieldError;
use crate::error::check_len;

/// How the features of a tri-plane become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combine {
    /// They are added.
    Sum,
    /// They are multiplied.
    Product,
}

/// Planes over `[-1, 1]^3` or `[-1, 1]^4`, blended bilinearly. The first vertex of an axis lies at -1, the last at 1.
///
/// # Shapes
/// * `table`, `table_bar`: the planes in the order of the table above, each `[second axis][first axis][features]`
/// * `x`, `x_bar`, `x_dot` `[in_rows][n]`: x, y, z, and t; clamped, with zero gradient outside; NaN counts as -1
/// * `out`, `out_bar` `[features][n]`
///
/// # Numerics
/// Partial products are formed without division, so features of 0 have their exact gradient. All SIMD levels give the
/// same bits: sums run over the corners, then over the samples, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planes {
    axes: usize,
    resolution: [u32; MAX_AXES],
    features: usize,
    rule: Rule,
    planes: [Plane; MAX_PLANES],
    params: usize,
}

impl Planes {
    /// Three planes of `resolution` vertices along x, y, z, and any number of features.
    ///
    /// # Errors
    /// [`FieldError::Config`] for an axis of no or more than `2^22` vertices, no features, or more than `2^32` parameters.
    pub fn tri_plane(resolution: [u32; 3], features: usize, combine: Combine) -> Result<Self, FieldError> {
        let rule = match combine {
            Combine::Sum => Rule::Sum,
            Combine::Product => Rule::Product,
        };
        Self::new(&resolution, features, rule)
    }

    /// The product of six planes of `resolution` vertices along x, y, z, t.
    ///
    /// Planes of time that hold 1 change nothing: the scene stands still.
    ///
    /// # Errors
    /// As [`tri_plane`](Self::tri_plane).
    pub fn k_planes(resolution: [u32; 4], features: usize) -> Result<Self, FieldError> {
        Self::new(&resolution, features, Rule::Product)
    }

    /// The sum of three products of two planes without a common axis, of `resolution` vertices along x, y, z, t.
    ///
    /// # Errors
    /// As [`tri_plane`](Self::tri_plane).
    pub fn hex_plane(resolution: [u32; 4], features: usize) -> Result<Self, FieldError> {
        Self::new(&resolution, features, Rule::Hex)
    }

    fn new(vertices: &[u32], features: usize, rule: Rule) -> Result<Self, FieldError> {
        let refuse = |what, got, accepts| Err(FieldError::Config { what, got, accepts });
        if let Some(&r) = vertices.iter().find(|r| !(1..=1 << 22).contains(*r)) {
            return refuse("resolution", f64::from(r), "1 to 2^22");
        }
        if features == 0 {
            return refuse("features", 0.0, "at least 1");
        }
        let mut resolution = [0; MAX_AXES];
        resolution[..vertices.len()].copy_from_slice(vertices);
        let mut planes = [Plane { axes: [0, 1], offset: 0, steps: [0; 2] }; MAX_PLANES];
        let mut end = 0_u128;
        let mut plane = planes.iter_mut();
        for a in 0..vertices.len() {
            for b in a + 1..vertices.len() {
                let [wide, high] = [a, b].map(|axis| u128::from(vertices[axis]));
                let start = end;
                end = end.saturating_add((wide * high).saturating_mul(features as u128));
                if end > u128::from(u32::MAX) {
                    return refuse("parameters", end as f64, "at most 2^32 - 1");
                }
                // Steps and offsets are no larger than `end`.
                let step = |vertices: u128, step: u128| if vertices > 1 { step as u32 } else { 0 };
                let steps = [step(wide, features as u128), step(high, wide * features as u128)];
                if let Some(plane) = plane.next() {
                    *plane = Plane { axes: [a, b], offset: start as u32, steps };
                }
            }
        }
        Ok(Self { axes: vertices.len(), resolution, features, rule, planes, params: end as usize })
    }

    /// Coordinates of a point: 3, or 4 with time.
    #[must_use]
    pub fn in_rows(&self) -> usize {
        self.axes
    }

    /// Vertices along each axis.
    #[must_use]
    pub fn resolution(&self) -> &[u32] {
        &self.resolution[..self.axes]
    }

    /// Features of a vertex, and rows of the output.
    #[must_use]
    pub fn features(&self) -> usize {
        self.features
    }

    /// Rows of the output: the features.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.features
    }

    /// Length of the table.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.params
    }

    /// The two axes of each plane, in the order of the table.
    pub fn pairs(&self) -> impl ExactSizeIterator<Item = [usize; 2]> + '_ {
        self.planes().iter().map(|plane| plane.axes)
    }

    /// Which parameters belong to a plane.
    ///
    /// # Panics
    /// If there is no such plane.
    #[must_use]
    pub fn plane_range(&self, plane: usize) -> Range<usize> {
        let Plane { axes, offset, .. } = self.planes()[plane];
        let [wide, high] = axes.map(|a| self.resolution[a] as usize);
        offset as usize..offset as usize + wide * high * self.features
    }

    /// Features at `x`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        self.check(table, x, None, out.len())?;
        self.blend(simd, table, x, None, out);
        Ok(())
    }

    /// Derivative along `x_dot`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot: &mut [f32],
    ) -> Result<(), FieldError> {
        self.check(table, x, Some(x_dot), out_dot.len())?;
        self.blend(simd, table, x, Some(x_dot), out_dot);
        Ok(())
    }

    /// Adds the gradients of the table and of the positions, where wanted: both at once cost little more than one.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        self.check(table, x, None, out_bar.len())?;
        self.add_gradients(simd, table, x, None, out_bar, bars)
    }

    /// Adds the gradients of the table and of the positions through [`tangent`](Self::tangent), where wanted. With respect
    /// to `x_dot` it is the gradient of the positions of [`encode_backward`](Self::encode_backward), given the tangent's
    /// cotangent.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn tangent_backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: &[f32],
        out_dot_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        self.check(table, x, Some(x_dot), out_dot_bar.len())?;
        self.add_gradients(simd, table, x, Some(x_dot), out_dot_bar, bars)
    }

    /// The table of planes of another resolution that hold the same features, as far as their vertices can: these planes
    /// at the vertices of `finer`. Exact where vertices coincide, and everywhere if the cells of `finer` are a whole
    /// fraction of these.
    ///
    /// # Panics
    /// If `table` has the wrong length, or `finer` has other axes or another number of features.
    #[must_use]
    pub fn upsampled(&self, table: &[f32], finer: &Self) -> Vec<f32> {
        assert_eq!(table.len(), self.params_len(), "the table has the wrong length");
        let shape = |planes: &Self| (planes.axes, planes.features);
        assert_eq!(shape(self), shape(finer), "the planes have different axes or numbers of features");
        let lattice = |planes: &Self, plane: usize| {
            let [wide, high] = planes.planes[plane].axes.map(|a| planes.resolution[a] as usize);
            [wide, high, 1].map(|vertices| Axis { vertices, cells: vertices - 1 })
        };
        let of = |plane| {
            resample(lattice(self, plane), lattice(finer, plane), self.features, &table[self.plane_range(plane)])
        };
        (0..self.planes().len()).flat_map(of).collect()
    }

    /// The planes of space of a product, with the same resolution and features.
    fn space_planes(&self) -> Self {
        Self::new(&self.resolution[..3], self.features, Rule::Product).expect("fewer planes than were accepted before")
    }

    /// Whether nothing is multiplied.
    pub(crate) fn sums(&self) -> bool {
        self.rule == Rule::Sum
    }

    fn planes(&self) -> &[Plane] {
        &self.planes[..self.axes * (self.axes - 1) / 2]
    }

    fn check(&self, table: &[f32], x: &[f32], x_dot: Option<&[f32]>, out: usize) -> Result<(), FieldError> {
        check_len("table", table.len(), self.params_len())?;
        let n = x.len() / self.axes;
        check_len("x", x.len(), n * self.axes)?;
        x_dot.map_or(Ok(()), |x_dot| check_len("x_dot", x_dot.len(), x.len()))?;
        check_len("out", out, n * self.features)
    }

    fn place<'a>(&'a self, first: usize, table: &'a [f32], x: &'a [f32], x_dot: Option<&'a [f32]>) -> Place<'a> {
        Place {
            planes: self.planes(),
            rule: self.rule,
            resolution: self.resolution(),
            params: self.params,
            features: self.features,
            first,
            n: x.len() / self.axes,
            table,
            x,
            x_dot,
        }
    }

    fn blend(&self, simd: Simd, table: &[f32], x: &[f32], x_dot: Option<&[f32]>, out: &mut [f32]) {
        fn some<const F: usize>(simd: Simd, place: Place<'_>, out: &mut [f32])
        where
            Packed: Features<F>,
        {
            simd.run(Forward::<F> { place, out: rows_mut(out) });
        }
        let n = x.len() / self.axes;
        for (first, size) in groups(self.features) {
            let (place, out) = (self.place(first, table, x, x_dot), &mut out[first * n..(first + size) * n]);
            match size {
                1 => some::<1>(simd, place, out),
                2 => some::<2>(simd, place, out),
                4 => some::<4>(simd, place, out),
                6 => some::<6>(simd, place, out),
                _ => some::<8>(simd, place, out),
            }
        }
    }

    fn add_gradients(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        x_dot: Option<&[f32]>,
        out_bar: &[f32],
        bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let EncodingBars { table: mut table_bar, x: mut x_bar } = bars;
        type Bar<'o> = Option<&'o mut [f32]>;
        fn some<const F: usize>(simd: Simd, place: Place<'_>, out_bar: &[f32], table_bar: Bar<'_>, x_bar: Bar<'_>)
        where
            Packed: Features<F>,
        {
            simd.run(Backward::<F> { place, out_bar: rows(out_bar), table_bar, x_bar });
        }
        table_bar.as_ref().map_or(Ok(()), |bar| check_len("table_bar", bar.len(), table.len()))?;
        x_bar.as_ref().map_or(Ok(()), |bar| check_len("x_bar", bar.len(), x.len()))?;
        let n = x.len() / self.axes;
        for (first, size) in groups(self.features) {
            let (place, out_bar) = (self.place(first, table, x, x_dot), &out_bar[first * n..(first + size) * n]);
            let (table_bar, x_bar) = (table_bar.as_deref_mut(), x_bar.as_deref_mut());
            match size {
                1 => some::<1>(simd, place, out_bar, table_bar, x_bar),
                2 => some::<2>(simd, place, out_bar, table_bar, x_bar),
                4 => some::<4>(simd, place, out_bar, table_bar, x_bar),
                6 => some::<6>(simd, place, out_bar, table_bar, x_bar),
                _ => some::<8>(simd, place, out_bar, table_bar, x_bar),
            }
        }
        Ok(())
    }
}
