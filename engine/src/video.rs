//! Videos by `ffmpeg`, where that is installed: pictures go into its standard input one by one.

use crate::error::RunError;
use image::RgbImage;
use scene_io::Size;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

/// The program.
const PROGRAM: &str = "ffmpeg";

/// A container with what players expect in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VideoFormat {
    /// H.264 in MP4: plays everywhere.
    Mp4,
    /// VP9 or VP8 in WebM: plays in browsers.
    Webm,
}

impl VideoFormat {
    /// Ending of the file's name, and name of the container.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Mp4 => "mp4",
            Self::Webm => "webm",
        }
    }

    /// Encoders in software that make it, the best first, with their settings: hardware encoders are listed also where there
    /// is no such hardware.
    fn encoders(self) -> &'static [(&'static str, &'static [&'static str])] {
        match self {
            Self::Mp4 => &[
                ("libx264", &["-crf", "18", "-preset", "medium", "-movflags", "+faststart"]),
                ("libopenh264", &["-b:v", "6M", "-movflags", "+faststart"]),
            ],
            Self::Webm => &[
                ("libvpx-vp9", &["-crf", "28", "-b:v", "0", "-deadline", "good", "-cpu-used", "4", "-row-mt", "1"]),
                ("libvpx", &["-crf", "8", "-b:v", "6M"]),
            ],
        }
    }
}

/// What the `ffmpeg` of this machine can make.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ffmpeg {
    encoders: Vec<String>,
}

impl Ffmpeg {
    /// Ask it; `None` where there is none on the `PATH`, or it does not start.
    #[must_use]
    pub fn find() -> Option<Self> {
        let answer = Command::new(PROGRAM)
            .args(["-hide_banner", "-encoders"])
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .output()
            .ok()?;
        answer.status.success().then(|| Self { encoders: encoders(&String::from_utf8_lossy(&answer.stdout)) })
    }

    /// The format to take where none is asked for: MP4, else WebM.
    #[must_use]
    pub fn best(&self) -> Option<VideoFormat> {
        [VideoFormat::Mp4, VideoFormat::Webm].into_iter().find(|&format| self.encoder(format).is_some())
    }

