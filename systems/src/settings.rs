//! Settings of a system as a table, and what `--set` says over them.
//!
//! Each part of a system has a struct of its own with 3 to 12 settings. [`Settings`] joins those of the parts that are there: these
//! names and no others can be set, and all of them are written to the run's `config.toml`.

use engine::options::RunOptions;
use engine::system::SystemError;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// What accepts training cameras that are all the same: `--set accept_no_parallax=true`.
pub(crate) const NO_PARALLAX: &str = "accept_no_parallax";

/// Whether a name of `--set` is read elsewhere, whatever the system.
pub(crate) fn elsewhere(key: &str) -> bool {
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

/// The settings of a system, part by part.
pub(crate) struct Settings<'a> {
    run: &'a RunOptions,
    /// Names and values of the parts so far.
    all: toml::Table,
}

impl<'a> Settings<'a> {
    /// Of no part yet.
    pub(crate) fn new(run: &'a RunOptions) -> Self {
        Self { run, all: toml::Table::new() }
    }

    /// The settings of a part: `planned`, and what `--set` says over them.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a value of the wrong kind.
    ///
    /// # Panics
    /// Where another part has a setting of the same name.
    pub(crate) fn of<C: Serialize + DeserializeOwned>(&mut self, planned: &C) -> Result<C, SystemError> {
        let part = over(table(planned), self.run)?;
        for (key, value) in &part {
            let before = self.all.insert(key.clone(), value.clone());
            assert!(before.is_none(), "two parts have a setting `{key}`");
        }
        typed(part, self.run)
    }

    /// Names and values of the parts so far.
    pub(crate) fn known(&self) -> &toml::Table {
        &self.all
    }

    /// Write other values of settings that a part has: those that were only known once it had read something.
    pub(crate) fn record<C: Serialize>(&mut self, part: &C) {
        self.all.extend(table(part));
    }

    /// All settings by name, after the last part was asked for its own.
    ///
    /// # Errors
    /// [`SystemError::Config`] for names of `--set` that no part has.
    pub(crate) fn all(self) -> Result<toml::Table, SystemError> {
        refuse_unknown(self.run, &self.all)?;
        let mut all = self.all;
        // A resumed run must be given it again.
        all.extend(self.run.set.get_key_value(NO_PARALLAX).map(|(key, value)| (key.clone(), value.clone())));
        Ok(all)
    }
}

/// The values of `--set` in the place of those that are planned.
fn over(mut planned: toml::Table, run: &RunOptions) -> Result<toml::Table, SystemError> {
    for (key, value) in &run.set {
        let Some(slot) = planned.get_mut(key) else { continue };
        *slot = match (&*slot, value) {
            // `1` for a float is meant well.
            (toml::Value::Float(_), toml::Value::Integer(i)) => toml::Value::Float(*i as f64),
            (planned, value) if planned.same_type(value) => value.clone(),
            (planned, value) => return Err(another_kind(key, value, planned)),
        };
    }
    Ok(planned)
}

/// That a setting is not of the kind that it is planned with.
fn another_kind(key: &str, value: &toml::Value, planned: &toml::Value) -> SystemError {
    let kind = match planned {
        toml::Value::String(_) => "a word",
        toml::Value::Integer(_) => "a whole number",
        toml::Value::Float(_) => "a number",
        toml::Value::Boolean(_) => "true or false",
        _ => "a list",
    };
    SystemError::Config {
        field: "set",
        value: format!("{key} = {value}"),
        problem: format!("must be {kind}, as {planned} is"),
    }
}

fn typed<C: DeserializeOwned>(settings: toml::Table, run: &RunOptions) -> Result<C, SystemError> {
    settings.try_into().map_err(|e: toml::de::Error| SystemError::Config {
        field: "set",
        value: run.set.to_string().trim().replace('\n', ", "),
        problem: e.message().into(),
    })
}

/// Every field of a configuration with its value.
pub(crate) fn table<C: Serialize>(config: &C) -> toml::Table {
    toml::Table::try_from(config).expect("settings are plain values")
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Serialize, Deserialize, PartialEq, Debug)]
    struct One {
        width: f32,
    }

    #[derive(Serialize, Deserialize, PartialEq, Debug)]
    struct Two {
        depth: u32,
    }

    fn run(set: &str) -> RunOptions {
        RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: set.parse().unwrap() }
    }

    #[test]
    fn each_part_gets_its_own_and_unknown_names_are_refused_with_those_there_are() {
        let run = run("width = 3\naccept_no_parallax = true");
        let mut settings = Settings::new(&run);
        assert_eq!(settings.of(&One { width: 1.0 }).unwrap(), One { width: 3.0 });
        assert_eq!(settings.of(&Two { depth: 2 }).unwrap(), Two { depth: 2 });
        assert_eq!(settings.all().unwrap(), "width = 3.0\ndepth = 2\naccept_no_parallax = true".parse().unwrap());
        let run = self::run("depth = 4");
        let mut settings = Settings::new(&run);
        settings.of(&One { width: 1.0 }).unwrap();
        let error = settings.all().unwrap_err().to_string();
        assert!(error.contains("depth") && error.contains("there are width"), "{error}");
        let run = self::run("width = \"wide\"");
        let error = Settings::new(&run).of(&One { width: 1.0 }).unwrap_err().to_string();
        assert!(error.contains("width = \"wide\"") && error.contains("must be a number, as 1.0 is"), "{error}");
    }
}
