//! Small images.

use proptest::collection::vec;
use proptest::prelude::*;

/// An image of bytes: rows top to bottom, channels interleaved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageData {
    /// Columns, at least 1.
    pub width: usize,
    /// Rows, at least 1.
    pub height: usize,
    /// Values per pixel.
    pub channels: usize,
    /// `[height][width][channels]`.
    pub data: Vec<u8>,
}

impl ImageData {
    /// The pixel in column `x` of row `y`.
    ///
    /// # Panics
    /// If it lies outside.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> &[u8] {
        assert!(x < self.width, "column {x} of {}", self.width);
        let start = (y * self.width + x) * self.channels;
        &self.data[start..start + self.channels]
    }

    /// Values divided by 255.
    #[must_use]
    pub fn unit(&self) -> Vec<f32> {
        self.data.iter().map(|&v| f32::from(v) / 255.0).collect()
    }
}

/// An image of `channels` values per pixel, each side `1..=longest`: noise, one colour, a ramp, black and white.
///
/// # Panics
/// If `longest` is 0.
pub fn any_image(channels: usize, longest: usize) -> impl Strategy<Value = ImageData> {
    assert!(longest > 0, "an image has at least one pixel");
    (1..=longest, 1..=longest, 0..4_u8).prop_flat_map(move |(width, height, kind)| {
        let n = width * height * channels;
        let data = match kind {
            0 => vec(any::<u8>(), n).boxed(),
            1 => vec(any::<u8>(), channels).prop_map(move |c| c.repeat(width * height)).boxed(),
            2 => (any::<u8>(), any::<u8>())
                .prop_map(move |(start, step)| {
                    (0..n).map(|i| start.wrapping_add(step.wrapping_mul((i / channels.max(1)) as u8))).collect()
                })
                .boxed(),
            _ => vec(prop_oneof![Just(0_u8), Just(255)], n).boxed(),
        };
        data.prop_map(move |data| ImageData { width, height, channels, data })
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::count;
    use super::*;

    proptest! {
        #![proptest_config(crate::property::cases(128))]

        #[test]
        fn images_have_the_size_they_say(image in any_image(3, 9)) {
            prop_assert!((1..=9).contains(&image.width) && (1..=9).contains(&image.height));
            prop_assert_eq!(image.data.len(), image.width * image.height * 3);
            prop_assert_eq!(image.pixel(image.width - 1, image.height - 1), &image.data[image.data.len() - 3..]);
            prop_assert!(image.unit().iter().all(|v| (0.0..=1.0).contains(v)));
        }
    }

    #[test]
    fn the_special_cases_come_up() {
        assert!(count(any_image(1, 4), |i| i.data.len() == 1) > 5);
        assert!(count(any_image(3, 8), |i| i.data.chunks(3).all(|p| p == &i.data[..3])) > 50);
        assert!(count(any_image(3, 8), |i| i.data.iter().all(|v| *v == 0 || *v == 255)) > 50);
    }
}
