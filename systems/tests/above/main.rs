//! What stands above every system: batches, the loop, checkpoints, evaluation, the run folder. Driven by a small system
//! of the tests' own.

mod common;
mod data;
mod full_disk;
mod light;
mod objects;
mod paths;
mod results;
mod resume;
