//! In which photo's appearance a picture is rendered: words of the command line to codes of the system.
//!
//! | word | appearance |
//! | --- | --- |
//! | `mean` | the mean of all training photos |
//! | `image:NAME` | that of a training photo |
//! | `fit:FILE` | the one that explains another photo best, everything else as it is |
//! | `A..B` | from one of these to another, evenly over the frames of a path |
//!
//! A photo to fit to needs a camera, and of a scene that moves a time: see [`Run::fit_photo`].

use crate::camera_path;
use crate::error::RunError;
use crate::eval::{FIT_LR, FIT_STEPS, need_codes, pixels, view_of};
use crate::names;
use crate::picture::over_background;
use crate::run::Run;
use crate::system::{Appearance, Fit};
use glam::DVec2;
use render_core::camera::{Camera, Lens};
use scene_io::{Frame, ImageSource, ImageStore, Size, StoreOptions};
use serde_json::Value;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;

/// One appearance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PhotoAppearance {
    /// The mean of all training photos.
    Mean,
    /// That of a training photo.
    Image(String),
    /// Fitted to a photo: a file, or the name of a frame of the scene.
    Fit(PathBuf),
}

/// The appearance of the frames of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AppearancePath {
    /// The same for all.
    Still(PhotoAppearance),
    /// From one to another.
    Between(PhotoAppearance, PhotoAppearance),
}

impl FromStr for PhotoAppearance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "mean" => Ok(Self::Mean),
            Some(("image", name)) if !name.is_empty() => Ok(Self::Image(name.into())),
            Some(("fit", file)) if !file.is_empty() => Ok(Self::Fit(file.into())),
            _ => Err(format!("`{text}`: write `mean`, `image:NAME` or `fit:FILE`; two with `..` between them")),
        }
    }
}

impl FromStr for AppearancePath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // Paths hold dots, too: only those before another word part two appearances.
        let parts = |at: &usize| {
            let rest = text.get(*at..).and_then(|rest| rest.strip_prefix(".."));
            rest.is_some_and(|rest| rest == "mean" || rest.starts_with("image:") || rest.starts_with("fit:"))
        };
        match (0..text.len()).find(parts) {
            None => Ok(Self::Still(text.parse()?)),
            Some(at) => Ok(Self::Between(text[..at].parse()?, text[at + 2..].parse()?)),
        }
    }
}

impl fmt::Display for PhotoAppearance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mean => f.write_str("mean"),
            Self::Image(name) => write!(f, "image:{name}"),
            Self::Fit(file) => write!(f, "fit:{}", file.display()),
        }
    }
}

/// The appearance of the frames of a path, as the system knows it.
#[derive(Clone, Debug, PartialEq)]
pub enum FrameAppearances {
    /// The same for all.
    Still(Appearance),
    /// From one code to another of the same length.
    Between(Vec<f32>, Vec<f32>),
}

impl FrameAppearances {
    /// The appearance of frame `i` of `n`: the first has the first one, the last the last.
    #[must_use]
    pub fn at(&self, i: usize, n: usize) -> Appearance {
        match self {
            Self::Still(appearance) => appearance.clone(),
            Self::Between(a, b) => {
                let x = if n > 1 { i as f32 / (n - 1) as f32 } else { 0.0 };
                // Both ends are met exactly.
                Appearance::Code(a.iter().zip(b).map(|(a, b)| a * (1.0 - x) + b * x).collect())
            }
        }
    }
}

