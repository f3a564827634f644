//! Which scenes that move, which systems, and what is expected of them.

use super::ablations::ABLATIONS;
use super::entry::{Aim, Entry};
use super::film::{Film, PriorsFrom};
use crate::sections::training::Held;
use engine::train::Stop;
use scene_io::synthetic::OrbitCamera;

/// A scene, and everything that is trained on it.
pub(super) struct Group {
    /// Name on the command line.
    pub(super) name: &'static str,
    /// In the folder of datasets, or an embedded scene.
    pub(super) path: &'static str,
    pub(super) holdout: Held,
    /// When a row ends where nothing is said.
    pub(super) stop: Stop,
    /// What others are compared with comes before them.
    pub(super) entries: &'static [Entry],
    /// How the stage in `path` is filmed for this page; `None`: `path` is read as it is.
    pub(super) film: Option<Film>,
}

/// What one seed may differ by, dB, and as a multiple of an error of depth: less says nothing.
const SPREAD: f64 = 0.3;
const DEPTH_SPREAD: f64 = 1.1;
/// What knows no time loses at least this much on things that move.
const STATIC_LOSES: Aim = Aim::Moving("ngp", 8.0);
/// Rays a second of systems that are as D-NeRF is.
const RAYS: Aim = Aim::Rays(1e4);
/// What a whole training of ten minutes is to reach.
const THIRTY: Aim = Aim::Within { seconds: 600.0, psnr: 30.0 };

const NGP: Entry = Entry::new("ngp");
const D_NERF: Entry = Entry::new("d-nerf");
/// The baseline: rays a second, and what the original makes of the time that the others have.
const D_NERF_PUBLISHED: Entry = D_NERF
    .named("d-nerf, published networks")
    .set("field = 'mlp'")
    .slow()
    .quick("width = 16\nwarp_width = 16\ncoarse = 8\nfine = 8");
/// Finding out whether photos need codes takes longer than a quick row.
const ONE_LIGHT: &str = "appearance = 'none'";
const NERFIES: Entry = Entry::new("nerfies").quick(ONE_LIGHT);
const HYPERNERF: Entry = Entry::new("hypernerf").quick(ONE_LIGHT);
const TINEUVOX: Entry = Entry::new("tineuvox");
const K_PLANES: Entry = Entry::new("k-planes");
const TWO_PARTS: Entry = Entry::new("two-parts");
const GAUSSIANS: Entry =
    Entry::new("4dgs").quick("start = 'random'\nstart_count = 200\nmax_splats = 300\nplane_vertices = 16");
const DEGAUSS: Entry = Entry::new("degauss")
    .quick("start = 'random'\nstart_count = 200\nmax_splats = 300\nfront_count = 100\nplane_vertices = 16");
const ENDO_NERF: Entry = Entry::new("endo-nerf");

/// Every system for scenes that move, and Nerfies without its parts.
const EVERYTHING: &[Entry] = &[
    NGP,
    Entry::new("t-nerf").aims(&[STATIC_LOSES]),
    D_NERF.aims(&[STATIC_LOSES, Aim::Over("t-nerf", SPREAD), RAYS, THIRTY]),
    NERFIES.aims(&[STATIC_LOSES]),
    HYPERNERF.aims(&[STATIC_LOSES]),
    TINEUVOX.aims(&[STATIC_LOSES, Aim::Faster("d-nerf", 10.0), RAYS, THIRTY]),
    K_PLANES,
    TWO_PARTS,
    GAUSSIANS.aims(&[STATIC_LOSES, THIRTY]),
    DEGAUSS,
    NERFIES.without("nerfies, no elastic loss", "elastic = 0.0").aims(&[Aim::Costs(SPREAD)]),
    NERFIES.without("nerfies, all octaves from the start", "warp_anneal = 0").aims(&[Aim::Costs(SPREAD)]),
    NERFIES.without("nerfies, no background loss", "background_loss = 0.0").aims(&[Aim::Costs(SPREAD)]),
    D_NERF_PUBLISHED,
];
/// Where pictures are so large that published networks take half an hour for one.
const EVERYTHING_BUT_PUBLISHED: &[Entry] = match EVERYTHING.split_last() {
    Some((last, others)) if last.slow => others,
    _ => panic!("published networks come last"),
};

