//! What a run is told and what was decided from it.

use crate::error::RunError;
use crate::eval::EvalAppearance;
use crate::train::Stop;
use field_core::rng::Rng;
use scene_io::{Holdout, LoadOptions, MaskPolarity, Masks, MissingImages, TrainPhotos, Validation};
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::path::PathBuf;
use std::str::FromStr;

/// What is composited behind transparent pixels and behind the reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// White.
    White,
    /// Black.
    Black,
    /// A random colour per training ray, so that empty space cannot hide as background; evaluated on white.
    Random,
}

impl Background {
    /// Colour used for evaluation and pictures.
    pub fn colour(self) -> [f32; 3] {
        match self {
            Self::White | Self::Random => [1.0; 3],
            Self::Black => [0.0; 3],
        }
    }

    /// What is behind training ray `i`: `rng` is the stream of a step's backgrounds.
    #[must_use]
    pub fn of_ray(self, rng: &Rng, i: u64) -> [f32; 3] {
        match self {
            Self::Random => [0, 1, 2].map(|c| rng.uniform_at(3 * i + c)),
            fixed => fixed.colour(),
        }
    }

    /// The word on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::White => "white",
            Self::Black => "black",
            Self::Random => "random",
        }
    }
}

/// What a reconstruction is for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Purpose {
    /// Looking at it from new places.
    #[default]
    Viewing,
    /// Points, meshes, densities.
    Geometry,
}

impl FromStr for Purpose {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "viewing" => Ok(Self::Viewing),
            "geometry" => Ok(Self::Geometry),
            other => Err(format!("`{other}`: write `viewing` or `geometry`")),
        }
    }
}

/// A system and why it was taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Its name.
    pub system: &'static str,
    /// The reason, with figures.
    pub line: String,
}

impl Choice {
    /// A system, and why it was taken.
    #[must_use]
    pub fn new(system: &'static str, why: impl Display) -> Self {
        Self { system, line: format!("system: {system} ({why})") }
    }
}

/// What every system is told besides scene and data.
#[derive(Clone, Debug, PartialEq)]
pub struct RunOptions {
    /// Seed of all randomness.
    pub seed: u64,
    /// Background, or `None` to let the plan decide.
    pub background: Option<Background>,
    /// Error a training or evaluation pixel may have from skipped work, in colour units; `None` lets the plan decide.
    pub error_budget: Option<f32>,
    /// `--set key=value`, over whatever the plan decides.
    pub set: toml::Table,
}

/// What was decided about a run, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// One decision a line, for people: `contraction: on, the cameras look outwards (71 % …)`.
    pub lines: Vec<String>,
    /// Background after the decision.
    pub background: Background,
    /// Error budget of evaluation renders after the decision.
    pub error_budget: f32,
    /// Every field of the system's configuration with its value. Building with this as `set` gives the same system.
    pub config: toml::Table,
}

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
    /// What white means in the masks: `used`, `ignored` or `object`; absent: `used`, and a new run looks at masks that leave little
    /// of the photos (`run::mask_meaning`) and writes down what it took them for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask_white: Option<String>,
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

/// Memory for decoded images where nothing is said, MiB.
pub const IMAGE_MEMORY_MIB: u64 = 2048;

/// The configuration of a run: with the dataset it determines every bit of the result. Written as `config.toml` and into
/// every checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunConfig {
    /// Where the scene is: an absolute path, or `synthetic:tabletop`.
    pub scene: String,
    /// Name of the system.
    pub system: String,
    /// Seed of all randomness.
    pub seed: u64,
    /// What is behind the scene.
    pub background: Background,
    /// Error a pixel may have from skipped work, in colour units.
    pub error_budget: f32,
    /// In which light held-out views are measured; absent: as the system suggests. No part of the training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eval_appearance: Option<EvalAppearance>,
    /// How the dataset is read.
    pub data: DataOptions,
    /// Every field of the system's configuration.
    pub settings: toml::Table,
}

