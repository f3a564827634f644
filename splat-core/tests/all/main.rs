//! The tests of this crate in one program: built and linked once. `cargo test -p wildfield-splat-core --test all MODULE::` runs one file of them.

mod absolute;
mod camera;
mod common;
mod convergence;
mod density;
mod needles;
mod projection;
mod properties;
mod raster;
mod renderer;
mod smoothing;
mod twin;
