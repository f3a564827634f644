//! Which photos, which systems, and what is expected of them.

use crate::sections::training::Held;

/// A dataset with its oracle, and the photos of it that are trained on.
pub(super) struct Group {
    /// Name on the command line and in the table.
    pub(super) name: &'static str,
    /// In the folder of datasets, or an embedded scene.
    pub(super) path: &'static str,
    pub(super) longest_side: Option<u32>,
    pub(super) holdout: Held,
    /// What white means in its masks, where it is not what it means everywhere.
    pub(super) mask_white: Option<&'static str>,
    pub(super) steps: u64,
    /// Clean photos come first, where there are such.
    pub(super) photos: &'static [Photos],
}

/// One set of training photos of a place.
pub(super) struct Photos {
    pub(super) name: &'static str,
    pub(super) kind: Kind,
    /// Photos of the dataset that are trained on, a word of `--train-split`; none: all.
    pub(super) split: Option<&'static str>,
    /// Lights that held-out views are measured in, words of `--eval-appearance`.
    pub(super) appearances: &'static [&'static str],
    pub(super) entries: &'static [Entry],
}

/// What makes them differ from the dataset as it lies there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Nothing.
    AsIs,
    /// Its clean photos: the first of a group, which others are compared with.
    Clean,
    /// Perturbed: `c`, `o` or `co`.
    Perturbed(&'static str),
}

/// A system with its settings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) name: &'static str,
    pub(super) system: &'static str,
    /// The system of its kind without masks and codes: what it wins back is counted between this on its photos and on clean ones.
    pub(super) base: &'static str,
    /// TOML.
    pub(super) set: &'static str,
    pub(super) segments: Segments,
    pub(super) aims: &'static [Aim],
}

/// Segments of the photos.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Segments {
    /// The dataset's own files, or what the system makes itself.
    Own,
    /// True outlines of occluders, as a segmenter that makes no mistake would draw them; the rest in squares of so many
    /// pixels.
    True(usize),
}

/// What was planned, in per cent, decibels or as F1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Aim {
    /// Of the gap between plain and clean, at least; in the appearance of a training photo or over whole views.
    Share(f64),
    /// Occluders in its masks.
    F1(f64),
    /// Below `plain` on the same clean photos, at most.
    Loss(f64),
}

/// A field, and a cloud, that take photos as they are.
const FIELD: &str = "plain";
const CLOUD: &str = "splat";

impl Entry {
    const fn new(system: &'static str) -> Self {
        Self { name: system, system, base: FIELD, set: "", segments: Segments::Own, aims: &[] }
    }

    const fn cloud(system: &'static str) -> Self {
        Self { base: CLOUD, ..Self::new(system) }
    }

    const fn set(self, name: &'static str, set: &'static str) -> Self {
        Self { name, set, ..self }
    }

    const fn aims(self, aims: &'static [Aim]) -> Self {
        Self { aims, ..self }
    }

    const fn true_segments(self, name: &'static str, square: usize) -> Self {
        Self { name, segments: Segments::True(square), ..self }
    }
}

/// What `plain` is compared with: the system of `nerf-static` itself.
pub(super) const NGP: Entry = Entry::new("ngp").set("ngp of nerf-static", "");
const PLAIN: Entry = Entry::new(FIELD);
/// What clouds are compared with: the cloud of `nerf-static`.
const SPLAT: Entry = Entry::cloud(CLOUD);
const ROBUST: Entry = Entry::new("robust-nerf");
const L1: Entry = ROBUST.set("robust-nerf: L1, no masks", "kernel = 'l1'\njudging = 'never'");
const CHARBONNIER: Entry =
    ROBUST.set("robust-nerf: Charbonnier, no masks", "kernel = 'charbonnier'\njudging = 'never'");
const ROBUST_CODES: Entry = ROBUST.set("robust-nerf with codes", "appearance = 'codes'");
const NERF_A: Entry = Entry::new("nerf-a");
const NERF_U: Entry = Entry::new("nerf-u");
const NERF_W: Entry = Entry::new("nerf-w");
const HA_NERF: Entry = Entry::new("ha-nerf");
const HA_NERF_A: Entry = Entry::new("ha-nerf-a");
const HA_NERF_T: Entry = Entry::new("ha-nerf-t");
const SF_NERF: Entry = Entry::new("sf-nerf");
const SF_NERF_ONE_APPEARANCE: Entry = SF_NERF.set("sf-nerf, one appearance", "appearance = 'none'");
const HUGS: Entry = Entry::new("hugs");
const HUGS_CODES: Entry = HUGS.set("hugs with codes", "appearance = 'codes'");
const WILD_GAUSSIANS: Entry = Entry::cloud("wild-gaussians");
const CLOUD_ONE_APPEARANCE: Entry = WILD_GAUSSIANS.set("wild-gaussians, one appearance", "appearance = 'none'");
const CLOUD_ALL_SHOWN: Entry = WILD_GAUSSIANS.set("wild-gaussians, no masks", "occluders = 'none'");
/// Without features beside the photos: masks by errors.
const SPOTLESS: Entry = Entry::cloud("spotless");
const CLOUD_STRUCTURE: Entry = WILD_GAUSSIANS.set("wild-gaussians, masks of structure", "occluders = 'residual'");

