//! K-Planes at several scales: features of all scales one below the other.

use alloc::vec::Vec;
use core::ops::Range;

use float_core::Simd;

use super::{Combine, Planes};
use crate::FieldError;
use crate::encoding::EncodingBars;
use crate::error::check_len;
use crate::rng::Rng;

/// Products of planes at several scales, concatenated: three planes of space for a scene that stands still, with three planes of
/// time for one that moves. Resolutions in space are multiplied by the scale, that in time is the same for all.
///
/// # Shapes
/// * `table`, `table_bar`: the tables of the scales one after the other, each as [`Planes`] lays it out
/// * `x`, `x_bar`, `x_dot` `[in_rows][n]`: x, y, z, and t of a scene that moves, all in `[-1, 1]`; clamped as in [`Planes`]
/// * `out`, `out_bar` `[scales * features][n]`, scale by scale
///
/// # Source
/// Fridovich-Keil et al., "K-Planes", 2023, sections 3.1 and 3.2.
///
/// ```
/// use field_core::encoding::planes::{KPlanes, SPACE_INIT};
/// use field_core::rng::Rng;
/// use float_core::Simd;
///
/// let planes = KPlanes::moving([16, 16, 16], 10, &[1, 2, 4], 8)?;
/// let mut table = vec![0.0; planes.params_len()];
/// planes.init(Rng::new(1, 0), SPACE_INIT, &mut table);
/// let (x, mut features) = ([0.1, -0.2, 0.3, 0.9], vec![0.0; planes.out_rows()]);
/// planes.encode(Simd::best(), &table, &x, &mut features)?;
/// assert_eq!(features.len(), 3 * 8);
/// # Ok::<(), field_core::FieldError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct KPlanes {
    scales: Vec<Planes>,
    params: usize,
}

/// Range of the uniform distribution that the published planes of space start with.
pub const SPACE_INIT: Range<f32> = 0.1..0.5;

/// One plane of a [`KPlanes`]: what regularisers need to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlaneInfo {
    /// Number of its scale.
    pub scale: usize,
    /// Its axes, the smaller one first: 0 to 2 are x, y, z, 3 is time.
    pub axes: [usize; 2],
    /// Its parameters in the table, `[rows][columns][features]`.
    pub range: Range<usize>,
    /// Vertices along the second axis: time steps of a plane of time.
    pub rows: usize,
    /// Vertices along the first axis.
    pub columns: usize,
}

impl PlaneInfo {
    /// Whether the second axis is time.
    #[must_use]
    pub fn has_time(&self) -> bool {
        self.axes[1] == TIME
    }
}

/// Number of the time axis.
const TIME: usize = 3;

impl KPlanes {
    /// Three planes a scale: no time. `resolution` are the vertices along x, y, z at scale 1.
    ///
    /// # Errors
    /// [`FieldError::Config`] for no scales, or as [`Planes::tri_plane`].
    pub fn still(resolution: [u32; 3], scales: &[u32], features: usize) -> Result<Self, FieldError> {
        Self::assemble(scales, |scale| {
            Planes::tri_plane(resolution.map(|r| r.saturating_mul(scale)), features, Combine::Product)
        })
    }

    /// Six planes a scale, with `time_steps` vertices in time at every scale.
    ///
    /// # Errors
    /// As [`still`](Self::still).
    pub fn moving(resolution: [u32; 3], time_steps: u32, scales: &[u32], features: usize) -> Result<Self, FieldError> {
        Self::assemble(scales, |scale| {
            let [x, y, z] = resolution.map(|r| r.saturating_mul(scale));
            Planes::k_planes([x, y, z, time_steps], features)
        })
    }

    fn assemble(scales: &[u32], planes: impl Fn(u32) -> Result<Planes, FieldError>) -> Result<Self, FieldError> {
        if scales.is_empty() {
            return Err(FieldError::Config { what: "scales", got: 0.0, accepts: "at least 1" });
        }
        let scales = scales.iter().map(|&scale| planes(scale)).collect::<Result<Vec<_>, _>>()?;
        // Each is below 2^32.
        let total = scales.iter().map(|planes| planes.params_len() as u64).sum::<u64>();
        let refused = FieldError::Config { what: "parameters", got: total as f64, accepts: "what memory can hold" };
        Ok(Self { params: usize::try_from(total).map_err(|_| refused)?, scales })
    }

    /// Coordinates of a point: 3, or 4 with time.
    #[must_use]
    pub fn in_rows(&self) -> usize {
        self.scales[0].in_rows()
    }

    /// Rows of the output: scales times features.
    #[must_use]
    pub fn out_rows(&self) -> usize {
        self.scales.len() * self.scales[0].features()
    }

    /// Length of the table.
    #[must_use]
    pub fn params_len(&self) -> usize {
        self.params
    }

    /// The scales, in the order of the features.
    #[must_use]
    pub fn scales(&self) -> &[Planes] {
        &self.scales
    }

