//! The filter of another run: SF-NeRF with few photos begins with a filter that saw many photos of another scene (its paper,
//! section 3.4). Codes of photos and the field begin anew.

use super::filter::Filter;
use engine::checkpoint;
use engine::error::RunError;
use engine::system::{SystemError, TensorData, TensorMap};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The part of a filter from another run that does not learn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Freeze {
    /// The branch of the features.
    #[default]
    Features,
    /// Nothing.
    Nothing,
}

/// Settings of a filter that begins with the weights of another run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PretrainedConfig {
    /// A run of `sf-nerf`, or the array file of one of its checkpoints, whose filter this one begins with; empty: from
    /// scratch. Codes and field begin anew.
    pub filter_from: String,
    /// The part that does not learn: `features` (their branch) or `nothing`.
    pub filter_freeze: Freeze,
    /// SHA-256 of the file that the filter was read from; recorded when it is.
    pub filter_sha256: String,
}

/// The initial weights of the filter.
pub(super) enum FilterStart {
    /// Random weights.
    Scratch,
    /// The networks of another run.
    Of(Pretrained),
    /// Those of a file with this SHA-256, which is read if training begins here: a resumed run has them already.
    Later(PathBuf, String),
}

/// Arrays of another run.
pub(super) struct Pretrained {
    file: PathBuf,
    sha256: String,
    state: TensorMap,
    /// Settings of that run, where they are known.
    settings: toml::Table,
}

impl FilterStart {
    /// As set; the SHA-256 of a file that is read is recorded in `settings`.
    pub(super) fn of(settings: &mut PretrainedConfig) -> Result<Self, SystemError> {
        if settings.filter_from.is_empty() {
            return Ok(Self::Scratch);
        }
        let path = PathBuf::from(&settings.filter_from);
        if !settings.filter_sha256.is_empty() {
            return Ok(Self::Later(path, settings.filter_sha256.clone()));
        }
        let read = Pretrained::read(&path)?;
        settings.filter_sha256.clone_from(&read.sha256);
        Ok(Self::Of(read))
    }

    /// A line of the plan.
    pub(super) fn line(&self, freeze: Freeze) -> String {
        let rest = match freeze {
            Freeze::Features => "its branch of features does not learn",
            Freeze::Nothing => "all of it learns",
        };
        match self {
            Self::Scratch => "filter: from scratch (for few photos, begin with that of a run with many: \
                              `--set filter_from=RUN`)"
                .into(),
            Self::Of(Pretrained { file: path, .. }) | Self::Later(path, _) => {
                format!("filter: begins with that of {}; {rest}", path.display())
            }
        }
    }
}

fn refuse(path: &Path, problem: String) -> SystemError {
    SystemError::Config { field: "filter_from", value: format!("\"{}\"", path.display()), problem }
}

impl Pretrained {
    /// From a run's folder, its newest checkpoint, or from the array file of a checkpoint.
    pub(super) fn read(path: &Path) -> Result<Self, SystemError> {
        if path.is_dir() {
            let found = checkpoint::load_newest(path).map_err(|e| match e {
                RunError::NoCheckpoint(_) => refuse(path, "there is no checkpoint in it".into()),
                other => refuse(path, other.to_string()),
            })?;
            let file = checkpoint::folder(path).join(&found.meta.tensors.file);
            let (sha256, settings) = (found.meta.tensors.sha256, found.meta.config.settings);
            return Ok(Self { file, sha256, state: found.state, settings });
        }
        let (state, sha256) = checkpoint::read_arrays(path).map_err(|problem| refuse(path, problem))?;
        Ok(Self { file: path.into(), sha256, state, settings: toml::Table::new() })
    }

    /// [`Pretrained::read`] of a file that has to be the one read before.
    pub(super) fn read_again(path: &Path, sha256: &str) -> Result<Self, SystemError> {
        let read = Self::read(path)?;
        if read.sha256 != sha256 {
            let problem = "holds another filter than when it was first read: take `filter_sha256` out of the settings, or put \
                           the file back";
            return Err(refuse(path, problem.into()));
        }
        Ok(read)
    }

    /// Put the weights in the place of a filter's. Nothing is changed unless all of them fit.
    pub(super) fn fill(&self, filter: &mut Filter) -> Result<(), SystemError> {
        let mut weights = Vec::new();
        for net in filter.nets() {
            let (name, want) = (format!("{}.network", net.name()), net.params.len());
            match self.state.get(&name).map(|tensor| &tensor.data) {
                Some(TensorData::F32(data)) if data.len() == want => weights.push(data.to_vec()),
                Some(TensorData::F32(data)) => {
                    let problem = format!(
                        "`{name}` in {} has shape [{}], here it is [{want}] ({}){}",
                        self.file.display(),
                        data.len(),
                        net.shape(),
                        self.difference(filter)
                    );
                    return Err(refuse(&self.file, problem));
                }
                _ => {
                    let why = match self.state.keys().any(|key| key.starts_with("filter.")) {
                        true => "its filter was trained without features (`--set filter_features=none`)",
                        false => "it is not a checkpoint of `sf-nerf`",
                    };
                    return Err(refuse(&self.file, format!("there is no `{name}` in {}: {why}", self.file.display())));
                }
            }
        }
        filter.nets_mut().zip(weights).for_each(|(net, weights)| net.begin_with(weights));
        Ok(())
    }

    /// Why the shapes differ, as far as it is known.
    fn difference(&self, filter: &Filter) -> String {
        let shape = filter.shape;
        let here = [("filter_octaves", shape.octaves), ("filter_width", shape.width), ("transient_dims", shape.code)];
        let there = |key| self.settings.get(key).and_then(toml::Value::as_integer);
        let differs: Vec<String> = here
            .into_iter()
            .filter_map(|(key, here)| Some((key, here, there(key)?)))
            .filter(|&(_, here, there)| usize::try_from(there) != Ok(here))
            .map(|(key, here, there)| format!("`{key}` is {there} there and {here} here"))
            .collect();
        match (differs.is_empty(), self.settings.is_empty()) {
            (false, _) => format!(": {}", differs.join(", ")),
            (true, false) => ": features have another length there, or only one of the filters has them".into(),
            (true, true) => ": `filter_octaves`, `filter_width`, `transient_dims` and features have to agree".into(),
        }
    }
}
