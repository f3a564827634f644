//! The gradients of a chunk's rays, by origin and direction.

use super::context::StepContext;
use crate::buffers::shapes_hold;
use crate::fields::Field;
use float_core::Simd;
use render_core::ray::RayBar;

/// The gradients of a chunk's rays, where they are asked for.
#[derive(Default)]
pub(super) struct RayGeometryBars {
    /// `[sh][rays]`, of the basis of the view directions; empty where they are not asked for.
    pub(super) basis: Vec<f32>,
    /// `[rays]`
    pub(super) bars: Vec<RayBar>,
}

impl RayGeometryBars {
    /// All zero for this many rays, where they are asked for.
    pub(super) fn begin(&mut self, ctx: &StepContext<'_>, rays: usize) {
        self.basis.clear();
        if ctx.by_ray {
            self.basis.resize(ctx.field.harmonics.out_rows() * rays, 0.0);
        }
    }

    /// Gradients `d_bar` `[3][rays]` of directions, from those of their basis.
    pub(super) fn directions(&self, simd: Simd, field: &Field, d: &[f32]) -> Vec<f32> {
        let mut d_bar = vec![0.0; d.len()];
        shapes_hold(field.harmonics.encode_backward(simd, d, &self.basis, &mut d_bar));
        d_bar
    }
}