    /// All planes, in the order of the table.
    pub fn planes(&self) -> impl Iterator<Item = PlaneInfo> + '_ {
        self.tables().enumerate().flat_map(|(scale, (planes, table))| {
            planes.pairs().enumerate().map(move |(plane, axes)| {
                let range = planes.plane_range(plane);
                let [columns, rows] = axes.map(|axis| planes.resolution()[axis] as usize);
                PlaneInfo { scale, axes, range: table.start + range.start..table.start + range.end, rows, columns }
            })
        })
    }

    /// Start values: planes of space uniform in `space`, planes of time 1, which changes nothing.
    ///
    /// # Panics
    /// Where `table` has the wrong length.
    pub fn init(&self, rng: Rng, space: Range<f32>, table: &mut [f32]) {
        assert_eq!(table.len(), self.params, "the table has the wrong length");
        for (number, plane) in (0..).zip(self.planes()) {
            let values = &mut table[plane.range.clone()];
            if plane.has_time() {
                values.fill(1.0);
            } else {
                rng.substream(number).fill_uniform(0, values);
                values.iter_mut().for_each(|v| *v = space.start + (space.end - space.start) * *v);
            }
        }
    }

    /// Largest distance of a plane of time from 1: 0 for a scene that stands still. NaN counts as infinite.
    ///
    /// With distance `d`, features are within `(1 + d)^3 - 1` of those of [`without_time`](Self::without_time), relatively, and
    /// rounding.
    ///
    /// # Panics
    /// Where `table` has the wrong length.
    #[must_use]
    pub fn time_deviation(&self, table: &[f32]) -> f32 {
        assert_eq!(table.len(), self.params, "the table has the wrong length");
        let of = |v: f32| if v.is_nan() { f32::INFINITY } else { (v - 1.0).abs() };
        let planes = self.planes().filter(PlaneInfo::has_time);
        planes.flat_map(|plane| &table[plane.range]).fold(0.0, |most, &v| most.max(of(v)))
    }

    /// The planes of space alone and their table: the model of a scene that stands still. Where
    /// [`time_deviation`](Self::time_deviation) is 0 it needs three look-ups less and has the same features up to rounding
    /// (weights of a cell need not add up to 1 exactly).
    ///
    /// # Panics
    /// Where `table` has the wrong length.
    #[must_use]
    pub fn without_time(&self, table: &[f32]) -> (Self, Vec<f32>) {
        assert_eq!(table.len(), self.params, "the table has the wrong length");
        let scales: Vec<Planes> = self.scales.iter().map(Planes::space_planes).collect();
        let planes = self.planes().filter(|plane| !plane.has_time());
        let table: Vec<f32> = planes.flat_map(|plane| &table[plane.range]).copied().collect();
        (Self { scales, params: table.len() }, table)
    }

    /// Features at `x`.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode(&self, simd: Simd, table: &[f32], x: &[f32], out: &mut [f32]) -> Result<(), FieldError> {
        let rows = self.check(table, x, out.len())?;
        for ((planes, range), out) in self.tables().zip(out.chunks_mut(rows)) {
            planes.encode(simd, &table[range], x, out)?;
        }
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
        let rows = self.check(table, x, out_dot.len())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        for ((planes, range), out_dot) in self.tables().zip(out_dot.chunks_mut(rows)) {
            planes.tangent(simd, &table[range], x, x_dot, out_dot)?;
        }
        Ok(())
    }

    /// Adds the gradients of the table and of the positions, where wanted.
    ///
    /// # Errors
    /// [`FieldError::Shape`].
    pub fn encode_backward(
        &self,
        simd: Simd,
        table: &[f32],
        x: &[f32],
        out_bar: &[f32],
        mut bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let rows = self.check(table, x, out_bar.len())?;
        self.check_bars(x, &bars)?;
        for ((planes, range), out_bar) in self.tables().zip(out_bar.chunks(rows)) {
            planes.encode_backward(simd, &table[range.clone()], x, out_bar, part(&mut bars, range))?;
        }
        Ok(())
    }

    /// Adds the gradients of the table and of the positions through [`tangent`](Self::tangent), where wanted.
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
        mut bars: EncodingBars<'_>,
    ) -> Result<(), FieldError> {
        let rows = self.check(table, x, out_dot_bar.len())?;
        check_len("x_dot", x_dot.len(), x.len())?;
        self.check_bars(x, &bars)?;
        for ((planes, range), out_bar) in self.tables().zip(out_dot_bar.chunks(rows)) {
            planes.tangent_backward(simd, &table[range.clone()], x, x_dot, out_bar, part(&mut bars, range))?;
        }
        Ok(())
    }

    /// The scales with their parts of the table.
    fn tables(&self) -> impl Iterator<Item = (&Planes, Range<usize>)> {
        self.scales.iter().scan(0, |end, planes| {
            let start = *end;
            *end += planes.params_len();
            Some((planes, start..*end))
        })
    }

    /// Numbers of one scale's features, at least 1: there are no chunks of 0.
    fn check(&self, table: &[f32], x: &[f32], out: usize) -> Result<usize, FieldError> {
        check_len("table", table.len(), self.params)?;
        let n = x.len() / self.in_rows();
        check_len("x", x.len(), n * self.in_rows())?;
        check_len("out", out, n * self.out_rows())?;
        Ok((n * self.scales[0].features()).max(1))
    }

    fn check_bars(&self, x: &[f32], bars: &EncodingBars<'_>) -> Result<(), FieldError> {
        bars.table.as_ref().map_or(Ok(()), |bar| check_len("table_bar", bar.len(), self.params))?;
        bars.x.as_ref().map_or(Ok(()), |bar| check_len("x_bar", bar.len(), x.len()))
    }
}

/// The bars of one scale.
fn part<'a>(bars: &'a mut EncodingBars<'_>, range: Range<usize>) -> EncodingBars<'a> {
    EncodingBars { table: bars.table.as_deref_mut().map(|bar| &mut bar[range]), x: bars.x.as_deref_mut() }
}