/// What was asked for on the command line; `None` where nothing was said.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Request {
    /// Where the scene is.
    pub scene: Option<String>,
    /// Name of the system.
    pub system: Option<String>,
    /// Seed of all randomness.
    pub seed: Option<u64>,
    /// What is behind the scene.
    pub background: Option<Background>,
    /// Error a pixel may have from skipped work.
    pub error_budget: Option<f32>,
    /// In which light held-out views are measured.
    pub eval_appearance: Option<EvalAppearance>,
    /// How the dataset is read.
    pub data: DataOptions,
    /// `--set key=value`.
    pub set: toml::Table,
    /// What the reconstruction is for, where no system is named. No part of a run that is resumed.
    pub purpose: Purpose,
    /// When the training is to stop, where that is known: a system is chosen by it. No part of a run that is resumed.
    pub stop: Option<Stop>,
    /// Try a few steps with a copy of the system first, to know what memory the training will need.
    pub rehearsal: bool,
    /// LPIPS will be measured.
    pub lpips: bool,
}

impl Request {
    /// Check that nothing asked for differs from what the run was started with. The scene is compared by its content,
    /// elsewhere.
    ///
    /// # Errors
    /// [`RunError::ResumeDiffers`] naming the option and both values.
    pub fn agree_with(&self, run: &RunConfig) -> Result<(), RunError> {
        agree("--system", self.system.as_ref(), Some(&run.system))?;
        agree("--seed", self.seed.as_ref(), Some(&run.seed))?;
        agree("--background", self.background.map(Background::name).as_ref(), Some(&run.background.name()))?;
        agree("--error-budget", self.error_budget.as_ref(), Some(&run.error_budget))?;
        agree("--eval-appearance", self.eval_appearance.as_ref(), run.eval_appearance.as_ref())?;
        let (given, data) = (&self.data, &run.data);
        agree("--longest-side", given.longest_side.as_ref(), data.longest_side.as_ref())?;
        agree("--holdout", given.holdout.as_ref(), data.holdout.as_ref())?;
        let validation = data.validation.as_deref().unwrap_or("none");
        agree("--validation", given.validation.as_deref().as_ref(), Some(&validation))?;
        let split = data.train_split.as_deref().unwrap_or(TrainPhotos::default().name());
        agree("--train-split", given.train_split.as_deref().as_ref(), Some(&split))?;
        agree("--format", given.format.as_ref(), data.format.as_ref())?;
        agree("--images", shown(&given.images).as_ref(), shown(&data.images).as_ref())?;
        agree("--masks", given.masks.as_ref(), data.masks.as_ref())?;
        agree("--mask-white", given.mask_white.as_ref(), data.mask_white.as_ref())?;
        agree("--missing-images", given.missing_images.as_ref(), data.missing_images.as_ref())?;
        agree("--scales", given.scales.as_ref(), Some(&data.scales.unwrap_or(1)))?;
        let memory = data.image_memory.unwrap_or(IMAGE_MEMORY_MIB);
        agree("--image-memory", given.image_memory.as_ref(), Some(&memory))?;
        for (key, given) in &self.set {
            let same = run.settings.get(key).is_some_and(|run| same_value(run, given));
            if !same {
                let run = run.settings.get(key).map_or_else(|| "(not given)".into(), toml::Value::to_string);
                return Err(RunError::ResumeDiffers {
                    option: "--set".into(),
                    run: format!("{key}={run}"),
                    given: format!("{key}={given}"),
                });
            }
        }
        Ok(())
    }
}

fn shown(path: &Option<PathBuf>) -> Option<String> {
    path.as_ref().map(|p| p.display().to_string())
}

/// Nothing given, or the same as the run's.
fn agree<T: PartialEq + Display>(option: &str, given: Option<&T>, run: Option<&T>) -> Result<(), RunError> {
    match given {
        Some(given) if Some(given) != run => Err(RunError::ResumeDiffers {
            option: option.into(),
            run: run.map_or_else(|| "(not given)".into(), T::to_string),
            given: given.to_string(),
        }),
        _ => Ok(()),
    }
}

