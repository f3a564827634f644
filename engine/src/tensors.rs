//! Named arrays of a checkpoint: how a part writes its state down, and how it takes it back.

use crate::error::SystemError;
use optim::Adam;
use std::borrow::Cow;
use std::collections::BTreeMap;

/// A named array of a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor<'a> {
    /// Unique within the system, dotted: `field.grid`, `adam.field.grid.m`.
    pub name: String,
    /// Dimensions, slowest first.
    pub shape: Vec<usize>,
    /// Row-major values.
    pub data: TensorData<'a>,
}

impl Tensor<'_> {
    /// The same, holding its own values.
    #[must_use]
    pub fn into_owned(self) -> Tensor<'static> {
        let data = match self.data {
            TensorData::F32(d) => TensorData::F32(Cow::Owned(d.into_owned())),
            TensorData::U64(d) => TensorData::U64(Cow::Owned(d.into_owned())),
        };
        Tensor { name: self.name, shape: self.shape, data }
    }
}

/// Values of a tensor.
#[derive(Clone, Debug, PartialEq)]
pub enum TensorData<'a> {
    /// 32-bit floats.
    F32(Cow<'a, [f32]>),
    /// 64-bit unsigned integers: counters, bit sets.
    U64(Cow<'a, [u64]>),
}

/// Tensors of a checkpoint by name.
pub type TensorMap = BTreeMap<String, Tensor<'static>>;

/// A tensor of one dimension.
pub fn f32_tensor<'a>(name: impl Into<String>, data: &'a [f32]) -> Tensor<'a> {
    Tensor { name: name.into(), shape: vec![data.len()], data: TensorData::F32(Cow::Borrowed(data)) }
}

/// Counters of one dimension.
pub fn u64_tensor<'a>(name: impl Into<String>, data: Vec<u64>) -> Tensor<'a> {
    Tensor { name: name.into(), shape: vec![data.len()], data: TensorData::U64(Cow::Owned(data)) }
}

/// The floats of an array of a checkpoint.
///
/// # Errors
/// [`SystemError::State`] where it is missing, of another type, or not `len` long.
pub fn take_f32(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<f32>, SystemError> {
    match tensors.get(name).map(|t| &t.data) {
        Some(TensorData::F32(data)) if data.len() == len => Ok(data.to_vec()),
        found => Err(refused(name, "32-bit floats", len, found)),
    }
}

/// The counters of an array of a checkpoint.
///
/// # Errors
/// As [`take_f32`].
pub fn take_u64(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<u64>, SystemError> {
    match tensors.get(name).map(|t| &t.data) {
        Some(TensorData::U64(data)) if data.len() == len => Ok(data.to_vec()),
        found => Err(refused(name, "64-bit integers", len, found)),
    }
}

/// Counters a run may have: whatever is counted is counted exactly, and one more does not overflow.
pub(crate) const MOST_COUNTED: u64 = 1 << 53;

/// Counters of a checkpoint that go on counting: none is larger than a run can count.
///
/// # Errors
/// As [`take_u64`], and for a number that no run has counted to.
pub fn take_counts(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<u64>, SystemError> {
    let counts = take_u64(tensors, name, len)?;
    match counts.iter().position(|&count| count > MOST_COUNTED) {
        Some(i) => {
            let problem = format!("entry {i} is {}; no run counts that far", counts[i]);
            Err(SystemError::State { name: name.into(), problem })
        }
        None => Ok(counts),
    }
}

/// Floats of a checkpoint that are numbers: neither NaN nor infinite.
///
/// # Errors
/// As [`take_f32`], and for an entry that is not finite.
pub fn take_numbers(tensors: &TensorMap, name: &str, len: usize) -> Result<Vec<f32>, SystemError> {
    let numbers = take_f32(tensors, name, len)?;
    match numbers.iter().position(|x| !x.is_finite()) {
        Some(i) => {
            let problem = format!("entry {i} is {}; a number is expected", numbers[i]);
            Err(SystemError::State { name: name.into(), problem })
        }
        None => Ok(numbers),
    }
}

/// The moments of the optimiser of a part, to a checkpoint.
pub fn push_adam<'a>(out: &mut Vec<Tensor<'a>>, name: &str, adam: &'a Adam) {
    out.push(f32_tensor(format!("adam.{name}.m"), adam.first_moment()));
    out.push(f32_tensor(format!("adam.{name}.v"), adam.second_moment()));
    out.push(u64_tensor(format!("adam.{name}.steps"), vec![adam.steps()]));
}

/// What [`push_adam`] wrote, for a part like `old`.
///
/// # Errors
/// [`SystemError::State`] for arrays that are missing or do not fit `old`.
pub fn take_adam(state: &TensorMap, name: &str, old: &Adam) -> Result<Adam, SystemError> {
    let m = take_f32(state, &format!("adam.{name}.m"), old.len())?;
    let v = take_f32(state, &format!("adam.{name}.v"), old.len())?;
    let steps = take_counts(state, &format!("adam.{name}.steps"), 1)?[0];
    Adam::restore(old.config(), m, v, steps)
        .map_err(|e| SystemError::State { name: format!("adam.{name}"), problem: e.to_string() })
}

fn refused(name: &str, kind: &str, len: usize, found: Option<&TensorData<'_>>) -> SystemError {
    let found = match found {
        None => "it is missing".into(),
        Some(TensorData::F32(d)) => format!("it holds {} 32-bit floats", d.len()),
        Some(TensorData::U64(d)) => format!("it holds {} 64-bit integers", d.len()),
    };
    SystemError::State { name: name.into(), problem: format!("{len} {kind} expected, {found}") }
}
