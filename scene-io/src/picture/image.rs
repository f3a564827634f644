//! Images and photos as numbers.

use crate::Size;

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

/// A photo as numbers: [`Scene::picture`](crate::Scene::picture).
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Picture {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `[height * width]` sRGB colours in `[0, 1]`, rows top to bottom; not multiplied by alpha.
    pub rgb: Vec<[f32; 3]>,
    /// `[height * width]` opacities in `[0, 1]`; `None`: all opaque.
    pub alpha: Option<Vec<f32>>,
    /// `[height * width]` whether a pixel takes part in the loss; `None`: all of them do.
    pub used: Option<Vec<bool>>,
}

impl Picture {
    pub(crate) fn of(image: &Image) -> Self {
        let unit = |v: u8| f32::from(v) / 255.0;
        let pixels = || image.data.chunks_exact(usize::from(image.channels));
        Self {
            width: image.width,
            height: image.height,
            rgb: pixels().map(|p| [unit(p[0]), unit(p[1]), unit(p[2])]).collect(),
            alpha: (image.channels == 4).then(|| pixels().map(|p| unit(p[3])).collect()),
            used: image.mask.as_ref().map(|mask| mask.iter().map(|&m| m >= 128).collect()),
        }
    }

    /// The colours over a background, `[height * width]`: `rgb * alpha + background * (1 - alpha)`.
    #[must_use]
    pub fn over(&self, background: [f32; 3]) -> Vec<[f32; 3]> {
        let Some(alpha) = &self.alpha else { return self.rgb.clone() };
        let mixed = |(rgb, &a): (&[f32; 3], &f32)| [0, 1, 2].map(|c| rgb[c] * a + background[c] * (1.0 - a));
        self.rgb.iter().zip(alpha).map(mixed).collect()
    }
}

impl Image {
    /// Columns and rows.
    #[must_use]
    pub fn size(&self) -> Size {
        Size::new(self.width, self.height)
    }

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
        let want = Size::new(width, height).pixels() * u64::from(channels);
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

    /// Bytes of memory held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (self.data.len() + self.mask.as_ref().map_or(0, Vec::len)) as u64
    }
}
