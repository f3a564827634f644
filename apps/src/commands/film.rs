//! The frames of a path, and their video.

use crate::cli::VideoWord;
use crate::session::Failure;
use crate::show::line;
use engine::RunError;
use engine::camera_path::Film;
use engine::video::{Ffmpeg, Video, VideoFormat};
use image::RgbImage;
use render_core::camera::Camera;
use std::path::{Path, PathBuf};

/// Name of the video without its ending.
const NAME: &str = "preview";

/// The cameras of all frames.
pub(super) struct Shots {
    pub(super) cameras: Vec<Camera>,
    /// The share of each frame that two photos saw; `None` where there are no photos.
    pub(super) seen: Option<Vec<f64>>,
    /// What to say about them.
    pub(super) lines: Vec<String>,
}

impl Shots {
    /// Where there are no photos to compare with.
    pub(super) fn plain(cameras: Vec<Camera>, line: Option<&str>) -> Self {
        Self { cameras, seen: None, lines: line.map(str::to_owned).into_iter().collect() }
    }

    /// With what the photos saw of them.
    pub(super) fn looked_at(film: Film) -> Self {
        let lines = film.lines().to_vec();
        Self { cameras: film.cameras, seen: Some(film.seen), lines }
    }
}

/// Makes the video beside the frames, where it can be made.
pub(super) struct Videographer {
    ffmpeg: Option<(Ffmpeg, VideoFormat)>,
    /// Asked for by name: then its failure is one of the command.
    wanted: bool,
    frames_per_second: f64,
    video: Option<Video>,
}

impl Videographer {
    /// Without a word: what `ffmpeg` makes, if it is installed.
    pub(super) fn new(word: Option<VideoWord>, frames_per_second: f64) -> Result<Self, Failure> {
        let found = || Ffmpeg::find();
        let named = |format: VideoFormat| match found() {
            Some(ffmpeg) => Ok(Some((ffmpeg, format))),
            None => Err(RunError::Option(format!(
                "`--video {}`: there is no `ffmpeg` on the PATH; install it, or leave `--video` out",
                format.extension()
            ))),
        };
        let ffmpeg = match word {
            Some(VideoWord::Off) => None,
            Some(VideoWord::Mp4) => named(VideoFormat::Mp4)?,
            Some(VideoWord::Webm) => named(VideoFormat::Webm)?,
            None => found().and_then(|ffmpeg| ffmpeg.best().map(|format| (ffmpeg, format))),
        };
        Ok(Self { ffmpeg, wanted: word.is_some(), frames_per_second, video: None })
    }

    /// Add a picture; the first one begins the video in `folder`.
    pub(super) fn add(&mut self, folder: &Path, picture: &RgbImage) -> Result<(), Failure> {
        let added = match (&mut self.video, &self.ffmpeg) {
            (Some(video), _) => video.add(picture),
            (None, Some((ffmpeg, format))) => {
                Video::begin(ffmpeg, *format, folder, NAME, picture.dimensions().into(), self.frames_per_second)
                    .and_then(|mut video| {
                        let added = video.add(picture);
                        self.video = Some(video);
                        added
                    })
            }
            (None, None) => Ok(()),
        };
        self.unless_failed(added).map(|_| ())
    }

    /// The video and the encoder that made it.
    pub(super) fn finish(mut self) -> Result<Option<(PathBuf, &'static str)>, Failure> {
        let finished = self.video.take().map(Video::finish).transpose();
        self.unless_failed(finished).map(Option::flatten)
    }

    /// A video that was not asked for by name may fail with a line.
    fn unless_failed<T>(&mut self, result: Result<T, RunError>) -> Result<Option<T>, Failure> {
        match result {
            Ok(value) => Ok(Some(value)),
            Err(error) if self.wanted => Err(error.into()),
            Err(error) => {
                line(format_args!("no video: {error}"));
                (self.ffmpeg, self.video) = (None, None);
                Ok(None)
            }
        }
    }
}
