//! The filter of SF-NeRF: a network in image space that predicts the opacity and the colour of an occluder before each pixel, and
//! how uncertain the pixel is.
//!
//! ```text
//! [gamma(p), q] -> 3 layers \
//!                            joined -> 2 layers -> raw opacity h, raw colour, raw uncertainty
//! features      -> 3 layers /
//! ```
//!
//! Letters: `p` place in the photo, shares of width and height; `gamma` its octaves; `q` code of the photo. Without features
//! that branch is not there. The last layer of a branch is linear.

use super::pretrained::Freeze;
use crate::limits::refuse;
use crate::occluders::pixel_network::PixelNetwork;
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::mlp::{Mlp, MlpConfig};
use field_core::rng::Rng;
use float_core::Simd;
use scene_io::Features;
use std::ops::Range;

/// Raw outputs of a pixel: opacity, colour, uncertainty.
pub(super) const OUTPUTS: usize = 5;

/// Initial raw opacity: an opacity of 0.11, as most pixels show the scene.
const RAW_OPACITY: f32 = -2.0;

/// Sizes of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) octaves: usize,
    pub(super) width: usize,
    /// Length of a photo's code.
    pub(super) code: usize,
    /// Length of a feature vector; 0: there are none.
    pub(super) channels: usize,
}

/// The input of the filter at a pixel.
#[derive(Clone, Copy)]
pub(super) struct FilterInput<'a> {
    /// Share of width and height.
    pub(super) place: [f32; 2],
    /// The photo's code.
    pub(super) code: &'a [f32],
    /// The photo's features; ignored by a filter without that branch.
    pub(super) features: Option<&'a Features>,
}

/// The network.
pub(super) struct Filter {
    pub(super) shape: Shape,
    pub(super) encoding: Frequency,
    pub(super) place: PixelNetwork,
    pub(super) features: Option<PixelNetwork>,
    pub(super) joined: PixelNetwork,
    /// `[pixels][joined inputs]`: outputs of the branches for the last batch, and their gradient.
    pub(super) hidden: Vec<f32>,
    hidden_bar: Vec<f32>,
    /// The part that does not learn.
    pub(super) freeze: Freeze,
}

fn mlp(inputs: usize, width: usize, outputs: usize) -> Result<Mlp, SystemError> {
    Mlp::new(&MlpConfig::new(inputs, vec![width; 2], outputs)).or_else(|e| refuse("filter_width", width, e.to_string()))
}

impl Filter {
    /// # Errors
    /// [`SystemError::Config`] for a width of 0, no octaves or too many.
    pub(super) fn new(shape: Shape, rng: Rng) -> Result<Self, SystemError> {
        let Shape { octaves, width, code, channels } = shape;
        let encoding = Frequency::new(2, octaves, Base::Pi, Identity::Omit)
            .or_else(|e| refuse("filter_octaves", octaves, e.to_string()))?;
        let place = PixelNetwork::new("filter.place", mlp(encoding.out_rows() + code, width, width)?, rng.substream(0));
        let features = match channels {
            0 => None,
            n => Some(PixelNetwork::new("filter.features", mlp(n, width, width)?, rng.substream(1))),
        };
        let branches = 1 + usize::from(features.is_some());
        let mut joined = PixelNetwork::new("filter.joined", mlp(branches * width, width, OUTPUTS)?, rng.substream(2));
        let biases = joined.mlp.layers()[2].biases.clone();
        joined.params[biases][0] = RAW_OPACITY;
        joined.pack();
        Ok(Self {
            shape,
            encoding,
            place,
            features,
            joined,
            hidden: Vec::new(),
            hidden_bar: Vec::new(),
            freeze: Freeze::Nothing,
        })
    }

