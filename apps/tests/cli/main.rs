//! `nerf-static` and `nerf-wild` as people and scripts meet them: exit codes, one clear line for each failure, files left behind.

mod bad_datasets;
mod commands;
mod resume;
mod scales;
mod tools;
mod wild;
