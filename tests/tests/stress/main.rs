//! The stress list of trainings and files: what people do to programs, at every SIMD level of
//! this machine. The list of the math crates is the package `stress`.

mod common;
mod dynamic;
mod files;
mod settings;
mod splats;
mod trainings;
mod wild;

use stress::Group::Once;

#[test]
fn every_case_keeps_its_promise() {
    stress::run_at_each_level(
        "systems",
        "every_case_keeps_its_promise",
        &[
            Once("files", files::cases),
            Once("settings", settings::cases),
            Once("learning rates", trainings::learning_rates),
            Once("scenes", trainings::scenes),
            Once("long run", trainings::long_run),
            Once("wild settings", wild::settings),
            Once("wild scenes", wild::scenes),
            Once("wild rates", wild::learning_rates),
            Once("moving settings", dynamic::settings),
            Once("moving scenes", dynamic::scenes),
            Once("moving rates", dynamic::learning_rates),
            Once("moving priors", dynamic::priors),
        ],
    );
}

#[test]
fn every_case_of_splats_keeps_its_promise() {
    stress::run_at_each_level(
        "splats",
        "every_case_of_splats_keeps_its_promise",
        &[Once("settings", splats::settings), Once("scenes", splats::scenes)],
    );
}
