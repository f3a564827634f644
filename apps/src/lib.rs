//! The binaries: they parse, call `systems`, and show.
//!
//! Exit codes: 0 done, 1 failed or not all written, 2 wrong usage, 130 stopped by SIGINT or SIGTERM (what is done is kept; `view` ends with 0, as there is no
//! other end). Results go to standard
//! output, progress and errors to standard error.

mod app;
mod cli;
mod commands;
mod interrupt;
mod show;
mod view;

use std::process::ExitCode;

/// `nerf-static`: static scenes.
pub fn nerf_static() -> ExitCode {
    run(&app::STATIC)
}

/// `nerf-dynamic`: scenes that move.
pub fn nerf_dynamic() -> ExitCode {
    run(&app::DYNAMIC)
}

/// `nerf-wild`: one place in photos of many people.
pub fn nerf_wild() -> ExitCode {
    run(&app::WILD)
}

fn run(app: &'static app::App) -> ExitCode {
    let cli = cli::Cli::read(app, std::env::args_os()).unwrap_or_else(|e| e.exit());
    match commands::run(app, cli) {
        Ok(commands::Done::Finished) => ExitCode::SUCCESS,
        Ok(commands::Done::Interrupted) => ExitCode::from(interrupt::CODE),
        Ok(commands::Done::Refused) => ExitCode::FAILURE,
        Err(error) => {
            show::error(error.as_ref());
            if let Some(advice) = commands::prepare::advice(app, error.as_ref()) {
                show::note(&advice);
            }
            ExitCode::FAILURE
        }
    }
}
