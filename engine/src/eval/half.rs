//! Halves of photos, and the pixels an appearance is fitted to.

use image::RgbImage;
use render_core::ray::Ray;
use scene_io::Image;
use std::ops::Range;

/// Pixels of a fit at most; larger photos give every second, third … column and row. Far more than a fit draws.
const MOST_PIXELS: u64 = 1 << 18;

/// First column of the right half.
pub(crate) fn middle(width: u32) -> u32 {
    width / 2
}

/// The columns of a picture from `from` on.
pub(crate) fn right(picture: &RgbImage) -> RgbImage {
    let from = middle(picture.width());
    image::imageops::crop_imm(picture, from, 0, picture.width() - from, picture.height()).to_image()
}

/// The same of a mask, `width` values a row.
pub(crate) fn right_mask(mask: &[u8], width: u32) -> Vec<u8> {
    let (width, from) = (width as usize, middle(width) as usize);
    mask.chunks_exact(width.max(1)).flat_map(|row| row[from..].iter().copied()).collect()
}

/// The left half of a photo.
pub(crate) fn left(photo: &Image) -> Image {
    let (width, to) = (photo.width as usize, middle(photo.width) as usize);
    let rows = |values: &[u8], channels: usize| -> Vec<u8> {
        values.chunks_exact((width * channels).max(1)).flat_map(|row| row[..to * channels].iter().copied()).collect()
    };
    Image {
        width: middle(photo.width),
        height: photo.height,
        channels: photo.channels,
        data: rows(&photo.data, photo.channels.into()),
        mask: photo.mask.as_deref().map(|mask| rows(mask, 1)),
    }
}

/// Rays and colours of the pixels of some columns of a photo that the lens has a ray for and no mask ignores; `truth` is the
/// photo on the background.
pub(crate) fn pixels(
    photo: &Image,
    truth: &RgbImage,
    columns: Range<u32>,
    ray: impl Fn(u32, u32) -> Option<Ray>,
) -> (Vec<Ray>, Vec<[f32; 3]>) {
    let all = u64::from(columns.end.saturating_sub(columns.start)) * u64::from(photo.height);
    let stride = (1..).find(|s| all <= MOST_PIXELS * s * s).unwrap_or(1) as usize;
    let (mut rays, mut rgb) = (Vec::new(), Vec::new());
    for y in (0..photo.height).skip(stride / 2).step_by(stride) {
        for x in columns.clone().skip(stride / 2).step_by(stride) {
            if !photo.is_used(x, y) {
                continue;
            }
            if let Some(ray) = ray(x, y) {
                rays.push(ray);
                rgb.push(truth.get_pixel(x, y).0.map(|c| f32::from(c) / 255.0));
            }
        }
    }
    (rays, rgb)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn the_halves_of_odd_widths_meet_and_do_not_overlap() {
        let data: Vec<u8> = (0..5 * 2 * 3).collect();
        let mut photo = Image::rgb(5, 2, data.clone()).unwrap();
        photo.mask = Some((0..10).collect());
        let (a, b) = (left(&photo), right(&RgbImage::from_raw(5, 2, data.clone()).unwrap()));
        assert_eq!((a.width, a.height, b.width(), b.height()), (2, 2, 3, 2));
        assert_eq!(a.data, [&data[..6], &data[15..21]].concat());
        assert_eq!(b.into_raw(), [&data[6..15], &data[21..]].concat());
        assert_eq!(a.mask.unwrap(), [0, 1, 5, 6]);
        assert_eq!(right_mask(&photo.mask.unwrap(), 5), [2, 3, 4, 7, 8, 9]);
    }

    #[test]
    fn ignored_pixels_and_pixels_without_a_ray_are_left_out() {
        let mut photo = Image::rgb(3, 1, vec![255, 0, 0, 0, 255, 0, 0, 0, 255]).unwrap();
        photo.mask = Some(vec![255, 0, 255]);
        let truth = RgbImage::from_raw(3, 1, photo.data.clone()).unwrap();
        let ray = |x: u32, _: u32| (x != 2).then(|| Ray { o: DVec3::ZERO, d: DVec3::X * f64::from(x + 1) });
        let (rays, rgb) = pixels(&photo, &truth, 0..3, ray);
        assert_eq!((rays.len(), rgb), (1, vec![[1.0, 0.0, 0.0]]));
    }

    #[test]
    fn large_photos_are_thinned_out_evenly() {
        let photo = Image::rgb(1200, 900, vec![7; 1200 * 900 * 3]).unwrap();
        let truth = RgbImage::from_raw(1200, 900, photo.data.clone()).unwrap();
        let (rays, _) = pixels(&photo, &truth, 0..1200, |x, y| {
            Some(Ray { o: DVec3::ZERO, d: DVec3::new(f64::from(x), f64::from(y), 1.0) })
        });
        assert_eq!(rays.len(), 400 * 300);
        assert_eq!((rays[0].d.x, rays[1].d.x), (1.0, 4.0));
    }
}
