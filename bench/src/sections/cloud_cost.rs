//! What a step of each cloud costs beside that of `splat`, part by part.

use super::cost::{self, Head, Photos, Row};
use super::dynamic::small_orbit;
use super::scene::small_tabletop;
use crate::bench::{Bench, Extent, Keep};
use crate::error::BenchError;
use crate::page::Section;
use scene_io::synthetic::{OrbitOptions, TabletopOptions, orbit, tabletop};
use scene_io::{PerturbationKind, perturb};

const HEAD: Head = Head {
    title: "Clouds: cost of a step, part by part",
    intro: "All clouds have as many Gaussians, 5000 at random places and never more, so that rows differ in their parts alone. Many \
            people's photos: the embedded tabletop, its training photos covered with squares and with colours of their own. A film: \
            the embedded stage.",
    about: "Median over rounds in which the systems took turns; surveys, warm-ups and encoders included. Memory: the most that the \
            process held, photos and program too. Held-out PSNR in dB, in the mean appearance, after so few steps of so few Gaussians: it \
            says that the work was done.",
};

/// Where all begin, and stay in number.
macro_rules! alike {
    ($more:literal) => {
        concat!("start = 'random'\nstart_count = 5000\nmax_splats = 5000\n", $more)
    };
}

const fn row(name: &'static str, system: &'static str, set: &'static str) -> Row {
    Row { name, system, set }
}

const SPLAT: Row = row("splat", "splat", alike!(""));

/// Of photos of many people.
const PHOTOS: &[Row] = &[
    SPLAT,
    row("wild-gaussians, neither part", "wild-gaussians", alike!("appearance = 'none'\noccluders = 'none'")),
    row("wild-gaussians, appearance alone", "wild-gaussians", alike!("appearance = 'codes'\noccluders = 'none'")),
    row("wild-gaussians, masks alone", "wild-gaussians", alike!("appearance = 'none'\noccluders = 'photos'")),
    row("wild-gaussians", "wild-gaussians", alike!("appearance = 'codes'\noccluders = 'photos'")),
    row("gs-w, appearance alone", "gs-w", alike!("appearance = 'maps'\noccluders = 'none'")),
    row("gs-w", "gs-w", alike!("appearance = 'maps'\noccluders = 'photos'")),
    row("wild-gs, the photo as a whole alone", "wild-gs", alike!("occluders = 'none'\nplane_from = 1.0")),
    row("wild-gs, appearance alone", "wild-gs", alike!("occluders = 'none'")),
    row("wild-gs", "wild-gs", alike!("occluders = 'photos'")),
    row("spotless", "spotless", alike!("")),
    row("degauss", "degauss", alike!("front_count = 1000\nfront_max = 1000")),
];

/// Of a film.
const FILM: &[Row] = &[
    SPLAT,
    row("4dgs, nothing moves", "4dgs", alike!("motion_from = 0.999")),
    row("4dgs, positions, sizes and turns", "4dgs", alike!("")),
    row("4dgs, opacities and colours, too", "4dgs", alike!("motion_opacity = true\nmotion_colour = true")),
    row("degauss", "degauss", alike!("front_count = 1000\nfront_max = 1000")),
];

/// Milliseconds a step of all clouds.
pub(super) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    cost::run(bench, keep, HEAD, &all(bench.extent))
}

/// The photos, and the film.
fn all(extent: Extent) -> [Photos; 2] {
    let (table, stage) = match extent {
        Extent::Full => (tabletop(&TabletopOptions::default()), orbit(&OrbitOptions::default())),
        Extent::Quick => (small_tabletop(), orbit(&small_orbit())),
    };
    let photos = Photos {
        name: "tabletop, co",
        word: "perturbed:co:synthetic:tabletop",
        scene: perturb(table, PerturbationKind::Both, 0),
        appearance: Some("mean"),
        rows: PHOTOS.to_vec(),
    };
    let film = Photos { name: "orbit", word: "synthetic:orbit", scene: stage, appearance: None, rows: FILM.to_vec() };
    [photos, film]
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::data::Dataset;
    use engine::options::RunOptions;
    use engine::train::Stop;
    use scene_io::{ImageStore, Split, StoreOptions};
    use std::sync::Arc;

    #[test]
    fn every_row_is_a_system_that_takes_its_settings() {
        for Photos { scene, rows, .. } in all(Extent::Quick) {
            assert_eq!(rows[0].name, "splat", "the others are compared with it");
            let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
            let train = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
            for row in rows {
                let set = row.set.parse().unwrap();
                let stop = Some(Stop::Steps(10));
                let run = RunOptions { seed: 0, background: None, error_budget: None, stop, set };
                let built = systems::registry::build(row.system, &scene, &train, &run);
                assert!(built.is_ok(), "{}: {}", row.name, built.err().map_or_else(String::new, |e| e.to_string()));
            }
        }
    }
}