/// Equal, with `1` equal to `1.0` and floats equal as `f32`, which is what systems keep.
fn same_value(a: &toml::Value, b: &toml::Value) -> bool {
    let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
    match (number(a), number(b)) {
        (Some(a), Some(b)) => a == b || a as f32 == b as f32,
        _ => a == b,
    }
}

/// Read `key=value` as it stands after `--set`: the value is TOML, a bare word is a string.
///
/// # Errors
/// A sentence for the person when there is no `=` or no key.
pub fn parse_set(text: &str) -> Result<(String, toml::Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| format!("`{text}` has no `=`: write key=value"))?;
    let (key, value) = (key.trim(), value.trim());
    if key.is_empty() {
        return Err(format!("`{text}` has no key before the `=`"));
    }
    let parsed = toml::from_str::<toml::Table>(&format!("value = {value}")).ok().and_then(|mut t| t.remove("value"));
    Ok((key.to_string(), parsed.unwrap_or_else(|| toml::Value::String(value.to_string()))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config() -> RunConfig {
        RunConfig {
            scene: "/photos".into(),
            system: "ngp".into(),
            seed: 0,
            background: Background::White,
            error_budget: 0.0,
            eval_appearance: Some(EvalAppearance::Fit),
            data: DataOptions { longest_side: Some(480), image_memory: Some(512), ..DataOptions::default() },
            settings: toml::toml! { lr = 0.01
            levels = 8 },
        }
    }

    #[test]
    fn config_round_trips_through_toml_and_json() {
        let text = toml::to_string(&config()).unwrap();
        assert_eq!(toml::from_str::<RunConfig>(&text).unwrap(), config());
        let text = serde_json::to_string(&config()).unwrap();
        assert_eq!(serde_json::from_str::<RunConfig>(&text).unwrap(), config());
    }

    #[test]
    fn a_differing_option_is_named_with_both_values() {
        assert!(Request::default().agree_with(&config()).is_ok());
        assert!(Request { seed: Some(0), ..Request::default() }.agree_with(&config()).is_ok());
        let split = |word: &str| {
            let data = DataOptions { train_split: Some(word.into()), ..DataOptions::default() };
            Request { data, ..Request::default() }.agree_with(&config())
        };
        assert!(split("clutter").is_ok(), "the default by its name");
        assert!(split("clean").unwrap_err().to_string().contains("`--train-split clutter`"));
        let error = Request { seed: Some(3), ..Request::default() }.agree_with(&config()).unwrap_err().to_string();
        assert!(error.contains("`--seed 3`") && error.contains("`--seed 0`"), "{error}");
        let data = DataOptions { holdout: Some("none".into()), ..DataOptions::default() };
        let error = Request { data, ..Request::default() }.agree_with(&config()).unwrap_err();
        assert!(error.to_string().contains("(not given)"), "{error}");
    }

    #[test]
    fn settings_compare_as_numbers_not_as_spelling() {
        let request = |set| Request { set, ..Request::default() };
        assert!(request(toml::toml! { levels = 8.0 }).agree_with(&config()).is_ok());
        let error = request(toml::toml! { levels = 9 }).agree_with(&config()).unwrap_err().to_string();
        assert!(error.contains("levels=9") && error.contains("levels=8"), "{error}");
        assert!(request(toml::toml! { unknown = 1 }).agree_with(&config()).is_err());
    }

    #[test]
    fn set_values_are_toml_and_bare_words_are_strings() {
        assert_eq!(parse_set("lr=1e-2").unwrap(), ("lr".into(), toml::Value::Float(0.01)));
        assert_eq!(parse_set("levels = 8").unwrap(), ("levels".into(), toml::Value::Integer(8)));
        assert_eq!(parse_set("space=ndc").unwrap(), ("space".into(), toml::Value::String("ndc".into())));
        assert!(parse_set("lr").is_err() && parse_set("=3").is_err());
    }
}
