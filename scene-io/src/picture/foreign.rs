//! Photo formats that are known and not read, and the commands that convert them.
//!
//! HEIC (phones), AVIF and the raw formats of cameras need large decoders, most of them in C. Other programs have them.

use crate::files::with_image_extension;
use crate::{ErrorKind, Problem, SceneError};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// What sort of file it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Heic,
    Avif,
    Raw,
    Tiff,
}

/// Extensions, lower case.
const EXTENSIONS: [(&str, Kind); 20] = [
    ("heic", Kind::Heic),
    ("heif", Kind::Heic),
    ("hif", Kind::Heic),
    ("avif", Kind::Avif),
    ("dng", Kind::Raw),
    ("cr2", Kind::Raw),
    ("cr3", Kind::Raw),
    ("nef", Kind::Raw),
    ("nrw", Kind::Raw),
    ("arw", Kind::Raw),
    ("srf", Kind::Raw),
    ("raf", Kind::Raw),
    ("orf", Kind::Raw),
    ("rw2", Kind::Raw),
    ("pef", Kind::Raw),
    ("srw", Kind::Raw),
    ("3fr", Kind::Raw),
    ("raw", Kind::Raw),
    ("tif", Kind::Tiff),
    ("tiff", Kind::Tiff),
];

/// The kind a file name tells.
fn by_name(path: &Path) -> Option<Kind> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    EXTENSIONS.iter().find(|(known, _)| *known == extension).map(|(_, kind)| *kind)
}

/// The kind the first bytes of a file tell: the brand of an ISO base media file, or the mark of a TIFF file, which many raw
/// formats begin with.
fn by_content(start: &[u8], path: &Path) -> Option<Kind> {
    if start.get(4..8) == Some(b"ftyp") {
        return match start.get(8..12)? {
            b"avif" | b"avis" => Some(Kind::Avif),
            b"crx " => Some(Kind::Raw),
            b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"hevx" | b"mif1" | b"msf1" => Some(Kind::Heic),
            _ => None,
        };
    }
    let is_tiff = start.starts_with(b"II*\0") || start.starts_with(b"MM\0*");
    is_tiff.then(|| by_name(path).filter(|kind| *kind == Kind::Raw).unwrap_or(Kind::Tiff))
}

/// Whether the name is that of a photo that is known and not read.
pub(crate) fn is_foreign(path: &Path) -> bool {
    by_name(path).is_some()
}

/// A photo of such a format in place of the one listed: the same name with another extension.
pub(crate) fn in_place_of(listed: &Path) -> Option<PathBuf> {
    let spelt = EXTENSIONS.iter().flat_map(|(e, _)| [(*e).to_owned(), e.to_ascii_uppercase()]);
    spelt.map(|extension| listed.with_extension(extension)).find(|path| path.is_file())
}

/// The first photo of such a format in a folder, by name.
pub(crate) fn first_in(folder: &Path) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_foreign(path) && path.is_file()).min()
}

/// The image that was made of such a photo: the same name with an extension that is read.
pub(crate) fn converted(path: &Path) -> Option<PathBuf> {
    is_foreign(path).then(|| with_image_extension(&path.with_extension(""))).flatten()
}

/// What is wrong with a file of such a format, with the commands that convert it; `None` for any other file.
pub(crate) fn refusal(path: &Path) -> Option<SceneError> {
    let mut start = [0; 12];
    let read = File::open(path).and_then(|mut file| file.read(&mut start)).unwrap_or(0);
    let kind = by_content(&start[..read], path).or_else(|| by_name(path))?;
    Some(SceneError::new(ErrorKind::Image, problem(path, kind)))
}

fn problem(path: &Path, kind: Kind) -> Problem {
    let (what, to) = match kind {
        Kind::Heic => ("a HEIC photo", "jpg"),
        Kind::Avif => ("an AVIF photo", "jpg"),
        Kind::Raw => ("a raw photo", "jpg"),
        Kind::Tiff => ("a TIFF picture", "png"),
    };
    let quoted = |path: &Path| {
        let text = path.display().to_string();
        shlex::try_quote(&text).map_or_else(|_| text.clone(), std::borrow::Cow::into_owned)
    };
    let (from, made) = (quoted(path), quoted(&path.with_extension(to)));
    let one = match kind {
        Kind::Heic => format!("`heif-convert {from} {made}` (libheif)"),
        Kind::Avif => format!("`avifdec {from} {made}` (libavif)"),
        Kind::Raw => format!("`darktable-cli {from} {made}` (darktable)"),
        Kind::Tiff => format!("`convert {from} {made}` (ImageMagick)"),
    };
    // The star must stay outside of the quotes.
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let all = format!("`mogrify -format {to} {}/*.{extension}` (ImageMagick) all of its folder", quoted(folder));
    let what = format!("is {what}, which cannot be read here");
    Problem::new(path, what, format!("{one} converts it, {all}; the new file is found by its name"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_by_content_before_names() {
        let brand = |brand: &[u8; 4]| [&[0, 0, 0, 24], b"ftyp".as_slice(), brand].concat();
        for (start, name, kind) in [
            (brand(b"heic"), "a.jpg", Some(Kind::Heic)),
            (brand(b"mif1"), "a.heic", Some(Kind::Heic)),
            (brand(b"avif"), "a.heic", Some(Kind::Avif)),
            (brand(b"crx "), "a.cr3", Some(Kind::Raw)),
            (brand(b"isom"), "a.mp4", None),
            (b"II*\0".to_vec(), "a.NEF", Some(Kind::Raw)),
            (b"MM\0*".to_vec(), "a.png", Some(Kind::Tiff)),
            (Vec::new(), "a.heic", None),
        ] {
            assert_eq!(by_content(&start, Path::new(name)), kind, "{name}");
        }
        assert!(is_foreign(Path::new("b/IMG_1.HEIC")) && !is_foreign(Path::new("b/IMG_1.webp")));
    }

    #[test]
    fn a_refusal_is_one_line_that_can_be_typed() {
        let text = problem(Path::new("my photos/it's.heic"), Kind::Heic).to_string();
        assert!(!text.contains('\n') && text.starts_with("my photos/it's.heic: is a HEIC photo"), "{text}");
        let commands: Vec<&str> = text.split('`').skip(1).step_by(2).collect();
        let words: Vec<Vec<String>> = commands.iter().map(|c| shlex::split(c).unwrap()).collect();
        assert_eq!(words[0], ["heif-convert", "my photos/it's.heic", "my photos/it's.jpg"]);
        assert_eq!(words[1], ["mogrify", "-format", "jpg", "my photos/*.heic"]);
        assert!(commands[1].ends_with("'/*.heic"), "the shell sees the star: {}", commands[1]);
    }
}
