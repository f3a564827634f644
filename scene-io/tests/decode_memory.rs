//! What decoding reserves is what it takes: never less, and not much more.

#[path = "counting/mod.rs"]
mod counting;

use counting::{alone, peak_of};
use image::{DynamicImage, ExtendedColorType, ImageBuffer, ImageEncoder, ImageFormat};
use render_core::camera::{Camera, Pose};
use scene_io::{DecodeMemory, DepthSource, Frame, ImageSource, ImageStore, MaskPolarity, StoreOptions, decode_photo};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Beside what depends on the size: tables, buffers.
const FIXED: u64 = 1_500_000;

/// Wide, high, and like a photo.
const SIZES: [(u32, u32); 4] = [(1500, 1000), (9000, 12), (12, 9000), (500, 500)];

fn noise(i: usize) -> u8 {
    ((i as u32).wrapping_mul(2_654_435_761) >> 24) as u8
}

/// A picture of each kind of pixels, half noise and half one colour.
fn pictures((w, h): (u32, u32)) -> Vec<DynamicImage> {
    let n = (w * h) as usize;
    let bytes = |c: usize| (0..c * n).map(|i| if i < c * n / 2 { noise(i) } else { 99 }).collect::<Vec<u8>>();
    let words = |c: usize| bytes(c).into_iter().map(|b| u16::from(b) * 257).collect::<Vec<u16>>();
    let floats = |c: usize| bytes(c).into_iter().map(|b| f32::from(b) / 255.0).collect::<Vec<f32>>();
    vec![
        DynamicImage::ImageLuma8(ImageBuffer::from_raw(w, h, bytes(1)).unwrap()),
        DynamicImage::ImageLumaA8(ImageBuffer::from_raw(w, h, bytes(2)).unwrap()),
        DynamicImage::ImageRgb8(ImageBuffer::from_raw(w, h, bytes(3)).unwrap()),
        DynamicImage::ImageRgba8(ImageBuffer::from_raw(w, h, bytes(4)).unwrap()),
        DynamicImage::ImageLuma16(ImageBuffer::from_raw(w, h, words(1)).unwrap()),
        DynamicImage::ImageRgb16(ImageBuffer::from_raw(w, h, words(3)).unwrap()),
        DynamicImage::ImageRgba16(ImageBuffer::from_raw(w, h, words(4)).unwrap()),
        DynamicImage::ImageRgb32F(ImageBuffer::from_raw(w, h, floats(3)).unwrap()),
        DynamicImage::ImageRgba32F(ImageBuffer::from_raw(w, h, floats(4)).unwrap()),
    ]
}

fn encoded(picture: &DynamicImage, format: ImageFormat) -> Option<Vec<u8>> {
    use image::ColorType as C;
    let colour = picture.color();
    let fits = match format {
        ImageFormat::Png => !matches!(colour, C::Rgb32F | C::Rgba32F),
        ImageFormat::Jpeg => matches!(colour, C::L8 | C::Rgb8),
        ImageFormat::OpenExr => matches!(colour, C::Rgb32F | C::Rgba32F),
        _ => matches!(colour, C::Rgb8 | C::Rgba8),
    };
    let mut bytes = Cursor::new(Vec::new());
    fits.then(|| picture.write_to(&mut bytes, format).unwrap())?;
    Some(bytes.into_inner())
}

/// What `work` took at most, and what was reserved for it; the latter must be no less, and at most twice the former.
fn honest<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let memory = DecodeMemory::of_process();
    memory.set_limit(1 << 40);
    let (result, peak) = peak_of(work);
    let reserved = memory.most_used();
    assert!(memory.used() == 0 && peak <= reserved, "{what}: {peak} bytes taken, {reserved} reserved");
    assert!(reserved <= 2 * peak + FIXED, "{what}: {peak} bytes taken, {reserved} reserved");
    result
}

fn store(frame: &Frame, longest_side: Option<u32>) -> ImageStore {
    // Nothing is kept: what comes out belongs to the caller.
    ImageStore::new(
        std::slice::from_ref(frame),
        StoreOptions::default().with_longest_side(longest_side).with_budget_bytes(0),
    )
    .unwrap()
}

fn frame(photo: &Path) -> Frame {
    let scene_io::Size { width: w, height: h } = scene_io::photo_size(photo).unwrap();
    let pose = Pose { r: glam::DMat3::IDENTITY, c: glam::DVec3::ZERO };
    let focal = f64::from(w);
    let camera = Camera::pinhole(w, h, focal, focal, f64::from(w) / 2.0, f64::from(h) / 2.0, pose);
    Frame::new("a", ImageSource::File(photo.into()), camera)
}

/// All ways to read one photo.
fn all_ways(what: &str, photo: &Path) {
    honest(&format!("{what}, as it is"), || decode_photo(photo).unwrap());
    let frame = frame(photo);
    for side in [None, Some(64)] {
        let store = store(&frame, side);
        honest(&format!("{what}, to {side:?}"), || store.get(0).unwrap());
    }
}

#[test]
fn every_format_and_size_reserves_what_it_takes() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo");
    let mut cases = 0;
    for size in SIZES {
        for picture in pictures(size) {
            for format in
                [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Gif, ImageFormat::OpenExr]
            {
                let Some(bytes) = encoded(&picture, format) else { continue };
                fs::write(&path, bytes).unwrap();
                all_ways(&format!("{format:?} of {:?}, {size:?}", picture.color()), &path);
                cases += 1;
            }
        }
    }
    assert_eq!(cases, 4 * (7 + 2 + 2 + 2 + 2));
}

