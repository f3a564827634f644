//! The transient head: what one photo alone shows. A small network sees the geometry features of a sample and the code of
//! the photo, and says how dense, of which colour and how uncertain what stood there was (NeRF in the Wild, section 4.2).
//!
//! Every ray has one sample more, where it enters the scene: the **veil**. Nothing static is there, and the occupancy grid
//! never rules it out, so that an occluder before the camera, in what is empty space for all other photos, has a place.

use super::context::StepContext;
use super::marched::{Gradients, Marched};
use crate::buffers::sized;
use crate::fields::NETWORK_ADAM;
use crate::fields::xavier;
use crate::photo_model::Pixel;
use engine::system::{MOST_UNITS, SystemError, at_most};
use field_core::mlp::{Mlp, MlpConfig, Packed};
use field_core::rng::Rng;
use float_core::m32::softplus;
use optim::Adam;
use render_core::quadrature::Values;
use render_core::quadrature::two::{
    CompositeTwo, CompositeTwoBar, CompositeTwoGrads, Mixture, TwoSamples, TwoValues, WeightsTwo, composite_two,
    composite_two_backward,
};
use serde::{Deserialize, Serialize};
use std::array;
use std::f32::consts::PI;
use std::ops::Range;

/// Octaves of the pixel's place in its photo, which the head sees beside the code: what the trunk of the published network
/// knows of an occluder from fifteen octaves of the position, a hash grid would have to learn from one photo.
const PLACE_OCTAVES: usize = 4;

/// What the head sees of a ray besides its code.
pub(super) const PLACE_ROWS: usize = 4 * PLACE_OCTAVES;

/// Sines and cosines of a place, `[u, v]` for each octave.
pub(super) fn place_features([u, v]: [f32; 2]) -> [f32; PLACE_ROWS] {
    array::from_fn(|k| {
        let x = if k & 1 == 0 { u } else { v };
        // Half a period across the photo first: left and right are told apart.
        let angle = (x - 0.5) * PI * (1_u32 << (k / 4)) as f32;
        if k & 2 == 0 { angle.sin() } else { angle.cos() }
    })
}

/// Outputs of the network: density, three colours, uncertainty.
const OUTPUTS: usize = 5;

/// How static and transient part share an interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MixtureKind {
    /// As published: each as if the other were not there, so that what both cover counts twice.
    #[default]
    Paper,
    /// In proportion to their densities: weights sum to 1.
    Proportional,
}

impl From<MixtureKind> for Mixture {
    fn from(kind: MixtureKind) -> Self {
        match kind {
            MixtureKind::Paper => Self::Paper,
            MixtureKind::Proportional => Self::Proportional,
        }
    }
}

/// Settings of the transient head.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadConfig {
    /// Width of the two hidden layers of the transient head.
    pub head_width: usize,
    /// Added to the head's raw density: how thin transient matter starts, 5 % of a ray at -3, less than 1 % at -5.
    pub head_bias: f32,
    /// How static and transient part share an interval: `paper` or `proportional`.
    pub mixture: MixtureKind,
}

impl Default for HeadConfig {
    fn default() -> Self {
        Self { head_width: 64, head_bias: -5.0, mixture: MixtureKind::Paper }
    }
}

impl HeadConfig {
    /// Check the ranges.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        at_most(&[("head_width", self.head_width, MOST_UNITS)])?;
        if !(-20.0..=10.0).contains(&self.head_bias) {
            let problem = "must be in -20..=10".into();
            return Err(SystemError::Config { field: "head_bias", value: self.head_bias.to_string(), problem });
        }
        Ok(())
    }
}

/// The network, its moments and its size.
pub(super) struct Head {
    pub(super) mlp: Mlp,
    pub(super) params: Vec<f32>,
    pub(super) packed: Packed,
    pub(super) adam: Adam,
    /// Rows of the geometry features.
    geometry: usize,
    /// Length of a transient code.
    pub(super) dims: usize,
    /// How the two parts share an interval.
    mixture: Mixture,
    /// One over the length of the smallest step: the unit of transient density.
    per_step: f32,
    /// Added to the raw density.
    bias: f32,
}

impl Head {
    pub(super) fn new(
        geometry: usize,
        dims: usize,
        config: &HeadConfig,
        step_min: f32,
        rng: Rng,
    ) -> Result<Self, SystemError> {
        let mlp =
            Mlp::new(&MlpConfig::new(geometry + PLACE_ROWS + dims, vec![config.head_width; 2], OUTPUTS)).map_err(
                |e| SystemError::Config { field: "transient_dims", value: dims.to_string(), problem: e.to_string() },
            )?;
        let params = xavier(&mlp, rng);
        let adam = Adam::new(params.len(), NETWORK_ADAM);
        let mut head = Self {
            mlp,
            params,
            packed: Packed::default(),
            adam,
            geometry,
            dims,
            mixture: config.mixture.into(),
            per_step: 1.0 / step_min,
            bias: config.head_bias,
        };
        head.pack();
        Ok(head)
    }

