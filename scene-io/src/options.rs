//! What a caller may say about how a dataset is to be read.

use crate::scene::{Dialect, MaskPolarity};
use crate::{ErrorKind, Problem, SceneError};
use std::path::{Path, PathBuf};

/// The word on the command line for [`Validation`].
pub(crate) const VALIDATION: &str = "--validation";

/// How a dataset is to be read; the default lets the files decide everything, `with_` methods change one thing each.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct LoadOptions {
    /// Which frames are held out; `None`: as the dialect defines it.
    pub holdout: Option<Holdout>,
    /// Which of the training frames that are left are held out for choosing settings; `None`: as the dataset has them.
    pub validation: Option<Validation>,
    /// The dialect, where the folder holds several; `None`: detected.
    pub dialect: Option<Dialect>,
    /// Folder of the images, where it is not beside the cameras (COLMAP, LLFF).
    pub images: Option<PathBuf>,
    /// Which photos are trained on, where a dataset holds cluttered and clean ones.
    pub train_photos: TrainPhotos,
    /// Where ignore masks come from.
    pub masks: Masks,
    /// What white means in them. EndoNeRF's masks are [`MaskPolarity::WhiteIsIgnored`] by themselves.
    pub mask_polarity: MaskPolarity,
    /// Folder of optical flow, disparities and motion masks, in folders of their usual names and by the photos' places in the dataset, as
    /// `nerf-dynamic priors` writes it; `None`: those beside the photos.
    pub priors: Option<PathBuf>,
    /// Longest image side wanted: picks among `images`, `images_2`, `images_4`, … the smallest folder that has it.
    pub longest_side: Option<u32>,
    /// What to do about images that are listed and not there; `None`: as the dialect's own tools do (instant-ngp skips
    /// them, the others refuse).
    pub missing_images: Option<MissingImages>,
}

impl LoadOptions {
    /// The same with other frames held out; [`LoadOptions::holdout`].
    #[must_use]
    pub fn with_holdout(self, holdout: impl Into<Option<Holdout>>) -> Self {
        Self { holdout: holdout.into(), ..self }
    }

    /// The same with other validation frames; [`LoadOptions::validation`].
    #[must_use]
    pub fn with_validation(self, validation: impl Into<Option<Validation>>) -> Self {
        Self { validation: validation.into(), ..self }
    }

    /// The same for a dialect; [`LoadOptions::dialect`].
    #[must_use]
    pub fn with_dialect(self, dialect: impl Into<Option<Dialect>>) -> Self {
        Self { dialect: dialect.into(), ..self }
    }

    /// The same with another folder of images; [`LoadOptions::images`].
    #[must_use]
    pub fn with_images(self, images: impl Into<Option<PathBuf>>) -> Self {
        Self { images: images.into(), ..self }
    }

    /// The same with other photos to train on; [`LoadOptions::train_photos`].
    #[must_use]
    pub fn with_train_photos(self, train_photos: TrainPhotos) -> Self {
        Self { train_photos, ..self }
    }

    /// The same with other masks; [`LoadOptions::masks`].
    #[must_use]
    pub fn with_masks(self, masks: Masks) -> Self {
        Self { masks, ..self }
    }

    /// The same with another meaning of white; [`LoadOptions::mask_polarity`].
    #[must_use]
    pub fn with_mask_polarity(self, mask_polarity: MaskPolarity) -> Self {
        Self { mask_polarity, ..self }
    }

    /// The same with priors of motion from a folder; [`LoadOptions::priors`].
    #[must_use]
    pub fn with_priors(self, priors: impl Into<Option<PathBuf>>) -> Self {
        Self { priors: priors.into(), ..self }
    }

    /// The same for images of another size; [`LoadOptions::longest_side`].
    #[must_use]
    pub fn with_longest_side(self, longest_side: impl Into<Option<u32>>) -> Self {
        Self { longest_side: longest_side.into(), ..self }
    }

    /// The same with another treatment of missing images; [`LoadOptions::missing_images`].
    #[must_use]
    pub fn with_missing_images(self, missing_images: impl Into<Option<MissingImages>>) -> Self {
        Self { missing_images: missing_images.into(), ..self }
    }
}

