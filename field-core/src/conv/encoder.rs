//! An image to a code: one wide convolution, several that halve the image, the mean of each channel, a linear layer.

use super::{Conv2d, Map, Padding, Size, Workspace, global_mean, global_mean_backward, grown, relu, relu_backward};
use crate::FieldError;
use crate::error::check_len;
use crate::init::Init;
use crate::rng::Rng;
use alloc::vec;
use alloc::vec::Vec;
use core::ops::Range;
use float_core::Simd;

/// Shape of an [`Encoder`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct EncoderConfig {
    /// Channels of the images.
    pub inputs: usize,
    /// Channels after the first convolution and after each one that halves.
    pub channels: Vec<usize>,
    /// Numbers of a code.
    pub code: usize,
}

impl EncoderConfig {
    /// Images of `inputs` channels to codes of `code` numbers; `channels` after the first convolution and after each one that
    /// halves.
    #[must_use]
    pub fn new(inputs: usize, channels: Vec<usize>, code: usize) -> Self {
        Self { inputs, channels, code }
    }

    /// Ha-NeRF's encoder: 2.8 million parameters.
    #[must_use]
    pub fn published() -> Self {
        Self { inputs: 3, channels: vec![64, 128, 256, 256, 256], code: 48 }
    }

    /// The same shape with fewer channels, for training on CPUs: 61 thousand parameters.
    #[must_use]
    pub fn small() -> Self {
        Self { inputs: 3, channels: vec![16, 32, 32, 32, 32], code: 48 }
    }
}

/// The encoder of a photograph's appearance: reflect-padded 7 x 7 convolution, then for each further entry of the channels a
/// reflect-padded 4 x 4 convolution of stride 2, ReLU after each, mean over the image, linear layer to the code.
///
/// Images are `[n][inputs][height][width]` of any size from [`Encoder::min_side`] on; their values are expected around 0, such
/// as `2 * srgb - 1`. Codes are `[n][code]`. Holds no parameters: they are those of the convolutions in order, each
/// as [`Conv2d::param_count`] says, then the linear layer's `[code][channels]` and biases `[code]`.
///
/// # Source
/// Chen et al., "Hallucinated Neural Radiance Fields in the Wild", 2022, section 3.2.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    layers: Vec<Conv2d>,
    /// The linear layer, as a convolution of one pixel.
    head: Conv2d,
    /// Where the parameters of each convolution lie, the linear layer's last.
    ranges: Vec<Range<usize>>,
    config: EncoderConfig,
}

impl Encoder {
    /// Lay out an encoder.
    ///
    /// # Errors
    /// [`FieldError::Config`] where there are no channels, or none of a kind.
    pub fn new(config: EncoderConfig) -> Result<Self, FieldError> {
        let mut layers = Vec::with_capacity(config.channels.len());
        let mut inputs = config.inputs;
        for (i, &outputs) in config.channels.iter().enumerate() {
            let (kernel, stride, padding) = if i == 0 { (7, 1, 3) } else { (4, 2, 1) };
            layers.push(Conv2d::new(inputs, outputs, kernel, stride, Padding::Reflect(padding))?);
            inputs = outputs;
        }
        if layers.is_empty() {
            return Err(FieldError::Config { what: "layers", got: 0.0, accepts: "at least 1" });
        }
        let head = Conv2d::new(inputs, config.code, 1, 1, Padding::Zero(0))?;
        let mut end = 0;
        let next = |conv: &Conv2d| {
            end += conv.param_count();
            end - conv.param_count()..end
        };
        let ranges = layers.iter().chain([&head]).map(next).collect();
        Ok(Self { layers, head, ranges, config })
    }

    /// Its shape.
    #[must_use]
    pub fn config(&self) -> &EncoderConfig {
        &self.config
    }

    /// Numbers of a code.
    #[must_use]
    pub fn code(&self) -> usize {
        self.config.code
    }

    /// Trainable numbers.
    #[must_use]
    pub fn param_count(&self) -> usize {
        self.head_range().end
    }

