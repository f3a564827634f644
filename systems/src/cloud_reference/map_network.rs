//! The network that makes feature maps of a picture: halved four times, doubled three times, with what was there on the way down beside.
//!
//! ```text
//! side      1   1/2  1/4  1/8  1/16                               1/8  1/4  1/2
//! channels  8   16   32   32   32     with their mean over all: 32   32   24   16   the maps
//! ```
//!
//! ReLU after each but the last. The mean tells every pixel how bright the picture is; as convolutions learn slowly what a factor and a
//! summand do to a photo, a linear map of its tones ([`tone`]) is added to each map where that is asked for, as to the codes of
//! [`crate::appearance`].

use crate::appearance::photo_network::tone;
use crate::buffers::shapes_hold;
use engine::system::SystemError;
use field_core::FieldError;
use field_core::conv::{
    Conv2d, Extent, Padding, Size, Workspace, global_mean, global_mean_backward, relu, relu_backward, resize,
    resize_backward,
};
use field_core::init::Init;
use field_core::rng::Rng;
use float_core::Simd;
use std::ops::Range;

/// Channels on the way down, and on the way up.
const DOWN: [usize; 5] = [8, 16, 32, 32, 32];
const MIDDLE: usize = 32;
const UP: [usize; 3] = [32, 24, 16];

/// From the darkest to the brightest pixels of a photo.
pub(crate) const TILTS: [f32; 5] = [-50.0, -5.0, 0.0, 5.0, 50.0];
/// Pictures are halved this often.
const HALVINGS: u32 = 4;
/// Pictures that are larger are a mistake.
const MOST_SIDE: usize = 512;

/// What goes in, and what comes out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MapShape {
    /// Pixels along a side of a picture: see [`is_side`]. Maps are half as wide.
    pub(crate) side: usize,
    /// Channels of a picture.
    pub(crate) channels: usize,
    /// Planes of all maps.
    pub(crate) planes: usize,
    /// Whether tones of each channel are added.
    pub(crate) tones: bool,
}

/// What [`is_side`] asks for.
pub(crate) const SIDE: &str = "must be a multiple of 16, 16 to 512";

/// Whether pictures can have this side.
pub(crate) fn is_side(side: usize) -> bool {
    (1..=MOST_SIDE).contains(&side) && side.is_multiple_of(1 << HALVINGS)
}

/// What a convolution reads.
#[derive(Clone, Copy, Debug)]
enum Input {
    Picture,
    /// What another one gave.
    Of(usize),
    /// The same, and its mean over all pixels beside it.
    WithMean(usize),
    /// What one gave, twice as large, and what another gave beside it.
    Doubled(usize, usize),
}

struct Layer {
    conv: Conv2d,
    params: Range<usize>,
    input: Input,
    /// Of the input.
    size: Size,
}

/// Convolutions. Parameters: one after the other, as [`Conv2d`] has them, then `[planes][tones]`.
pub(crate) struct MapNetwork {
    layers: Vec<Layer>,
    shape: MapShape,
    simd: Simd,
}

/// What the way back needs.
#[derive(Clone, Debug, Default)]
pub(crate) struct MapMemory {
    inputs: Vec<Vec<f32>>,
    outputs: Vec<Vec<f32>>,
    tones: Vec<f32>,
    work: Workspace,
}

/// A layer before it is laid out: inputs, outputs, kernel, stride, what it reads, side of that.
struct Plan {
    channels: [usize; 2],
    kernel: usize,
    stride: usize,
    input: Input,
    side: usize,
}

fn plans(shape: &MapShape) -> Vec<Plan> {
    let mut side = shape.side;
    let mut plans =
        vec![Plan { channels: [shape.channels, DOWN[0]], kernel: 3, stride: 1, input: Input::Picture, side }];
    for k in 1..DOWN.len() {
        let channels = [DOWN[k - 1], DOWN[k]];
        plans.push(Plan { channels, kernel: 4, stride: 2, input: Input::Of(k - 1), side });
        side /= 2;
    }
    let deepest = HALVINGS as usize;
    let channels = [2 * DOWN[deepest], MIDDLE];
    plans.push(Plan { channels, kernel: 1, stride: 1, input: Input::WithMean(deepest), side });
    let mut inputs = MIDDLE;
    for (k, &outputs) in UP.iter().enumerate() {
        side *= 2;
        let beside = deepest - 1 - k;
        let (channels, input) = ([inputs + DOWN[beside], outputs], Input::Doubled(plans.len() - 1, beside));
        plans.push(Plan { channels, kernel: 3, stride: 1, input, side });
        inputs = outputs;
    }
    let channels = [inputs, shape.planes];
    plans.push(Plan { channels, kernel: 1, stride: 1, input: Input::Of(plans.len() - 1), side });
    plans
}

