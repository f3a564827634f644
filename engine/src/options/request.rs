//! What was asked for on the command line, and what a run was started with.

use super::appearance::EvalAppearance;
use super::background::Background;
use super::data::{DataOptions, IMAGE_MEMORY_MIB};
use super::plan::Purpose;
use super::schedule::Stop;
use crate::error::RunError;
use scene_io::TrainPhotos;
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::path::PathBuf;

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
    /// In which appearance held-out views are measured; absent: as the system suggests. The training does not depend on it.
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
    /// In which appearance held-out views are measured.
    pub eval_appearance: Option<EvalAppearance>,
    /// How the dataset is read.
    pub data: DataOptions,
    /// `--set key=value`.
    pub set: toml::Table,
    /// What the reconstruction is for, where no system is named. No part of a run that is resumed.
    pub purpose: Purpose,
    /// When the training is to stop, where that is known: a system is chosen by it. No part of a run that is resumed.
    pub stop: Option<Stop>,
    /// How fast this machine is, in that of the machine that schedules are planned for; `None`: as fast. Schedules of a training that
    /// stops after seconds are of the steps that it makes in them. No part of a run that is resumed.
    pub speed: Option<f64>,
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
        agree("--priors", shown(&given.priors).as_ref(), shown(&data.priors).as_ref())?;
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
}
