//! JSON with errors that name the field: `transforms.json: `frames[3].fl_x` = "wide": is not a number`.

use crate::{ErrorKind, Place, Problem, SceneError, files};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// A parsed JSON file.
#[derive(Debug)]
pub(crate) struct Document {
    pub(crate) file: PathBuf,
    value: Value,
}

impl Document {
    pub(crate) fn read(file: &Path) -> Result<Self, SceneError> {
        let text = files::read_text(file)?;
        let value = serde_json::from_str(&quote_non_finite(&text)).map_err(|e| {
            let what = format!("is not valid JSON: {e}");
            let remedy = if text.trim().is_empty() {
                "the file is empty: write it again"
            } else if e.is_eof() {
                "the file seems cut off: copy or write it again"
            } else {
                "correct the file there"
            };
            let problem = Problem::new(file, what, remedy).at(Place::LineColumn(e.line(), e.column()));
            SceneError::new(ErrorKind::Format, problem).caused_by(e)
        })?;
        Ok(Self { file: file.to_path_buf(), value })
    }

    /// The object at top level.
    pub(crate) fn top(&self) -> Result<Object<'_>, Problem> {
        match &self.value {
            Value::Object(map) => Ok(Object { file: &self.file, path: String::new(), map }),
            other => {
                Err(Problem::new(&self.file, "holds no JSON object", "is this the right file?").value(shown(other)))
            }
        }
    }
}

/// Writes `NaN`, `Infinity` and `-Infinity`, which Python prints and JSON does not know, as strings: readers then meet
/// them at their field and can name it. Leaves strings alone and keeps the number of lines.
fn quote_non_finite(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        if c == '"' {
            let mut end = rest.len();
            let mut escaped = false;
            for (i, c) in rest.char_indices().skip(1) {
                match c {
                    _ if escaped => escaped = false,
                    '\\' => escaped = true,
                    '"' => {
                        end = i + 1;
                        break;
                    }
                    _ => {}
                }
            }
            out.push_str(&rest[..end]);
            rest = &rest[end..];
            continue;
        }
        let token = ["-Infinity", "Infinity", "-NaN", "NaN", "-nan", "nan", "-inf", "inf"];
        let token = if "-InN".contains(c) || c == 'i' { token.into_iter().find(|t| rest.starts_with(t)) } else { None };
        if let Some(token) = token {
            out.push('"');
            out.push_str(token);
            out.push('"');
            rest = &rest[token.len()..];
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
        }
    }
    out
}

/// A value on one line.
fn shown(value: &Value) -> String {
    value.to_string()
}

/// A JSON object and the way to it.
#[derive(Clone, Debug)]
pub(crate) struct Object<'a> {
    pub(crate) file: &'a Path,
    pub(crate) path: String,
    map: &'a Map<String, Value>,
}

impl<'a> Object<'a> {
    /// The way to a field: `frames[3].fl_x`.
    pub(crate) fn field(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// A problem with a field.
    pub(crate) fn problem(&self, key: &str, what: impl Into<String>, remedy: impl Into<String>) -> Problem {
        let problem = Problem::new(self.file, what, remedy).field(self.field(key));
        match self.get(key) {
            Some(value) => problem.value(shown(value)),
            None => problem,
        }
    }

    /// A field that is there and not null.
    pub(crate) fn get(&self, key: &str) -> Option<&'a Value> {
        self.map.get(key).filter(|v| !v.is_null())
    }

