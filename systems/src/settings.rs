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
        let planned = table(planned);
        let part = over(planned.clone(), self.run)?;
        for (key, value) in &part {
            let before = self.all.insert(key.clone(), value.clone());
            assert!(before.is_none(), "two parts have a setting `{key}`");
        }
        part.try_into().map_err(|e: toml::de::Error| unreadable::<C>(&planned, self.run, e.message()))
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

/// That a value of `--set` is of the right kind and cannot be read all the same: the first such one, and what it must be. `message` is what
/// was said of all of them together.
fn unreadable<C: DeserializeOwned>(planned: &toml::Table, run: &RunOptions, message: &str) -> SystemError {
    let refused = |value: String, problem| SystemError::Config { field: "set", value, problem };
    for (key, value) in run.set.iter().filter(|(key, _)| planned.contains_key(*key)) {
        let mut with_it = planned.clone();
        with_it.insert(key.clone(), value.clone());
        if let Err(e) = with_it.try_into::<C>() {
            return refused(format!("{key} = {value}"), must_be(value, e.message()));
        }
    }
    refused(run.set.to_string().trim().replace('\n', ", "), message.into())
}

/// What a value must be, of which `message` was said.
fn must_be(value: &toml::Value, message: &str) -> String {
    let words = words_in(message);
    match value {
        toml::Value::String(_) if !words.is_empty() => format!("must be one of {}", words.join(", ")),
        toml::Value::Integer(..0) => "must be a whole number, 0 or more".into(),
        toml::Value::Integer(i) if *i > i64::from(u32::MAX) => "is too large a number".into(),
        toml::Value::Array(list) if list.iter().any(|v| v.as_integer().is_some_and(|i| i < 0)) => {
            "must hold whole numbers, 0 or more".into()
        }
        _ => message.into(),
    }
}

/// The words of a setting that is one of several, in their order.
pub(crate) fn words_of<W: DeserializeOwned>() -> Vec<String> {
    let refused = toml::Value::String(String::new()).try_into::<W>().err();
    refused.map_or_else(Vec::new, |e| words_in(e.message()))
}

/// The words that serde says there are, where it was given another one: each between two backticks.
fn words_in(message: &str) -> Vec<String> {
    let (_, words) =
        message.split_once("unknown variant").and_then(|_| message.rsplit_once("expected ")).unwrap_or_default();
    words.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// That settings make nothing together, each fine by itself: `fields` names them as `--set` does, with a comma and a space between two of
/// them, and `config` holds them among others.
pub(crate) fn together<C: Serialize>(fields: &'static str, config: &C, problem: impl ToString) -> SystemError {
    let table = table(config);
    let values =
        fields.split(", ").map(|name| table.get(name).map_or_else(|| "not set".into(), toml::Value::to_string));
    SystemError::Config { field: fields, value: values.collect::<Vec<_>>().join(", "), problem: problem.to_string() }
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

    #[derive(Serialize, Deserialize, PartialEq, Debug)]
    #[serde(rename_all = "lowercase")]
    enum Place {
        Here,
        There,
    }

    #[derive(Serialize, Deserialize, PartialEq, Debug)]
    struct Three {
        place: Place,
        count: u32,
        cells: Vec<u32>,
        share: f32,
    }

    #[test]
    fn what_makes_nothing_together_is_said_with_its_values() {
        let three = Three { place: Place::Here, count: 3, cells: vec![8, 4], share: 0.5 };
        let error = together("count, cells", &three, "do not fit").to_string();
        assert_eq!(error, "`count, cells` = 3, [8, 4]: do not fit");
    }

    #[test]
    fn a_value_that_cannot_be_is_said_alone_with_what_it_must_be() {
        let planned = || Three { place: Place::Here, count: 3, cells: vec![8], share: 0.5 };
        for (set, line) in [
            ("place = \"nowhere\"", "`set` = place = \"nowhere\": must be one of here, there"),
            ("count = -1", "`set` = count = -1: must be a whole number, 0 or more"),
            ("count = 5000000000", "`set` = count = 5000000000: is too large a number"),
            ("cells = [4, -4]", "`set` = cells = [4, -4]: must hold whole numbers, 0 or more"),
        ] {
            // What is right, and what other parts read, is not said with it.
            let run = run(&format!("share = 1\nwidth = 4.0\n{set}"));
            assert_eq!(Settings::new(&run).of(&planned()).unwrap_err().to_string(), line);
        }
        let run = run("share = 1\nplace = \"there\"");
        assert_eq!(Settings::new(&run).of(&planned()).unwrap(), Three { place: Place::There, share: 1.0, ..planned() });
        assert_eq!(words_of::<Place>(), ["here", "there"]);
        assert!(words_of::<Three>().is_empty());
    }
}
