//! What a caller may say about how a dataset is to be read.

use crate::scene::{Dialect, MaskPolarity};
use crate::{ErrorKind, Problem, SceneError};
use std::path::{Path, PathBuf};

/// How a dataset is to be read; the default lets the files decide everything.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    /// Which frames are held out; `None`: as the dialect defines it.
    pub holdout: Option<Holdout>,
    /// The dialect, where the folder holds several; `None`: detected.
    pub dialect: Option<Dialect>,
    /// Folder of the images, where it is not beside the cameras (COLMAP, LLFF).
    pub images: Option<PathBuf>,
    /// Where ignore masks come from.
    pub masks: Masks,
    /// What white means in them.
    pub mask_polarity: MaskPolarity,
    /// Longest image side wanted: picks among `images`, `images_2`, `images_4`, … the smallest folder that has it.
    pub longest_side: Option<u32>,
    /// What to do about images that are listed and not there; `None`: as the dialect's own tools do (instant-ngp skips
    /// them, the others refuse).
    pub missing_images: Option<MissingImages>,
}

/// Where ignore masks come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// Masks that the dataset names, else those in a folder `masks` beside the images' folder. Blender scenes have none.
    #[default]
    Auto,
    /// No masks.
    Off,
    /// Masks in this folder, named like the images (`NAME.png`, `NAME.jpg`, `NAME.jpg.png`).
    Folder(PathBuf),
}

/// What to do about images that a dataset lists and does not hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissingImages {
    /// Each is an error.
    Refuse,
    /// Their frames are left out, with one note that lists them.
    Skip,
}

/// Which frames are held out for testing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Holdout {
    /// Of the frames sorted by name, those at 0, N, 2N, …
    Every(usize),
    /// These: by name, by name without extension, or by the end of the path (`test/r_0`).
    ///
    /// Where the dialect has a test split of its own, its other frames become [`crate::Split::Unused`].
    Names(Vec<String>),
    /// None: all frames are trained on.
    None,
}

impl Holdout {
    /// Reads `every:N`, `names:FILE` (one name a line; empty lines and lines starting with `#` do not count) or `none`.
    ///
    /// # Errors
    /// [`ErrorKind::Split`] for anything else, [`ErrorKind::Io`] where the file cannot be read.
    pub fn parse(text: &str) -> Result<Self, SceneError> {
        let refuse = |what: &str| {
            let problem = Problem::new("--holdout", what, "write `every:8`, `names:FILE` or `none`").value(text);
            SceneError::new(ErrorKind::Split, problem)
        };
        match text.split_once(':') {
            None if text == "none" => Ok(Self::None),
            Some(("every", number)) => match number.parse::<usize>() {
                Ok(0) => Err(refuse("every 0th frame is none")),
                Ok(every) => Ok(Self::Every(every)),
                Err(_) => Err(refuse("the part after `every:` is no whole number")),
            },
            Some(("names", file)) if !file.is_empty() => Self::from_file(Path::new(file)),
            _ => Err(refuse("not a way to hold frames out")),
        }
    }

    /// Reads names from a file, one a line.
    ///
    /// # Errors
    /// [`ErrorKind::Io`] where the file cannot be read, [`ErrorKind::Split`] where it names nothing.
    pub fn from_file(path: &Path) -> Result<Self, SceneError> {
        let text = crate::files::read_text(path)?;
        let names: Vec<String> =
            text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')).map(str::to_owned).collect();
        if names.is_empty() {
            let problem = Problem::new(path, "names no frame", "write one frame name a line, or use `--holdout none`");
            return Err(SceneError::new(ErrorKind::Split, problem));
        }
        Ok(Self::Names(names))
    }
}
