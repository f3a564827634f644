//! HEIC photos to PNG, by whichever program of this machine can.

use crate::error::PrepareError;
use crate::tool::{Job, Log, Toolbox, install, run};
use crate::watch::Watch;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A program that reads HEIC.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Converter {
    name: &'static str,
    program: PathBuf,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// `heif-convert IN OUT` of libheif, also called `heif-dec`.
    Libheif,
    /// `magick IN -auto-orient OUT` of ImageMagick.
    Magick,
    /// `sips` of macOS.
    Sips,
    /// `ffmpeg -i IN OUT`.
    Ffmpeg,
}

/// Whether a photo needs a [`Converter`].
pub(crate) fn is_heic(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    extension.is_some_and(|e| ["heic", "heif", "hif"].contains(&e.as_str()))
}

impl Converter {
    /// The first program that can read HEIC.
    ///
    /// # Errors
    /// [`PrepareError::Missing`], naming what to install.
    pub(crate) fn find(tools: &Toolbox) -> Result<Self, PrepareError> {
        for name in ["heif-convert", "heif-dec"] {
            if let Some(program) = tools.find(name) {
                return Ok(Self { name, program, kind: Kind::Libheif });
            }
        }
        for name in ["magick", "convert"] {
            // On Windows another program is called `convert`, and ImageMagick may be built without HEIC.
            let reads = |program: &Path| {
                let formats = tools.ask(program, &["-list", "format"]).unwrap_or_default();
                formats.lines().any(|l| l.trim_start().starts_with("HEIC") && l.contains(" r"))
            };
            if let Some(program) = tools.find(name).filter(|p| reads(p)) {
                return Ok(Self { name, program, kind: Kind::Magick });
            }
        }
        if let Some(program) = tools.find("sips").filter(|_| cfg!(target_os = "macos")) {
            return Ok(Self { name: "sips", program, kind: Kind::Sips });
        }
        // Before version 8, ffmpeg reads one tile of the photo and says nothing.
        let version = |program: &Path| {
            let text = tools.ask(program, &["-version"])?;
            let number = text.strip_prefix("ffmpeg version ")?.trim_start_matches('n');
            number.split(['.', '-', ' ']).next()?.parse::<u32>().ok()
        };
        if let Some(program) = tools.find("ffmpeg").filter(|p| version(p).is_some_and(|v| v >= 8)) {
            return Ok(Self { name: "ffmpeg", program, kind: Kind::Ffmpeg });
        }
        Err(PrepareError::Missing {
            purpose: "reading HEIC photos",
            program: "heif-convert, ImageMagick with HEIC or ffmpeg 8",
            remedy: install(tools, "libheif-examples", "libheif", "https://github.com/strukturag/libheif"),
        })
    }

    /// Converts a photo to PNG; the picture is upright afterwards.
    pub(crate) fn convert(
        &self,
        tools: &Toolbox,
        photo: &Path,
        png: &Path,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        let (photo, png): (OsString, OsString) = (photo.into(), png.into());
        let words: Vec<OsString> = match self.kind {
            Kind::Libheif => vec![photo, png],
            Kind::Magick => vec![photo, "-auto-orient".into(), png],
            Kind::Sips => vec!["-s".into(), "format".into(), "png".into(), photo, "--out".into(), png],
            Kind::Ffmpeg => {
                let quiet = ["-hide_banner", "-nostdin", "-y", "-i"].map(OsString::from);
                let end = ["-frames:v".into(), "1".into(), png];
                quiet.into_iter().chain([photo]).chain(end).collect()
            }
        };
        let remedy = "open the photo elsewhere, or export it as JPEG";
        let job = Job { name: self.name, program: &self.program, words, doing: "read a HEIC photo", remedy };
        run(tools, &job, log, watch, |_, _| {})
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::testing::fake_program;
    use crate::watch::Silent;

    #[test]
    fn without_a_program_what_to_install_is_said() {
        let empty = tempfile::tempdir().unwrap();
        let error = Converter::find(&Toolbox::of_folders(&[empty.path()])).unwrap_err().to_string();
        assert!(error.contains("heif-convert") && error.contains("install"), "{error}");
        assert_eq!(error.lines().count(), 1);
    }

    #[test]
    fn programs_that_cannot_are_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let tools = Toolbox::of_folders(&[folder.path()]);
        // A `convert` that is not ImageMagick, and an ffmpeg that reads one tile.
        fake_program(folder.path(), "convert", "echo usage; exit 4");
        fake_program(folder.path(), "ffmpeg", "echo 'ffmpeg version 5.1.9-0+deb12u1 Copyright'");
        assert!(Converter::find(&tools).is_err());
        fake_program(folder.path(), "ffmpeg", "echo 'ffmpeg version n8.0.1 Copyright'");
        assert_eq!(Converter::find(&tools).unwrap().kind, Kind::Ffmpeg);
        fake_program(folder.path(), "convert", "echo '     HEIC  HEIC      rw+   High Efficiency Image Format'");
        assert_eq!(Converter::find(&tools).unwrap().kind, Kind::Magick);
        fake_program(folder.path(), "heif-convert", "/bin/cp \"$1\" \"$2\"");
        let converter = Converter::find(&tools).unwrap();
        assert_eq!(converter.kind, Kind::Libheif);
        let (photo, png) = (folder.path().join("a b.heic"), folder.path().join("a.png"));
        std::fs::write(&photo, b"pixels").unwrap();
        let mut log = Log::open(&folder.path().join("log")).unwrap();
        converter.convert(&tools, &photo, &png, &mut log, &mut Silent).unwrap();
        assert_eq!(std::fs::read(&png).unwrap(), b"pixels");
    }
}
