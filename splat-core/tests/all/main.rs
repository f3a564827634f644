//! The tests of this crate in one program: built and linked once. `cargo test -p splat-core --test all MODULE::` runs one file of them.

#[path = "../common/mod.rs"]
mod common;
mod convergence;
mod needles;
mod projection;
mod properties;
mod raster;
#[path = "../twin/mod.rs"]
mod twin;