    /// Raw outputs of `n` pixels: `take(pixel, outputs)` in order. Keeps what [`Filter::backward`] needs.
    pub(super) fn forward<'a>(
        &mut self,
        simd: Simd,
        n: usize,
        input_of: impl Fn(usize) -> FilterInput<'a> + Sync,
        mut take: impl FnMut(usize, [f32; OUTPUTS]),
    ) {
        let (width, inputs) = (self.shape.width, self.joined.mlp.inputs());
        let Self { encoding, place, features, joined, hidden, .. } = self;
        hidden.resize(n * inputs, 0.0);
        place.forward(
            simd,
            n,
            |span, x| fill_places(simd, encoding, span, &input_of, x),
            |span, y| scatter(span, y, hidden, inputs, 0),
        );
        if let Some(net) = features {
            let fill = |span, x: &mut [f32]| fill_features(span, &input_of, x);
            net.forward(simd, n, fill, |span, y| scatter(span, y, hidden, inputs, width));
        }
        joined.forward(
            simd,
            n,
            |span, x| gather(span, hidden, inputs, 0, x),
            |span, y| {
                let len = span.len();
                for (j, i) in span.enumerate() {
                    take(i, std::array::from_fn(|k| y[k * len + j]));
                }
            },
        );
    }

    /// Gradients of the pixels of [`Filter::forward`] from those of their raw outputs, `[pixels][OUTPUTS]`. The gradient of
    /// the pixels' codes is written to `code_bar`, `[pixels][code]`.
    pub(super) fn backward(&mut self, simd: Simd, raw_bar: &[[f32; OUTPUTS]], code_bar: &mut Vec<f32>) {
        let (Shape { width, code, .. }, inputs) = (self.shape, self.joined.mlp.inputs());
        let rows = self.encoding.out_rows();
        let learns = self.learning_features().is_some();
        let Self { place, features, joined, hidden_bar, .. } = self;
        hidden_bar.resize(raw_bar.len() * inputs, 0.0);
        code_bar.resize(raw_bar.len() * code, 0.0);
        joined.backward(
            simd,
            |span, bar| {
                let len = span.len();
                for (j, i) in span.enumerate() {
                    raw_bar[i].iter().enumerate().for_each(|(k, &raw)| bar[k * len + j] = raw);
                }
            },
            |span, x_bar| scatter(span, x_bar, hidden_bar, inputs, 0),
        );
        if let Some(net) = features.as_mut().filter(|_| learns) {
            net.backward(simd, |span, bar| gather(span, hidden_bar, inputs, width, bar), |_, _| {});
        }
        place.backward(
            simd,
            |span, bar| gather(span, hidden_bar, inputs, 0, bar),
            |span, x_bar| {
                let first = rows * span.len();
                scatter(span, &x_bar[first..], code_bar, code, 0);
            },
        );
    }

    /// Adam: the branch of the place at a learning rate of its own. Returns the count of non-finite gradients.
    pub(super) fn step(&mut self, simd: Simd, place_lr: f64, others_lr: f64) -> usize {
        let features = self.learning_features().map_or(0, |net| net.step(simd, others_lr));
        self.place.step(simd, place_lr) + features + self.joined.step(simd, others_lr)
    }

    /// Raw outputs of `n` pixels, from many threads, keeping nothing.
    pub(super) fn infer<'a>(
        &self,
        simd: Simd,
        n: usize,
        input_of: impl Fn(usize) -> FilterInput<'a> + Sync,
    ) -> Vec<[f32; OUTPUTS]> {
        let width = self.shape.width;
        let place = self.place.infer(simd, n, |span, x| fill_places(simd, &self.encoding, span, &input_of, x));
        let seen = self.features.as_ref().map(|net| net.infer(simd, n, |span, x| fill_features(span, &input_of, x)));
        let raw = self.joined.infer(simd, n, |span, x| {
            let (first, second) = x.split_at_mut(width * span.len());
            gather(span.clone(), &place, width, 0, first);
            if let Some(seen) = &seen {
                gather(span, seen, width, 0, second);
            }
        });
        raw.as_chunks().0.to_vec()
    }

    /// The branch of the features, where it learns.
    fn learning_features(&mut self) -> Option<&mut PixelNetwork> {
        let freeze = self.freeze;
        self.features.as_mut().filter(|_| freeze != Freeze::Features)
    }

    pub(super) fn nets(&self) -> impl Iterator<Item = &PixelNetwork> {
        [Some(&self.place), self.features.as_ref(), Some(&self.joined)].into_iter().flatten()
    }

    pub(super) fn nets_mut(&mut self) -> impl Iterator<Item = &mut PixelNetwork> {
        [Some(&mut self.place), self.features.as_mut(), Some(&mut self.joined)].into_iter().flatten()
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.nets().for_each(|net| net.push_state(out));
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.nets_mut().try_for_each(|net| net.load_state(state))
    }

    /// Trainable parameters.
    pub(super) fn parameter_count(&self) -> usize {
        self.nets().map(|net| net.params.len()).sum()
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.nets().map(PixelNetwork::bytes).sum::<usize>() + 4 * (self.hidden.capacity() + self.hidden_bar.capacity())
    }
}

/// `[gamma + code][pixels of the span]`.
pub(super) fn fill_places<'a>(
    simd: Simd,
    encoding: &Frequency,
    span: Range<usize>,
    input_of: &impl Fn(usize) -> FilterInput<'a>,
    x: &mut [f32],
) {
    let n = span.len();
    let mut places = vec![0.0; 2 * n];
    let (octaves, codes) = x.split_at_mut(encoding.out_rows() * n);
    for (j, i) in span.enumerate() {
        let FilterInput { place, code, .. } = input_of(i);
        (places[j], places[n + j]) = (place[0], place[1]);
        code.iter().enumerate().for_each(|(k, &value)| codes[k * n + j] = value);
    }
    encoding.encode(simd, &places, None, octaves).expect("rows of the encoding's own count");
}

/// `[channels][pixels of the span]`: a photo's features, bilinearly at its pixels.
fn fill_features<'a>(span: Range<usize>, input_of: &impl Fn(usize) -> FilterInput<'a>, x: &mut [f32]) {
    let n = span.len();
    let mut vector = vec![0.0; x.len() / n.max(1)];
    for (j, i) in span.enumerate() {
        let FilterInput { place: [u, v], features, .. } = input_of(i);
        if let Some(features) = features {
            features.sample(u.into(), v.into(), &mut vector);
        }
        vector.iter().enumerate().for_each(|(k, &value)| x[k * n + j] = value);
    }
}

/// Rows `[features][pixels of the span]` to columns from `first` on of `[pixels][stride]`.
fn scatter(span: Range<usize>, rows: &[f32], out: &mut [f32], stride: usize, first: usize) {
    let n = span.len();
    for (j, i) in span.enumerate() {
        let columns = out[i * stride + first..(i + 1) * stride].iter_mut();
        columns.zip(rows[j..].iter().step_by(n)).for_each(|(out, &value)| *out = value);
    }
}

/// The reverse of [`scatter`].
fn gather(span: Range<usize>, from: &[f32], stride: usize, first: usize, rows: &mut [f32]) {
    let n = span.len();
    for (j, i) in span.enumerate() {
        let columns = &from[i * stride + first..(i + 1) * stride];
        rows[j..].iter_mut().step_by(n).zip(columns).for_each(|(row, &value)| *row = value);
    }
}
