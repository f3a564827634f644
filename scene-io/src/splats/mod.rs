//! Clouds of Gaussians in files: the PLY of 3DGS, `.splat` and SPZ.
//!
//! | format | numbers | degree | bytes a Gaussian at degree 3 |
//! | --- | --- | --- | --- |
//! | `.ply` | as trained, bit for bit | 0 to 3 | 248 |
//! | `.splat` | positions and sizes as `f32`, the rest bytes | 0 | 32 |
//! | `.spz` | fixed point and bytes, gzip | 0 to 3 | at most 65 |
//!
//! PLY and `.splat` are written in the frame and unit of the scene, as they are read. SPZ prescribes right, up, back:
//! y and z are turned on the way out and on the way in.
//!
//! # Source
//! PLY: Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, released code. `.splat`: antimatter15's viewer. SPZ:
//! Niantic's description of the format, versions 2 and 3.

mod file;
mod ply;
mod rows;
mod splat;
mod spz;

use crate::export::write_atomically;
use crate::{ErrorKind, Problem, SceneError, files};
use splat_core::{Gaussians, Widening};
use std::io::{self, Write};
use std::path::Path;

pub use file::{SplatFile, SplatOptions};

/// A format that splats are stored in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplatFormat {
    /// That of 3DGS.
    Ply,
    /// 32 bytes a Gaussian, no header.
    Splat,
    /// Quantised and compressed.
    Spz,
}

impl SplatFormat {
    /// The format that a name ends in, either case.
    #[must_use]
    pub fn of_name(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "splat" => Some(Self::Splat),
            "spz" => Some(Self::Spz),
            _ => None,
        }
    }

    /// The format that a file begins as; `.splat` files begin with any number.
    fn of_content(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [b'p', b'l', b'y', b'\n' | b'\r', ..] => Some(Self::Ply),
            [0x1f, 0x8b, 8, 0..=0x1f, ..] => Some(Self::Spz),
            _ if bytes.starts_with(spz::MAGIC.as_slice()) => Some(Self::Spz),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Ply => "PLY",
            Self::Splat => ".splat",
            Self::Spz => "SPZ",
        }
    }
}

/// Read a cloud of Gaussians from a file of any format, found out from how it begins, then from its name.
///
/// # Errors
/// Names the file, the place and what is wrong: no splats in it, cut off, a form that is not read. Single Gaussians
/// that are not finite are dropped with a note.
pub fn read_splats(path: &Path) -> Result<SplatFile, SceneError> {
    parse_splats(path, &files::read_bytes(path)?)
}

/// [`read_splats`] of bytes at hand. The name is for errors and, where the bytes do not tell, for the format.
///
/// # Errors
/// As [`read_splats`], except that nothing is read.
pub fn parse_splats(name: &Path, bytes: &[u8]) -> Result<SplatFile, SceneError> {
    let named = SplatFormat::of_name(name);
    let begun = SplatFormat::of_content(bytes);
    let Some(format) = begun.or(named) else {
        let what = "is neither PLY nor SPZ, and its name does not end in .splat";
        let problem = Problem::new(name, what, "give a .ply, .splat or .spz file");
        return Err(SceneError::new(ErrorKind::Format, problem));
    };
    match parse_as(format, named, name, bytes) {
        // A coordinate may begin like another format, but then nothing else follows as it should.
        Err(_) if named == Some(SplatFormat::Splat) && splat::may_be(bytes) => splat::read(name, bytes),
        result => result,
    }
}

fn parse_as(
    format: SplatFormat,
    named: Option<SplatFormat>,
    name: &Path,
    bytes: &[u8],
) -> Result<SplatFile, SceneError> {
    let mut file = match format {
        SplatFormat::Ply => ply::read(name, bytes),
        SplatFormat::Splat => splat::read(name, bytes),
        SplatFormat::Spz => spz::read(name, bytes),
    }?;
    if named != Some(format) {
        file.notes.insert(0, format!("read as {}, whatever its name says", format.name()));
    }
    Ok(file)
}

