//! Rays whose moving samples are those of a pass and whose others are the still part's, held: composited with the intervals of this
//! frame, and back.

use super::chosen::Chosen;
use super::term::{Seen, SeenBars};
use crate::buffers::sized;
use float_core::Simd;
use render_core::quadrature::{
    Composite, CompositeBar, CompositeGrads, LastInterval, Samples, Values, Weights, composite, composite_backward,
};

/// Buffers of a render.
#[derive(Default)]
pub(super) struct Rendered {
    /// `[m]` and `[3][m]`, densities and colours of the moving samples.
    pub(super) sigma: Vec<f32>,
    pub(super) rgb_of_moving: Vec<f32>,
    /// `[m]` and `[3][m]`, gradients of their raw log-densities and of their colours.
    pub(super) raw_bar: Vec<f32>,
    pub(super) rgb_of_moving_bar: Vec<f32>,
    tau: Vec<f32>,
    rgb: Vec<f32>,
    opacity: Vec<f32>,
    trans_end: Vec<f32>,
    tau_bar: Vec<f32>,
    rgb_bar: Vec<f32>,
}

impl Rendered {
    /// Colours and weights of the rays, written to `seen`.
    pub(super) fn forward(&mut self, simd: Simd, rays: &Chosen, seen: &mut Seen) {
        let ([n, m], count) = (rays.samples(), rays.len());
        self.tau.clone_from(&rays.tau);
        self.rgb.clone_from(&rays.rgb);
        for (sigma, &i) in self.sigma[..m].iter().zip(&rays.at) {
            self.tau[i as usize] = sigma * rays.dt[i as usize];
        }
        rays.scatter(&self.rgb_of_moving[..3 * m], &mut self.rgb);
        seen.colour.resize(3 * count, 0.0);
        seen.w.resize(n, 0.0);
        let out = Composite {
            colour: &mut seen.colour,
            opacity: sized(&mut self.opacity, count),
            trans_end: sized(&mut self.trans_end, count),
            w: &mut seen.w,
        };
        let samples = Samples { offsets: &rays.offsets, tau: &self.tau, last: LastInterval::Finite };
        composite(simd, samples, Values { data: &self.rgb, stride: n, channels: 3 }, &rays.background, out);
    }

    /// The way back, to the moving samples alone.
    pub(super) fn backward(&mut self, simd: Simd, rays: &Chosen, seen: &Seen, bars: &SeenBars) {
        let ([n, m], count) = (rays.samples(), rays.len());
        let (tau_bar, rgb_bar) = (sized(&mut self.tau_bar, n), sized(&mut self.rgb_bar, 3 * n));
        composite_backward(
            simd,
            Samples { offsets: &rays.offsets, tau: &self.tau, last: LastInterval::Finite },
            Values { data: &self.rgb, stride: n, channels: 3 },
            &rays.background,
            Weights { w: &seen.w, trans_end: &self.trans_end[..count] },
            CompositeBar { colour: &bars.colour, w: Some(&bars.w), trans_end: None },
            CompositeGrads { tau: tau_bar, values: rgb_bar, background: None },
        );
        rays.gather(rgb_bar, &mut self.rgb_of_moving_bar);
        rays.gather(tau_bar, &mut self.raw_bar);
        // d tau / d raw = tau, as the density is an exponential.
        for (bar, (sigma, &i)) in self.raw_bar.iter_mut().zip(self.sigma[..m].iter().zip(&rays.at)) {
            *bar *= sigma * rays.dt[i as usize];
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats = [&self.tau, &self.rgb, &self.tau_bar, &self.rgb_bar, &self.rgb_of_moving, &self.sigma];
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>()
    }
}
