//! The tests of this crate in one program, but for those that count memory: built and linked once.
//! `cargo test -p wildfield-scene-io --test all MODULE::` runs one file of them.

mod bad_input;
mod clutter;
mod common;
mod export;
mod formats;
mod fuzz;
mod motion_priors;
mod moving;
mod picture;
mod priors;
mod real_data;
mod splats;
mod synthetic;
