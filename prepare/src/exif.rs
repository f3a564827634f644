//! What a photo says about the camera that took it.

use exif::{Exif, In, Reader, Tag, Value};
use scene_io::Size;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Diagonal of a frame of 35 mm film, millimetres: what "35 mm equivalent" refers to.
const FILM_DIAGONAL: f64 = 43.266_615;
/// Focal lengths outside these, in longest sides of the picture, are not believed: 165 and 3 degrees of view.
const FOCAL_RANGE: (f64, f64) = (0.066, 19.0);

/// What is known of a photo's camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CameraFacts {
    /// How the pixels must be turned to be upright, 1 to 8 as in EXIF; 1 is upright.
    pub(crate) orientation: u8,
    /// Maker, model and lens; empty where they are not known.
    pub(crate) device: String,
    /// Focal length in longest sides of the picture.
    pub(crate) focal: Option<f64>,
}

/// Reads the EXIF data of JPEG, PNG, WebP, TIFF and HEIF files; defaults where there is none.
///
/// `size` is that of the picture's pixels.
pub(crate) fn camera_facts(path: &Path, size: Size) -> CameraFacts {
    let none = CameraFacts { orientation: 1, ..CameraFacts::default() };
    let Ok(file) = File::open(path) else { return none };
    match Reader::new().read_from_container(&mut BufReader::new(file)) {
        Ok(exif) => facts(&exif, size),
        Err(_) => none,
    }
}

fn facts(exif: &Exif, size: Size) -> CameraFacts {
    let orientation = number(exif, Tag::Orientation).filter(|o| (1.0..=8.0).contains(o)).unwrap_or(1.0) as u8;
    let words: Vec<String> = [Tag::Make, Tag::Model, Tag::LensModel].iter().filter_map(|t| text(exif, *t)).collect();
    CameraFacts { orientation, device: words.join(" "), focal: focal(exif, size) }
}

/// The focal length in longest sides of the picture: from the size of the sensor's pixels, else from the 35 mm equivalent,
/// which is over the diagonal.
fn focal(exif: &Exif, size: Size) -> Option<f64> {
    let longest = f64::from(size.longest_side());
    let plausible = |f: &f64| f.is_finite() && *f >= FOCAL_RANGE.0 && *f <= FOCAL_RANGE.1;
    let from_sensor = || {
        let millimetres = number(exif, Tag::FocalLength).filter(|f| *f > 0.0)?;
        let per_unit = number(exif, Tag::FocalPlaneXResolution).filter(|r| *r > 0.0)?;
        // EXIF 2.3: 2 inch, 3 centimetre; 4 millimetre and 5 micrometre are in use, too.
        let unit = match number(exif, Tag::FocalPlaneResolutionUnit).unwrap_or(2.0) as u32 {
            3 => 10.0,
            4 => 1.0,
            5 => 1e-3,
            _ => 25.4,
        };
        // The resolution is that of the picture as it was taken, which may have been scaled down since.
        let sides = [Tag::PixelXDimension, Tag::PixelYDimension].map(|t| number(exif, t).filter(|n| *n > 0.0));
        let taken = sides.into_iter().flatten().fold(0.0, f64::max);
        let taken = if taken > 0.0 { taken } else { longest };
        Some(millimetres * per_unit / unit / taken)
    };
    let from_film = || {
        let millimetres = number(exif, Tag::FocalLengthIn35mmFilm).filter(|f| *f > 0.0)?;
        let diagonal = f64::from(size.width).hypot(f64::from(size.height));
        Some(millimetres * diagonal / FILM_DIAGONAL / longest)
    };
    from_sensor().filter(plausible).or_else(|| from_film().filter(plausible))
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    match &exif.get_field(tag, In::PRIMARY)?.value {
        Value::Rational(v) => v.first().map(|r| r.to_f64()).filter(|x| x.is_finite()),
        Value::SRational(v) => v.first().map(|r| r.to_f64()).filter(|x| x.is_finite()),
        Value::Double(v) => v.first().copied().filter(|x| x.is_finite()),
        value => value.get_uint(0).map(f64::from),
    }
}

fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let Value::Ascii(lines) = &exif.get_field(tag, In::PRIMARY)?.value else { return None };
    let text = String::from_utf8_lossy(lines.first()?).trim_matches(['\0', ' ']).to_string();
    (!text.is_empty()).then_some(text)
}

/// EXIF data for tests.
#[cfg(test)]
pub(crate) mod testing {
    use exif::experimental::Writer;
    use exif::{Field, In, Rational, Tag, Value};
    use std::io::Cursor;
    use std::path::Path;

    /// Fields that a phone writes.
    pub(crate) fn phone(orientation: u16, millimetres35: u16) -> Vec<Field> {
        let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
        vec![
            field(Tag::Make, Value::Ascii(vec![b"Maker".to_vec()])),
            field(Tag::Model, Value::Ascii(vec![b"Phone 7".to_vec()])),
            field(Tag::Orientation, Value::Short(vec![orientation])),
            field(Tag::FocalLength, Value::Rational(vec![Rational { num: 425, denom: 100 }])),
            field(Tag::FocalLengthIn35mmFilm, Value::Short(vec![millimetres35])),
        ]
    }

    /// The bytes of EXIF data, little end first.
    pub(crate) fn bytes(fields: &[Field]) -> Vec<u8> {
        let mut writer = Writer::new();
        for field in fields {
            writer.push_field(field);
        }
        let mut out = Cursor::new(Vec::new());
        writer.write(&mut out, true).unwrap();
        out.into_inner()
    }

    /// A JPEG with EXIF data.
    pub(crate) fn jpeg(path: &Path, picture: &image::RgbImage, fields: &[Field]) {
        let mut plain = Cursor::new(Vec::new());
        picture.write_to(&mut plain, image::ImageFormat::Jpeg).unwrap();
        let (plain, exif) = (plain.into_inner(), bytes(fields));
        let mut out = vec![0xff, 0xd8, 0xff, 0xe1];
        out.extend((exif.len() as u16 + 8).to_be_bytes());
        out.extend(b"Exif\0\0");
        out.extend(exif);
        out.extend(&plain[2..]);
        std::fs::write(path, out).unwrap();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::exif::{Field, Rational};

    fn read(fields: &[Field], size: Size) -> CameraFacts {
        let exif = Reader::new().read_raw(testing::bytes(fields)).unwrap();
        facts(&exif, size)
    }

    #[test]
    fn a_phone_says_how_to_turn_the_photo_and_its_focal_length() {
        let facts = read(&testing::phone(6, 26), Size::new(4032, 3024));
        assert_eq!((facts.orientation, facts.device.as_str()), (6, "Maker Phone 7"));
        // 26 mm on the diagonal of film, over 5040 pixels of diagonal: 3029 pixels.
        assert!((facts.focal.unwrap() * 4032.0 - 3028.7).abs() < 0.5, "{facts:?}");
    }

    #[test]
    fn the_pixels_of_the_sensor_count_more_than_the_equivalent() {
        let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
        let mut fields = testing::phone(1, 26);
        // 5000 pixels to the centimetre: 4.25 mm are 2125 pixels of the 4000 that were taken.
        fields.push(field(Tag::FocalPlaneXResolution, Value::Rational(vec![Rational { num: 5000, denom: 1 }])));
        fields.push(field(Tag::FocalPlaneResolutionUnit, Value::Short(vec![3])));
        fields.push(field(Tag::PixelXDimension, Value::Long(vec![4000])));
        let facts = read(&fields, Size::new(1000, 750));
        assert!((facts.focal.unwrap() - 2125.0 / 4000.0).abs() < 1e-9, "{facts:?}");
    }

    #[test]
    fn nonsense_is_not_believed() {
        let facts = read(&testing::phone(9, 60_000), Size::new(100, 100));
        assert_eq!((facts.orientation, facts.focal), (1, None));
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("x.jpg");
        std::fs::write(&file, b"no photo").unwrap();
        assert_eq!(camera_facts(&file, Size::new(1, 1)), CameraFacts { orientation: 1, ..CameraFacts::default() });
    }
}
