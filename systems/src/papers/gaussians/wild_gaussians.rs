//! WildGaussians: one cloud from photos of many people, a tone for each of them, and what stands before the scene left out.
//!
//! Kulhanek, Peng, Kukelova, Pollefeys, Sattler, "WildGaussians: 3D Gaussian Splatting in the Wild", 2024.
//!
//! ```text
//! (b, g) = f(e_j, g_i, c_i)                          a tone, of codes of photo and Gaussian and its colour (equation 4)
//! c~_i = g c_i(d) + b                                the colour of Gaussian i in photo j (equation 5)
//! L = (1 - l) |C~ - C| M + l (1 - SSIM(C^, C)) M,  l = 0.2   of toned colours C~ and plain ones C^ (equation 8)
//! M = 1 where 1 / (2 s^2) > 1, else 0                the pixels that count, by their uncertainty s (equations 10, 11)
//! ```
//!
//! Codes of Gaussians begin as waves of their places ([`crate::cloud_appearance`]). The uncertainty is that of features of a network
//! that no program here runs; which pixels count instead: [`crate::cloud_occluders`]. What differs, and why:
//! `docs/decisions/0062-clouds-from-photos-of-many-people.md`.

use super::gs_w::{HEAD, MAPS, VISIBILITY};
use super::photos::PhotoParts;
use super::recipe::Recipe;
use super::sky::{SkyChoice, SkySettings};
use super::splat;
use super::start::StartKind;
use crate::claims::Claim;
use crate::cloud_appearance::{CloudAppearance, ToneSettings};
use crate::cloud_occluders::{CloudOccluders, ErrorMaskSettings, FeatureMaskSettings, MaskSettings, StructureSettings};
use crate::cloud_triplane::TriplaneSettings;
use crate::plan::{Ask, Built};
use crate::views::{L1DssimConfig, Structure};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "wild-gaussians",
    paper: "Kulhanek et al., 2024",
    what: "A cloud of Gaussians with a tone for each photo; what most photos do not show is left out",
    take: "photos of many people, to look around in any of their appearances",
    differs: "The cloud is that of `splat` here, with spherical harmonics of degree 1 where photos differ. Occluders are masks that are \
              found in whole photos, as `robust-nerf` here finds them, not by features of a network; `--set occluders=residual` takes \
              structural similarity, as the paper's ablation. The network of tones is a quarter as wide, rates are higher, the sky has fewer points.",
    mark: "own masks, small network",
};

/// Released: 32 numbers of a photo's code; 128 units of the network; rates of 1e-3 (photos), 5e-3 (Gaussians) and 5e-4 (network), for
/// 70 000 to 200 000 steps; a factor of 0.01.
pub(super) const TONE: ToneSettings = ToneSettings {
    appearance_dims: 32,
    tone_width: 32,
    tone_scale: 0.1,
    code_lr: 3e-2,
    place_code_lr: 5e-3,
    tone_lr: 6e-3,
};

/// Released: from step 10 000 of 70 000 on, over 1 800 steps.
pub(super) const JUDGE: StructureSettings =
    StructureSettings { judge_from: 0.15, judge_warmup: 0.03, uncertainty_weight: 0.5 };

/// Of masks by errors and by features (Sabour et al., "SpotLessSplats", 2024), released: the chance falls to 1/e in 500 of 30 000 steps,
/// the network learns at 1e-3; here there are a tenth of the steps or fewer.
const ERRORS: ErrorMaskSettings = ErrorMaskSettings { chance_fade: 1.0 / 60.0, inlier_share: 0.7 };
const FEATURES: FeatureMaskSettings =
    FeatureMaskSettings { chance_fade: ERRORS.chance_fade, inlier_least: 0.5, inlier_most: 0.9, mask_lr: 1e-2 };

/// Released: 50 000 to 100 000 points. Of clouds that were not measured with a sky none has one.
const SKY: SkySettings = SkySettings { sky: SkyChoice::Auto, sky_splats: 5_000 };
const NO_SKY: SkySettings = SkySettings { sky: SkyChoice::No, ..SKY };

pub(super) const PHOTOS: PhotoParts = PhotoParts {
    appearance: CloudAppearance::Codes,
    tone: TONE,
    maps: MAPS,
    triplane: TriplaneSettings::PLANNED,
    sh_degree: 1,
    structure: Structure::Plain,
    occluders: CloudOccluders::Photos,
    masks: MaskSettings { judge_first: 100, judge_every: 200 },
    judge: JUDGE,
    errors: ERRORS,
    features: FEATURES,
    visibility: VISIBILITY,
    head: HEAD,
    sky: NO_SKY,
    depth: None,
};

static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Points,
    cloud: splat::CLOUD,
    rates: splat::RATES,
    density: splat::CONTROL,
    pictures: splat::PICTURES,
    loss: Some(L1DssimConfig { dssim: 0.2 }),
    motion: None,
    photos: Some(PhotoParts { sky: SKY, ..PHOTOS }),
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}

/// All settings by name, whatever is chosen; values are of no scene.
pub(crate) fn names() -> toml::Table {
    RECIPE.names()
}
