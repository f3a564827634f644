//! The binaries: they parse the command line, call `engine` and `systems`, and show the results.
//!
//! Exit codes: 0 done, 1 failed or not all written, 2 wrong usage, 130 stopped by SIGINT or SIGTERM (what is done is kept). A
//! signal is the usual end of `view`, which then ends with 0. Results go to standard output, progress and errors to standard
//! error.

mod app;
mod cli;
mod commands;
mod interrupt;
#[doc(hidden)]
pub mod reference;
mod session;
mod show;
mod view;

use std::process::ExitCode;

/// Doors that fuzz targets knock at; nothing else has a use for them.
#[doc(hidden)]
pub mod doors {
    use render_core::camera::Camera;

    /// A message of the viewer's page, read as the server reads it: the camera of the picture that it asks for, whose numbers are
    /// fine ([`Camera::check`]); `None` for a message that asks for none.
    ///
    /// # Errors
    /// One line that names what is wrong, at most 300 characters.
    pub fn viewer_message(bytes: &[u8]) -> Result<Option<Camera>, String> {
        crate::view::camera_of(bytes)
    }
}

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
        Ok(session::Done::Finished) => ExitCode::SUCCESS,
        Ok(session::Done::Interrupted) => {
            // Work may have seen the flag before the thread that answers it did.
            interrupt::answered();
            ExitCode::from(interrupt::CODE)
        }
        Ok(session::Done::Refused) => ExitCode::FAILURE,
        Err(error) => {
            show::error(error.as_ref());
            if let Some(advice) = commands::prepare::advice(app, error.as_ref()) {
                show::note(&advice);
            }
            ExitCode::FAILURE
        }
    }
}
