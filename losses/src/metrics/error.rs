//! What can be wrong with the images of a metric.

use core::fmt;

/// A pair of images that a metric is not defined for.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum MetricError {
    /// The data of an image, or a mask, should hold `want` values and holds `got`.
    Shape {
        /// What holds them.
        what: &'static str,
        /// `width * height * channels`, or `width * height` for a mask.
        want: usize,
        /// Values there are.
        got: usize,
    },
    /// The two images differ in size or channels.
    Mismatch {
        /// `[width, height, channels]` of the first.
        a: [usize; 3],
        /// `[width, height, channels]` of the second.
        b: [usize; 3],
    },
    /// An image has another number of channels than the metric is defined for.
    Channels {
        /// Channels the metric needs.
        want: usize,
        /// Channels the images have.
        got: usize,
    },
    /// The images are smaller than the window of the metric.
    TooSmall {
        /// The metric.
        metric: &'static str,
        /// Smallest side, in pixels, that it needs.
        min_side: usize,
        /// Width of the images.
        width: usize,
        /// Height of the images.
        height: usize,
    },
    /// A value is NaN or infinite.
    NonFinite {
        /// Index into the data, in memory order.
        index: usize,
    },
    /// A mask value is not in `[0, 1]`.
    Mask {
        /// Index into the mask.
        index: usize,
        /// What it holds.
        value: f32,
    },
    /// The mask keeps nothing: the metric is undefined for this image. Skip it, and count it.
    EmptyMask,
    /// Values so far outside `[0, 1]` that the metric overflows.
    Overflow {
        /// The metric.
        metric: &'static str,
    },
}

impl fmt::Display for MetricError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape { what, want, got } => write!(f, "the {what} holds {got} values, expected {want}"),
            Self::Mismatch { a: [aw, ah, ac], b: [bw, bh, bc] } => {
                write!(f, "images of different shapes: {aw}x{ah} with {ac} channels and {bw}x{bh} with {bc}")
            }
            Self::Channels { want, got } => write!(f, "the images have {got} channels, the metric needs {want}"),
            Self::TooSmall { metric, min_side, width, height } => {
                write!(f, "{metric} needs images of at least {min_side} pixels a side, these are {width}x{height}")
            }
            Self::NonFinite { index } => write!(f, "value {index} of an image is NaN or infinite"),
            Self::Mask { index, value } => write!(f, "value {index} of the mask is {value}, expected 0 to 1"),
            Self::EmptyMask => write!(f, "the mask keeps no pixel"),
            Self::Overflow { metric } => write!(f, "{metric} overflows: the images hold values far outside 0 to 1"),
        }
    }
}

impl core::error::Error for MetricError {}