impl MapNetwork {
    /// `field` is the setting that gives the side.
    ///
    /// # Errors
    /// [`SystemError::Config`] for maps that cannot be.
    pub(crate) fn new(shape: MapShape, field: &'static str) -> Result<Self, SystemError> {
        let refused =
            |e: FieldError| SystemError::Config { field, value: shape.side.to_string(), problem: e.to_string() };
        let mut layers: Vec<Layer> = Vec::new();
        for Plan { channels: [inputs, outputs], kernel, stride, input, side } in plans(&shape) {
            let padding = Padding::Zero(if kernel > 1 { 1 } else { 0 });
            let conv = Conv2d::new(inputs, outputs, kernel, stride, padding).map_err(refused)?;
            let first = layers.last().map_or(0, |layer| layer.params.end);
            layers.push(Layer { params: first..first + conv.param_count(), conv, input, size: Size::one(side, side) });
        }
        Ok(Self { layers, shape, simd: Simd::best() })
    }

    pub(crate) fn param_count(&self) -> usize {
        self.of_tones().end
    }

    /// Where the linear map of tones lies.
    fn of_tones(&self) -> Range<usize> {
        let first = self.layers.last().map_or(0, |layer| layer.params.end);
        first..first + self.shape.planes * self.tones()
    }

    /// Tones of a picture.
    fn tones(&self) -> usize {
        if self.shape.tones { self.shape.channels * TILTS.len() } else { 0 }
    }

    /// Numbers of all maps.
    pub(crate) fn map_numbers(&self) -> usize {
        self.shape.planes * (self.shape.side / 2).pow(2)
    }

    /// Numbers that [`MapMemory`] holds of a photo.
    pub(crate) fn memory_len(&self) -> usize {
        let of = |layer: &Layer| layer.size.len(layer.conv.inputs()) + layer.size.len(layer.conv.outputs());
        self.layers.iter().map(of).sum()
    }

    /// Random parameters; biases are 0, and tones say nothing.
    pub(crate) fn init(&self, rng: Rng) -> Vec<f32> {
        let mut params = vec![0.0; self.param_count()];
        for (k, layer) in self.layers.iter().enumerate() {
            let init = if k + 1 < self.layers.len() { Init::HeUniform } else { Init::XavierUniform };
            layer.conv.init(init, rng.substream(k as u64), &mut params[layer.params.clone()]);
        }
        params
    }

    /// Let all maps begin as zeros, but for their tones.
    pub(crate) fn begin_at_zero(&self, params: &mut [f32]) {
        if let Some(last) = self.layers.last() {
            params[last.params.clone()].fill(0.0);
        }
    }

