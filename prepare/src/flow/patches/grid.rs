//! Where patches lie in a picture.

use rayon::prelude::*;
use std::ops::Range;

/// Side of a patch, pixels (Kroeger et al., 2016, section 3).
pub(super) const SIDE: usize = 8;
/// Pixels from a patch to the next: each pixel lies in about seven of them.
const STRIDE: usize = 3;

/// Square patches that cover a picture; those of a picture smaller than one are as large as the picture.
pub(super) struct Grid {
    pub(super) across: Axis,
    pub(super) down: Axis,
}

/// The patches along one axis.
pub(super) struct Axis {
    /// First pixel of each, ascending.
    pub(super) starts: Vec<usize>,
    /// Pixels of each.
    pub(super) side: usize,
    /// Of each pixel, the patches that cover it.
    pub(super) covering: Vec<Range<usize>>,
}

impl Axis {
    fn new(pixels: usize) -> Self {
        let side = SIDE.min(pixels);
        let last = pixels - side;
        let mut starts: Vec<usize> = (0..last).step_by(STRIDE).collect();
        starts.push(last);
        let cover = |pixel: usize| {
            starts.partition_point(|start| start + side <= pixel)..starts.partition_point(|start| *start <= pixel)
        };
        let covering = (0..pixels).map(cover).collect();
        Self { starts, side, covering }
    }

    /// Middle of a patch, in index coordinates.
    pub(super) fn middle(&self, patch: usize) -> f32 {
        self.starts[patch] as f32 + 0.5 * (self.side as f32 - 1.0)
    }
}

impl Grid {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { across: Axis::new(width), down: Axis::new(height) }
    }

    /// Patches in a row.
    pub(super) fn columns(&self) -> usize {
        self.across.starts.len()
    }

    /// Number of the patch at a column and row of patches: they are counted row by row.
    pub(super) fn index(&self, column: usize, row: usize) -> usize {
        row * self.columns() + column
    }

    /// What a function says of each patch, of which it is given column and row.
    pub(super) fn each<T: Send>(&self, of: impl Fn(usize, usize) -> T + Sync) -> Vec<T> {
        let row = |row: usize| -> Vec<T> { (0..self.columns()).map(|column| of(column, row)).collect() };
        let rows: Vec<Vec<T>> = (0..self.down.starts.len()).into_par_iter().map(row).collect();
        rows.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_lies_in_a_patch_and_patches_in_the_picture() {
        for pixels in 1..60 {
            let axis = Axis::new(pixels);
            assert!(axis.starts.is_sorted() && axis.starts.iter().all(|start| start + axis.side <= pixels));
            for (pixel, covering) in axis.covering.iter().enumerate() {
                let is_in = |patch: usize| (axis.starts[patch]..axis.starts[patch] + axis.side).contains(&pixel);
                let naive: Vec<usize> = (0..axis.starts.len()).filter(|patch| is_in(*patch)).collect();
                assert!(!naive.is_empty() && covering.clone().eq(naive), "pixel {pixel} of {pixels}");
            }
        }
    }
}