pub(super) const WORKBENCH: Group = Group {
    name: "workbench",
    path: "blender_rendered/workbench",
    holdout: Held::Own,
    stop: Stop::Seconds(200.0),
    entries: EVERYTHING_BUT_PUBLISHED,
    film: None,
};

pub(super) const ORBIT: Group = Group { name: "orbit", path: "synthetic:orbit", entries: EVERYTHING, ..WORKBENCH };

/// What ambient coordinates are for: the systems of the other pages, and the one that has such coordinates without them.
pub(super) const MOUTH: Group = Group {
    name: "mouth",
    path: "synthetic:mouth",
    holdout: Held::Own,
    stop: Stop::Seconds(200.0),
    entries: &[
        NGP,
        Entry::new("t-nerf"),
        D_NERF,
        NERFIES,
        HYPERNERF.aims(&[Aim::Moving("nerfies", SPREAD)]),
        TINEUVOX,
        K_PLANES,
        GAUSSIANS,
        DEGAUSS,
        HYPERNERF.without("hypernerf, no ambient coordinates", "ambient = 0").aims(&[Aim::Costs(SPREAD)]),
    ],
    film: None,
};

pub(super) const NR: Group = Group {
    name: "nr",
    path: "nr_nerf/example_sequence",
    holdout: Held::EveryFrom(8, 4),
    stop: Stop::Seconds(300.0),
    entries: &[NGP, D_NERF, TINEUVOX, NERFIES, K_PLANES, TWO_PARTS, GAUSSIANS, DEGAUSS],
    film: None,
};

pub(super) const TISSUE: Group = Group {
    name: "tissue",
    path: "synthetic:tissue",
    holdout: Held::Own,
    // Four rounds of refinement, a fifth of the steps apart.
    stop: Stop::Steps(2000),
    entries: &[
        ENDO_NERF,
        ENDO_NERF
            .without("endo-nerf, not held to depth", "depth = 0.0")
            .aims(&[Aim::HiddenCosts(SPREAD), Aim::DepthCosts(DEPTH_SPREAD)]),
        ENDO_NERF
            .without("endo-nerf, samples not led by depth", "cue_samples = 0")
            .aims(&[Aim::HiddenCosts(SPREAD), Aim::DepthCosts(DEPTH_SPREAD)]),
        ENDO_NERF
            .without("endo-nerf, no refinement of depth", "refine_every = 0")
            .aims(&[Aim::DepthCosts(DEPTH_SPREAD)]),
        ENDO_NERF.without("endo-nerf, rays not led by masks", "guided = false").aims(&[Aim::HiddenCosts(SPREAD)]),
        // The endoscope stands still, and this system makes nothing of measured depth: it has to be told to try.
        D_NERF.set("accept_no_parallax = true"),
    ],
    film: None,
};

/// Scene flow with priors that are perfect, of a camera that jumps.
pub(super) const ORBIT_EXACT: Group = Group {
    name: "orbit-exact",
    stop: Stop::Seconds(60.0),
    entries: ABLATIONS,
    film: Some(Film { camera: OrbitCamera::Jumping, priors: PriorsFrom::Stage }),
    ..ORBIT
};

/// The same with priors that anyone can have. Of a camera that jumps they know next to nothing.
pub(super) const ORBIT_MADE: Group = Group {
    name: "orbit-made",
    film: Some(Film { camera: OrbitCamera::Jumping, priors: PriorsFrom::Photos }),
    ..ORBIT_EXACT
};

/// What scene flow is made for: a film by one camera that moves on.
pub(super) const WALK_EXACT: Group = Group {
    name: "walk-exact",
    film: Some(Film { camera: OrbitCamera::Walking, priors: PriorsFrom::Stage }),
    ..ORBIT_EXACT
};

pub(super) const WALK_MADE: Group = Group {
    name: "walk-made",
    film: Some(Film { camera: OrbitCamera::Walking, priors: PriorsFrom::Photos }),
    ..ORBIT_EXACT
};

/// What `--protocol` may name.
pub(in crate::sections) fn names() -> impl Iterator<Item = &'static str> {
    let films = [ORBIT_EXACT, ORBIT_MADE, WALK_EXACT, WALK_MADE];
    [WORKBENCH, ORBIT, MOUTH, NR, TISSUE].into_iter().chain(films).map(|group| group.name)
}
