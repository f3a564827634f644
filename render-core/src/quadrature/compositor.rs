//! Compositing for the usual case, with the buffers inside.

use super::{
    Composite, CompositeBar, CompositeGrads, DepthBar, LastInterval, Samples, Values, Weights, check_offsets,
    composite, composite_backward, depth_expected, depth_expected_backward,
};
use alloc::vec::Vec;
use float_core::Simd;

/// Channels of a colour.
const RGB: usize = 3;

/// Renders batches of rays with three colour channels and takes gradients back, with all buffers inside.
///
/// [`Compositor::render`] lends its result as [`Pixels`], and only they have a [`backward`](Pixels::backward): a gradient
/// cannot meet the weights, samples or background of another call. The numbers are bit for bit those of the functions it
/// calls: [`composite`], [`depth_expected`] and their backward twins. Take these where values have another number of channels, where
/// each ray has its own background, or where buffers belong to the caller.
///
/// ```
/// use float_core::Simd;
/// use render_core::quadrature::{Compositor, PixelsBar, RaySamples};
///
/// // One ray of two samples: thin red matter at distance 1, a green wall at distance 2.
/// let samples = RaySamples { offsets: &[0, 2], t: &[1.0, 2.0], tau: &[0.5, 90.0], rgb: &[1.0, 0.0, 0.0, 1.0, 0.0, 0.0] };
/// let mut compositor = Compositor::new(Simd::best());
/// let pixels = compositor.render(samples);
/// assert!((pixels.rgb()[0] - (1.0 - (-0.5_f32).exp())).abs() < 1e-6);
/// assert!((pixels.depth()[0] - (2.0 - pixels.rgb()[0])).abs() < 1e-6);
/// // More red: a thicker first sample.
/// let grads = pixels.backward(PixelsBar::of_rgb(&[1.0, 0.0, 0.0]));
/// assert!(grads.tau()[0] > 0.0 && grads.rgb()[0] > 0.0);
/// ```
#[derive(Clone, Debug)]
pub struct Compositor {
    simd: Simd,
    last: LastInterval,
    background: [f32; RGB],
    far: f32,
    buffers: Buffers,
}

/// Arrays that are kept from call to call.
#[derive(Clone, Debug, Default)]
struct Buffers {
    /// `[rays][3]`
    background: Vec<f32>,
    colour: Vec<f32>,
    /// `[rays]`
    opacity: Vec<f32>,
    depth: Vec<f32>,
    trans_end: Vec<f32>,
    trans_end_bar: Vec<f32>,
    /// `[n]`
    w: Vec<f32>,
    w_bar: Vec<f32>,
    tau_bar: Vec<f32>,
    t_bar: Vec<f32>,
    /// `[3][n]`
    rgb_bar: Vec<f32>,
}

/// Samples of a batch of rays: where they lie, their optical depths and their colours.
#[derive(Clone, Copy, Debug)]
pub struct RaySamples<'a> {
    /// `[rays + 1]`, non-decreasing: ray `r` owns the samples `offsets[r] .. offsets[r + 1]`, front to back.
    pub offsets: &'a [u32],
    /// `[n]` distance of each sample along its ray, any unit; the depth has the same.
    pub t: &'a [f32],
    /// `[n]` optical depth of each interval, `sigma * dt`, dimensionless, `>= 0`; `inf` is opaque.
    pub tau: &'a [f32],
    /// `[3][n]` colour of each sample: all reds, all greens, all blues.
    pub rgb: &'a [f32],
}

/// Gradients that reach a batch of [`Pixels`]; nothing where no loss depends on an output.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
pub struct PixelsBar<'a> {
    /// `[rays][3]` of the colours.
    pub rgb: Option<&'a [f32]>,
    /// `[rays]` of the opacities.
    pub opacity: Option<&'a [f32]>,
    /// `[rays]` of the depths.
    pub depth: Option<&'a [f32]>,
    /// `[n]` of the weights: distortion and interlevel losses.
    pub w: Option<&'a [f32]>,
}

