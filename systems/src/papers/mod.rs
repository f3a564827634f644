//! One file or folder a system: which parts it is made of, how its paper wires and weighs them, and the paper's equations.

pub(crate) mod dynamic;
pub(crate) mod field_kind;
pub mod gaussians;
pub mod static_scenes;
pub mod wild;
