//! Photos and other pictures: JPEG, PNG, WebP, GIF, EXR, by what their first bytes say.

use crate::Try;
use image::{DynamicImage, ImageFormat, Rgb, RgbImage};
use scene_io::{DecodeMemory, decode_photo};
use std::fs;
use std::io::Cursor;

/// What decoding may take here, bytes. The fuzzer ends a process that takes much more.
const LIMIT: u64 = 64 << 20;

pub(crate) fn open() -> Try {
    let folder = tempfile::tempdir().expect("room for a file");
    Box::new(move |bytes| {
        DecodeMemory::of_process().set_limit(LIMIT);
        let path = folder.path().join("photo.jpg");
        fs::write(&path, bytes).expect("room for a file");
        match decode_photo(&path) {
            Ok(picture) => assert!(picture.width() > 0 && picture.height() > 0, "a picture without pixels"),
            Err(error) => {
                let line = error.to_string();
                assert!(!line.contains('\n') && line.contains("photo.jpg"), "{line}");
            }
        }
        let memory = DecodeMemory::of_process();
        assert!(memory.used() == 0, "something stays reserved");
        assert!(memory.most_used() <= LIMIT, "more was reserved than there is");
    })
}

/// A JPEG whose picture comes in several scans, of one colour.
fn progressive() -> Vec<u8> {
    let segment = |marker: u8, body: &[u8]| [&[0xff, marker, 0, body.len() as u8 + 2], body].concat();
    let frame = [8, 0, 9, 0, 17, 3, 1, 0x22, 0, 2, 0x11, 0, 3, 0x11, 0];
    // One code of one bit: the value 0.
    let table = |class: u8| [&[class, 1][..], &[0; 15], &[0]].concat();
    [
        vec![0xff, 0xd8],
        segment(0xdb, &[&[0][..], &[1; 64]].concat()),
        segment(0xc2, &frame),
        segment(0xc4, &table(0x00)),
        segment(0xc4, &table(0x10)),
        segment(0xda, &[3, 1, 0, 2, 0, 3, 0, 0, 0, 0]),
        vec![0; 8],
        vec![0xff, 0xd9],
    ]
    .concat()
}

pub(crate) fn seeds() -> Vec<(String, Vec<u8>)> {
    let picture = DynamicImage::from(RgbImage::from_fn(17, 9, |x, y| Rgb([(x * 14) as u8, (y * 25) as u8, 7])));
    let encoded = |picture: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).expect("memory takes it");
        bytes.into_inner()
    };
    let exr = DynamicImage::from(picture.to_rgb32f());
    vec![
        ("jpeg".into(), encoded(&picture, ImageFormat::Jpeg)),
        ("jpeg-grey".into(), encoded(&DynamicImage::from(picture.to_luma8()), ImageFormat::Jpeg)),
        ("jpeg-progressive".into(), progressive()),
        ("png".into(), encoded(&picture, ImageFormat::Png)),
        ("png-alpha-16".into(), encoded(&DynamicImage::from(picture.to_rgba16()), ImageFormat::Png)),
        ("webp".into(), encoded(&picture, ImageFormat::WebP)),
        ("gif".into(), encoded(&DynamicImage::from(picture.to_rgba8()), ImageFormat::Gif)),
        ("exr".into(), encoded(&exr, ImageFormat::OpenExr)),
    ]
}
