//! The stress list of the math crates, at every SIMD level of this machine and with the float functions it is built with.

mod budget;
mod cameras;
mod compositing;
mod contraction;
mod encodings;
mod functions;
mod intervals;
mod losses;
mod networks;
mod occupancy;
mod optimiser;
mod rules;
mod sampling;
mod splats;

use stress::Group::{EachLevel, Once};

#[test]
fn every_case_keeps_its_promise() {
    stress::run(
        "math",
        &[
            EachLevel("functions", functions::cases),
            EachLevel("compositing", compositing::cases),
            Once("depths", compositing::depths),
            EachLevel("rules", rules::cases),
            Once("budget", budget::cases),
            Once("sampling", sampling::cases),
            Once("occupancy", occupancy::cases),
            Once("cameras", cameras::cases),
            EachLevel("contraction", contraction::cases),
            EachLevel("encodings", encodings::cases),
            EachLevel("networks", networks::cases),
            Once("distances", intervals::distances),
            Once("frusta", intervals::frusta),
            Once("losses", losses::cases),
            Once("losses of rays", intervals::losses),
            EachLevel("splats", splats::cases),
            Once("density", splats::density),
            EachLevel("optimiser", optimiser::cases),
        ],
    );
}