/// Pictures of what is behind; one appearance.
const DEGAUSS: Entry = Entry::cloud("degauss");
const GS_W: Entry = Entry::cloud("gs-w");
const GS_W_VISIBILITY: Entry = GS_W.set("gs-w, the paper's map", "occluders = 'visibility'");
/// Without depth files beside the photos.
const WILD_GS: Entry = Entry::cloud("wild-gs");
const WILD_GS_VISIBILITY: Entry = WILD_GS.set("wild-gs, the paper's mask", "occluders = 'visibility'");

/// Every appearance is the same there, or known: whole views count.
const ONE_APPEARANCE: &[&str] = &["mean"];
/// The first photo of lego is left as it was.
const KNOWN_APPEARANCE: &[&str] = &["image:train/r_0", "fit"];
const FITTED: &[&str] = &["fit"];

const PERTURBED: [Photos; 4] = [
    Photos {
        name: "clean",
        kind: Kind::Clean,
        // The perturbed ones are made of these: there are no others.
        split: None,
        appearances: KNOWN_APPEARANCE,
        entries: &[PLAIN, ROBUST.aims(&[Aim::Loss(0.5)]), HUGS.aims(&[Aim::Loss(0.5)]), SPLAT],
    },
    Photos {
        name: "o",
        kind: Kind::Perturbed("o"),
        split: None,
        appearances: ONE_APPEARANCE,
        entries: &[
            PLAIN,
            L1,
            CHARBONNIER,
            ROBUST.aims(&[Aim::Share(85.0)]),
            HUGS.aims(&[Aim::Share(85.0)]),
            NERF_U,
            NERF_W,
            HA_NERF_T,
            SF_NERF_ONE_APPEARANCE,
            SPLAT,
            WILD_GAUSSIANS.aims(&[Aim::Share(85.0)]),
            CLOUD_ONE_APPEARANCE,
            SPOTLESS,
            DEGAUSS.aims(&[Aim::Share(85.0)]),
            CLOUD_STRUCTURE,
            GS_W,
            WILD_GS.aims(&[Aim::Share(85.0)]),
        ],
    },
    Photos {
        name: "c",
        kind: Kind::Perturbed("c"),
        split: None,
        appearances: KNOWN_APPEARANCE,
        entries: &[
            PLAIN,
            NERF_A.aims(&[Aim::Share(85.0)]),
            NERF_W.aims(&[Aim::Share(85.0)]),
            HA_NERF_A.aims(&[Aim::Share(85.0)]),
            SPLAT,
            WILD_GAUSSIANS.aims(&[Aim::Share(85.0)]),
            CLOUD_ALL_SHOWN,
            GS_W.aims(&[Aim::Share(85.0)]),
            WILD_GS.aims(&[Aim::Share(85.0)]),
        ],
    },
    Photos {
        name: "co",
        kind: Kind::Perturbed("co"),
        split: None,
        appearances: KNOWN_APPEARANCE,
        entries: &[
            PLAIN,
            ROBUST_CODES,
            HUGS_CODES,
            NERF_W.aims(&[Aim::Share(80.0)]),
            HA_NERF,
            SF_NERF,
            SPLAT,
            WILD_GAUSSIANS.aims(&[Aim::Share(85.0)]),
            CLOUD_ONE_APPEARANCE,
            SPOTLESS,
            DEGAUSS,
            CLOUD_ALL_SHOWN,
            GS_W,
            WILD_GS,
            GS_W_VISIBILITY,
            WILD_GS_VISIBILITY,
        ],
    },
];

const EVERYTHING: &[Entry] = &[
    PLAIN,
    ROBUST_CODES,
    HUGS_CODES,
    NERF_A,
    NERF_W,
    HA_NERF,
    SF_NERF,
    SPLAT,
    WILD_GAUSSIANS,
    CLOUD_ONE_APPEARANCE,
    SPOTLESS,
    DEGAUSS,
    CLOUD_ALL_SHOWN,
    GS_W,
    WILD_GS,
];