    /// Names of the fields.
    pub(crate) fn keys(&self) -> impl Iterator<Item = &'a str> {
        self.map.keys().map(String::as_str)
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// A finite number.
    pub(crate) fn number(&self, key: &str) -> Result<Option<f64>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        match finite(value) {
            Ok(x) => Ok(Some(x)),
            Err(what) => Err(self.problem(key, what, "correct the value")),
        }
    }

    /// A number of pixels: whole, at least 1.
    pub(crate) fn pixels(&self, key: &str) -> Result<Option<u32>, Problem> {
        match self.number(key)? {
            None => Ok(None),
            // instant-ngp writes 1080.0.
            Some(x) if x >= 1.0 && x <= f64::from(u32::MAX) && x.fract() == 0.0 => Ok(Some(x as u32)),
            Some(_) => Err(self.problem(key, "is not an image size", "write the whole number of pixels")),
        }
    }

    pub(crate) fn string(&self, key: &str) -> Result<Option<&'a str>, Problem> {
        match self.get(key) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(_) => Err(self.problem(key, "is not text", "write it in quotes")),
        }
    }

    /// `true`, or a number that is not 0.
    pub(crate) fn flag(&self, key: &str) -> Result<bool, Problem> {
        match self.get(key) {
            None => Ok(false),
            Some(Value::Bool(set)) => Ok(*set),
            Some(Value::Number(n)) => Ok(n.as_f64() != Some(0.0)),
            Some(_) => Err(self.problem(key, "is neither true nor false", "write true or false")),
        }
    }

    /// The objects of a list.
    pub(crate) fn objects(&self, key: &str) -> Result<Option<Vec<Object<'a>>>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let Value::Array(items) = value else {
            return Err(self.problem(key, "is not a list", "write [ ... ]"));
        };
        let object = |(i, item): (usize, &'a Value)| match item {
            Value::Object(map) => Ok(Object { file: self.file, path: format!("{}[{i}]", self.field(key)), map }),
            other => Err(Problem::new(self.file, "is not an object", "write { ... } for each frame")
                .field(format!("{}[{i}]", self.field(key)))
                .value(shown(other))),
        };
        items.iter().enumerate().map(object).collect::<Result<_, _>>().map(Some)
    }

    /// A list of texts.
    pub(crate) fn strings(&self, key: &str) -> Result<Option<Vec<&'a str>>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let texts = value.as_array().map(|items| items.iter().map(Value::as_str).collect::<Option<Vec<_>>>());
        texts.flatten().map(Some).ok_or_else(|| self.problem(key, "is not a list of texts", "write [\"a\", \"b\"]"))
    }

    /// A list of whole numbers from 0.
    pub(crate) fn indices(&self, key: &str) -> Result<Option<Vec<usize>>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let index = |v: &Value| v.as_u64().and_then(|i| usize::try_from(i).ok());
        let indices = value.as_array().map(|items| items.iter().map(index).collect::<Option<Vec<_>>>());
        indices.flatten().map(Some).ok_or_else(|| self.problem(key, "is not a list of whole numbers", "write [0, 1]"))
    }

    /// A whole number from 0 to 2^32 - 1.
    pub(crate) fn index(&self, key: &str) -> Result<Option<u32>, Problem> {
        match self.number(key)? {
            None => Ok(None),
            Some(x) if x >= 0.0 && x <= f64::from(u32::MAX) && x.fract() == 0.0 => Ok(Some(x as u32)),
            Some(_) => Err(self.problem(key, "is not a whole number from 0", "write an index")),
        }
    }

    /// An object in this one.
    pub(crate) fn object(&self, key: &str) -> Result<Option<Object<'a>>, Problem> {
        match self.get(key) {
            None => Ok(None),
            Some(Value::Object(map)) => Ok(Some(Object { file: self.file, path: self.field(key), map })),
            Some(_) => Err(self.problem(key, "is not an object", "write { ... }")),
        }
    }

    /// A list of blocks, each a list of `rows` lists of `width` finite numbers (one row: the block is that list).
    pub(crate) fn blocks(&self, key: &str, rows: usize, width: usize) -> Result<Option<Vec<Vec<f64>>>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let shape = |field: String, form: String| {
            Problem::new(self.file, format!("is not a list of {form}"), "write it anew").field(field)
        };
        let key = self.field(key);
        let form = format!("{rows}x{width} numbers");
        let blocks = value.as_array().ok_or_else(|| shape(key.clone(), form.clone()))?;
        let mut out = Vec::with_capacity(blocks.len());
        for (i, block) in blocks.iter().enumerate() {
            let here = |r: usize, c: usize| {
                if rows > 1 { format!("{key}[{i}][{r}][{c}]") } else { format!("{key}[{i}][{c}]") }
            };
            let lines: Vec<&Value> = match block.as_array() {
                Some(_) if rows == 1 => vec![block],
                Some(lines) if lines.len() == rows => lines.iter().collect(),
                _ => return Err(shape(format!("{key}[{i}]"), form)),
            };
            let mut values = Vec::with_capacity(rows * width);
            for (r, line) in lines.into_iter().enumerate() {
                let line = line.as_array().filter(|l| l.len() == width);
                for (c, entry) in line.ok_or_else(|| shape(format!("{key}[{i}]"), form.clone()))?.iter().enumerate() {
                    values.push(finite(entry).map_err(|what| {
                        let problem = Problem::new(self.file, what, "remove the frame or estimate its pose again");
                        problem.field(here(r, c)).value(shown(entry).trim_matches('"'))
                    })?);
                }
            }
            out.push(values);
        }
        Ok(Some(out))
    }

    /// A list of finite numbers.
    pub(crate) fn numbers(&self, key: &str) -> Result<Option<Vec<f64>>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let items = value.as_array().ok_or_else(|| self.problem(key, "is not a list of numbers", "write [1, 2]"))?;
        let number = |(i, item): (usize, &Value)| {
            finite(item).map_err(|what| {
                let problem = Problem::new(self.file, what, "correct the value");
                problem.field(format!("{}[{i}]", self.field(key))).value(shown(item).trim_matches('"'))
            })
        };
        items.iter().enumerate().map(number).collect::<Result<_, _>>().map(Some)
    }

    /// A list of three finite numbers.
    pub(crate) fn triple(&self, key: &str) -> Result<Option<[f64; 3]>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = value.as_array().and_then(|a| a.iter().map(|v| finite(v).ok()).collect());
        match numbers.as_deref() {
            Some(&[x, y, z]) => Ok(Some([x, y, z])),
            _ => Err(self.problem(key, "is not a list of three numbers", "write [x, y, z]")),
        }
    }

    /// A matrix of three rows and four columns; a fourth row must be `0 0 0 1`. Numbers may be non-finite only in that
    /// the problem then names the entry.
    pub(crate) fn matrix(&self, key: &str) -> Result<Option<[[f64; 4]; 3]>, Problem> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let shape = || self.problem(key, "is not a 4x4 (or 3x4) matrix", "write it as a list of rows");
        let rows = value.as_array().ok_or_else(shape)?;
        if rows.len() != 3 && rows.len() != 4 {
            return Err(shape());
        }
        let mut matrix = [[0.0; 4]; 4];
        matrix[3] = [0.0, 0.0, 0.0, 1.0];
        for (i, row) in rows.iter().enumerate() {
            let row = row.as_array().filter(|r| r.len() == 4).ok_or_else(shape)?;
            for (j, entry) in row.iter().enumerate() {
                matrix[i][j] = finite(entry).map_err(|what| {
                    Problem::new(self.file, what, "remove the frame or estimate its pose again")
                        .field(format!("{}[{i}][{j}]", self.field(key)))
                        .value(shown(entry).trim_matches('"'))
                })?;
            }
        }
        let [a, b, c, last] = matrix;
        if last.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(x, want)| (x - want).abs() > 1e-6) {
            return Err(self.problem(key, "has a last row other than 0 0 0 1", "write a camera-to-world matrix"));
        }
        Ok(Some([a, b, c]))
    }
}

fn finite(value: &Value) -> Result<f64, String> {
    match value {
        Value::Number(n) => match n.as_f64() {
            Some(x) if x.is_finite() => Ok(x),
            _ => Err("is not a finite number".into()),
        },
        Value::String(s) if s.trim_start_matches('-').to_ascii_lowercase().starts_with(['n', 'i']) => {
            Err("is not a finite number".into())
        }
        _ => Err("is not a number".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn non_finite_numbers_become_strings_outside_strings_only() {
        let text = r#"{"NaN \" inf": [NaN, -Infinity, 1.5, "nan"]}"#;
        assert_eq!(quote_non_finite(text), r#"{"NaN \" inf": ["NaN", "-Infinity", 1.5, "nan"]}"#);
        assert_eq!(quote_non_finite("\"cut off"), "\"cut off");
    }
}
