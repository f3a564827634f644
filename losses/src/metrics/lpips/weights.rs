//! Tensors by name, checked.

use alloc::{borrow::Cow, boxed::Box, format, string::String, vec::Vec};
use core::fmt;

/// A named tensor as the caller found it.
#[derive(Clone, Debug, PartialEq)]
pub struct LpipsTensor<'w> {
    /// Dimensions, slowest first.
    pub shape: Vec<usize>,
    /// Row-major values.
    pub data: Cow<'w, [f32]>,
}

/// Weights that do not make the network.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum LpipsError {
    /// No tensor of this name.
    Missing {
        /// The tensor.
        name: String,
    },
    /// A tensor of another shape than the network, as given by the tensors before it, needs.
    Shape {
        /// The tensor.
        name: String,
        /// Shape it should have; `None` where any size above 0 will do.
        want: Vec<Option<usize>>,
        /// Shape it has.
        got: Vec<usize>,
    },
    /// A tensor that does not hold as many values as its shape says.
    Length {
        /// The tensor.
        name: String,
        /// Product of its shape.
        want: usize,
        /// Values it holds.
        got: usize,
    },
    /// A value that cannot work: NaN, infinite, or a scale of 0.
    Value {
        /// The tensor.
        name: String,
        /// Index into its data.
        index: usize,
        /// The value.
        value: f32,
    },
}

impl fmt::Display for LpipsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { name } => write!(f, "tensor `{name}` is missing"),
            Self::Shape { name, want, got } => {
                write!(f, "tensor `{name}` has shape {got:?}, expected [")?;
                for (i, want) in want.iter().enumerate() {
                    let comma = if i > 0 { ", " } else { "" };
                    match want {
                        Some(n) => write!(f, "{comma}{n}")?,
                        None => write!(f, "{comma}any")?,
                    }
                }
                f.write_str("]")
            }
            Self::Length { name, want, got } => {
                write!(f, "tensor `{name}` holds {got} values, its shape says {want}")
            }
            Self::Value { name, index, value } => write!(f, "tensor `{name}`: value {index} is {value}"),
        }
    }
}

impl core::error::Error for LpipsError {}

/// Where tensors come from.
type Source<'l, 'w> = Box<dyn FnMut(&str) -> Option<LpipsTensor<'w>> + 'l>;

/// Fetches tensors and checks them.
pub(super) struct Lookup<'l, 'w>(Source<'l, 'w>);

impl<'l, 'w> Lookup<'l, 'w> {
    pub(super) fn new(lookup: impl FnMut(&str) -> Option<LpipsTensor<'w>> + 'l) -> Self {
        Self(Box::new(lookup))
    }

    /// The tensor `name`, of shape `want`.
    pub(super) fn get(&mut self, name: String, want: &[Option<usize>]) -> Result<LpipsTensor<'w>, LpipsError> {
        let Some(tensor) = (self.0)(&name) else { return Err(LpipsError::Missing { name }) };
        let fits = |(got, want): (&usize, &Option<usize>)| want.map_or(*got > 0, |want| *got == want);
        if tensor.shape.len() != want.len() || !tensor.shape.iter().zip(want).all(fits) {
            return Err(LpipsError::Shape { name, want: want.to_vec(), got: tensor.shape });
        }
        checked(name, tensor)
    }

    /// `n` values, one a channel: shape `[n]`, or `[1, n, 1, 1]` as a 1x1 convolution writes it.
    pub(super) fn channels(&mut self, name: &str, n: usize) -> Result<Vec<f32>, LpipsError> {
        let name = String::from(name);
        let Some(tensor) = (self.0)(&name) else { return Err(LpipsError::Missing { name }) };
        if tensor.shape != [n] && tensor.shape != [1, n, 1, 1] {
            return Err(LpipsError::Shape { name, want: [Some(n)].to_vec(), got: tensor.shape });
        }
        Ok(checked(name, tensor)?.data.into_owned())
    }

    /// Weight and bias of a convolution of `inputs` channels and `side` x `side` taps.
    pub(super) fn convolution(
        &mut self,
        name: &str,
        inputs: usize,
        side: usize,
    ) -> Result<(LpipsTensor<'w>, LpipsTensor<'w>), LpipsError> {
        let weight = self.get(format!("{name}.weight"), &[None, Some(inputs), Some(side), Some(side)])?;
        let bias = self.get(format!("{name}.bias"), &[Some(weight.shape[0])])?;
        Ok((weight, bias))
    }
}

fn checked(name: String, tensor: LpipsTensor<'_>) -> Result<LpipsTensor<'_>, LpipsError> {
    let want = tensor.shape.iter().try_fold(1_usize, |n, &x| n.checked_mul(x)).unwrap_or(usize::MAX);
    if tensor.data.len() != want {
        return Err(LpipsError::Length { name, want, got: tensor.data.len() });
    }
    match tensor.data.iter().position(|x| !x.is_finite()) {
        Some(index) => Err(LpipsError::Value { name, index, value: tensor.data[index] }),
        None => Ok(tensor),
    }
}
