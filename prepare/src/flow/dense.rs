//! Dense flow, from the smallest pictures of the pyramids to the largest.

use super::confidence::confidence;
use super::field::Field;
use super::patches::patch_flow;
use super::plane::Plane;
use super::pyramid::pyramid;
use super::variational::refined;

/// A flow vector for each pixel of a picture, and how well it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseFlow {
    field: Field,
    confidence: Plane,
}

impl DenseFlow {
    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.field.width()
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.field.height()
    }

    /// The flow vector of a pixel.
    ///
    /// # Panics
    /// Outside the picture.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> [f32; 2] {
        self.field.at(column, row)
    }

    /// The flow vectors, `[height * width]`.
    #[must_use]
    pub fn vectors(&self) -> &[[f32; 2]] {
        self.field.vectors()
    }

    /// How well the flow vector of a pixel can be known, in `[0, 1)`: `1 / (1 + s^2)` with the error `s` that noise alone would make in its worst
    /// direction, pixels. 0 where all around is one grey.
    ///
    /// # Panics
    /// Outside the picture.
    #[must_use]
    pub fn confidence(&self, column: usize, row: usize) -> f32 {
        self.confidence.at(column, row)
    }

    /// The flow between pixels.
    pub(super) fn between(&self, x: f32, y: f32) -> [f32; 2] {
        self.field.linear(x, y)
    }
}

/// The flow from one grey picture (`0..=255`) to another of the same size. The same bits with any number of threads.
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn dense_flow(first: &Plane, second: &Plane) -> DenseFlow {
    let size = |plane: &Plane| (plane.width(), plane.height());
    assert_eq!(size(first), size(second), "flow between pictures of two sizes");
    let (width, height) = size(first);
    if width == 0 || height == 0 {
        return DenseFlow { field: Field::zero(width, height), confidence: first.clone() };
    }
    let (firsts, seconds) = (pyramid(first), pyramid(second));
    let mut found: Option<Field> = None;
    for (first, second) in firsts.iter().zip(&seconds).rev() {
        let (width, height) = size(first);
        let start = found.map_or_else(|| Field::zero(width, height), |half| half.doubled(width, height));
        let patches = patch_flow(first, second, &start);
        found = Some(refined(first, second, patches));
    }
    let field = found.unwrap_or_else(|| Field::zero(width, height));
    DenseFlow { field, confidence: confidence(&firsts[0]) }
}