    /// The smallest height and width of an image: 2 for each halving, and what the first convolution mirrors. 16 for the
    /// published shape.
    #[must_use]
    pub fn min_side(&self) -> usize {
        (1_usize << (self.layers.len() - 1)).max(4)
    }

    /// Draw parameters: convolutions by He's rule, the linear layer by Glorot's, biases 0.
    ///
    /// # Panics
    /// When `params` does not hold [`Encoder::param_count`] numbers.
    pub fn init(&self, rng: Rng, params: &mut [f32]) {
        assert_eq!(params.len(), self.param_count(), "encoder: parameters");
        for (i, (conv, range)) in self.layers.iter().chain([&self.head]).zip(&self.ranges).enumerate() {
            let init = if i < self.layers.len() { Init::HeUniform } else { Init::XavierUniform };
            conv.init(init, rng.substream(i as u64), &mut params[range.clone()]);
        }
    }

    /// Numbers that [`Encoder::forward`] keeps for the way back.
    ///
    /// # Errors
    /// [`FieldError::Config`] for images below [`Encoder::min_side`].
    pub fn activations_len(&self, size: Size) -> Result<usize, FieldError> {
        let mut len = size.images * self.head.inputs();
        self.each_map(size, |map| len += map.len)?;
        Ok(len)
    }

    /// Codes of a batch of images.
    ///
    /// # Shapes
    /// * `images` `[n][inputs][height][width]`, of extent `size`
    /// * `acts` [`Encoder::activations_len`] numbers: written, for [`Encoder::backward`]
    /// * `codes` `[n][code]`: written
    ///
    /// # Errors
    /// [`FieldError::Shape`] for other lengths, [`FieldError::Config`] for images below [`Encoder::min_side`].
    ///
    /// # Panics
    /// May do so where a product of the extents does not fit `usize`.
    #[expect(clippy::too_many_arguments, reason = "inputs, outputs and what is kept between")]
    pub fn forward(
        &self,
        simd: Simd,
        params: &[f32],
        images: &[f32],
        size: Size,
        acts: &mut [f32],
        codes: &mut [f32],
        work: &mut Workspace,
    ) -> Result<(), FieldError> {
        self.check(params, images, size, acts.len())?;
        check_len("codes", codes.len(), size.images * self.code())?;
        let (mut from, mut from_size) = (images, size);
        let mut rest = acts;
        for (conv, range) in self.layers.iter().zip(&self.ranges) {
            let to = conv.output_size(from_size)?;
            let (out, behind) = rest.split_at_mut(to.len(conv.outputs()));
            conv.forward(simd, &params[range.clone()], from, from_size, out, work)?;
            relu(out);
            (from, from_size, rest) = (out, to, behind);
        }
        global_mean(from, self.head.inputs(), from_size, rest)?;
        let one = Size { images: size.images, height: 1, width: 1 };
        self.head.forward(simd, &params[self.head_range()], rest, one, codes, work)
    }

    /// Gradient of [`Encoder::forward`]: **adds** into `params_bar`, and into `images_bar` where it is wanted.
    ///
    /// # Shapes
    /// `acts` as [`Encoder::forward`] left them, `codes_bar` as codes, the others as what they are gradients of.
    ///
    /// # Errors
    /// As [`Encoder::forward`].
    ///
    /// # Panics
    /// As [`Encoder::forward`].
    #[expect(clippy::too_many_arguments, reason = "inputs, what was kept, the gradient that comes and those that go")]
    pub fn backward(
        &self,
        simd: Simd,
        params: &[f32],
        images: &[f32],
        size: Size,
        acts: &[f32],
        codes_bar: &[f32],
        params_bar: &mut [f32],
        images_bar: Option<&mut [f32]>,
        work: &mut Workspace,
    ) -> Result<(), FieldError> {
        self.check(params, images, size, acts.len())?;
        check_len("codes_bar", codes_bar.len(), size.images * self.code())?;
        check_len("params_bar", params_bar.len(), params.len())?;
        if let Some(bar) = &images_bar {
            check_len("images_bar", bar.len(), images.len())?;
        }
        // Taken out, so that the convolutions can have the rest of the workspace.
        let (mut bars, mut mean_bar) = (core::mem::take(&mut work.maps), core::mem::take(&mut work.mean));
        let mut maps = core::mem::take(&mut work.sizes);
        maps.clear();
        self.each_map(size, |map| maps.push(map))?;
        let widest = maps.iter().map(|m| m.len).max().unwrap_or(0);
        let [bar, next] = bars.each_mut().map(|b| grown(b, widest));
        let means = grown(&mut mean_bar, size.images * self.head.inputs());
        let grads = Backward { encoder: self, simd, params, images, size, acts, maps: &maps };
        let result = grads.run(codes_bar, params_bar, images_bar, means, [bar, next], work);
        (work.maps, work.mean, work.sizes) = (bars, mean_bar, maps);
        result
    }

