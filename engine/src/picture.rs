//! Layers to 8-bit pictures that people look at.

use crate::error::RunError;
use crate::output::{Storage, write_file};
use crate::render::Rendered;
use image::codecs::gif::{GifEncoder, Repeat};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{Delay, ExtendedColorType, Frame, GrayImage, ImageEncoder, RgbImage, RgbaImage};
use losses::metrics::quantise_value;
use render_core::camera::Camera;
use std::path::Path;

/// Absolute colour error that the error map draws as its brightest colour.
pub const ERROR_MAP_TOP: f32 = 0.25;

/// Colour, clipped to `[0, 1]`.
///
/// # Panics
/// If a layer it draws is shorter than the picture.
pub fn colour(view: &Rendered) -> RgbImage {
    picture(view, |i| view.layers.rgb[i].map(quantise_value))
}

/// Colours of what stands still behind what moves; `None` where the render has none.
#[must_use]
pub fn behind(view: &Rendered) -> Option<RgbImage> {
    (view.layers.behind.len() == view.layers.rgb.len())
        .then(|| picture(view, |i| view.layers.behind[i].map(quantise_value)))
}

/// Opacity as grey.
///
/// # Panics
/// If a layer it draws is shorter than the picture.
pub fn opacity(view: &Rendered) -> RgbImage {
    picture(view, |i| [quantise_value(view.layers.opacity[i]); 3])
}

/// Normals of the world's frame as colour, `(n + 1) / 2`; black where nothing was hit.
pub fn normals(view: &Rendered) -> RgbImage {
    picture(view, |i| match view.layers.normal.get(i) {
        Some(&n) if n != [0.0; 3] => n.map(|c| quantise_value(c * 0.5 + 0.5)),
        _ => [0; 3],
    })
}

/// Canonical points as colour: their place in the box `[min, max]`, x red, y green, z blue, beyond it as on its faces; black
/// where nothing was hit.
pub fn canonical(view: &Rendered, bounds: [[f64; 3]; 2]) -> RgbImage {
    let [min, max] = bounds;
    picture(view, |i| match view.layers.canonical.get(i) {
        Some(p) if p.iter().all(|x| x.is_finite()) => {
            [0, 1, 2].map(|a| quantise_value(((p[a] - min[a]) / (max[a] - min[a]).max(1e-12)) as f32))
        }
        _ => [0; 3],
    })
}

/// Distances `range[0]` (bright) to `range[1]` (dark), linear in inverse distance; black where nothing was hit.
///
/// # Panics
/// If a layer it draws is shorter than the picture.
pub fn depth(view: &Rendered, range: [f32; 2]) -> RgbImage {
    let [near, far] = range.map(|t| 1.0 / t.max(1e-6));
    let scale = 1.0 / (near - far).max(1e-12);
    picture(view, |i| {
        let t = view.layers.depth[i];
        match t.is_finite() {
            true => magma((1.0 / t.max(1e-6) - far) * scale),
            false => [0; 3],
        }
    })
}

/// Distances that most pixels of a picture lie between: the 2nd and 98th percentile of those that hit something.
pub fn depth_range(views: &[&Rendered]) -> [f32; 2] {
    let mut depths: Vec<f32> = views
        .iter()
        .flat_map(|v| v.layers.depth.iter().zip(&v.layers.opacity))
        .filter(|(t, opacity)| t.is_finite() && **opacity > 0.5)
        .map(|(t, _)| *t)
        .collect();
    if depths.is_empty() {
        return [0.0, 1.0];
    }
    depths.sort_by(f32::total_cmp);
    let at = |share: f64| depths[((depths.len() - 1) as f64 * share).round() as usize];
    [at(0.02) * 0.98, at(0.98) * 1.02]
}

