//! Convolution and pooling of small images: for encoders that turn a photo into an appearance code.
//!
//! A batch is `[image][channel][row][column]`, its extent a [`Size`]. Weights of a convolution are `[out][in][row][column]`, then
//! biases `[out]`. Everything is a pair, `forward` and `backward`; backward functions **add** into gradients unless they say
//! otherwise.
//!
//! | pair | what |
//! | --- | --- |
//! | [`Conv2d`] | convolution with stride, zeros or mirrored pixels around the image ([`Padding`]) |
//! | [`relu`], [`relu_backward`] | in place |
//! | [`global_mean`], [`max_pool`], [`adaptive_mean`] | pooling: to one number a channel, 2 x 2 to one, to any size |
//! | [`resize`] | bilinear, half-pixel centres |
//! | [`Encoder`] | image to code: convolutions that halve, mean, linear layer |
//!
//! A convolution is a product of matrices: the pixels under the kernel become columns (of one tile of pixels at a time), and
//! the panels of [`mlp`](crate::mlp) multiply. Buffers live in a [`Workspace`] that the caller keeps; it grows on the first
//! call and is not allocated again.
//!
//! ```
//! use field_core::conv::{Conv2d, Padding, Size, Workspace};
//! use float_core::Simd;
//!
//! // A difference to the right neighbour, mirrored at the edge.
//! let conv = Conv2d::new(1, 1, 3, 1, Padding::Reflect(1)).unwrap();
//! let params = [0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0];
//! let size = Size { images: 1, height: 2, width: 3 };
//! let (mut out, mut work) = ([0.0; 6], Workspace::default());
//! conv.forward(Simd::best(), &params, &[1.0, 2.0, 4.0, 8.0, 7.0, 6.0], size, &mut out, &mut work).unwrap();
//! assert_eq!(out, [1.0, 2.0, -2.0, -1.0, -1.0, 1.0]);
//! // A row of one pixel has nothing to mirror.
//! let thin = conv.output_size(Size { width: 1, ..size }).unwrap_err();
//! assert_eq!(thin.to_string(), "`width` is 1, expected more pixels than the padding mirrors");
//! ```

mod columns;
mod encoder;
mod layer;
mod pad;
mod pool;
mod resize;

pub use encoder::{Encoder, EncoderConfig};
pub use layer::Conv2d;
pub use pad::Padding;
pub use pool::{
    adaptive_mean, adaptive_mean_backward, global_mean, global_mean_backward, max_pool, max_pool_backward,
    max_pool_size,
};
pub use resize::{resize, resize_backward};

use crate::mlp::Packed;
use alloc::vec::Vec;

/// Extent of a batch of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// How many.
    pub images: usize,
    /// Rows of each.
    pub height: usize,
    /// Columns of each.
    pub width: usize,
}

impl Size {
    /// One image.
    #[must_use]
    pub const fn one(height: usize, width: usize) -> Self {
        Self { images: 1, height, width }
    }

    /// Pixels of one image; the most that can be counted where there are more.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.height.saturating_mul(self.width)
    }

    /// Numbers of the batch; the most that can be counted where there are more.
    #[must_use]
    pub const fn len(self, channels: usize) -> usize {
        self.images.saturating_mul(channels).saturating_mul(self.pixels())
    }

    /// As many images of another extent.
    const fn with_extent(self, extent: Extent) -> Self {
        Self { images: self.images, height: extent.height, width: extent.width }
    }
}

/// Rows and columns of one map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Extent {
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
}

impl Extent {
    /// `height` rows of `width` numbers.
    #[must_use]
    pub const fn new(height: usize, width: usize) -> Self {
        Self { height, width }
    }

    /// Numbers of a map; the most that can be counted where there are more.
    #[must_use]
    pub const fn len(self) -> usize {
        self.height.saturating_mul(self.width)
    }

    /// Whether there is no number.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// Buffers of convolutions, of any layers and sizes one after the other. They grow and stay.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    packed: Packed,
    /// The image with its border, and its gradient.
    padded: Vec<f32>,
    padded_bar: Vec<f32>,
    /// Pixels under the kernel, `[in * kernel * kernel][tile]`, and their gradients.
    columns: Vec<f32>,
    columns_bar: Vec<f32>,
    /// Those of the network that multiplies.
    panels: Vec<f32>,
    scratch: Vec<f32>,
    grad: Vec<f32>,
    /// Extents of an encoder's feature maps, gradients of two of them, and of their means.
    sizes: Vec<Map>,
    maps: [Vec<f32>; 2],
    mean: Vec<f32>,
}

/// Feature maps of a batch.
#[derive(Clone, Copy, Debug)]
struct Map {
    size: Size,
    /// Numbers of all of them.
    len: usize,
}

/// The first `n` numbers of a buffer that grows to hold them.
fn grown(buffer: &mut Vec<f32>, n: usize) -> &mut [f32] {
    if buffer.len() < n {
        buffer.resize(n, 0.0);
    }
    &mut buffer[..n]
}

/// `max(x, 0)` in place; NaN becomes 0.
pub fn relu(x: &mut [f32]) {
    for x in x {
        *x = x.max(0.0);
    }
}

/// Gradient of [`relu`], in place: zero where the output `y` is not positive.
///
/// # Panics
/// When the lengths differ.
pub fn relu_backward(y: &[f32], bar: &mut [f32]) {
    assert_eq!(y.len(), bar.len(), "relu: outputs and gradients differ in length");
    for (bar, &y) in bar.iter_mut().zip(y) {
        *bar = if y > 0.0 { *bar } else { 0.0 };
    }
}
