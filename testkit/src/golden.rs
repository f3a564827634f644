//! Golden vectors: inputs, outputs and exact gradients made by independent code, read from JSON.
//!
//! One file holds one topic and many [`Record`]s. Numbers are read as the exact `f64` they were written from.
//!
//! ```
//! use testkit::golden::{Golden, assert_close};
//!
//! let text = r#"{"topic": "square", "seed": 1, "format": 1, "about": "", "oracle": "", "records": [
//!     {"op": "square", "name": "plain", "kind": "random", "params": {"scale": 2}, "f32_inputs_exact": true,
//!      "inputs": {"x": {"shape": [2], "data": [1.0, 3.0]}}, "outputs": {"y": {"shape": [2], "data": [2.0, 18.0]}},
//!      "cotangents": {"y": {"shape": [2], "data": [1.0, 1.0]}}, "grads": {"x": {"shape": [2], "data": [4.0, 12.0]}}}]}"#;
//! let golden = Golden::parse(text).unwrap();
//! for record in golden.op("square") {
//!     let scale = record.param("scale").f64();
//!     let got: Vec<f64> = record.input("x").data.iter().map(|x| scale * x * x).collect();
//!     assert_close(&record.label(), &got, &record.output("y").data, 1e-12, 1e-13);
//! }
//! ```

use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::Path;

mod close;
mod data;
mod error;
mod param;
mod tensor;
#[cfg(test)]
mod tests;

pub use close::{Number, assert_close, check_close};
pub use data::{data_dir, data_or_skip, skipped};
pub use error::GoldenError;
pub use param::Param;
pub use tensor::Tensor;

use error::error;

/// One file.
#[derive(Clone, Debug)]
pub struct Golden {
    /// What it is about, as in the file's name.
    pub topic: String,
    /// Everything in it, in file order.
    pub records: Vec<Record>,
}

/// How a record's inputs were chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Ordinary values.
    Random,
    /// Values on the edges of the domain.
    Boundary,
    /// Values picked to break naive code.
    Adversarial,
}

/// One case: parameters, inputs, outputs and, where the function is differentiated, cotangents and gradients of
/// `L = sum over outputs of <cotangent, output>`.
#[derive(Clone, Debug)]
pub struct Record {
    /// The function.
    pub op: String,
    /// The case.
    pub name: String,
    /// How the inputs were chosen.
    pub kind: Kind,
    /// Remark of whoever made it; often the formula.
    pub note: String,
    /// Every input is exactly an `f32`: both precisions see the same problem. Otherwise compare in `f64` only.
    pub f32_inputs_exact: bool,
    params: Map<String, Value>,
    /// `inputs`, `outputs`, `cotangents`, `grads`, and sections special to one topic.
    sections: BTreeMap<String, BTreeMap<String, Tensor>>,
}

impl Golden {
    /// Read a file.
    ///
    /// # Errors
    /// Names the file and what is wrong in it.
    pub fn read(path: &Path) -> Result<Self, GoldenError> {
        let text = std::fs::read_to_string(path).or_else(|e| error(format!("{}: {e}", path.display())))?;
        Self::parse(&text).or_else(|e| error(format!("{}: {e}", path.display())))
    }

    /// Read from text.
    ///
    /// # Errors
    /// Names the record and field which is wrong.
    pub fn parse(text: &str) -> Result<Self, GoldenError> {
        let root: Value = serde_json::from_str(text).or_else(|e| error(e.to_string()))?;
        if root["format"] != 1 {
            return error(format!("`format` is {}, this reader knows 1", root["format"]));
        }
        let Some(records) = root["records"].as_array() else { return error("no list `records`") };
        let records = records
            .iter()
            .enumerate()
            .map(|(i, value)| Record::parse(value).or_else(|e| error(format!("record {i}: {e}"))))
            .collect::<Result<_, _>>()?;
        Ok(Self { topic: text_of(&root, "topic")?, records })
    }

    /// The records of one function.
    ///
    /// # Panics
    /// If there is none: a test that loops over nothing tests nothing.
    #[track_caller]
    pub fn op<'a>(&'a self, op: &'a str) -> impl Iterator<Item = &'a Record> {
        assert!(self.records.iter().any(|r| r.op == op), "golden `{}` has no record of `{op}`", self.topic);
        self.records.iter().filter(move |r| r.op == op)
    }

    /// The one record of this function and name.
    ///
    /// # Panics
    /// If there is none.
    #[must_use]
    #[track_caller]
    pub fn record(&self, op: &str, name: &str) -> &Record {
        let found = self.records.iter().find(|r| r.op == op && r.name == name);
        found.unwrap_or_else(|| panic!("golden `{}` has no record `{op}/{name}`", self.topic))
    }
}

