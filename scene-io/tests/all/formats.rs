//! Photo formats: WebP is read; HEIC, AVIF and raw photos are refused with the command that converts them; a photo that is
//! turned by EXIF only says so where its size shows it.

use crate::common::{Dataset, gradient};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder};
use scene_io::{Depth, ErrorKind, ImageStore, LoadOptions, MissingImages, StoreOptions, check, load};

fn refusal(dataset: &Dataset, options: &LoadOptions) -> String {
    let error = load(dataset.path(), options).expect_err("the photo cannot be used");
    let text = error.to_string();
    assert!(error.kind() != ErrorKind::Io && !text.contains('\n'), "{text}");
    text
}

/// A JPEG that says how it is to be turned.
fn jpeg(width: u32, height: u32, orientation: u8) -> Vec<u8> {
    // TIFF header, one entry: tag 0x0112 (orientation), type 3 (short), one value.
    let exif =
        [b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".as_slice(), &[orientation, 0, 0, 0], &[0, 0, 0, 0]].concat();
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new(&mut bytes);
    encoder.set_exif_metadata(exif).unwrap();
    encoder.write_image(&gradient(width, height), width, height, ExtendedColorType::Rgb8).unwrap();
    bytes
}

#[test]
fn webp_is_read_listed_and_found_under_its_other_name() {
    let dataset = Dataset::ngp(3);
    let png = dataset.path().join("images/001.png");
    let picture = image::open(&png).unwrap();
    std::fs::remove_file(&png).unwrap();
    picture.save(png.with_extension("webp")).unwrap();
    let scene = load(dataset.path(), &LoadOptions::default()).unwrap();
    assert!(scene.notes.iter().any(|n| n.contains("another extension")), "{:?}", scene.notes);
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    assert_eq!(store.get(1).unwrap().data, picture.into_rgb8().into_raw());
    dataset.edit("transforms.json", "001.png", "001.webp");
    assert!(check(dataset.path(), &LoadOptions::default(), Depth::Pixels).can_train());
    // Cut off.
    let bytes = std::fs::read(png.with_extension("webp")).unwrap();
    std::fs::write(png.with_extension("webp"), &bytes[..bytes.len() / 2]).unwrap();
    assert!(!check(dataset.path(), &LoadOptions::default(), Depth::Pixels).can_train());
}

#[test]
fn photos_that_other_programs_must_convert_are_refused_with_the_command() {
    let heic = [&[0, 0, 0, 24], b"ftypheic\0\0\0\0mif1heic".as_slice()].concat();
    let avif = [&[0, 0, 0, 24], b"ftypavif\0\0\0\0mif1avif".as_slice()].concat();
    for (name, bytes, parts) in [
        ("001.HEIC", &heic, ["a HEIC photo", "`heif-convert ", "001.jpg` (libheif)"]),
        ("001.avif", &avif, ["an AVIF photo", "`avifdec ", "001.jpg` (libavif)"]),
        ("001.NEF", &b"MM\0*\0\0\0\x08".to_vec(), ["a raw photo", "`darktable-cli ", "/*.NEF` (ImageMagick)"]),
        ("001.tif", &b"II*\0\0\0\0\x08".to_vec(), ["a TIFF picture", "`convert ", "mogrify -format png"]),
        // Whatever the name says.
        ("001.png", &heic, ["a HEIC photo", "`heif-convert ", "/*.png`"]),
    ] {
        let dataset = Dataset::ngp(3);
        std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
        let photo = dataset.write(&format!("images/{name}"), bytes);
        dataset.edit("transforms.json", "001.png", name);
        let text = refusal(&dataset, &LoadOptions::default());
        for part in [&parts[..], &[photo.to_str().unwrap(), "frame `images/001"]].concat() {
            assert!(text.contains(part), "`{part}` is not in: {text}");
        }
        // Once it is converted, the photo beside it may stay.
        if photo.extension().is_some_and(|e| e != "png") {
            gradient(8, 6).save(photo.with_extension("jpg")).unwrap();
            load(dataset.path(), &LoadOptions::default()).unwrap();
        }
    }
}

#[test]
fn a_photo_that_is_there_in_another_format_is_named() {
    let dataset = Dataset::ngp(3);
    std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
    dataset.write("images/001.heic", b"");
    let options = LoadOptions::default().with_missing_images(MissingImages::Refuse);
    let text = refusal(&dataset, &options);
    assert!(text.contains("images/001.heic: frame") && text.contains("heif-convert"), "{text}");

    // A folder of nothing else.
    let dataset = Dataset::new();
    dataset.write("poses_bounds.npy", crate::common::poses_bounds(3));
    (0..3).for_each(|i| drop(dataset.write(&format!("images/{i}.heic"), b"")));
    let text = refusal(&dataset, &LoadOptions::default());
    assert!(text.contains("images/0.heic") && text.contains("mogrify -format jpg"), "{text}");
}

#[test]
fn exif_rotation_is_named_as_the_cause_where_sizes_disagree() {
    let with = |bytes: Vec<u8>| {
        let dataset = Dataset::ngp(3);
        std::fs::remove_file(dataset.path().join("images/001.png")).unwrap();
        dataset.write("images/001.jpg", bytes);
        dataset.edit("transforms.json", "001.png", "001.jpg");
        dataset
    };
    let text = refusal(&with(jpeg(6, 8, 6)), &LoadOptions::default());
    for part in ["001.jpg", "6x8", "8x6", "EXIF rotation (orientation 6)", "`mogrify -auto-orient "] {
        assert!(text.contains(part), "`{part}` is not in: {text}");
    }
    let text = refusal(&with(jpeg(6, 8, 1)), &LoadOptions::default());
    assert!(!text.contains("EXIF") && text.contains("turned by 90 degrees"), "{text}");
    let text = refusal(&with(jpeg(8, 8, 3)), &LoadOptions::default());
    assert!(text.contains("its EXIF orientation, 3, is not applied"), "{text}");
    // Sizes that agree are nothing to complain of: cameras may be those of the pixels as they are stored.
    load(with(jpeg(8, 6, 6)).path(), &LoadOptions::default()).unwrap();
}
