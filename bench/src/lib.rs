//! `nerf-bench`: time against error, and kernels against the ceilings of the machine they run on.
//!
//! Each file of `sections` measures one thing and gives a `page::Section`; `page` writes sections as Markdown, CSV and
//! SVG. What is compared is measured interleaved in one run (`measure`), so that a ratio means something on a machine
//! that others use too. Every time has an error beside it: kernels are compared with `f64` twins on the same inputs.

mod bench;
mod claims;
mod cli;
mod error;
mod goals;
mod machine;
mod measure;
mod name;
mod page;
mod peers;
mod plot;
mod sections;
mod table;

use clap::Parser;
use std::io::Write;
use std::process::ExitCode;

/// The command `nerf-bench`.
pub fn nerf_bench() -> ExitCode {
    match sections::run(&cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Nobody is left to tell when standard error is closed.
            let _ = writeln!(std::io::stderr().lock(), "error: {}", error.line());
            ExitCode::FAILURE
        }
    }
}
