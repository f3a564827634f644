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
use std::fmt;
use std::path::{Path, PathBuf};

/// What went wrong while a golden file was read: where in the file, and what.
#[derive(Debug)]
pub struct GoldenError(String);

impl fmt::Display for GoldenError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for GoldenError {}

fn error<T>(what: impl Into<String>) -> Result<T, GoldenError> {
    Err(GoldenError(what.into()))
}

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

/// Numbers and their shape, row-major. A scalar has the shape `[]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Length of each axis, slowest first.
    pub shape: Vec<usize>,
    /// Values; image bytes as `0.0 ..= 255.0`.
    pub data: Vec<f64>,
}

impl Tensor {
    /// Values rounded to `f32`.
    #[must_use]
    pub fn f32(&self) -> Vec<f32> {
        self.data.iter().map(|&x| x as f32).collect()
    }

    /// The only value.
    ///
    /// # Panics
    /// If there is not exactly one.
    #[must_use]
    #[track_caller]
    pub fn scalar(&self) -> f64 {
        assert_eq!(self.data.len(), 1, "a tensor of shape {:?} is not a scalar", self.shape);
        self.data[0]
    }

    /// Values as bytes.
    ///
    /// # Panics
    /// If a value is no integer in `0..=255`.
    #[must_use]
    #[track_caller]
    pub fn bytes(&self) -> Vec<u8> {
        let byte = |&x: &f64| {
            assert!((0.0..=255.0).contains(&x) && x.fract() == 0.0, "{x} is not a byte");
            x as u8
        };
        self.data.iter().map(byte).collect()
    }

    /// Values as indices.
    ///
    /// # Panics
    /// If a value is no integer `>= 0`.
    #[must_use]
    #[track_caller]
    pub fn indices(&self) -> Vec<usize> {
        let index = |&x: &f64| {
            assert!(x >= 0.0 && x.fract() == 0.0 && x < 9e15, "{x} is not an index");
            x as usize
        };
        self.data.iter().map(index).collect()
    }

    /// Row `i` of the first axis.
    ///
    /// # Panics
    /// If `i` is past the end or the tensor is a scalar.
    #[must_use]
    #[track_caller]
    pub fn row(&self, i: usize) -> &[f64] {
        let n: usize = self.shape[1..].iter().product();
        &self.data[i * n..(i + 1) * n]
    }
}

/// A parameter of a record. The accessors panic, naming record and parameter, where the type is another.
#[derive(Clone, Copy, Debug)]
pub struct Param<'a> {
    record: &'a Record,
    name: &'a str,
    value: &'a Value,
}

impl<'a> Param<'a> {
    #[track_caller]
    fn wrong(&self, want: &str) -> ! {
        panic!("{}: parameter `{}` is {}, not {want}", self.record.label(), self.name, self.value)
    }

    /// A number; the strings `"inf"`, `"-inf"` and `"nan"` count as numbers.
    #[must_use]
    #[track_caller]
    pub fn f64(&self) -> f64 {
        number(self.value).unwrap_or_else(|| self.wrong("a number"))
    }

    /// A number rounded to `f32`.
    #[must_use]
    #[track_caller]
    pub fn f32(&self) -> f32 {
        self.f64() as f32
    }

    /// A whole number `>= 0` (`3` and `3.0` alike).
    #[must_use]
    #[track_caller]
    pub fn usize(&self) -> usize {
        let x = self.f64();
        if x >= 0.0 && x.fract() == 0.0 && x < 9e15 { x as usize } else { self.wrong("a whole number >= 0") }
    }

    /// `true` or `false`.
    #[must_use]
    #[track_caller]
    pub fn bool(&self) -> bool {
        self.value.as_bool().unwrap_or_else(|| self.wrong("a truth value"))
    }