    fn head_range(&self) -> Range<usize> {
        self.ranges[self.layers.len()].clone()
    }

    /// The feature maps behind each convolution, one after the other.
    fn each_map(&self, size: Size, mut f: impl FnMut(Map)) -> Result<(), FieldError> {
        for (what, n) in [("height", size.height), ("width", size.width)] {
            if n < self.min_side() {
                return Err(FieldError::Config {
                    what,
                    got: n as f64,
                    accepts: "at least 2 pixels for each halving and 4",
                });
            }
        }
        let mut size = size;
        for conv in &self.layers {
            size = conv.output_size(size)?;
            f(Map { size, len: size.len(conv.outputs()) });
        }
        Ok(())
    }

    fn check(&self, params: &[f32], images: &[f32], size: Size, acts: usize) -> Result<(), FieldError> {
        let want = self.activations_len(size)?;
        check_len("params", params.len(), self.param_count())?;
        check_len("images", images.len(), size.len(self.config.inputs))?;
        check_len("acts", acts, want)
    }
}

struct Backward<'a> {
    encoder: &'a Encoder,
    simd: Simd,
    params: &'a [f32],
    images: &'a [f32],
    size: Size,
    acts: &'a [f32],
    maps: &'a [Map],
}

impl Backward<'_> {
    fn run(
        &self,
        codes_bar: &[f32],
        params_bar: &mut [f32],
        mut images_bar: Option<&mut [f32]>,
        means_bar: &mut [f32],
        [mut bar, mut next]: [&mut [f32]; 2],
        work: &mut Workspace,
    ) -> Result<(), FieldError> {
        let Self { encoder, simd, params, images, size, acts, maps } = *self;
        let one = Size { images: size.images, height: 1, width: 1 };
        let (mut end, range) = (acts.len() - means_bar.len(), encoder.head_range());
        means_bar.fill(0.0);
        let means = Some(&mut *means_bar);
        let head_bar = &mut params_bar[range.clone()];
        encoder.head.backward(simd, &params[range], &acts[end..], one, codes_bar, head_bar, means, work)?;
        let Some(last) = maps.last() else { return Ok(()) };
        bar[..last.len].fill(0.0);
        global_mean_backward(means_bar, encoder.head.inputs(), last.size, &mut bar[..last.len])?;
        for (i, conv) in encoder.layers.iter().enumerate().rev() {
            let start = end - maps[i].len;
            relu_backward(&acts[start..end], &mut bar[..maps[i].len]);
            let (before, before_size) = match i.checked_sub(1) {
                Some(before) => (&acts[start - maps[before].len..start], maps[before].size),
                None => (images, size),
            };
            let before_bar = if i > 0 {
                next[..before.len()].fill(0.0);
                Some(&mut next[..before.len()])
            } else {
                images_bar.take()
            };
            let own = &mut params_bar[encoder.ranges[i].clone()];
            let y_bar = &bar[..maps[i].len];
            conv.backward(simd, &params[encoder.ranges[i].clone()], before, before_size, y_bar, own, before_bar, work)?;
            core::mem::swap(&mut bar, &mut next);
            end = start;
        }
        Ok(())
    }
}