impl Run<'_> {
    /// Words as codes of the run's system. `fit_camera` names the frame whose camera took the photo of `fit:FILE`.
    ///
    /// # Errors
    /// [`RunError::Option`] for systems with one appearance, names that mean no training photo, and as [`Run::fit_photo`].
    pub fn appearance_along(
        &self,
        path: &AppearancePath,
        fit_camera: Option<&str>,
    ) -> Result<FrameAppearances, RunError> {
        Ok(match path {
            AppearancePath::Still(word) => FrameAppearances::Still(self.appearance(word, fit_camera)?),
            AppearancePath::Between(a, b) => {
                let code = |word: &PhotoAppearance| -> Result<Vec<f32>, RunError> {
                    need_codes(self.system.as_ref(), &format!("`--appearance {word}`"))?;
                    let appearance = self.appearance(word, fit_camera)?;
                    Ok(self.system.appearance_code(&appearance).unwrap_or_default())
                };
                FrameAppearances::Between(code(a)?, code(b)?)
            }
        })
    }

    fn appearance(&self, word: &PhotoAppearance, fit_camera: Option<&str>) -> Result<Appearance, RunError> {
        match word {
            PhotoAppearance::Mean => Ok(Appearance::Mean),
            PhotoAppearance::Image(name) => {
                Ok(Appearance::View(view_of(self.system.as_ref(), &self.train, name, "--appearance")?))
            }
            PhotoAppearance::Fit(file) => Ok(Appearance::Code(Arc::from(self.fit_photo(file, fit_camera)?))),
        }
    }

    /// The appearance code that explains a photo best.
    ///
    /// Its camera is that of the frame `camera` names; else that of the frame that `file` is or names (`fit:test/r_0` needs
    /// no file at all); else the only one of the JSON file beside the photo (`photo.json` for `photo.jpg`, in the form of a
    /// [camera path](camera_path)). A mask beside it (`photo.mask.png`, white = used) says which pixels count. The time at which
    /// the scene is compared with it is that of the same frame, or the number `time` of the JSON file, 0 the first time step and 1
    /// the last.
    ///
    /// # Errors
    /// [`RunError::Option`] for systems with one appearance, photos without a camera or of another shape than their camera's, photos
    /// of a scene that moves without a time; unreadable files.
    pub fn fit_photo(&self, file: &Path, camera: Option<&str>) -> Result<Vec<f32>, RunError> {
        let option = format!("`--appearance fit:{}`", file.display());
        need_codes(self.system.as_ref(), &option)?;
        let mut frame = self.photo(file, camera, &option)?;
        let time = self.time_of(&frame, file, &option)?;
        // What it is for does not matter here.
        frame.split = scene_io::Split::Unused;
        let longest_side = Some(self.train.longest_side().unwrap_or(MOST_SIDE).min(MOST_SIDE));
        let store =
            ImageStore::new(std::slice::from_ref(&frame), StoreOptions::default().with_longest_side(longest_side))?;
        let (photo, prepared) = (store.get(0)?, store.camera(0).prepare());
        let background = self.config.background.colour();
        let truth = over_background(&photo, background);
        let (rays, rgb) = pixels(&photo, &truth, 0..photo.width, |x, y| {
            prepared.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
        });
        if rays.is_empty() {
            return Err(RunError::Option(format!(
                "{option}: no pixel of the photo is used, so there is nothing to fit"
            )));
        }
        let (steps, lr, seed) = (FIT_STEPS, FIT_LR, self.config.seed);
        let fit = Fit { rays: &rays, rgb: &rgb, time, background, steps, lr, seed, halt: &self.halt };
        self.system.fit_appearance(&fit).ok_or_else(|| {
            RunError::Option(format!("{option}: `{}` fits no codes; use `mean` or `image:NAME`", self.system.name()))
        })
    }

    /// When a photo was taken; the only time of a scene that stands still.
    fn time_of(&self, photo: &Frame, file: &Path, option: &str) -> Result<f64, RunError> {
        match photo.time {
            _ if self.train.time_steps() <= 1 => Ok(self.train.views().first().map_or(0.0, |view| view.time)),
            Some(time) => Ok(time),
            None => Err(RunError::Option(format!(
                "{option}: the scene moves, and when the photo was taken is not known: write `\"time\": T` into `{}` (0 the \
                 first time step, 1 the last), or take camera and time of a frame with `--fit-camera NAME`",
                file.with_extension("json").display()
            ))),
        }
    }

    /// A photo with its camera, and its time where that is known.
    fn photo(&self, file: &Path, camera: Option<&str>, option: &str) -> Result<Frame, RunError> {
        let frames = &self.scene.frames;
        let all: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
        let named = match camera {
            Some(name) => Some(names::find(&all, name, &format!("`--fit-camera {name}`"))?),
            None => frames.iter().position(|f| is_file(&f.image, file)),
        };
        if !file.is_file() {
            let word = file.to_string_lossy();
            return match names::find(&all, &word, option) {
                // Its pixels are in the scene; another frame's camera would be a mistake.
                Ok(frame) if named.is_none_or(|named| named == frame) => Ok(frames[frame].clone()),
                Ok(_) => {
                    Err(RunError::Option(format!("{option}: a frame has its own camera; leave `--fit-camera` out")))
                }
                Err(_) => Err(RunError::Option(format!("{option}: there is no such file, and no frame of that name"))),
            };
        }
        if let (Some(frame), None) = (named, camera) {
            return Ok(frames[frame].clone());
        }
        let Size { width, height } = scene_io::photo_size(file)?;
        let beside = file.with_extension("json");
        let (camera, time) = match named {
            Some(frame) => (frames[frame].camera, frames[frame].time),
            None if beside.is_file() => {
                // A scene that stands still has one time, whatever the file says.
                let time = if self.train.time_steps() > 1 { time_beside(&beside)? } else { None };
                (self.camera_beside(&beside, width, height)?, time)
            }
            None => {
                let stem = file.file_stem().unwrap_or_default().to_string_lossy();
                return match names::find(&all, &stem, option) {
                    Ok(frame) => Err(RunError::Option(format!(
                        "{option}: is it the photo of frame `{}`? Then say so with `--fit-camera {}`",
                        all[frame], all[frame]
                    ))),
                    Err(_) => Err(RunError::Option(format!(
                        "{option}: its camera is not known: name the frame whose camera took it (`--fit-camera NAME`), or \
                         write its camera into `{}`, in the form of transforms.json",
                        beside.display()
                    ))),
                };
            }
        };
        let shape = |w: u32, h: u32| f64::from(w) / f64::from(h.max(1));
        let (photo, own) = (shape(width, height), shape(camera.width, camera.height));
        // Sides are rounded to pixels, and cameras are kept at several scales.
        if (photo / own - 1.0).abs() > 0.02 {
            return Err(RunError::Option(format!(
                "{option}: the photo is {width}x{height} and its camera {}x{}: give it the shape of the camera's pictures",
                camera.width, camera.height
            )));
        }
        let source = ImageSource::File(file.into());
        let mut frame = Frame::new(file.display().to_string(), source, camera.resized(width, height));
        frame.mask = Some(file.with_extension("mask.png")).filter(|mask| mask.is_file());
        frame.time = time;
        Ok(frame)
    }

    /// The camera in a JSON file; what it does not say is that of the first training view.
    fn camera_beside(&self, file: &Path, width: u32, height: u32) -> Result<Camera, RunError> {
        let wrong = |problem: String| RunError::Content { path: file.into(), problem };
        let Some(first) = self.train.views().first() else {
            return Err(wrong("the run has no training views to take the optics from".into()));
        };
        // A picture of the same width of view, in the photo's shape.
        let f = first.camera.fx / f64::from(first.camera.width.max(first.camera.height));
        let f = f * f64::from(width.max(height));
        let (cx, cy) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        let lens = Lens::Perspective { k: [0.0; 6], p: [0.0; 2] };
        let optics = Camera { width, height, fx: f, fy: f, cx, cy, lens, ..first.camera };
        match camera_path::read(file, &optics)?.as_slice() {
            [camera] => Ok(*camera),
            cameras => Err(wrong(format!("holds {} cameras; one photo has one", cameras.len()))),
        }
    }
}

