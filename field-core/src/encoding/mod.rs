//! Encodings of positions, directions and indices.

pub mod hash_grid;