impl<'a> PixelsBar<'a> {
    /// A loss of the colours alone, `[rays][3]`.
    #[must_use]
    pub fn of_rgb(rgb: &'a [f32]) -> Self {
        Self { rgb: Some(rgb), ..Self::default() }
    }

    /// The same with a gradient of the opacities, `[rays]`.
    #[must_use]
    pub fn with_opacity(self, opacity: &'a [f32]) -> Self {
        Self { opacity: Some(opacity), ..self }
    }

    /// The same with a gradient of the depths, `[rays]`.
    #[must_use]
    pub fn with_depth(self, depth: &'a [f32]) -> Self {
        Self { depth: Some(depth), ..self }
    }

    /// The same with a gradient of the weights, `[n]`.
    #[must_use]
    pub fn with_weights(self, w: &'a [f32]) -> Self {
        Self { w: Some(w), ..self }
    }
}

/// What [`Compositor::render`] made of a batch of rays.
#[derive(Debug)]
pub struct Pixels<'a> {
    compositor: &'a mut Compositor,
    samples: RaySamples<'a>,
}

/// Gradients with respect to the samples of a batch, made by [`Pixels::backward`].
#[derive(Debug)]
pub struct SampleGrads<'a> {
    buffers: &'a Buffers,
}

impl Compositor {
    /// A compositor on a black background whose last intervals are finite.
    #[must_use]
    pub fn new(simd: Simd) -> Self {
        Self {
            simd,
            last: LastInterval::Finite,
            background: [0.0; RGB],
            far: f32::INFINITY,
            buffers: Buffers::default(),
        }
    }

    /// The same with a colour behind the last interval of every ray.
    #[must_use]
    pub fn with_background(self, background: [f32; RGB]) -> Self {
        Self { background, ..self }
    }

    /// The same with another meaning of each ray's last interval.
    #[must_use]
    pub fn with_last_interval(self, last: LastInterval) -> Self {
        Self { last, ..self }
    }

    /// The same with another depth of rays that hit nothing than infinity, unit of the distances.
    #[must_use]
    pub fn with_far(self, far: f32) -> Self {
        Self { far, ..self }
    }

    /// Composite a batch. Allocates only where it is larger than all before.
    ///
    /// # Panics
    /// When the lengths disagree, or the offsets decrease or run past the samples.
    pub fn render<'a>(&'a mut self, samples: RaySamples<'a>) -> Pixels<'a> {
        let (n, rays) = (samples.tau.len(), samples.rays());
        check_offsets(samples.offsets, n);
        assert_eq!(samples.t.len(), n, "t and tau differ in length");
        assert_eq!(samples.rgb.len(), RGB * n, "rgb holds three channels of as many samples as tau");
        let Self { simd, last, background, far, buffers } = self;
        buffers.background.clear();
        buffers.background.extend((0..rays).flat_map(|_| *background));
        zeros(&mut buffers.colour, RGB * rays);
        for per_ray in [&mut buffers.opacity, &mut buffers.depth, &mut buffers.trans_end] {
            zeros(per_ray, rays);
        }
        // Samples of no ray keep the weight 0.
        zeros(&mut buffers.w, n);
        let out = Composite {
            colour: &mut buffers.colour,
            opacity: &mut buffers.opacity,
            w: &mut buffers.w,
            trans_end: &mut buffers.trans_end,
        };
        composite(*simd, samples.raw(*last), samples.values(), &buffers.background, out);
        depth_expected(samples.offsets, &buffers.w, samples.t, *far, &mut buffers.depth);
        Pixels { compositor: self, samples }
    }
}

impl<'a> RaySamples<'a> {
    /// Number of rays.
    #[must_use]
    pub fn rays(&self) -> usize {
        super::rays(self.offsets)
    }

    fn raw(&self, last: LastInterval) -> Samples<'a> {
        Samples { offsets: self.offsets, tau: self.tau, last }
    }

    fn values(&self) -> Values<'a> {
        Values { data: self.rgb, stride: self.tau.len(), channels: RGB }
    }
}

