//! The box of the frame of training in which features are: its points are those of the unit cube.

use crate::views::cloud_frame::CloudFrame;
use scene_io::Bounds;

/// Sides shorter than this, internal units, are taken for this long.
const SHORTEST: f64 = 1e-6;

/// A box, and how its points are those of the unit cube.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct UnitBox {
    min: [f32; 3],
    per_side: [f32; 3],
}

impl UnitBox {
    /// A box of the scene's frame, in the frame of training.
    pub(crate) fn new(bounds: &Bounds, frame: &CloudFrame) -> Self {
        let [min, max] = [bounds.min, bounds.max].map(|x| frame.to_internal(x).to_array());
        let side = |k: usize| (max[k] - min[k]).max(SHORTEST);
        Self { min: min.map(|x| x as f32), per_side: [0, 1, 2].map(|k| (1.0 / side(k)) as f32) }
    }

    /// Coordinate `x` along `axis`, internal units, in the cube: beyond `0..=1` for points outside.
    pub(super) fn unit(&self, axis: usize, x: f32) -> f32 {
        (x - self.min[axis]) * self.per_side[axis]
    }

    /// The derivative of [`unit`](Self::unit).
    pub(super) fn unit_per_length(&self, axis: usize) -> f32 {
        self.per_side[axis]
    }
}