fn text_of(value: &Value, key: &str) -> Result<String, GoldenError> {
    match value[key].as_str() {
        Some(text) => Ok(text.to_owned()),
        None => error(format!("`{key}` is missing or no text")),
    }
}

impl Record {
    fn parse(value: &Value) -> Result<Self, GoldenError> {
        let (op, name) = (text_of(value, "op")?, text_of(value, "name")?);
        Self::parse_rest(value, op.clone(), name.clone()).or_else(|e| error(format!("{op}/{name}: {e}")))
    }

    fn parse_rest(value: &Value, op: String, name: String) -> Result<Self, GoldenError> {
        let kind = match text_of(value, "kind")?.as_str() {
            "random" => Kind::Random,
            "boundary" => Kind::Boundary,
            "adversarial" => Kind::Adversarial,
            other => return error(format!("`kind` is `{other}`")),
        };
        let mut sections = BTreeMap::new();
        for (key, section) in value.as_object().into_iter().flatten() {
            if !section.is_object() || key == "params" {
                continue;
            }
            let mut tensors = BTreeMap::new();
            if section.get("shape").is_some() {
                // A section that is one tensor: named as itself.
                tensors.insert(key.clone(), Tensor::parse(section).or_else(|e| error(format!("`{key}`: {e}")))?);
            } else {
                for (name, t) in section.as_object().into_iter().flatten() {
                    tensors.insert(name.clone(), Tensor::parse(t).or_else(|e| error(format!("`{key}.{name}`: {e}")))?);
                }
            }
            sections.insert(key.clone(), tensors);
        }
        Ok(Self {
            op,
            name,
            kind,
            note: value["note"].as_str().unwrap_or_default().to_owned(),
            f32_inputs_exact: value["f32_inputs_exact"].as_bool().unwrap_or(false),
            params: value["params"].as_object().cloned().unwrap_or_default(),
            sections,
        })
    }

    /// `op/name`, for messages.
    #[must_use]
    pub fn label(&self) -> String {
        format!("{}/{}", self.op, self.name)
    }

    /// A tensor of any section, if it is there. A section that is one tensor has that tensor under its own name.
    #[must_use]
    pub fn get(&self, section: &str, name: &str) -> Option<&Tensor> {
        self.sections.get(section)?.get(name)
    }

    #[track_caller]
    fn expect(&self, section: &str, name: &str) -> &Tensor {
        self.get(section, name).unwrap_or_else(|| {
            let there: Vec<_> = self.sections.get(section).into_iter().flat_map(BTreeMap::keys).collect();
            panic!("{}: no `{name}` among `{section}`, which holds {there:?}", self.label())
        })
    }

    /// All tensors of a section, by name.
    pub fn section(&self, section: &str) -> impl Iterator<Item = (&str, &Tensor)> {
        self.sections.get(section).into_iter().flatten().map(|(name, t)| (name.as_str(), t))
    }

    /// An input.
    ///
    /// # Panics
    /// If there is none of that name. So do the other accessors.
    #[must_use]
    #[track_caller]
    pub fn input(&self, name: &str) -> &Tensor {
        self.expect("inputs", name)
    }

    /// An output.
    ///
    /// # Panics
    /// As [`Record::input`].
    #[must_use]
    #[track_caller]
    pub fn output(&self, name: &str) -> &Tensor {
        self.expect("outputs", name)
    }

    /// `dL / d output`.
    ///
    /// # Panics
    /// As [`Record::input`].
    #[must_use]
    #[track_caller]
    pub fn cotangent(&self, name: &str) -> &Tensor {
        self.expect("cotangents", name)
    }

    /// `dL / d input`.
    ///
    /// # Panics
    /// As [`Record::input`].
    #[must_use]
    #[track_caller]
    pub fn grad(&self, name: &str) -> &Tensor {
        self.expect("grads", name)
    }

    /// A parameter.
    ///
    /// # Panics
    /// As [`Record::input`].
    #[must_use]
    #[track_caller]
    pub fn param<'a>(&'a self, name: &'a str) -> Param<'a> {
        self.try_param(name).unwrap_or_else(|| {
            panic!("{}: no parameter `{name}` among {:?}", self.label(), self.params.keys().collect::<Vec<_>>())
        })
    }

    /// A parameter, if it is there.
    #[must_use]
    pub fn try_param<'a>(&'a self, name: &'a str) -> Option<Param<'a>> {
        self.params.get(name).map(|value| Param { record: self, name, value })
    }
}