    /// Renew the packed parameters.
    pub(super) fn pack(&mut self) {
        self.mlp.pack(&self.params, &mut self.packed);
    }
}

/// Derivative of softplus. Not `m32::logistic`, whose last bits are others (`docs/decisions/0036-two-softplus.md`).
fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The static part of the rays of a tile.
pub(super) struct StaticPart<'a> {
    /// `[rays + 1]`
    pub(super) offsets: &'a [u32],
    /// `[n]`, optical depths.
    pub(super) tau: &'a [f32],
    /// `[3][n]`
    pub(super) rgb: &'a [f32],
    /// `[rays][3]`
    pub(super) background: &'a [f32],
}

/// Where the gradients of the static part are added.
pub(super) struct StaticBars<'a> {
    /// `[n]`
    pub(super) tau: &'a mut [f32],
    /// `[3][n]`
    pub(super) rgb: &'a mut [f32],
    /// `[geometry][n]`
    pub(super) geometry: &'a mut [f32],
}

/// Gradients of rays with respect to what the head adds to them.
#[derive(Default)]
pub(super) struct HeadBars {
    beta: Vec<f32>,
    sigma_t: Vec<f32>,
}

impl HeadBars {
    pub(super) fn clear(&mut self) {
        self.beta.clear();
        self.sigma_t.clear();
    }

    pub(super) fn push(&mut self, beta: f32, sigma_t: f32) {
        self.beta.push(beta);
        self.sigma_t.push(sigma_t);
    }
}

/// Buffers of the head in a tile.
#[derive(Default)]
pub(super) struct HeadTile {
    acts: Vec<f32>,
    /// `[geometry + place + code][n]`
    input: Vec<f32>,
    input_bar: Vec<f32>,
    /// `[5][n]`
    raw: Vec<f32>,
    raw_bar: Vec<f32>,
    tau: Vec<f32>,
    tau_bar: Vec<f32>,
    tau_s_bar: Vec<f32>,
    /// `d tau / d sigma`: the step in units of the smallest.
    length: Vec<f32>,
    rgb: Vec<f32>,
    rgb_bar: Vec<f32>,
    beta: Vec<f32>,
    beta_bar: Vec<f32>,
    w_s: Vec<f32>,
    w_t: Vec<f32>,
    trans_end: Vec<f32>,
    colour: Vec<f32>,
    ray_beta: Vec<f32>,
    transient: Vec<f32>,
    sigma_t: Vec<f32>,
    scratch: Vec<f32>,
}

