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
    row("4dgs, nothing moves", "4dgs", alike!("motion_from = 1.0")),
    row("4dgs, positions, sizes and turns", "4dgs", alike!("")),
    row("4dgs, opacities and colours, too", "4dgs", alike!("motion_opacity = true\nmotion_colour = true")),
    row("degauss", "degauss", alike!("front_count = 1000\nfront_max = 1000")),
];

/// Milliseconds a step of all clouds.
pub(super) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    let (table, stage) = match bench.extent {
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
    cost::run(bench, keep, HEAD, &[photos, film])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_name_systems_and_their_settings() {
        for row in PHOTOS.iter().chain(FILM) {
            assert!(systems::registry::find(row.system).is_some(), "{}", row.name);
            assert!(row.set.parse::<toml::Table>().is_ok(), "{}", row.set);
        }
        for rows in [PHOTOS, FILM] {
            assert_eq!(rows[0].name, "splat", "the others are compared with it");
        }
    }
}