/// Which photos are trained on, where a dataset holds the place both with and without things that do not belong there:
/// `transforms_train_clutter.json` and `transforms_train_clean.json` in the Blender form, file names that start with
/// `clutter` and `clean` (RobustNeRF), lists of these names in `split.json` (NeRF On-the-go). Tested on are `extra` photos,
/// or those of `transforms_test.json`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TrainPhotos {
    /// Those with things in the way; and all photos of datasets that make no difference.
    #[default]
    Clutter,
    /// Those without: the oracle a robust system is measured against. Datasets that make no difference are refused.
    Clean,
}

impl TrainPhotos {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Clutter => "clutter",
            Self::Clean => "clean",
        }
    }
}

impl std::str::FromStr for TrainPhotos {
    type Err = String;

    /// Accepts the names of [`TrainPhotos::name`].
    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Clutter, Self::Clean]
            .into_iter()
            .find(|photos| photos.name() == text)
            .ok_or_else(|| format!("`{text}` is not a choice of training photos: use clutter or clean"))
    }
}

/// Where ignore masks come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// Masks that the dataset names, else `STEM.mask.png` beside the image, else those in a folder `masks` beside the
    /// images' folder. Blender scenes have neither of the named ones nor that folder.
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
    /// Of the frames sorted by name, those at `first`, `first + every`, `first + 2 every`, …
    EveryFrom {
        /// One frame of this many; not 0.
        every: usize,
        /// The first one held out, counted from 0; below `every`.
        first: usize,
    },
    /// These: by name, by name without extension, or by the end of the path (`test/r_0`).
    ///
    /// Where the dialect has a test split of its own, its other frames become [`crate::Split::Unused`].
    Names(Vec<String>),
    /// None: all frames are trained on.
    None,
}

impl Holdout {
    /// Reads `every:N`, `every:N+K` (the first held out is the one at K, counted from 0), `names:FILE` (one name a line; empty
    /// lines and lines starting with `#` do not count) or `none`.
    ///
    /// # Errors
    /// [`ErrorKind::Split`] for anything else, [`ErrorKind::Io`] where the file cannot be read.
    pub fn parse(text: &str) -> Result<Self, SceneError> {
        Self::parse_word(text, "--holdout", "write `every:8`, `every:8+4`, `names:FILE` or `none`")
    }

    /// The same for the word of an option.
    fn parse_word(text: &str, option: &str, remedy: &str) -> Result<Self, SceneError> {
        let refuse = |what: &str| SceneError::new(ErrorKind::Split, Problem::new(option, what, remedy).value(text));
        match text.split_once(':') {
            None if text == "none" => Ok(Self::None),
            Some(("every", number)) => {
                let (number, first) = number.split_once('+').map_or((number, None), |(n, k)| (n, Some(k)));
                match (number.parse::<usize>(), first.map(str::parse::<usize>).transpose()) {
                    (Ok(0), _) => Err(refuse("one frame of 0 cannot be held out")),
                    (Ok(every), Ok(None)) => Ok(Self::Every(every)),
                    (Ok(every), Ok(Some(first))) if first < every => Ok(Self::EveryFrom { every, first }),
                    (Ok(_), Ok(Some(_))) => Err(refuse("the part after `+` must be below the one before it")),
                    _ => Err(refuse("the part after `every:` is not a whole number")),
                }
            }
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

/// Training frames that are held out to choose settings by. Test frames are neither trained on nor measured then.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Validation {
    /// The dataset's own validation split.
    Dataset,
    /// These, of the frames that would be trained on, in the order of their names; the dataset's own validation frames become
    /// [`crate::Split::Unused`]. [`Holdout::None`]: none.
    Frames(Holdout),
}

impl Validation {
    /// Reads `every:N`, `every:N+K`, `names:FILE`, `none` as [`Holdout::parse`] does, or `dataset`.
    ///
    /// # Errors
    /// As [`Holdout::parse`].
    pub fn parse(text: &str) -> Result<Self, SceneError> {
        const WORDS: &str = "write `every:8`, `every:8+4`, `names:FILE`, `dataset` or `none`";
        match text {
            "dataset" => Ok(Self::Dataset),
            word => Holdout::parse_word(word, VALIDATION, WORDS).map(Self::Frames),
        }
    }
}
