//! Numbers with a shape.

use super::error::{GoldenError, error};
use serde_json::Value;

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
    /// If a value is not an integer in `0..=255`.
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
    /// If a value is not an integer `>= 0`.
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

impl Tensor {
    pub(super) fn parse(value: &Value) -> Result<Self, GoldenError> {
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
        Ok(Self { shape, data })
    }
}

fn bytes_of(hex: &str) -> Result<Vec<u8>, GoldenError> {
    if !hex.len().is_multiple_of(2) {
        return error("`hex` has an odd number of digits");
    }
    let digit = |c: u8| match char::from(c).to_digit(16) {
        Some(d) => Ok(d as u8),
        None => error(format!("`{}` is not a hex digit", char::from(c))),
    };
    hex.as_bytes().chunks_exact(2).map(|pair| Ok(digit(pair[0])? * 16 + digit(pair[1])?)).collect()
}
