//! What a step of each system costs, and that a part which the plan left out costs nothing.

use super::protocols::{COSTS, Entry, NGP};
use crate::bench::{Bench, Keep};
use crate::error::BenchError;
use crate::page::Section;
use crate::sections::cost::{self, Head, Photos, Row};
use crate::sections::scene::small_tabletop;
use scene_io::{PerturbationKind, perturb};

const HEAD: Head = Head {
    title: "In the wild: cost of a step",
    intro: "The embedded tabletop, its training photos covered with squares and with colours of their own: every part of every \
            system has something to do.",
    about: "Median over rounds in which the systems took turns; the first steps' surveys, warm-ups and encoders included. Memory: \
            the most that the process held. Held-out PSNR in dB, in the mean appearance, after so few steps: it says that the \
            work was done, and that `plain` is `ngp`, to the last digit.",
};

impl From<&Entry> for Row {
    fn from(entry: &Entry) -> Self {
        let &Entry { name, system, set, .. } = entry;
        Self { name, system, set }
    }
}

/// Milliseconds a step of all systems of fields.
pub(in crate::sections) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    let photos = Photos {
        name: "tabletop, co",
        word: "perturbed:co:synthetic:tabletop",
        scene: perturb(small_tabletop(), PerturbationKind::Both, 0),
        appearance: Some("mean"),
        rows: [&NGP].into_iter().chain(COSTS).map(Row::from).collect(),
    };
    cost::run(bench, keep, HEAD, &[photos])
}
