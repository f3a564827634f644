//! What all commands share: the words of the command line as the engine takes them, and how a command ends.

use crate::app::App;
use crate::cli::{Data, ProgressKind};
use crate::show::Show;
use engine::RunError;
use engine::eval::lpips_file::{load_lpips, lpips_path};
use engine::options::DataOptions;
use engine::run::{Parts, Run};
use losses::metrics::Lpips;
use std::error::Error;
use std::path::{Path, PathBuf};

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Done {
    /// As wished.
    Finished,
    /// By a signal; a checkpoint is written.
    Interrupted,
    /// It has said why not.
    Refused,
}

/// Any failure; shown as its line and its causes.
pub(crate) type Failure = Box<dyn Error>;

/// What all commands share.
pub(crate) struct Session {
    pub(crate) app: &'static App,
    pub(crate) progress: ProgressKind,
    pub(crate) lpips: Option<PathBuf>,
    pub(crate) threads: Option<u16>,
    pub(crate) memory: Option<u64>,
}

impl Session {
    /// The LPIPS network, when its weights are given.
    pub(crate) fn lpips(&self) -> Result<Option<Lpips>, Failure> {
        match lpips_path(self.lpips.as_deref()) {
            Some(path) => Ok(Some(load_lpips(&path)?)),
            None => Ok(None),
        }
    }

    /// Whether LPIPS will be measured.
    pub(crate) fn measures_lpips(&self) -> bool {
        lpips_path(self.lpips.as_deref()).is_some()
    }

    /// Scenes from files and the embedded ones, systems by their names, files to the disk.
    pub(crate) fn parts(&self) -> Parts<'static> {
        engine::run::disk_parts(&self.app.load, &systems::registry::build, self.app.default_system)
    }

    /// The run in a folder, at its newest checkpoint.
    pub(crate) fn open(&self, folder: &Path, show: &mut Show) -> Result<Run<'static>, RunError> {
        Run::open(folder, &engine::options::Request::default(), self.parts(), show)
    }

    /// The same, for work that writes into the folder: nothing else does so meanwhile.
    pub(crate) fn open_to_write(&self, folder: &Path, show: &mut Show) -> Result<Run<'static>, RunError> {
        Run::open_to_write(folder, &engine::options::Request::default(), self.parts(), show)
    }

    pub(crate) fn show(&self) -> Show {
        Show::new(self.progress)
    }

    /// A line that can be typed as it is: this program as it was called, `words` quoted where a shell needs it, and
    /// `with_options` of all commands as they were given.
    pub(crate) fn command_line(&self, words: Vec<String>, with_options: bool) -> String {
        let mut line = vec![program(self.app)];
        line.extend(words);
        if with_options {
            line.extend(self.threads.into_iter().flat_map(|n| ["--threads".into(), n.to_string()]));
            line.extend(self.memory.into_iter().flat_map(|n| ["--memory".into(), n.to_string()]));
            line.extend(self.lpips.iter().flat_map(|file| ["--lpips-weights".into(), file.display().to_string()]));
        }
        shlex::try_join(line.iter().map(String::as_str)).unwrap_or_else(|_| line.join(" "))
    }
}

/// This program as it was called: what is typed next begins with it.
pub(crate) fn program(app: &App) -> String {
    // No panic over a name that is not UTF-8.
    let name = std::env::args_os().next().map(|name| name.to_string_lossy().into_owned());
    name.filter(|name| !name.is_empty()).unwrap_or_else(|| app.name.into())
}

/// What the command line says about the dataset, with paths that mean the same from everywhere.
pub(crate) fn data_options(data: &Data) -> DataOptions {
    DataOptions {
        longest_side: data.longest_side,
        holdout: data.holdout.as_deref().map(which_frames),
        validation: data.validation.as_deref().map(which_frames),
        train_split: data.train_split.clone(),
        format: data.format.clone(),
        images: data.images.as_deref().map(absolute),
        masks: data.masks.as_ref().map(|m| match m.as_str() {
            "off" => m.clone(),
            folder => absolute(Path::new(folder)).display().to_string(),
        }),
        mask_white: data.mask_white.clone(),
        priors: data.priors.as_deref().map(absolute),
        missing_images: data.missing_images.clone(),
        scales: None,
        image_memory: data.image_memory,
    }
}

/// Which frames, as the run remembers it: a file of names by absolute path.
fn which_frames(word: &str) -> String {
    match word.strip_prefix("names:") {
        Some(file) => format!("names:{}", absolute(Path::new(file)).display()),
        None => word.into(),
    }
}

/// A scene as the run remembers it: embedded scenes by name, files by absolute path, what is done to them before it.
pub(crate) fn scene_spec(scene: &str) -> String {
    // What is done to it stands before it, up to a colon.
    let rest = scene.strip_prefix(engine::source::PERTURBED).and_then(|rest| rest.split_once(':'));
    let (before, inner) = scene.split_at(rest.map_or(0, |(_, inner)| scene.len() - inner.len()));
    match inner.starts_with(engine::source::SYNTHETIC) {
        true => scene.into(),
        false => format!("{before}{}", absolute(Path::new(inner)).display()),
    }
}

fn absolute(path: &Path) -> PathBuf {
    // Fails for empty paths and unknown working folders only; reading them will say what is wrong.
    std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf())
}

/// The table behind `--set`, with `--field` and `--max-splats` as words of it.
pub(crate) fn settings(set: Vec<(String, toml::Value)>, field: Option<String>, max_splats: Option<u32>) -> toml::Table {
    let mut table: toml::Table = set.into_iter().collect();
    table.extend(field.map(|kind| ("field".to_string(), toml::Value::String(kind))));
    table.extend(max_splats.map(|n| ("max_splats".to_string(), toml::Value::Integer(n.into()))));
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_is_a_setting_like_any_other() {
        let set = || vec![("lr".to_string(), toml::Value::Float(0.5))];
        let table = settings(set(), Some("mlp".into()), Some(9));
        assert_eq!(table["field"].as_str(), Some("mlp"));
        assert_eq!(table["lr"].as_float(), Some(0.5));
        assert_eq!(table["max_splats"].as_integer(), Some(9));
        assert!(!settings(set(), None, None).contains_key("field"));
    }
}
