//! Pixels in memory, and how they get there.

mod decode;
pub(crate) mod foreign;
mod jpeg;
mod plan;
mod png;
mod refusal;
mod resize;
mod store;
mod webp;

pub(crate) use decode::{decode_labels, with_mask};
pub use decode::{decode_photo, photo_size, with_photo};
pub(crate) use plan::{Plan, exr_blocks};
pub(crate) use refusal::wrong_size;
pub(crate) use resize::scaling_bytes;
pub(crate) use store::same_shape;
pub use store::{ImageStore, StoreOptions};

/// An 8-bit image: display-referred sRGB as in the file, rows top to bottom, channels interleaved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// 3 (RGB) or 4 (RGB and straight alpha).
    pub channels: u8,
    /// `height * width * channels` values.
    pub data: Vec<u8>,
    /// Ignore mask, `height * width` values: 255 = used, 0 = ignored. `None`: all used.
    pub mask: Option<Vec<u8>>,
}

impl Image {
    /// An RGB image; `None` if `data` does not hold `width * height * 3` values.
    #[must_use]
    pub fn rgb(width: u32, height: u32, data: Vec<u8>) -> Option<Self> {
        Self::checked(width, height, 3, data)
    }

    /// An RGBA image with straight alpha; `None` if `data` does not hold `width * height * 4` values.
    #[must_use]
    pub fn rgba(width: u32, height: u32, data: Vec<u8>) -> Option<Self> {
        Self::checked(width, height, 4, data)
    }

    fn checked(width: u32, height: u32, channels: u8, data: Vec<u8>) -> Option<Self> {
        let want = u64::from(width) * u64::from(height) * u64::from(channels);
        (data.len() as u64 == want).then_some(Self { width, height, channels, data, mask: None })
    }

    /// The values of a pixel, 3 or 4 of them.
    ///
    /// # Panics
    /// Outside the image.
    #[must_use]
    pub fn pixel(&self, column: u32, row: u32) -> &[u8] {
        assert!(
            column < self.width && row < self.height,
            "pixel ({column}, {row}) outside {}x{}",
            self.width,
            self.height
        );
        let channels = usize::from(self.channels);
        let start = (row as usize * self.width as usize + column as usize) * channels;
        &self.data[start..start + channels]
    }

    /// Whether a pixel takes part in the loss.
    ///
    /// # Panics
    /// Outside the image.
    #[must_use]
    pub fn is_used(&self, column: u32, row: u32) -> bool {
        assert!(
            column < self.width && row < self.height,
            "pixel ({column}, {row}) outside {}x{}",
            self.width,
            self.height
        );
        self.mask.as_ref().is_none_or(|m| m[row as usize * self.width as usize + column as usize] >= 128)
    }

    /// The image at another size: each pixel is the mean of the area it covers, colours weighted with their opacity. A pixel
    /// of the mask is used where half of its area is.
    ///
    /// # Panics
    /// If `data` or `mask` is shorter than the size says, or there are fewer than three channels.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) { self.clone() } else { resize::scaled(self, width, height) }
    }

    /// Bytes of memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (self.data.len() + self.mask.as_ref().map_or(0, Vec::len)) as u64
    }
}
