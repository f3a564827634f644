//! A few passes of the kill campaign: see `examples/kills`, which does many.

#[path = "../../examples/kills/campaign.rs"]
mod campaign;
#[path = "../../examples/kills/cases.rs"]
mod cases;
#[path = "../../examples/kills/compare.rs"]
mod compare;
#[path = "../../examples/kills/pass.rs"]
mod pass;
#[path = "../../examples/kills/program.rs"]
mod program;
#[path = "../../examples/kills/room.rs"]
mod room;

use std::process::ExitCode;

/// Passes, and their seed.
const PASSES: u64 = 6;
const SEED: u64 = 7;

fn main() -> ExitCode {
    if let Some(code) = program::as_app() {
        return code;
    }
    // Programs that list tests ask so.
    if std::env::args().any(|word| word == "--list") {
        println!("kills: test");
        return ExitCode::SUCCESS;
    }
    campaign::run(PASSES, SEED, 0)
}
