//! The stress list of the math crates, at every SIMD level of this machine and with the float functions it is built with.

mod cameras;
mod compositing;
mod contraction;
mod encodings;
mod losses;
mod networks;
mod occupancy;
mod optimiser;
mod sampling;

use stress::Group::{EachLevel, Once};

#[test]
fn every_case_keeps_its_promise() {
    stress::run(
        "math",
        &[
            EachLevel("compositing", compositing::cases),
            Once("depths", compositing::depths),
            Once("sampling", sampling::cases),
            Once("occupancy", occupancy::cases),
            Once("cameras", cameras::cases),
            EachLevel("contraction", contraction::cases),
            EachLevel("encodings", encodings::cases),
            EachLevel("networks", networks::cases),
            Once("losses", losses::cases),
            EachLevel("optimiser", optimiser::cases),
        ],
    );
}
