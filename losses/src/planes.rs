//! Regularisers of feature planes (K-Planes), one plane at a time.
//!
//! | function | of | mean over |
//! | --- | --- | --- |
//! | [`plane_variation`] | squared first differences: neighbours in space should not differ | pairs along each axis, halved |
//! | [`time_smoothness`] | squared second differences: features change steadily in time | triples along time |
//! | [`distance_from_one`] | `abs(1 - P)`: planes of time that hold 1 change nothing | entries |
//!
//! All are means, so planes of different resolutions weigh the same; a model takes the mean over its planes. Planes of space have
//! variation along both axes; planes of time have it along space only, smoothness along time, and the distance from one.
//!
//! A plane lies as `field_core`'s planes do, `[second axis][first axis][features]`; time is always the second axis. Sums are
//! `f64` in index order. Values are not scanned: NaN in gives NaN out.
//!
//! # Source
//! Fridovich-Keil et al., "K-Planes", 2023, section 3.3, equations 3 to 5. Factors in front differ between the paper and its code:
//! weights are to be read with the definitions here.

use crate::variation::{total_variation, total_variation_backward};
use crate::{LossError, error::same, kernel::Kernel};

/// Extents of a plane `[second axis][first axis][features]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneShape {
    /// Vertices along the second axis: rows. Time steps of a plane of time.
    pub rows: usize,
    /// Vertices along the first axis.
    pub columns: usize,
    /// Features of a vertex.
    pub features: usize,
}

/// Axes along which [`plane_variation`] takes differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Along {
    /// Both: a plane of space.
    Both,
    /// The first one alone: a plane of time, along space.
    First,
}

impl Along {
    fn axes(self) -> &'static [usize] {
        match self {
            Self::Both => &[0, 1],
            Self::First => &[1],
        }
    }
}

impl PlaneShape {
    fn dims(self) -> [usize; 3] {
        [self.rows, self.columns, self.features]
    }
}

/// Half of the sum over the axes of `mean (P[i + 1] - P[i])^2`; an axis of fewer than two vertices costs nothing.
///
/// # Errors
/// [`LossError::Shape`] unless `plane` has that shape.
pub fn plane_variation(plane: &[f32], shape: PlaneShape, along: Along) -> Result<f64, LossError> {
    Ok(0.5 * total_variation(plane, &shape.dims(), along.axes(), Kernel::Squared)?)
}

/// Backward twin of [`plane_variation`]: adds into `plane_bar`.
///
/// # Errors
/// As [`plane_variation`], also where `plane_bar` differs in length.
pub fn plane_variation_backward(
    plane: &[f32],
    shape: PlaneShape,
    along: Along,
    loss_bar: f64,
    plane_bar: &mut [f32],
) -> Result<(), LossError> {
    total_variation_backward(plane, &shape.dims(), along.axes(), Kernel::Squared, 0.5 * loss_bar, plane_bar)
}

/// `mean (P[t + 2] - 2 P[t + 1] + P[t])^2` over time steps `t`; 0 for fewer than three time steps, and for planes that are linear
/// in time. No number of time steps is too few: whoever has fewer than three should say that the term is idle.
///
/// # Errors
/// [`LossError::Shape`] unless `plane` has that shape.
pub fn time_smoothness(plane: &[f32], shape: PlaneShape) -> Result<f64, LossError> {
    let Triples { row, count } = Triples::new(plane, shape)?;
    let square = |x: f64| x * x;
    let at = |i: usize| [plane[i], plane[i + row], plane[i + 2 * row]];
    let sum: f64 = (0..count).map(|i| square(second_difference(at(i)))).sum();
    Ok(sum / count.max(1) as f64)
}

/// Backward twin of [`time_smoothness`]: adds into `plane_bar`.
///
/// # Errors
/// As [`time_smoothness`], also where `plane_bar` differs in length.
pub fn time_smoothness_backward(
    plane: &[f32],
    shape: PlaneShape,
    loss_bar: f64,
    plane_bar: &mut [f32],
) -> Result<(), LossError> {
    let Triples { row, count } = Triples::new(plane, shape)?;
    same("plane_bar", plane.len(), plane_bar.len())?;
    let bar = 2.0 * loss_bar / count.max(1) as f64;
    // Row by row, so that the three rows of a triple are slices that do not overlap: their entries go through vectors.
    for first in (0..count).step_by(row.max(1)) {
        let rows = &plane[first..first + 3 * row];
        let (p0, rest) = rows.split_at(row);
        let (p1, p2) = rest.split_at(row);
        let (bar0, rest) = plane_bar[first..first + 3 * row].split_at_mut(row);
        let (bar1, bar2) = rest.split_at_mut(row);
        let values = p0.iter().zip(p1).zip(p2);
        let bars = bar0.iter_mut().zip(bar1).zip(bar2);
        for (((&a, &b), &c), ((bar_a, bar_b), bar_c)) in values.zip(bars) {
            let bar = bar * second_difference([a, b, c]);
            *bar_a += bar as f32;
            *bar_b -= (2.0 * bar) as f32;
            *bar_c += bar as f32;
        }
    }
    Ok(())
}

/// `mean abs(1 - P)`; 0 for an empty plane.
#[must_use]
pub fn distance_from_one(plane: &[f32]) -> f64 {
    let sum: f64 = plane.iter().map(|&p| (1.0 - f64::from(p)).abs()).sum();
    sum / plane.len().max(1) as f64
}

/// Backward twin of [`distance_from_one`]: adds into `plane_bar`. The gradient at 1 is 0.
///
/// # Errors
/// [`LossError::Shape`] where the lengths differ.
pub fn distance_from_one_backward(plane: &[f32], loss_bar: f64, plane_bar: &mut [f32]) -> Result<(), LossError> {
    same("plane_bar", plane.len(), plane_bar.len())?;
    let bar = (loss_bar / plane.len().max(1) as f64) as f32;
    for (plane_bar, &p) in plane_bar.iter_mut().zip(plane) {
        // Without branches, so that it goes through vectors: at 1 the difference is 0, and NaN stays.
        let side = if p > 1.0 { bar } else { -bar };
        let apart = p - 1.0;
        *plane_bar += if apart == 0.0 || apart.is_nan() { apart } else { side };
    }
    Ok(())
}

/// Entries `i`, `i + row`, `i + 2 row` for `i` below `count` are three time steps after each other.
struct Triples {
    row: usize,
    count: usize,
}

impl Triples {
    fn new(plane: &[f32], shape: PlaneShape) -> Result<Self, LossError> {
        // More than can be counted is more than `plane` has.
        let row = shape.columns.checked_mul(shape.features);
        same("plane", row.and_then(|row| row.checked_mul(shape.rows)).unwrap_or(usize::MAX), plane.len())?;
        let row = row.unwrap_or(0);
        Ok(Self { row, count: row * shape.rows.saturating_sub(2) })
    }
}

/// Of three time steps, in `f64`: second differences of large features cancel.
fn second_difference(steps: [f32; 3]) -> f64 {
    let [a, b, c] = steps.map(f64::from);
    c - 2.0 * b + a
}
