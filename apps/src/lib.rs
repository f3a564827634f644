//! The binaries: they parse, call `systems`, and show.
//!
//! Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted (the checkpoint is written). Results go to standard
//! output, progress and errors to standard error.

mod cli;
mod commands;
mod interrupt;
mod show;

use clap::Parser;
use std::process::ExitCode;

/// `nerf-static`: static scenes.
pub fn nerf_static() -> ExitCode {
    match commands::run(cli::Cli::parse()) {
        Ok(commands::Done::Finished) => ExitCode::SUCCESS,
        Ok(commands::Done::Interrupted) => ExitCode::from(130),
        Ok(commands::Done::Refused) => ExitCode::FAILURE,
        Err(error) => {
            show::error(error.as_ref());
            ExitCode::FAILURE
        }
    }
}