    /// Text.
    #[must_use]
    #[track_caller]
    pub fn str(&self) -> &'a str {
        self.value.as_str().unwrap_or_else(|| self.wrong("text"))
    }

    /// Numbers; nested lists are flattened row by row.
    #[must_use]
    #[track_caller]
    pub fn list(&self) -> Vec<f64> {
        let mut out = Vec::new();
        if !self.value.is_array() || !flatten(self.value, &mut out) {
            self.wrong("a list of numbers");
        }
        out
    }

    /// The JSON value itself, for what the other accessors don't cover.
    #[must_use]
    pub fn json(&self) -> &'a Value {
        self.value
    }
}

fn number(value: &Value) -> Option<f64> {
    match value.as_str() {
        Some("inf") => Some(f64::INFINITY),
        Some("-inf") => Some(f64::NEG_INFINITY),
        Some("nan") => Some(f64::NAN),
        _ => value.as_f64(),
    }
}

fn flatten(value: &Value, out: &mut Vec<f64>) -> bool {
    match value {
        Value::Array(items) => items.iter().all(|item| flatten(item, out)),
        _ => number(value).map(|x| out.push(x)).is_some(),
    }
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
                tensors.insert(key.clone(), tensor(section).or_else(|e| error(format!("`{key}`: {e}")))?);
            } else {
                for (name, t) in section.as_object().into_iter().flatten() {
                    tensors.insert(name.clone(), tensor(t).or_else(|e| error(format!("`{key}.{name}`: {e}")))?);
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

fn tensor(value: &Value) -> Result<Tensor, GoldenError> {
    let Some(shape) = value["shape"].as_array() else { return error("no `shape`") };
    let axis = |n: &Value| n.as_u64().map(|n| n as usize);
    let Some(shape) = shape.iter().map(axis).collect::<Option<Vec<usize>>>() else {
        return error(format!("`shape` is {}", value["shape"]));
    };
    let data = if let Some(hex) = value["hex"].as_str() {
        bytes_of(hex)?.into_iter().map(f64::from).collect()
    } else {
        let mut data = Vec::new();
        match &value["data"] {
            Value::Array(items) => {
                for (i, item) in items.iter().enumerate() {
                    let Some(x) = item.as_f64().or(item.as_bool().map(f64::from)) else {
                        return error(format!("`data[{i}]` is {item}"));
                    };
                    data.push(x);
                }
            }
            other => return error(format!("neither `hex` nor a list `data`, but {other}")),
        }
        data
    };
    let want: usize = shape.iter().product();
    if data.len() != want {
        return error(format!("shape {shape:?} needs {want} values, the data holds {}", data.len()));
    }
    Ok(Tensor { shape, data })
}

fn bytes_of(hex: &str) -> Result<Vec<u8>, GoldenError> {
    if !hex.len().is_multiple_of(2) {
        return error("`hex` has an odd number of digits");
    }
    let digit = |c: u8| match char::from(c).to_digit(16) {
        Some(d) => Ok(d as u8),
        None => error(format!("`{}` is no hex digit", char::from(c))),
    };
    hex.as_bytes().chunks_exact(2).map(|pair| Ok(digit(pair[0])? * 16 + digit(pair[1])?)).collect()
}

/// Anything that is a number to compare in `f64`.
pub trait Number: Copy {
    /// As `f64`, exactly.
    fn to_f64(self) -> f64;
}

impl Number for f32 {
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
}

impl Number for f64 {
    fn to_f64(self) -> f64 {
        self
    }
}

/// `Ok` if `|got - want| <= atol + rtol * max|want|` holds for every entry, with the maximum over the finite
/// values of the whole tensor. NaN is never close to anything, infinity only to itself.
///
/// # Errors
/// Says where it is worst: index, both values, difference and bound.
pub fn check_close<G: Number, W: Number>(got: &[G], want: &[W], rtol: f64, atol: f64) -> Result<(), String> {
    if got.len() != want.len() {
        return Err(format!("holds {} values, expected {}", got.len(), want.len()));
    }
    // Infinite wants stay out of the maximum: they would allow everything.
    let largest = want.iter().map(|w| w.to_f64().abs()).filter(|w| w.is_finite()).fold(0.0, f64::max);
    let bound = atol + rtol * largest;
    let mut worst: Option<(usize, f64)> = None;
    for (i, (g, w)) in got.iter().zip(want).enumerate() {
        let (g, w) = (g.to_f64(), w.to_f64());
        let difference = if g == w { 0.0 } else { (g - w).abs() };
        // Not `difference > bound`: a NaN has to fail.
        let close = difference <= bound;
        if !close && worst.is_none_or(|(_, d)| difference.is_nan() || difference > d) {
            worst = Some((i, difference));
        }
    }
    match worst {
        None => Ok(()),
        Some((i, d)) => Err(format!(
            "[{i}]: got {:e}, want {:e}, difference {d:.3e} > bound {bound:.3e} (rtol {rtol:e}, atol {atol:e})",
            got[i].to_f64(),
            want[i].to_f64()
        )),
    }
}

/// Assert that `got` is `want`: see [`check_close`] for the rule.
///
/// # Panics
/// With `what`, index, both values, difference and bound of the worst entry.
#[track_caller]
pub fn assert_close<G: Number, W: Number>(what: &str, got: &[G], want: &[W], rtol: f64, atol: f64) {
    if let Err(message) = check_close(got, want, rtol, atol) {
        panic!("{what} {message}");
    }
}

/// The folder of real data sets and golden masters: the environment variable `WILDFIELD_DATA`, or `shared/data` beside
/// the repository. Pass `env!("CARGO_MANIFEST_DIR")` of a crate that lies directly in the repository.
///
/// `None` where the folder does not exist: call [`skipped`] then.
#[must_use]
pub fn data_dir(manifest_dir: &str) -> Option<PathBuf> {
    let dir = match std::env::var_os("WILDFIELD_DATA") {
        Some(dir) => PathBuf::from(dir),
        None => Path::new(manifest_dir).join("../../shared/data"),
    };
    dir.is_dir().then_some(dir)
}

/// Say loudly that a test did not run, and why. Call it, then return.
///
/// The line goes past the capture of the test harness, so it is seen without `--nocapture`.
pub fn skipped(test: &str, reason: &str) {
    use std::io::Write;
    // A closed stderr is no reason to fail a test.
    let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: {reason}");
}

/// [`data_dir`] with something in it, or `None` after a `SKIPPED:` line: a scene's folder, for example.
///
/// ```no_run
/// # fn main() {
/// let Some(lego) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), "nerf_synthetic/lego", "reads_lego") else { return };
/// # let _ = lego; }
/// ```
#[must_use]
pub fn data_or_skip(manifest_dir: &str, name: &str, test: &str) -> Option<PathBuf> {
    let Some(dir) = data_dir(manifest_dir) else {
        skipped(test, "no folder `../shared/data` beside the repository, and WILDFIELD_DATA names none");
        return None;
    };
    let path = dir.join(name);
    if !path.exists() {
        skipped(test, &format!("no `{}`", path.display()));
        return None;
    }
    Some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(record: &str) -> String {
        format!(r#"{{"topic": "t", "seed": 1, "format": 1, "records": [{record}]}}"#)
    }

    fn record(extra: &str) -> String {
        file(&format!(
            r#"{{"op": "f", "name": "n", "kind": "boundary", "params": {{"a": "-inf", "n": 3, "m": 3.0, "on": true, "s": "x", "l": [[1, 2], [3, 4]]}},
             "f32_inputs_exact": false, "inputs": {{"x": {{"shape": [2, 2], "data": [0.1, 1e-320, -2, 3]}}}}{extra}}}"#
        ))
    }

    #[test]
    fn numbers_come_back_exactly() {
        let golden = Golden::parse(&record("")).unwrap();
        let r = golden.record("f", "n");
        assert_eq!(r.input("x").data, [0.1, 1e-320, -2.0, 3.0]);
        assert_eq!(r.input("x").row(1), [-2.0, 3.0]);
        assert_eq!(r.kind, Kind::Boundary);
        assert_eq!(r.param("a").f64(), f64::NEG_INFINITY);
        assert_eq!((r.param("n").usize(), r.param("m").usize(), r.param("on").bool()), (3, 3, true));
        assert_eq!((r.param("s").str(), r.param("l").list()), ("x", vec![1.0, 2.0, 3.0, 4.0]));
        assert!(r.try_param("missing").is_none() && !r.f32_inputs_exact);
    }

    #[test]
    fn scalars_empty_tensors_and_image_bytes() {
        let golden = Golden::parse(&record(
            r#", "outputs": {"s": {"shape": [], "data": [7]}, "e": {"shape": [0, 3], "data": []}, "i": {"shape": [1, 3], "hex": "00fF80"}},
              "one": {"shape": [1], "data": [5]}"#,
        ))
        .unwrap();
        let r = &golden.records[0];
        assert_eq!(r.output("s").scalar(), 7.0);
        assert!(r.output("e").data.is_empty());
        assert_eq!(r.output("i").bytes(), [0, 255, 128]);
        assert_eq!(r.get("one", "one").unwrap().scalar(), 5.0);
        assert_eq!(r.section("outputs").count(), 3);
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, want) in [
            (record(r#", "outputs": {"y": {"shape": [3], "data": [1]}}"#), "f/n: `outputs.y`: shape [3] needs 3"),
            (record(r#", "outputs": {"y": {"shape": [1], "hex": "0g"}}"#), "`g` is no hex digit"),
            (record(r#", "outputs": {"y": {"shape": [1], "data": ["x"]}}"#), "`data[0]` is \"x\""),
            (file(r#"{"op": "f", "name": "n", "kind": "odd"}"#), "`kind` is `odd`"),
            (file("{}"), "record 0: `op` is missing"),
            ("{\"format\": 2}".to_owned(), "`format` is 2"),
            ("{".to_owned(), "EOF"),
        ] {
            let message = Golden::parse(&text).unwrap_err().to_string();
            assert!(message.contains(want), "`{message}` does not say `{want}`");
        }
    }

    #[test]
    #[should_panic(expected = "no `z` among `inputs`, which holds [\"x\"]")]
    fn a_missing_tensor_panics_with_what_is_there() {
        let golden = Golden::parse(&record("")).unwrap();
        let _ = golden.records[0].input("z");
    }

    #[test]
    #[should_panic(expected = "no record of `g`")]
    fn looping_over_nothing_panics() {
        let _ = Golden::parse(&record("")).unwrap().op("g").count();
    }

    #[test]
    fn close_fails_on_difference_nan_infinity_and_length() {
        let want = [1.0, -100.0, 0.0];
        // The bound counts from the largest entry: 1e-3 * 100 + 0.05.
        assert!(check_close(&[1.14, -100.0, 0.14], &want, 1e-3, 0.05).is_ok());
        let message = check_close(&[1.14, -100.0, 0.16], &want, 1e-3, 0.05).unwrap_err();
        assert!(message.starts_with("[2]: got 1.6e-1, want 0e0"), "{message}");
        assert!(check_close(&[1.0, f64::NAN, 0.0], &want, 1.0, 1.0).is_err());
        assert!(check_close(&[f64::NAN], &[f64::NAN], 1.0, 1.0).is_err());
        assert!(check_close(&[f64::INFINITY, -100.0, 0.0], &want, 1.0, 1.0).is_err());
        assert!(check_close(&[f64::INFINITY], &[f64::INFINITY], 0.0, 0.0).is_ok());
        assert!(check_close(&[f32::INFINITY], &[f64::NEG_INFINITY], 0.0, 0.0).is_err());
        assert!(check_close(&[1.0, -100.0], &want, 1.0, 1.0).is_err());
        assert!(check_close(&[5.0, 1.0], &[f64::INFINITY, 1.0], 0.5, 0.5).is_err());
        assert!(check_close::<f64, f64>(&[], &[], 0.0, 0.0).is_ok());
    }
}
