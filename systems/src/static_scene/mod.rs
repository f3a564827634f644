//! Systems for scenes that stand still.

pub mod ngp;