    /// The maps of `pixels` `[channels][side][side]`: `[planes][side / 2][side / 2]`.
    pub(crate) fn forward<'m>(&self, params: &[f32], pixels: &[f32], memory: &'m mut MapMemory) -> &'m [f32] {
        let MapMemory { inputs, outputs, tones, work } = memory;
        let plane = self.shape.side * self.shape.side;
        tones.clear();
        if self.shape.tones {
            let all = vec![1.0; plane];
            for x in pixels.chunks_exact(plane) {
                tones.extend(TILTS.iter().map(|tilt| tone(x, &all, *tilt)));
            }
        }
        inputs.clear();
        outputs.clear();
        for (k, layer) in self.layers.iter().enumerate() {
            let x = self.input(layer, pixels, outputs);
            let to = layer.conv.output_size(layer.size).map_or(0, |size| size.len(layer.conv.outputs()));
            let mut y = vec![0.0; to];
            let params = &params[layer.params.clone()];
            shapes_hold(layer.conv.forward(self.simd, params, &x, layer.size, &mut y, work));
            if k + 1 < self.layers.len() {
                relu(&mut y);
            }
            inputs.push(x);
            outputs.push(y);
        }
        let Some(maps) = outputs.last_mut() else { return &[] };
        let pixels = (maps.len() / self.shape.planes).max(1);
        let weights = params[self.of_tones()].chunks_exact(self.tones().max(1));
        for (plane, weights) in maps.chunks_exact_mut(pixels).zip(weights) {
            let sum: f32 = weights.iter().zip(&tones[..]).map(|(w, tone)| w * tone).sum();
            plane.iter_mut().for_each(|x| *x += sum);
        }
        maps
    }

    /// What a layer reads.
    fn input(&self, layer: &Layer, pixels: &[f32], outputs: &[Vec<f32>]) -> Vec<f32> {
        match layer.input {
            Input::Picture => pixels.to_vec(),
            Input::Of(k) => outputs[k].clone(),
            Input::WithMean(k) => {
                let (channels, pixels) = (self.layers[k].conv.outputs(), layer.size.pixels());
                let mut mean = vec![0.0; channels];
                shapes_hold(global_mean(&outputs[k], channels, layer.size, &mut mean));
                outputs[k].iter().copied().chain(mean.iter().flat_map(|x| std::iter::repeat_n(*x, pixels))).collect()
            }
            Input::Doubled(k, beside) => {
                let (channels, half, to) = self.doubled(layer, k);
                let mut x = vec![0.0; layer.size.len(channels)];
                shapes_hold(resize(&outputs[k], channels, half, to, &mut x));
                x.extend(&outputs[beside]);
                x
            }
        }
    }

    /// Channels and size of what is doubled, and the extent that it gets.
    fn doubled(&self, layer: &Layer, k: usize) -> (usize, Size, Extent) {
        let Size { height, width, .. } = layer.size;
        (self.layers[k].conv.outputs(), Size::one(height / 2, width / 2), Extent::new(height, width))
    }

    /// After [`forward`](Self::forward): the gradient with respect to the parameters, from that with respect to the maps.
    pub(crate) fn backward(&self, params: &[f32], maps_bar: &[f32], memory: &mut MapMemory) -> Vec<f32> {
        let MapMemory { inputs, outputs, tones, work } = memory;
        let mut grad = vec![0.0; params.len()];
        let mut bars: Vec<Vec<f32>> = outputs.iter().map(|y| vec![0.0; y.len()]).collect();
        if let Some(last) = bars.last_mut() {
            last.copy_from_slice(maps_bar);
        }
        let planes = maps_bar.chunks_exact((maps_bar.len() / self.shape.planes).max(1));
        for (plane, own) in planes.zip(grad[self.of_tones()].chunks_exact_mut(self.tones().max(1))) {
            let bar: f32 = plane.iter().sum();
            own.iter_mut().zip(&tones[..]).for_each(|(grad, tone)| *grad = bar * tone);
        }
        for (k, layer) in self.layers.iter().enumerate().rev() {
            let mut bar = std::mem::take(&mut bars[k]);
            if k + 1 < self.layers.len() {
                relu_backward(&outputs[k], &mut bar);
            }
            let mut x_bar = vec![0.0; if matches!(layer.input, Input::Picture) { 0 } else { inputs[k].len() }];
            let wanted = (!x_bar.is_empty()).then_some(&mut x_bar[..]);
            let (own, own_bar) = (&params[layer.params.clone()], &mut grad[layer.params.clone()]);
            shapes_hold(layer.conv.backward(self.simd, own, &inputs[k], layer.size, &bar, own_bar, wanted, work));
            self.input_backward(layer, &x_bar, &mut bars);
        }
        grad
    }

    /// Backward twin of [`input`](Self::input).
    fn input_backward(&self, layer: &Layer, x_bar: &[f32], bars: &mut [Vec<f32>]) {
        let add = |to: &mut [f32], from: &[f32]| to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        match layer.input {
            Input::Picture => {}
            Input::Of(k) => add(&mut bars[k], x_bar),
            Input::WithMean(k) => {
                let (own, of_mean) = x_bar.split_at(bars[k].len());
                add(&mut bars[k], own);
                let mean: Vec<f32> =
                    of_mean.chunks_exact(layer.size.pixels()).map(|plane| plane.iter().sum()).collect();
                shapes_hold(global_mean_backward(&mean, mean.len(), layer.size, &mut bars[k]));
            }
            Input::Doubled(k, beside) => {
                let (channels, half, to) = self.doubled(layer, k);
                let (doubled, own) = x_bar.split_at(layer.size.len(channels));
                shapes_hold(resize_backward(doubled, channels, half, to, &mut bars[k]));
                add(&mut bars[beside], own);
            }
        }
    }
}
