//! The size of a picture.

use render_core::camera::Camera;
use std::fmt;

/// The size of a picture, pixels. It is written `WIDTHxHEIGHT`.
///
/// ```
/// use scene_io::Size;
///
/// let size = Size::new(640, 480);
/// assert_eq!((size.to_string().as_str(), size.pixels(), size.longest_side()), ("640x480", 307_200, 640));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Size {
    /// A picture of `width` columns and `height` rows.
    #[must_use]
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Columns times rows.
    #[must_use]
    pub fn pixels(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// The larger one of columns and rows.
    #[must_use]
    pub fn longest_side(self) -> u32 {
        self.width.max(self.height)
    }
}

/// Columns and rows, as the crate `image` gives them.
impl From<(u32, u32)> for Size {
    fn from(columns_and_rows: (u32, u32)) -> Self {
        Self { width: columns_and_rows.0, height: columns_and_rows.1 }
    }
}

/// The size of the pictures that a camera takes.
impl From<&Camera> for Size {
    fn from(camera: &Camera) -> Self {
        Self { width: camera.width, height: camera.height }
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}