/// PNG of less than 8 bits, palettes with and without transparency, animations.
#[test]
fn palettes_and_animations_reserve_what_they_take() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo.png");
    use png::{BitDepth, ColorType};
    let size = (1600, 1000);
    for (colour, depth, clear) in [
        (ColorType::Grayscale, BitDepth::One, false),
        (ColorType::Grayscale, BitDepth::Four, false),
        (ColorType::Indexed, BitDepth::Two, false),
        (ColorType::Indexed, BitDepth::Eight, true),
    ] {
        for frames in [1, 3] {
            let mut encoder = png::Encoder::new(fs::File::create(&path).unwrap(), size.0, size.1);
            encoder.set_color(colour);
            encoder.set_depth(depth);
            if colour == ColorType::Indexed {
                encoder
                    .set_palette((0..=255).flat_map(|i| [i, 9, 255 - i]).take(3 << depth as u8).collect::<Vec<u8>>());
                if clear {
                    encoder.set_trns(vec![0, 255]);
                }
            }
            if frames > 1 {
                encoder.set_animated(frames, 0).unwrap();
            }
            let mut writer = encoder.write_header().unwrap();
            let bytes: Vec<u8> = (0..(size.0 * size.1 * depth as u32 / 8) as usize).map(noise).collect();
            for _ in 0..frames {
                writer.write_image_data(&bytes).unwrap();
            }
            writer.finish().unwrap();
            all_ways(&format!("{colour:?} of {depth:?}, {frames} frames"), &path);
        }
    }
}

/// The largest things in real photos that are not pixels.
#[test]
fn profiles_and_exif_count() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("photo");
    let (w, h) = (700, 500);
    let pixels: Vec<u8> = (0..3 * w * h).map(|i| noise(i as usize)).collect();
    let mut jpeg = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new(&mut jpeg);
    encoder.set_icc_profile(vec![7; 3_000_000]).unwrap();
    encoder.set_exif_metadata(vec![7; 60_000]).unwrap();
    encoder.write_image(&pixels, w, h, ExtendedColorType::Rgb8).unwrap();
    fs::write(&path, jpeg).unwrap();
    all_ways("JPEG with a profile", &path);
    let mut png = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut png);
    encoder.set_exif_metadata(vec![7; 2_000_000]).unwrap();
    encoder.write_image(&pixels, w, h, ExtendedColorType::Rgb8).unwrap();
    fs::write(&path, png).unwrap();
    all_ways("PNG with EXIF", &path);
}

#[test]
fn masks_transparency_and_perturbations_reserve_what_they_take() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| -> PathBuf { folder.path().join(name) };
    for (photo, mask) in [(2, 0), (3, 2), (2, 3), (5, 4)] {
        let kinds = pictures((1200, 900));
        fs::write(at("photo.png"), encoded(&kinds[photo], ImageFormat::Png).unwrap()).unwrap();
        fs::write(at("mask.png"), encoded(&kinds[mask], ImageFormat::Png).unwrap()).unwrap();
        for polarity in [MaskPolarity::WhiteIsUsed, MaskPolarity::WhiteIsIgnored, MaskPolarity::WhiteIsObject] {
            for side in [None, Some(600), Some(20)] {
                let mut frame = frame(&at("photo.png"));
                (frame.mask, frame.mask_polarity) = (Some(at("mask.png")), polarity);
                frame.alpha = scene_io::AlphaMeaning::Used;
                let store = store(&frame, side);
                let what = format!("photo {photo}, mask {mask}, {polarity:?}, {side:?}");
                honest(&what, || store.get(0).unwrap());
            }
        }
        let mut frame = frame(&at("photo.png"));
        frame.mask = Some(at("mask.png"));
        honest(&format!("mask {mask} alone"), || frame.read_mask().unwrap());
    }
}

#[test]
fn depth_files_reserve_what_they_take() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let (w, h) = (900_u32, 700_u32);
    let n = (w * h) as usize;
    let photo = folder.path().join("photo.png");
    fs::write(&photo, encoded(&pictures((w, h))[2], ImageFormat::Png).unwrap()).unwrap();
    let mut frame = frame(&photo);
    let mut read = |what: &str, path: PathBuf| {
        frame.depth = Some(DepthSource::file(path));
        let map = honest(what, || frame.read_depth().unwrap().unwrap());
        assert_eq!(map.z.len(), n);
    };
    let grey = folder.path().join("a.png");
    for kind in [0, 4] {
        fs::write(&grey, encoded(&pictures((w, h))[kind], ImageFormat::Png).unwrap()).unwrap();
        read("grey", grey.clone());
    }
    let exr = folder.path().join("a.exr");
    for kind in [7, 8] {
        fs::write(&exr, encoded(&pictures((w, h))[kind], ImageFormat::OpenExr).unwrap()).unwrap();
        read("EXR", exr.clone());
    }
    let npy = folder.path().join("a.npy");
    for (kind, size) in [("<f4", 4), ("<f8", 8), ("|u1", 1)] {
        for order in ["False", "True"] {
            let text = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({h}, {w}), }}");
            let mut bytes = b"\x93NUMPY\x01\0".to_vec();
            bytes.extend((text.len() as u16).to_le_bytes());
            bytes.extend(text.as_bytes());
            bytes.resize(bytes.len() + n * size, 0);
            fs::write(&npy, bytes).unwrap();
            read(&format!("{kind}, {order}"), npy.clone());
        }
    }
}