impl HeadTile {
    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats = [&self.acts, &self.input, &self.input_bar, &self.raw, &self.raw_bar, &self.rgb, &self.rgb_bar];
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>()
    }

    /// `[3 * rays]`, colours of the rays of the last forward pass.
    pub(super) fn colour(&self) -> &[f32] {
        &self.colour
    }

    /// The pixel whose rays these are.
    pub(super) fn pixel(&self, rgb: [f32; 3], rays: Range<usize>) -> Pixel {
        let mean = |v: &[f32]| v[rays.clone()].iter().sum::<f32>() / rays.len() as f32;
        let (beta, transient, sigma_t) = (mean(&self.ray_beta), mean(&self.transient), mean(&self.sigma_t));
        Pixel { rgb, beta, transient, sigma_t, ..Pixel::default() }
    }

    /// Rays with both parts. `input` is the colour network's, whose first rows are the geometry features.
    pub(super) fn forward(
        &mut self,
        head: &Head,
        ctx: &StepContext<'_>,
        chunk: Marched<'_>,
        rays: Range<usize>,
        input: &[f32],
        part: &StaticPart<'_>,
    ) {
        let &StaticPart { offsets, tau: tau_s, rgb: rgb_s, background } = part;
        let (simd, n, count) = (ctx.field.simd, tau_s.len(), rays.len());
        let first = chunk.offsets[rays.start] as usize;
        let geometry = head.geometry;
        let x = sized(&mut self.input, head.mlp.inputs() * n);
        x[..geometry * n].copy_from_slice(&input[..geometry * n]);
        for r in 0..count {
            let span = offsets[r] as usize..offsets[r + 1] as usize;
            for k in 0..PLACE_ROWS + head.dims {
                x[(geometry + k) * n..][span.clone()].fill(chunk.transient[k * chunk.rays + rays.start + r]);
            }
        }
        let raw = sized(&mut self.raw, OUTPUTS * n);
        let acts = sized(&mut self.acts, head.mlp.activations_len(n));
        head.mlp.forward(simd, &head.packed, x, n, n, raw, n, acts);
        let (tau, length) = (sized(&mut self.tau, n), sized(&mut self.length, n));
        let (rgb, beta) = (sized(&mut self.rgb, 3 * n), sized(&mut self.beta, n));
        for i in 0..n {
            length[i] = chunk.dt[first + i] * head.per_step;
            tau[i] = softplus(raw[i] + head.bias) * length[i];
            beta[i] = softplus(raw[4 * n + i]);
        }
        for (rgb, raw) in rgb.iter_mut().zip(&raw[n..4 * n]) {
            *rgb = logistic(*raw);
        }
        self.sigma_t.clear();
        self.sigma_t.extend((0..count).map(|r| {
            let span = offsets[r] as usize..offsets[r + 1] as usize;
            let sum: f32 = span.clone().map(|i| tau[i] / length[i]).sum();
            sum / span.len().max(1) as f32
        }));
        self.colour.resize(3 * count, 0.0);
        self.ray_beta.resize(count, 0.0);
        self.transient.resize(count, 0.0);
        let samples = TwoSamples { offsets, tau_s, tau_t: tau };
        let values = TwoValues {
            values_s: Values { data: rgb_s, stride: n, channels: 3 },
            values_t: Values { data: rgb, stride: n, channels: 3 },
            beta,
            background,
        };
        let out = CompositeTwo {
            colour: &mut self.colour,
            beta: &mut self.ray_beta,
            transient: &mut self.transient,
            trans_end: sized(&mut self.trans_end, count),
            w_s: sized(&mut self.w_s, n),
            w_t: sized(&mut self.w_t, n),
        };
        composite_two(simd, samples, head.mixture, values, out);
    }

    /// Back to the static part (`tau_s`, added; `rgb_s`, added; geometry rows, added), the head's parameters and codes.
    #[expect(clippy::too_many_arguments, reason = "all that a ray is made of")]
    pub(super) fn backward(
        &mut self,
        head: &Head,
        ctx: &StepContext<'_>,
        rays: Range<usize>,
        part: &StaticPart<'_>,
        colour_bar: &[f32],
        bars: &HeadBars,
        static_bars: StaticBars<'_>,
        out: &mut Gradients<'_>,
    ) {
        let &StaticPart { offsets, tau: tau_s, rgb: rgb_s, background } = part;
        let StaticBars { tau: tau_s_bar, rgb: rgb_s_bar, geometry: geometry_bar } = static_bars;
        let (simd, n, count) = (ctx.field.simd, tau_s.len(), rays.len());
        let (raw, tau, length) = (&self.raw[..OUTPUTS * n], &self.tau[..n], &self.length[..n]);
        let samples = TwoSamples { offsets, tau_s, tau_t: tau };
        let values = TwoValues {
            values_s: Values { data: rgb_s, stride: n, channels: 3 },
            values_t: Values { data: &self.rgb[..3 * n], stride: n, channels: 3 },
            beta: &self.beta[..n],
            background,
        };
        let weights = WeightsTwo { w_s: &self.w_s[..n], w_t: &self.w_t[..n], trans_end: &self.trans_end[..count] };
        let bar = CompositeTwoBar {
            colour: colour_bar,
            beta: Some(&bars.beta),
            transient: None,
            trans_end: None,
            w_s: None,
            w_t: None,
        };
        let (tau_bar, beta_bar) = (sized(&mut self.tau_bar, n), sized(&mut self.beta_bar, n));
        let rgb_bar = sized(&mut self.rgb_bar, 3 * n);
        let joint = sized(&mut self.tau_s_bar, n);
        let grads = CompositeTwoGrads {
            tau_s: joint,
            tau_t: tau_bar,
            values_s: rgb_s_bar,
            values_t: rgb_bar,
            beta: beta_bar,
            background: None,
        };
        composite_two_backward(simd, samples, head.mixture, values, weights, bar, grads);
        for (sum, bar) in tau_s_bar.iter_mut().zip(joint) {
            *sum += *bar;
        }

        let raw_bar = sized(&mut self.raw_bar, OUTPUTS * n);
        for r in 0..count {
            let span = offsets[r] as usize..offsets[r + 1] as usize;
            let prior = bars.sigma_t[r] / span.len().max(1) as f32;
            for i in span {
                raw_bar[i] = (tau_bar[i] * length[i] + prior) * logistic(raw[i] + head.bias);
                raw_bar[4 * n + i] = beta_bar[i] * logistic(raw[4 * n + i]);
            }
        }
        for (bar, (rgb, rgb_bar)) in raw_bar[n..4 * n].iter_mut().zip(self.rgb.iter().zip(&*rgb_bar)) {
            *bar = rgb_bar * rgb * (1.0 - rgb);
        }
        let input_bar = sized(&mut self.input_bar, head.mlp.inputs() * n);
        input_bar.fill(0.0);
        let scratch = sized(&mut self.scratch, head.mlp.backward_scratch_len());
        let x_bar = (&mut *input_bar, n);
        head.mlp.backward(ctx.field.simd, &head.packed, &self.acts, raw_bar, n, n, Some(x_bar), out.head, scratch);
        let geometry = head.geometry;
        for (sum, bar) in geometry_bar.iter_mut().zip(&input_bar[..geometry * n]) {
            *sum += *bar;
        }
        for (r, bars) in out.transient[rays.start * head.dims..].chunks_exact_mut(head.dims).take(count).enumerate() {
            let span = offsets[r] as usize..offsets[r + 1] as usize;
            for (k, bar) in bars.iter_mut().enumerate() {
                *bar += input_bar[(geometry + PLACE_ROWS + k) * n..][span.clone()].iter().sum::<f32>();
            }
        }
    }
}
