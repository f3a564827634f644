//! A tape: the memory it borrows, the parameters it looks into, and the custom operations on it.

use super::arena::Arena;
use super::custom::CustomOp;
use alloc::vec::Vec;

/// A record of operations over one tile of samples. See the [module](super) for what it does and an example.
///
/// # Panics
/// Functions that record nodes do so past `2^32 - 1` of them, and where there is no memory for a result.
pub struct Tape<'a> {
    pub(super) arena: &'a mut Arena,
    pub(super) params: &'a [f32],
    pub(super) customs: Vec<&'a dyn CustomOp>,
}