/// Write a cloud of Gaussians in the format its name ends in; whole or not at all. Gives what the format could not hold,
/// a line each.
///
/// # Errors
/// A name of no known format, a number that is not finite or that the format cannot hold, more Gaussians than it
/// takes, a file that cannot be written.
pub fn write_splats(path: &Path, cloud: &Gaussians, options: &SplatOptions) -> Result<Vec<String>, SceneError> {
    let (encoded, notes) = plan(path, cloud, options)?;
    write_atomically(path, |out| encoded.write(out))?;
    Ok(notes)
}

/// [`write_splats`] to memory. The name tells the format.
///
/// # Errors
/// As [`write_splats`], except that nothing is written.
pub fn encode_splats(
    name: &Path,
    cloud: &Gaussians,
    options: &SplatOptions,
) -> Result<(Vec<u8>, Vec<String>), SceneError> {
    let (encoded, notes) = plan(name, cloud, options)?;
    let mut bytes = Vec::new();
    encoded.write(&mut bytes).map_err(|e| SceneError::io(name, "encode the splats", e))?;
    Ok((bytes, notes))
}

/// A cloud that was found to fit a format.
enum Encoded<'a> {
    Ply(&'a Gaussians, Widening),
    Splat(splat::Sorted<'a>),
    Spz(spz::Packing<'a>),
}

impl Encoded<'_> {
    fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        match self {
            Self::Ply(cloud, widening) => ply::write(cloud, *widening, out),
            Self::Splat(sorted) => sorted.write(out),
            Self::Spz(packing) => packing.write(out),
        }
    }
}

fn plan<'a>(
    path: &Path,
    cloud: &'a Gaussians,
    options: &SplatOptions,
) -> Result<(Encoded<'a>, Vec<String>), SceneError> {
    let Some(format) = SplatFormat::of_name(path) else {
        let problem = Problem::new(path, "its name ends in no format of splats", "name it .ply, .splat or .spz");
        return Err(SceneError::new(ErrorKind::Format, problem));
    };
    rows::check(path, cloud)?;
    let mut notes = Vec::new();
    if options.widening == Widening::Dims && format == SplatFormat::Splat {
        notes.push(format!("{} cannot say that the splats were trained with antialiasing", format.name()));
    }
    let encoded = match format {
        SplatFormat::Ply => Encoded::Ply(cloud, options.widening),
        SplatFormat::Splat => Encoded::Splat(splat::Sorted::new(path, cloud, &mut notes)?),
        SplatFormat::Spz => Encoded::Spz(spz::Packing::new(path, cloud, options, &mut notes)?),
    };
    Ok((encoded, notes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_format_in_either_case() {
        for (name, want) in [
            ("a.ply", Some(SplatFormat::Ply)),
            ("b/a.SPLAT", Some(SplatFormat::Splat)),
            ("a.b.Spz", Some(SplatFormat::Spz)),
            ("a.ply.gz", None),
            ("ply", None),
        ] {
            assert_eq!(SplatFormat::of_name(Path::new(name)), want, "{name}");
        }
    }

    #[test]
    fn coordinates_are_not_taken_for_other_formats() {
        for head in [*b"ply\n", *b"ply\r", [0x1f, 0x8b, 8, 0], *spz::MAGIC] {
            assert!(SplatFormat::of_content(&head).is_some());
            let mut cloud = Gaussians::new(2, 0).unwrap();
            cloud.mean[0] = f32::from_le_bytes(head);
            let (bytes, _) = encode_splats(Path::new("a.splat"), &cloud, &SplatOptions::default()).unwrap();
            let file = parse_splats(Path::new("a.splat"), &bytes).unwrap();
            assert_eq!((file.cloud.mean, file.notes), (cloud.mean, vec![]));
            assert!(parse_splats(Path::new("a.splat"), &bytes[..40]).is_err());
        }
    }
}