impl<'a> Pixels<'a> {
    /// `[rays][3]` colours over the background.
    #[must_use]
    pub fn rgb(&self) -> &[f32] {
        &self.compositor.buffers.colour
    }

    /// `[rays]` accumulated opacity, in `[0, 1]`.
    #[must_use]
    pub fn opacity(&self) -> &[f32] {
        &self.compositor.buffers.opacity
    }

    /// `[rays]` expected depth, unit of the distances; that of [`Compositor::with_far`] where the opacity is 0.
    #[must_use]
    pub fn depth(&self) -> &[f32] {
        &self.compositor.buffers.depth
    }

    /// `[rays]` transmittance to the background, in `[0, 1]`.
    #[must_use]
    pub fn trans_end(&self) -> &[f32] {
        &self.compositor.buffers.trans_end
    }

    /// `[n]` weight of each sample, in `[0, 1]`; 0 for samples that belong to no ray.
    #[must_use]
    pub fn weights(&self) -> &[f32] {
        &self.compositor.buffers.w
    }

    /// Gradients with respect to the samples of this batch.
    ///
    /// # Panics
    /// When a gradient has another length than its output.
    #[must_use]
    pub fn backward(self, bar: PixelsBar<'_>) -> SampleGrads<'a> {
        let Self { compositor, samples } = self;
        let (n, rays) = (samples.tau.len(), samples.rays());
        let Compositor { simd, last, buffers, .. } = compositor;
        let by_weight = bar.w.is_some() || bar.depth.is_some();
        zeros(&mut buffers.w_bar, n);
        if let Some(w) = bar.w {
            assert_eq!(w.len(), n, "the gradient of the weights and tau differ in length");
            buffers.w_bar.copy_from_slice(w);
        }
        zeros(&mut buffers.t_bar, n);
        if let Some(depth) = bar.depth {
            let to = DepthBar { w: &mut buffers.w_bar, t: Some(&mut buffers.t_bar) };
            depth_expected_backward(samples.offsets, &buffers.w, samples.t, depth, to);
        }
        zeros(&mut buffers.trans_end_bar, rays);
        if let Some(opacity) = bar.opacity {
            assert_eq!(opacity.len(), rays, "the gradient of the opacities holds one number a ray");
            for (to, from) in buffers.trans_end_bar.iter_mut().zip(opacity) {
                *to = -from;
            }
        }
        zeros(&mut buffers.tau_bar, n);
        zeros(&mut buffers.rgb_bar, RGB * n);
        // Without a loss on the colours their gradient is 0; the colours themselves are needed no more.
        if bar.rgb.is_none() {
            zeros(&mut buffers.colour, RGB * rays);
        }
        let raw_bar = CompositeBar {
            colour: bar.rgb.unwrap_or(&buffers.colour),
            w: by_weight.then_some(&buffers.w_bar),
            trans_end: bar.opacity.is_some().then_some(&buffers.trans_end_bar),
        };
        let grads = CompositeGrads { tau: &mut buffers.tau_bar, values: &mut buffers.rgb_bar, background: None };
        let forward = Weights { w: &buffers.w, trans_end: &buffers.trans_end };
        composite_backward(*simd, samples.raw(*last), samples.values(), &buffers.background, forward, raw_bar, grads);
        SampleGrads { buffers }
    }
}

impl SampleGrads<'_> {
    /// `[n]` of the optical depths; 0 for samples that belong to no ray, here and below.
    #[must_use]
    pub fn tau(&self) -> &[f32] {
        &self.buffers.tau_bar
    }

    /// `[3][n]` of the colours.
    #[must_use]
    pub fn rgb(&self) -> &[f32] {
        &self.buffers.rgb_bar
    }

    /// `[n]` of the distances: through the depth alone, lengths of intervals are part of the optical depths.
    #[must_use]
    pub fn t(&self) -> &[f32] {
        &self.buffers.t_bar
    }
}

/// `n` zeros; keeps the memory.
fn zeros(x: &mut Vec<f32>, n: usize) {
    x.clear();
    x.resize(n, 0.0);
}