/// The time in a JSON file: the number `time` of its first camera, or at the top.
fn time_beside(file: &Path) -> Result<Option<f64>, RunError> {
    let text = std::fs::read_to_string(file).map_err(RunError::read(file))?;
    let wrong = |problem: String| RunError::Content { path: file.into(), problem };
    let json: Value = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let of_camera = ["frames", "camera_path"].iter().find_map(|list| json.get(list)?.get(0)?.get("time"));
    let Some(value) = of_camera.or_else(|| json.get("time")) else { return Ok(None) };
    match value.as_f64() {
        Some(time) if (0.0..=1.0).contains(&time) => Ok(Some(time)),
        _ => Err(wrong(format!("`time` = {value}: must be in 0..=1, 0 the first time step and 1 the last"))),
    }
}

/// Longest side of a photo that is fitted to, pixels.
const MOST_SIDE: u32 = 640;

/// Whether a frame's pixels are in this file.
fn is_file(source: &ImageSource, file: &Path) -> bool {
    match source {
        ImageSource::File(own) => match (own.canonicalize(), file.canonicalize()) {
            (Ok(own), Ok(file)) => own == file,
            _ => false,
        },
        ImageSource::Memory(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_dots_in_their_paths_are_parted_where_another_word_begins() {
        let parse = |text: &str| text.parse::<AppearancePath>();
        let image = |name: &str| PhotoAppearance::Image(name.into());
        assert_eq!(parse("mean").unwrap(), AppearancePath::Still(PhotoAppearance::Mean));
        assert_eq!(parse("fit:../a/b.png").unwrap(), AppearancePath::Still(PhotoAppearance::Fit("../a/b.png".into())));
        assert_eq!(parse("image:a..image:b").unwrap(), AppearancePath::Between(image("a"), image("b")));
        assert_eq!(
            parse("mean..fit:../b").unwrap(),
            AppearancePath::Between(PhotoAppearance::Mean, PhotoAppearance::Fit("../b".into()))
        );
        assert_eq!(parse("image:a...mean").unwrap(), AppearancePath::Between(image("a."), PhotoAppearance::Mean));
        for wrong in ["", "image:", "fit:", "a", "mean..", "..mean", "mean..b", "image:a..image:"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_time_of_a_photo_stands_with_its_camera_or_at_the_top() {
        let read = |text: &str| {
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), text).unwrap();
            time_beside(file.path()).map_err(|e| e.to_string())
        };
        assert_eq!(read(r#"{"frames": [{"time": 0.25}]}"#), Ok(Some(0.25)));
        assert_eq!(read(r#"{"time": 1, "camera_path": [{}]}"#), Ok(Some(1.0)));
        assert_eq!(read(r#"{"time": 1, "camera_path": [{"time": 0}]}"#), Ok(Some(0.0)));
        assert_eq!(read(r#"{"frames": [{}]}"#), Ok(None));
        for (text, part) in [
            (r#"{"time": 3}"#, "`time` = 3: must be in 0..=1"),
            (r#"{"frames": [{"time": "noon"}]}"#, "`time` = \"noon\""),
            ("{", "EOF"),
        ] {
            assert!(read(text).unwrap_err().contains(part), "{text}: {:?}", read(text));
        }
    }

    #[test]
    fn codes_go_evenly_from_one_light_to_the_other() {
        let between = FrameAppearances::Between(vec![0.1, 2.0], vec![0.7, -2.0]);
        let code = |i, n| match between.at(i, n) {
            Appearance::Code(code) => code.to_vec(),
            other => panic!("{other:?}"),
        };
        assert_eq!([code(0, 3), code(2, 3), code(0, 1)], [vec![0.1, 2.0], vec![0.7, -2.0], vec![0.1, 2.0]]);
        assert!((code(1, 3)[0] - 0.4).abs() < 1e-6 && code(1, 3)[1] == 0.0);
    }
}
