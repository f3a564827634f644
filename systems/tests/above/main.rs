//! What stands above every system: batches, the loop, checkpoints, evaluation, the run folder. Driven by a small system
//! of the tests' own.

mod appearance;
mod bake;
mod common;
mod data;
mod full_disk;
mod late;
mod mesh;
mod objects;
mod paths;
mod results;
mod resume;
mod validation;