/// Mean absolute colour error of each pixel, 0 (black) to [`ERROR_MAP_TOP`] and above (bright).
///
/// # Panics
/// When the two pictures differ in size.
pub fn error_map(rendered: &RgbImage, truth: &RgbImage) -> RgbImage {
    assert_eq!(rendered.dimensions(), truth.dimensions(), "pictures of one view have one size");
    let mut map = rendered.clone();
    for (out, truth) in map.pixels_mut().zip(truth.pixels()) {
        let sum: u32 = out.0.iter().zip(truth.0).map(|(a, b)| u32::from(a.abs_diff(b))).sum();
        out.0 = magma(sum as f32 / (3.0 * 255.0) / ERROR_MAP_TOP);
    }
    map
}

/// An 8-bit image of the dataset over a background colour.
///
/// # Panics
/// If the image has fewer than three channels.
pub fn over_background(image: &scene_io::Image, background: [f32; 3]) -> RgbImage {
    let channels = usize::from(image.channels);
    let mut out = RgbImage::new(image.width, image.height);
    for (out, p) in out.pixels_mut().zip(image.data.chunks_exact(channels)) {
        out.0 = match channels {
            4 => {
                let alpha = f32::from(p[3]) / 255.0;
                [0, 1, 2].map(|c| quantise_value(f32::from(p[c]) / 255.0 * alpha + background[c] * (1.0 - alpha)))
            }
            _ => [p[0], p[1], p[2]],
        };
    }
    out
}

/// Pictures of equal height side by side.
pub fn side_by_side(pictures: &[&RgbImage]) -> RgbImage {
    const GAP: u32 = 4; // white pixels between two pictures
    let width = pictures.iter().map(|p| p.width() + GAP).sum::<u32>().saturating_sub(GAP);
    let height = pictures.iter().map(|p| p.height()).max().unwrap_or(0);
    let mut out = RgbImage::from_pixel(width, height, image::Rgb([255; 3]));
    let mut x = 0;
    for picture in pictures {
        image::imageops::replace(&mut out, *picture, i64::from(x), 0);
        x += picture.width() + GAP;
    }
    out
}

/// `picture` as a PNG file in memory.
///
/// # Panics
/// If the picture has no pixels.
pub fn png_bytes(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    encoder
        .write_image(picture.as_raw(), picture.width(), picture.height(), ExtendedColorType::Rgb8)
        .expect("an RGB picture encodes into memory");
    bytes
}

/// `mask` as a grey PNG file in memory.
///
/// # Panics
/// If the picture has no pixels.
pub fn grey_png_bytes(mask: &GrayImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    encoder
        .write_image(mask.as_raw(), mask.width(), mask.height(), ExtendedColorType::L8)
        .expect("a grey picture encodes into memory");
    bytes
}

/// Write `picture` as PNG.
///
/// # Errors
/// [`RunError::Write`].
pub fn write_png(storage: &dyn Storage, path: &Path, picture: &RgbImage) -> Result<(), RunError> {
    write_file(storage, path, &png_bytes(picture))
}

/// An endless animation as a GIF file in memory.
///
/// # Errors
/// [`RunError::Option`] when the pictures cannot be a GIF: sides beyond 65535 pixels.
pub fn gif_bytes(pictures: &[RgbImage], frames_per_second: f64) -> Result<Vec<u8>, RunError> {
    let mut bytes = Vec::new();
    let failed = |e: image::ImageError| RunError::Option(format!("the animated preview cannot be made: {e}"));
    // Speed 10 of 30: the palette search is the slow part, and 256 colours are the limit anyway.
    let mut encoder = GifEncoder::new_with_speed(&mut bytes, 10);
    encoder.set_repeat(Repeat::Infinite).map_err(failed)?;
    let delay = Delay::from_saturating_duration(std::time::Duration::from_secs_f64(1.0 / frames_per_second.max(1.0)));
    for picture in pictures {
        let rgba: RgbaImage = image::DynamicImage::ImageRgb8(picture.clone()).into_rgba8();
        encoder.encode_frame(Frame::from_parts(rgba, 0, 0, delay)).map_err(failed)?;
    }
    drop(encoder);
    Ok(bytes)
}

