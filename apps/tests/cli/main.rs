//! `nerf-static`, `nerf-wild` and `nerf-dynamic` as people and scripts meet them: exit codes, one clear line for each
//! failure, files left behind.

mod bad_datasets;
mod browser;
mod choice;
mod chromium;
mod claims;
mod commands;
mod dynamic;
mod eval_file;
mod hostile;
mod huge;
mod memory;
mod numbers;
mod prepare;
mod priors;
mod progress;
mod resume;
mod scales;

mod splats;
mod tools;
mod trusted;
mod view;
mod viewing;
mod wild;
mod words;
