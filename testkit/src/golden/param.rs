//! Typed access to a record's parameters.

use super::Record;
use serde_json::Value;

/// A parameter of a record. The accessors panic, naming record and parameter, where the type is another.
#[derive(Clone, Copy, Debug)]
pub struct Param<'a> {
    pub(super) record: &'a Record,
    pub(super) name: &'a str,
    pub(super) value: &'a Value,
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
