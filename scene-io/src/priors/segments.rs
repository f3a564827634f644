//! Segments of a photo: label maps and stacks of masks.

use crate::bit_mask::{BitMask, nearest};

/// Segments of a photo.
#[derive(Clone, Debug, PartialEq)]
pub enum Segments {
    /// Each pixel belongs to one segment or to none.
    Labels(LabelMap),
    /// Segments that may overlap, in the order of their files' names.
    Stack(Vec<BitMask>),
}

impl Segments {
    /// The segments at another size, each pixel as the nearest of the old ones.
    ///
    /// # Panics
    /// As [`LabelMap::resized`].
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        match self {
            Self::Labels(map) => Self::Labels(map.resized(width, height)),
            Self::Stack(masks) => Self::Stack(masks.iter().map(|m| m.resized(width, height)).collect()),
        }
    }
}

/// A number for each pixel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LabelMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height * width` labels; 0 is not a segment. Labels need not be contiguous.
    pub labels: Vec<u16>,
}

impl LabelMap {
    /// The map at another size, each pixel as the nearest of the old ones.
    ///
    /// # Panics
    /// If there are labels, but fewer than the size says.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if self.labels.is_empty() {
            return Self { width, height, labels: vec![0; width as usize * height as usize] };
        }
        let columns: Vec<usize> = (0..width).map(|x| nearest(x, width, self.width) as usize).collect();
        let row = |y| nearest(y, height, self.height) as usize * self.width as usize;
        let labels = (0..height).flat_map(|y| columns.iter().map(move |x| row(y) + x)).map(|at| self.labels[at]);
        Self { width, height, labels: labels.collect() }
    }
}

/// A segment that a feature point of the photo stands for.
#[derive(Clone, Debug, PartialEq)]
pub struct PromptedSegment {
    /// Its pixels.
    pub mask: BitMask,
    /// How sure the segmenter was, where it said so.
    pub score: Option<f32>,
    /// How little the segment changes with the segmenter's threshold, where it said so.
    pub stability: Option<f32>,
}
