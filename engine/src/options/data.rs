//! How a dataset is read.

use crate::error::RunError;
use scene_io::{Holdout, LoadOptions, MaskPolarity, Masks, MissingImages, TrainPhotos, Validation};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Memory for decoded images where nothing is said, MiB.
pub const IMAGE_MEMORY_MIB: u64 = 2048;

/// How the dataset is read: the words of the command line; absent where nothing was said.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DataOptions {
    /// Longest image side trained on, pixels; absent: as in the files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub longest_side: Option<u32>,
    /// `every:N`, `names:FILE`, `none`; absent: the dataset's own split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holdout: Option<String>,
    /// `every:N`, `names:FILE`, `dataset`, `none`: training views that are held out and measured in the place of the test views;
    /// absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation: Option<String>,
    /// Which photos are trained on where the dataset holds cluttered and clean ones: `clutter` or `clean`; absent: `clutter`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub train_split: Option<String>,
    /// Name of the dataset's format; absent: detected.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Folder of the images, where not beside the cameras.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub images: Option<PathBuf>,
    /// `off`, or the folder of ignore masks; absent: the dataset's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masks: Option<String>,
    /// What white means in the masks: `used`, `ignored` or `object`; absent: `used`, and a new run examines masks that leave little
    /// of the photos (`run::mask_meaning`) and writes down what it took them for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask_white: Option<String>,
    /// Folder of optical flow, disparities and motion masks, as `nerf-dynamic priors` fills one; absent: those beside the photos.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub priors: Option<PathBuf>,
    /// What to do about images that are listed and missing: `refuse` or `skip`; absent: as the format's own tools do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing_images: Option<String>,
    /// Scales trained on: 2 for images at full and half size, 3 for a quarter as well, …; absent: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scales: Option<u32>,
    /// Memory for decoded images, MiB. Sets how many views a batch is drawn from when they do not all fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_memory: Option<u64>,
}

impl DataOptions {
    /// What the reader is told.
    ///
    /// # Errors
    /// [`RunError::Option`] for a word that means nothing, [`RunError::Scene`] when the file of `names:FILE` is
    /// unreadable.
    pub fn load_options(&self) -> Result<LoadOptions, RunError> {
        let word = |option: &str, given: &str, words: &str| {
            Err(RunError::Option(format!("`{option} {given}`: write one of {words}")))
        };
        Ok(LoadOptions::default()
            .with_holdout(self.holdout.as_deref().map(Holdout::parse).transpose()?)
            .with_validation(self.validation()?)
            .with_dialect(match &self.format {
                Some(name) => Some(name.parse().map_err(|e| RunError::Option(format!("`--format`: {e}")))?),
                None => None,
            })
            .with_images(self.images.clone())
            .with_train_photos(match &self.train_split {
                Some(word) => word.parse().map_err(|e| RunError::Option(format!("`--train-split`: {e}")))?,
                None => TrainPhotos::default(),
            })
            .with_masks(match self.masks.as_deref() {
                None => Masks::Auto,
                Some("off") => Masks::Off,
                Some(folder) => Masks::Folder(folder.into()),
            })
            .with_mask_polarity(match self.mask_white.as_deref() {
                None | Some("used") => MaskPolarity::WhiteIsUsed,
                Some("ignored") => MaskPolarity::WhiteIsIgnored,
                Some("object") => MaskPolarity::WhiteIsObject,
                Some(other) => return word("--mask-white", other, "used, ignored, object"),
            })
            .with_priors(self.priors.clone())
            .with_longest_side(self.longest_side)
            .with_missing_images(match self.missing_images.as_deref() {
                None => None,
                Some("refuse") => Some(MissingImages::Refuse),
                Some("skip") => Some(MissingImages::Skip),
                Some(other) => return word("--missing-images", other, "refuse, skip"),
            }))
    }

    /// Training views that are held out and measured in the place of the test views; `None`: the test views are measured.
    ///
    /// # Errors
    /// As [`DataOptions::load_options`].
    pub fn validation(&self) -> Result<Option<Validation>, RunError> {
        let asked = self.validation.as_deref().map(Validation::parse).transpose()?;
        Ok(asked.filter(|validation| *validation != Validation::Frames(Holdout::None)))
    }

    /// Bytes decoded images may take.
    pub fn image_bytes(&self) -> u64 {
        self.image_memory.unwrap_or(IMAGE_MEMORY_MIB).saturating_mul(1 << 20)
    }
}