    fn encoder(&self, format: VideoFormat) -> Option<(&'static str, &'static [&'static str])> {
        format.encoders().iter().find(|(name, _)| self.encoders.iter().any(|known| known == name)).copied()
    }
}

/// Names of the video encoders in the answer of `ffmpeg -encoders`: lines of flags that begin with `V`, a name, a description.
fn encoders(answer: &str) -> Vec<String> {
    let name = |line: &str| {
        let mut words = line.split_whitespace();
        let flags = words.next()?;
        (flags.len() == 6 && flags.starts_with('V')).then_some(words.next()?.to_string())
    };
    answer.lines().filter_map(name).filter(|name| name != "=").collect()
}

/// A video that is being made. Dropped before [`Video::finish`], it leaves no file.
#[derive(Debug)]
pub struct Video {
    child: Child,
    input: Option<ChildStdin>,
    complaints: Option<JoinHandle<String>>,
    size: Size,
    encoder: &'static str,
    partial: PathBuf,
    path: PathBuf,
    done: bool,
}

impl Video {
    /// Begin `folder/name.mp4` (or `.webm`), with pictures of `size`.
    ///
    /// # Errors
    /// [`RunError::Option`] where this `ffmpeg` cannot make the format or does not start.
    pub fn begin(
        ffmpeg: &Ffmpeg,
        format: VideoFormat,
        folder: &Path,
        name: &str,
        size: Size,
        frames_per_second: f64,
    ) -> Result<Self, RunError> {
        let word = format.extension();
        let Some((encoder, settings)) = ffmpeg.encoder(format) else {
            let known: Vec<&str> = format.encoders().iter().map(|e| e.0).collect();
            return Err(RunError::Option(format!(
                "`--video {word}`: this ffmpeg has none of the encoders {}; use another format or `--video off`",
                known.join(", ")
            )));
        };
        let path = folder.join(format!("{name}.{word}"));
        let partial = folder.join(format!(".{name}.{word}.partial"));
        let mut target = std::ffi::OsString::from("file:"); // a name may begin with `-`
        target.push(&partial);
        let mut child = Command::new(PROGRAM)
            .args(["-y", "-hide_banner", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &size.to_string()])
            .args(["-framerate", &format!("{frames_per_second:.6}"), "-i", "-", "-an", "-map_metadata", "-1"])
            // Players want even sides, and colours by the matrix of high definition.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p"])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"])
            .args(["-c:v", encoder])
            .args(settings)
            .args(["-f", word])
            .arg(target)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|e| RunError::Option(format!("ffmpeg does not start: {e}")))?;
        let input = child.stdin.take();
        let complaints = child.stderr.take().map(|mut pipe| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                // What was read until a failure is said, too.
                let _ = pipe.read_to_end(&mut text);
                String::from_utf8_lossy(&text).into_owned()
            })
        });
        Ok(Self { child, input, complaints, size, encoder, partial, path, done: false })
    }

    /// Add a picture; one of another size is scaled.
    ///
    /// # Errors
    /// [`RunError::Option`] with what `ffmpeg` says, once it has given up.
    pub fn add(&mut self, picture: &RgbImage) -> Result<(), RunError> {
        let written = match (&mut self.input, Size::from(picture.dimensions()) == self.size) {
            (None, _) => Ok(()),
            (Some(input), true) => input.write_all(picture.as_raw()),
            (Some(input), false) => {
                let Size { width, height } = self.size;
                let scaled = image::imageops::resize(picture, width, height, image::imageops::FilterType::Triangle);
                input.write_all(scaled.as_raw())
            }
        };
        written.map_err(|e| {
            let what = if e.kind() == ErrorKind::BrokenPipe { String::new() } else { e.to_string() };
            self.failed(&what)
        })
    }

    /// Write what is left; the file and the encoder that made it.
    ///
    /// # Errors
    /// [`RunError::Option`] with what `ffmpeg` says; [`RunError::Write`].
    pub fn finish(mut self) -> Result<(PathBuf, &'static str), RunError> {
        drop(self.input.take());
        let status = self.child.wait().map_err(|e| self.failed(&e.to_string()))?;
        if !status.success() {
            return Err(self.failed(&status.to_string()));
        }
        std::fs::rename(&self.partial, &self.path).map_err(RunError::write(&self.path))?;
        self.done = true;
        Ok((self.path.clone(), self.encoder))
    }

    fn failed(&mut self, what: &str) -> RunError {
        drop(self.input.take());
        let _ = self.child.kill();
        let _ = self.child.wait();
        let said = self.complaints.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let said: Vec<&str> = said.lines().map(str::trim).filter(|line| !line.is_empty()).take(2).collect();
        let reason = if said.is_empty() { what.to_string() } else { said.join("; ") };
        RunError::Option(format!("ffmpeg could not make `{}`: {reason}", self.path.display()))
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        if !self.done {
            drop(self.input.take());
            let _ = self.child.kill();
            let _ = self.child.wait();
            let _ = std::fs::remove_file(&self.partial);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoders_are_read_from_the_answer() {
        let answer = "Encoders:\n V..... = Video\n A..... = Audio\n ------\n V....D libx264    H.264 (codec h264)\n \
                      V..... libvpx-vp9 VP9\n A....D aac     AAC\n";
        let found = encoders(answer);
        assert_eq!(found, ["libx264", "libvpx-vp9"]);
        let ffmpeg = |names: &[&str]| Ffmpeg { encoders: names.iter().map(|n| n.to_string()).collect() };
        assert_eq!(ffmpeg(&["libx264", "libvpx"]).best(), Some(VideoFormat::Mp4));
        assert_eq!(ffmpeg(&["mpeg4", "libvpx"]).best(), Some(VideoFormat::Webm));
        assert_eq!(ffmpeg(&["h264_nvenc"]).best(), None);
        let folder = std::env::temp_dir();
        let error =
            Video::begin(&ffmpeg(&["libvpx"]), VideoFormat::Mp4, &folder, "x", Size::new(8, 8), 15.0).unwrap_err();
        assert!(error.to_string().contains("`--video mp4`") && error.to_string().contains("libx264"), "{error}");
    }

    #[test]
    fn a_video_is_a_file_or_nothing() {
        let Some(ffmpeg) = Ffmpeg::find() else {
            eprintln!("SKIPPED: ffmpeg is not installed");
            return;
        };
        let Some(format) = ffmpeg.best() else {
            eprintln!("SKIPPED: this ffmpeg encodes neither H.264 nor VP8 or VP9");
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let begin = || Video::begin(&ffmpeg, format, folder.path(), "-odd", Size::new(33, 21), 15.0).unwrap();
        let mut left = begin();
        left.add(&RgbImage::new(33, 21)).unwrap();
        drop(left);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "what is not finished is removed");
        let mut video = begin();
        for i in 0..5 {
            let size = if i == 3 { (66, 42) } else { (33, 21) };
            video.add(&RgbImage::from_pixel(size.0, size.1, image::Rgb([40 * i, 0, 90]))).unwrap();
        }
        let (path, _) = video.finish().unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() > 300);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