const LEGO: Group = Group {
    name: "lego100",
    path: "nerf_synthetic/lego",
    longest_side: Some(100),
    holdout: Held::EightOfTest,
    mask_white: None,
    steps: 1000,
    photos: &PERTURBED,
};

/// Lego with squares over it, other colours, both.
pub(super) const LEGO100: &[Group] = &[LEGO];
pub(super) const LEGO400: &[Group] = &[Group { name: "lego400", longest_side: Some(400), ..LEGO }];

/// Things that stand in the way, each in one photo.
pub(super) const YARD: &[Group] = &[Group {
    name: "yard",
    path: "blender_rendered/yard",
    longest_side: None,
    holdout: Held::Own,
    mask_white: None,
    steps: 2000,
    photos: &[
        Photos {
            name: "clean",
            kind: Kind::Clean,
            split: Some("clean"),
            appearances: ONE_APPEARANCE,
            entries: &[PLAIN, ROBUST.aims(&[Aim::Loss(0.5)]), SPLAT],
        },
        Photos {
            name: "occluders",
            kind: Kind::AsIs,
            split: None,
            appearances: ONE_APPEARANCE,
            entries: &[
                PLAIN,
                L1,
                CHARBONNIER,
                ROBUST.aims(&[Aim::Share(85.0), Aim::F1(0.75)]),
                HUGS,
                // As large as things of the place are, and much smaller: then shadows of occluders are segments, too.
                HUGS.true_segments("hugs, true outlines, squares of 40", 40).aims(&[Aim::Share(85.0), Aim::F1(0.9)]),
                HUGS.true_segments("hugs, true outlines, squares of 16", 16),
                NERF_A,
                NERF_U,
                NERF_W,
                HA_NERF,
                SF_NERF,
                SPLAT,
                WILD_GAUSSIANS.aims(&[Aim::Share(85.0), Aim::F1(0.75)]),
                SPOTLESS,
                DEGAUSS.aims(&[Aim::Share(85.0)]),
                WILD_GS.aims(&[Aim::Share(85.0)]),
            ],
        },
    ],
}];

/// Light, exposure and occluders at once, with the truth known.
pub(super) const PLAZA: &[Group] = &[
    Group {
        name: "plaza",
        path: "synthetic:plaza",
        // The demo's photos at half their size.
        longest_side: Some(96),
        holdout: Held::Own,
        mask_white: None,
        steps: 1000,
        photos: &[
            Photos {
                name: "clean",
                kind: Kind::Clean,
                split: Some("clean"),
                appearances: FITTED,
                entries: &[PLAIN, SPLAT],
            },
            Photos { name: "many people's", kind: Kind::AsIs, split: None, appearances: FITTED, entries: EVERYTHING },
        ],
    },
    Group {
        name: "plaza_photos",
        path: "blender_rendered/plaza_photos",
        longest_side: None,
        holdout: Held::Own,
        mask_white: None,
        steps: 1000,
        photos: &[Photos {
            name: "many people's",
            kind: Kind::AsIs,
            split: None,
            appearances: FITTED,
            entries: EVERYTHING,
        }],
    },
];

/// Real photographs.
pub(super) const REAL: &[Group] = &[
    Group {
        name: "statue",
        path: "nerd_in_the_wild/statue_of_liberty_40",
        longest_side: Some(480),
        holdout: Held::Every(8),
        mask_white: Some("object"),
        steps: 1000,
        photos: &[Photos {
            name: "40 people's",
            kind: Kind::AsIs,
            split: None,
            appearances: FITTED,
            entries: &[PLAIN, ROBUST_CODES, NERF_A, NERF_W, HA_NERF, WILD_GAUSSIANS, GS_W, WILD_GS],
        }],
    },
    Group {
        name: "sacre",
        path: "phototourism/sacre_coeur_10",
        longest_side: Some(480),
        holdout: Held::Every(5),
        mask_white: None,
        steps: 1000,
        photos: &[Photos {
            name: "8 people's",
            kind: Kind::AsIs,
            split: None,
            appearances: FITTED,
            entries: EVERYTHING,
        }],
    },
];

/// What `--protocol` may name.
pub(in crate::sections) fn names() -> impl Iterator<Item = &'static str> {
    [LEGO100, LEGO400, YARD, PLAZA, REAL].into_iter().flatten().map(|group| group.name)
}

/// Systems whose cost is measured.
pub(super) const COSTS: &[Entry] =
    &[PLAIN, L1, ROBUST, ROBUST_CODES, HUGS, NERF_A, NERF_U, NERF_W, HA_NERF_A, HA_NERF_T, HA_NERF, SF_NERF];
