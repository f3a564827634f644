//! The quadrature as a tape operation: densities and colours of a tile's samples to pixels.

use field_core::tape::{BackwardArgs, Bar, CustomOp, Demand, Shape, TapeError, View};
use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};

/// Inputs `[sigma [1 x n], rgb [3 x n]]`, output `[rays x 3]` pixels.
pub(super) struct CompositeOp<'a> {
    pub(super) simd: Simd,
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// `[n]`
    pub(super) dt: &'a [f32],
    /// `[rays][3]`
    pub(super) background: &'a [f32],
}

/// Arrays kept for the backward pass: optical depths, weights, opacities, transmittances.
fn split(saved: &[f32], n: usize, rays: usize) -> (&[f32], &[f32], &[f32]) {
    (&saved[..n], &saved[n..2 * n], &saved[2 * n + rays..2 * n + 2 * rays])
}

impl CompositeOp<'_> {
    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }
}

impl CustomOp for CompositeOp<'_> {
    fn name(&self) -> &'static str {
        "composite"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        let n = self.dt.len();
        if inputs.len() != 2 || inputs[0] != Shape::new(1, n) || inputs[1] != Shape::new(3, n) {
            return Err(TapeError::Custom { op: self.name(), reason: "takes a density and three colours a sample" });
        }
        Ok(Shape::new(self.rays(), 3))
    }

    fn saved_len(&self, _inputs: &[Shape]) -> usize {
        2 * (self.dt.len() + self.rays())
    }

    fn scratch_len(&self, _inputs: &[Shape]) -> usize {
        4 * self.dt.len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        let (n, rays) = (self.dt.len(), self.rays());
        let (tau, rest) = saved.split_at_mut(n);
        let (w, rest) = rest.split_at_mut(n);
        let (opacity, rest) = rest.split_at_mut(rays);
        for ((tau, sigma), dt) in tau.iter_mut().zip(inputs[0].data).zip(self.dt) {
            *tau = sigma * dt;
        }
        let samples = Samples { offsets: self.offsets, tau, last: LastInterval::Finite };
        let values = Values { data: inputs[1].data, stride: n, channels: 3 };
        let result = Composite { colour: out, opacity, trans_end: &mut rest[..rays], w };
        composite(self.simd, samples, values, self.background, result);
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, saved, out_bar, .. } = args;
        let n = self.dt.len();
        let (tau, w, trans_end) = split(saved, n, self.rays());
        let samples = Samples { offsets: self.offsets, tau, last: LastInterval::Finite };
        let values = Values { data: inputs[1].data, stride: n, channels: 3 };
        let (tau_bar, rgb_bar) = scratch.split_at_mut(n);
        composite_backward(
            self.simd,
            samples,
            values,
            self.background,
            Weights { w, trans_end },
            CompositeBar { colour: out_bar, w: None, trans_end: None },
            CompositeGrads { tau: tau_bar, values: &mut rgb_bar[..3 * n], background: None },
        );
        if bars[0].demand == Demand::Wanted {
            for ((bar, tau_bar), dt) in bars[0].data.iter_mut().zip(tau_bar).zip(self.dt) {
                *bar += *tau_bar * dt;
            }
        }
        if bars[1].demand == Demand::Wanted {
            for (bar, rgb_bar) in bars[1].data.iter_mut().zip(rgb_bar) {
                *bar += *rgb_bar;
            }
        }
        Ok(())
    }
}
