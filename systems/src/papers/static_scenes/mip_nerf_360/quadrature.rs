//! The quadrature as a tape operation whose weights are an output too: losses on them need their gradient.

use field_core::tape::{BackwardArgs, Bar, CustomOp, Demand, Shape, TapeError, View};
use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};

/// Inputs `[sigma [1 x n]]` or `[sigma [1 x n], rgb [3 x n]]`; output one row: pixels `[rays][3]` where there are colours, then
/// weights `[n]`.
pub(super) struct QuadratureOp<'a> {
    pub(super) simd: Simd,
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// `[n]`
    pub(super) dt: &'a [f32],
    pub(super) last: LastInterval,
    /// `[rays][3]`; nothing without colours.
    pub(super) background: &'a [f32],
}

impl QuadratureOp<'_> {
    fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Numbers of the pixels in front of the weights.
    fn pixels(&self, channels: usize) -> usize {
        channels * self.rays()
    }

    fn values<'v>(&self, inputs: &[View<'v>]) -> Values<'v> {
        let stride = self.dt.len();
        match inputs {
            [_, rgb] => Values { data: rgb.data, stride, channels: 3 },
            _ => Values { data: &[], stride, channels: 0 },
        }
    }
}

impl CustomOp for QuadratureOp<'_> {
    fn name(&self) -> &'static str {
        "quadrature"
    }

    fn shape(&self, inputs: &[Shape]) -> Result<Shape, TapeError> {
        let n = self.dt.len();
        let channels = match *inputs {
            [sigma] if sigma == Shape::new(1, n) => 0,
            [sigma, rgb] if sigma == Shape::new(1, n) && rgb == Shape::new(3, n) => 3,
            _ => {
                let reason = "takes a density a sample, and three colours or none";
                return Err(TapeError::Custom { op: self.name(), reason });
            }
        };
        Ok(Shape::new(1, self.pixels(channels) + n))
    }

    /// Optical depths; then opacities and transmittances of the rays.
    fn saved_len(&self, _inputs: &[Shape]) -> usize {
        self.dt.len() + 2 * self.rays()
    }

    fn scratch_len(&self, _inputs: &[Shape]) -> usize {
        4 * self.dt.len()
    }

    fn forward(&self, inputs: &[View<'_>], out: &mut [f32], saved: &mut [f32]) -> Result<(), TapeError> {
        let values = self.values(inputs);
        let (tau, rest) = saved.split_at_mut(self.dt.len());
        let (opacity, trans_end) = rest.split_at_mut(self.rays());
        for ((tau, sigma), dt) in tau.iter_mut().zip(inputs[0].data).zip(self.dt) {
            *tau = sigma * dt;
        }
        let samples = Samples { offsets: self.offsets, tau, last: self.last };
        let (colour, w) = out.split_at_mut(self.pixels(values.channels));
        composite(self.simd, samples, values, self.background, Composite { colour, opacity, trans_end, w });
        Ok(())
    }

    fn backward(&self, args: BackwardArgs<'_>, scratch: &mut [f32], bars: &mut [Bar<'_>]) -> Result<(), TapeError> {
        let BackwardArgs { inputs, out, saved, out_bar } = args;
        let n = self.dt.len();
        let values = self.values(inputs);
        let pixels = self.pixels(values.channels);
        let (colour_bar, w_bar) = out_bar.split_at(pixels);
        let (tau_bar, values_bar) = scratch.split_at_mut(n);
        let values_bar = &mut values_bar[..values.channels * n];
        composite_backward(
            self.simd,
            Samples { offsets: self.offsets, tau: &saved[..n], last: self.last },
            values,
            self.background,
            Weights { w: &out[pixels..], trans_end: &saved[n + self.rays()..] },
            CompositeBar { colour: colour_bar, w: Some(w_bar), trans_end: None },
            CompositeGrads { tau: tau_bar, values: values_bar, background: None },
        );
        if bars[0].demand == Demand::Wanted {
            for ((bar, tau_bar), dt) in bars[0].data.iter_mut().zip(tau_bar).zip(self.dt) {
                *bar += *tau_bar * dt;
            }
        }
        if let Some(bar) = bars.get_mut(1)
            && bar.demand == Demand::Wanted
        {
            for (bar, value_bar) in bar.data.iter_mut().zip(values_bar) {
                *bar += *value_bar;
            }
        }
        Ok(())
    }
}
