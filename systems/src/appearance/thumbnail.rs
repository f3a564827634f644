//! Small pictures of photos: the input of the encoder.

use field_core::conv::Size;
use scene_io::Image;

/// Smallest part of a photo, along each side.
const SMALLEST_PART: f32 = 0.5;

/// `[3][height][width]`, and the opacity `[height][width]`.
pub(super) struct Thumbnail {
    pub(super) size: Size,
    pub(super) planes: Vec<u8>,
    pub(super) alpha: Vec<u8>,
}

impl Thumbnail {
    /// A photo at `side` pixels along its longer side, and at least `least` along the other. Pixels that a mask
    /// ignores and transparent ones are grey.
    pub(super) fn of(photo: &Image, side: usize, least: usize) -> Self {
        let (width, height) = (photo.width as usize, photo.height as usize);
        let longest = width.max(height).max(1);
        let [width, height] = [width, height].map(|n| ((n * side + longest / 2) / longest).max(least));
        let size = Size::one(height, width);
        let small = photo.resized(width as u32, height as u32);
        let (mut planes, mut opacity) = (vec![0; 3 * size.pixels()], vec![0; size.pixels()]);
        for i in 0..size.pixels() {
            let [x, y] = [i % width, i / width].map(|n| n as u32);
            let pixel = small.pixel(x, y);
            let alpha = if small.is_used(x, y) { pixel.get(3).map_or(255, |&a| u32::from(a)) } else { 0 };
            for c in 0..3 {
                let value = u32::from(pixel[c]) * alpha + 128 * (255 - alpha);
                planes[c * size.pixels() + i] = ((value + 127) / 255) as u8;
            }
            opacity[i] = alpha as u8;
        }
        Self { size, planes, alpha: opacity }
    }

    /// A part of it, at least `least` pixels along each side: `u` uniform numbers for its size and place.
    pub(super) fn part(&self, least: usize, uniform: [f32; 4]) -> Self {
        let [u, x, y, _] = uniform;
        let span = SMALLEST_PART + (1.0 - SMALLEST_PART) * u;
        let cut = |n: usize, at: f32| {
            let part = ((n as f32 * span) as usize).clamp(least.min(n), n);
            let start = (((n - part + 1) as f32 * at) as usize).min(n - part);
            start..start + part
        };
        let (rows, columns) = (cut(self.size.height, y), cut(self.size.width, x));
        let take = |from: &[u8]| -> Vec<u8> {
            from.chunks_exact(self.size.pixels())
                .flat_map(|plane| rows.clone().flat_map(|row| &plane[row * self.size.width..][columns.clone()]))
                .copied()
                .collect()
        };
        Self { size: Size::one(rows.len(), columns.len()), planes: take(&self.planes), alpha: take(&self.alpha) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thumbnails_have_one_longest_side_and_no_side_too_small() {
        for (size, want) in
            [((640, 480), (32, 24)), ((480, 640), (24, 32)), ((20, 20), (32, 32)), ((3000, 20), (32, 16))]
        {
            let photo = Image::rgb(size.0, size.1, vec![9; (size.0 * size.1 * 3) as usize]).unwrap();
            let small = Thumbnail::of(&photo, 32, 16);
            assert_eq!((small.size.width, small.size.height), want, "{size:?}");
            assert!(small.planes.len() == 3 * want.0 * want.1 && small.planes.iter().all(|&v| v == 9));
        }
    }

    #[test]
    fn parts_lie_within_the_photo_and_are_large_enough() {
        let mut data: Vec<u8> = (0..24 * 16).flat_map(|i| [i % 24, i / 24, 7]).map(|v| v as u8).collect();
        data.truncate(24 * 16 * 3);
        let whole = Thumbnail::of(&Image::rgb(24, 16, data).unwrap(), 24, 8);
        for (u, size, first) in [
            ([1.0, 0.3, 0.9, 0.0], (24, 16), [0, 0]),
            ([0.0, 0.0, 0.0, 0.0], (12, 8), [0, 0]),
            ([0.0, 0.999_999, 0.999_999, 0.0], (12, 8), [12, 8]),
            ([0.5, 0.5, 0.0, 0.0], (18, 12), [3, 0]),
        ] {
            let part = whole.part(8, u);
            assert_eq!((part.size.width, part.size.height), size, "{u:?}");
            let n = size.0 * size.1;
            assert_eq!((part.planes.len(), part.alpha.len()), (3 * n, n));
            assert_eq!([part.planes[0], part.planes[n]], first, "{u:?}");
            let last = [first[0] as usize + size.0 - 1, first[1] as usize + size.1 - 1];
            assert_eq!([part.planes[n - 1], part.planes[2 * n - 1]].map(usize::from), last, "{u:?}");
        }
        assert_eq!(whole.part(16, [0.0; 4]).size, Size::one(16, 16));
    }

    #[test]
    fn what_is_transparent_or_ignored_is_grey() {
        let mut photo = Image::rgba(16, 16, [200, 100, 0, 0].repeat(256)).unwrap();
        assert!(Thumbnail::of(&photo, 16, 16).planes.iter().all(|&v| v == 128));
        photo.data = [200, 100, 0, 255].repeat(256);
        let planes = Thumbnail::of(&photo, 16, 16).planes;
        assert_eq!([planes[0], planes[256], planes[512]], [200, 100, 0]);
        photo.mask = Some(vec![0; 256]);
        assert!(Thumbnail::of(&photo, 16, 16).planes.iter().all(|&v| v == 128));
    }
}
