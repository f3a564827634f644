//! Samples along rays, and the gradients of what networks see of them.

use crate::space::InternalRay;
use field_core::tape::{Node, Tape, TapeError};
use glam::DVec3;
use render_core::ray::Ray;

/// The samples of a level along rays, each for the interval from `t` to `t + dt`.
#[derive(Clone, Copy, Debug)]
pub struct Along<'a> {
    /// In internal coordinates.
    pub rays: &'a [InternalRay],
    /// `[rays + 1]`
    pub offsets: &'a [u32],
    /// `[n]`
    pub t: &'a [f32],
    /// `[n]`
    pub dt: &'a [f32],
}

pub(super) fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

impl Along<'_> {
    /// Origins and directions.
    pub(crate) fn lines(&self) -> Vec<Ray> {
        self.rays.iter().map(|ray| Ray { o: wide(ray.o), d: wide(ray.d) }).collect()
    }
}

/// What is seen of places: an input where rays have a gradient.
pub(crate) fn placed(
    tape: &mut Tape<'_>,
    by_ray: bool,
    rows: usize,
    n: usize,
    data: &[f32],
) -> Result<Node, TapeError> {
    if by_ray { tape.input(rows, n, data) } else { tape.constant(rows, n, data) }
}

/// Gradients of what networks see of samples.
pub(super) struct PlaceBars<'a> {
    /// `[rows][n]`, of what the position encoding sees.
    pub(super) x: &'a [f32],
    /// `[3][n]`, of viewing directions.
    pub(super) d: &'a [f32],
}
