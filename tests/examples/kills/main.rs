//! A kill campaign: trainings, evaluations and renderings of all apps, ended at random moments by signals, full disks and read-only
//! disks, and gone on with until they are done. What comes out must be the bits of a run that nothing disturbed.
//!
//! `cargo run --release -p tests --example kills -- PASSES [SEED] [FIRST]`: so many passes, those from number FIRST on (for one that
//! failed). A line a pass, a table at the end, exit code not 0 where anything was lost.

mod campaign;
mod cases;
mod compare;
mod pass;
mod program;
mod room;

use std::process::ExitCode;

fn main() -> ExitCode {
    // The campaign is its own apps: started under an app's name it is that app.
    if let Some(code) = program::as_app() {
        return code;
    }
    let numbers: Result<Vec<u64>, String> =
        std::env::args().skip(1).map(|word| word.parse().map_err(|_| format!("`{word}` is not a number"))).collect();
    let numbers = match numbers {
        Ok(numbers) if numbers.len() <= 3 => numbers,
        Ok(_) => return refused("three numbers at most"),
        Err(problem) => return refused(&problem),
    };
    let number = |i: usize, otherwise: u64| numbers.get(i).copied().unwrap_or(otherwise);
    campaign::run(number(0, 20), number(1, 1), number(2, 0))
}

fn refused(problem: &str) -> ExitCode {
    eprintln!("error: {problem}: write `kills PASSES [SEED] [FIRST]`");
    ExitCode::from(2)
}