/// `camera` with its longest side at most `side` pixels, aspect kept.
pub fn limited(camera: &Camera, side: Option<u32>) -> Camera {
    let longest = camera.width.max(camera.height);
    match side {
        Some(side) if side < longest => {
            let scaled = |n: u32| ((f64::from(n) * f64::from(side) / f64::from(longest)).round() as u32).max(1);
            camera.resized(scaled(camera.width), scaled(camera.height))
        }
        _ => *camera,
    }
}

fn picture(view: &Rendered, pixel: impl Fn(usize) -> [u8; 3]) -> RgbImage {
    let mut out = RgbImage::new(view.width, view.height);
    for (i, p) in out.pixels_mut().enumerate() {
        p.0 = pixel(i);
    }
    out
}

/// Colour map "magma" (Smith and van der Walt, CC0) by nine stops: dark to bright, even steps look even.
fn magma(x: f32) -> [u8; 3] {
    const STOPS: [[u8; 3]; 9] = [
        [0, 0, 4],
        [29, 17, 71],
        [81, 18, 124],
        [130, 37, 129],
        [183, 55, 121],
        [230, 81, 100],
        [251, 136, 97],
        [254, 194, 135],
        [252, 253, 191],
    ];
    let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) } * 8.0;
    let i = (x as usize).min(7);
    let f = x - i as f32;
    [0, 1, 2].map(|c| (f32::from(STOPS[i][c]) * (1.0 - f) + f32::from(STOPS[i + 1][c]) * f + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::Layers;

    #[test]
    fn straight_alpha_goes_over_the_background() {
        let image = scene_io::Image::rgba(2, 1, vec![255, 0, 0, 255, 255, 0, 0, 0]).unwrap();
        let out = over_background(&image, [0.0, 0.0, 1.0]);
        assert_eq!(out.into_raw(), [255, 0, 0, 0, 0, 255]);
    }

    #[test]
    fn the_error_map_is_black_where_pictures_agree_and_brightest_where_they_do_not() {
        let a = RgbImage::from_raw(2, 1, vec![10, 20, 30, 0, 0, 0]).unwrap();
        let b = RgbImage::from_raw(2, 1, vec![10, 20, 30, 255, 255, 255]).unwrap();
        assert_eq!(error_map(&a, &b).into_raw(), [0, 0, 4, 252, 253, 191]);
    }

    #[test]
    fn depth_draws_nothing_for_rays_that_hit_nothing() {
        let layers = Layers { depth: vec![f32::INFINITY, 1.0], opacity: vec![0.0, 1.0], ..Layers::default() };
        let view = Rendered { width: 2, height: 1, layers };
        let out = depth(&view, depth_range(&[&view])).into_raw();
        assert_eq!(out[..3], [0; 3]);
        assert!(out[3..].iter().any(|&c| c > 50));
    }

    #[test]
    fn canonical_points_are_drawn_by_their_place_in_the_box() {
        let canonical = vec![[0.0, 1.0, 3.0], [1.0, -9.0, 9.0], crate::system::NOWHERE];
        let view = Rendered { width: 3, height: 1, layers: Layers { canonical, ..Layers::default() } };
        let out = super::canonical(&view, [[-1.0, 0.0, 1.0], [1.0, 1.0, 3.0]]);
        assert_eq!(out.into_raw(), [128, 255, 255, 255, 0, 255, 0, 0, 0]);
        let without_canonical = Rendered { width: 1, height: 1, layers: Layers::default() };
        assert_eq!(super::canonical(&without_canonical, [[0.0; 3], [1.0; 3]]).into_raw(), [0; 3]);
    }

    #[test]
    fn a_gif_is_an_animation() {
        let frames = vec![RgbImage::new(4, 4), RgbImage::from_pixel(4, 4, image::Rgb([200, 0, 0]))];
        let bytes = gif_bytes(&frames, 10.0).unwrap();
        assert_eq!(&bytes[..6], b"GIF89a");
    }
}
