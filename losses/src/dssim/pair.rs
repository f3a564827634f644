//! A rendered picture beside the truth, and what the gradient of its loss is multiplied by.

/// The truth of a picture.
#[derive(Clone, Copy, Debug)]
pub enum Target<'a> {
    /// `[channel][row][column]`.
    Planes(&'a [f32]),
    /// `[row][column][channel]`, read as `value / 255`.
    Bytes(&'a [u8]),
}

/// A rendered picture and what it should be.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// Channels of both.
    pub channels: usize,
    /// Rows of both.
    pub height: usize,
    /// Columns of both.
    pub width: usize,
    /// `[channel][row][column]`, `[0, 1]` expected, not clamped.
    pub x: &'a [f32],
    /// The truth.
    pub target: Target<'a>,
    /// `[row][column]`, `>= 0`, of the maps of both losses: 0 leaves a pixel out. One each where absent.
    ///
    /// A pixel that is left out is like one beyond the edge: windows see black there in both pictures, and it has no gradient.
    pub weights: Option<&'a [f32]>,
}

/// What the gradient of each map is multiplied by.
#[derive(Clone, Copy)]
pub(super) struct Derivatives {
    pub(super) l1: f32,
    pub(super) dssim: f32,
}
