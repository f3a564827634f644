//! Settings of any system as a table, and what `--set` says over them.

use super::parallax::NO_PARALLAX;
use engine::options::RunOptions;
use engine::system::SystemError;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// There is no system of this name, but of these.
pub(crate) fn no_such_system(name: &str, systems: impl IntoIterator<Item = &'static str>) -> SystemError {
    let names: Vec<&str> = systems.into_iter().collect();
    let problem = format!("there is no such system; use one of {}", names.join(", "));
    SystemError::Config { field: "system", value: name.into(), problem }
}

/// Whether a name of `--set` is read elsewhere, whatever the system.
fn elsewhere(key: &str) -> bool {
    key == NO_PARALLAX || key == engine::photo_points::provide::SETTING
}

/// Refuse names of `--set` that are none of `known`.
pub(crate) fn refuse_unknown(run: &RunOptions, known: &toml::Table) -> Result<(), SystemError> {
    match run.set.keys().find(|key| !elsewhere(key) && !known.contains_key(*key)) {
        None => Ok(()),
        Some(key) => {
            let names: Vec<&str> = known.keys().map(String::as_str).collect();
            Err(SystemError::Config {
                field: "set",
                value: key.clone(),
                problem: format!("there is no such setting; there are {}", names.join(", ")),
            })
        }
    }
}

/// Settings after `--set`: unknown names and values of the wrong kind are errors that name them.
pub(crate) fn settings<C: Serialize + DeserializeOwned>(planned: &C, run: &RunOptions) -> Result<C, SystemError> {
    let mut all = table(planned);
    refuse_unknown(run, &all)?;
    for (key, value) in &run.set {
        let Some(slot) = all.get_mut(key) else { continue };
        // `1` for a float is meant well.
        *slot = match (&*slot, value) {
            (toml::Value::Float(_), toml::Value::Integer(i)) => toml::Value::Float(*i as f64),
            _ => value.clone(),
        };
    }
    all.try_into().map_err(|e: toml::de::Error| SystemError::Config {
        field: "set",
        value: run.set.to_string().trim().replace('\n', ", "),
        problem: e.message().into(),
    })
}

/// `--set` for a method, whose settings are `ours`, and for its field.
pub(crate) fn split(run: &RunOptions, ours: &toml::Table) -> (RunOptions, RunOptions) {
    let keep = |mine: bool| RunOptions {
        set: run
            .set
            .iter()
            .filter(|(key, _)| ours.contains_key(*key) == mine)
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect(),
        ..run.clone()
    };
    (keep(true), keep(false))
}

/// Every field of a configuration with its value.
pub(crate) fn table<C: Serialize>(config: &C) -> toml::Table {
    toml::Table::try_from(config).expect("settings are plain values")
}
