//! Prints what a dataset holds and what is wrong with it: `cargo run -p wildfield-scene-io --example check -- FOLDER`.

use scene_io::{Depth, LoadOptions, check};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: check FOLDER");
        return ExitCode::from(2);
    };
    let report = check(path.as_ref(), &LoadOptions::default(), Depth::Pixels);
    println!("{report}");
    if report.can_train() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
