//! Systems for scenes that move.

pub(crate) mod k_planes;
