//! Size of an image.

use crate::{LossError, error::same};

/// Size of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Extent {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Extent {
    /// Number of pixels, the largest number where that is more than can be counted.
    #[must_use]
    pub const fn pixels(self) -> usize {
        self.width.saturating_mul(self.height)
    }

    /// The argument holds one value for each pixel.
    pub(super) fn check(self, what: &'static str, got: usize) -> Result<(), LossError> {
        same(what, self.pixels(), got)
    }
}
