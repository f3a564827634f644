//! SpotLessSplats: one cloud of what stands still; pixels that are far from their renders do not count.
//!
//! Sabour, Goli, Kopanas, Matthews, Lagun, Guibas, Jacobson, Fleet, Tagliasacchi, "SpotLessSplats: Ignoring Distractors in 3D Gaussian
//! Splatting", 2024.
//!
//! ```text
//! L = mean(M~ |C^ - C|)                              the loss (equation 4, without structural similarity)
//! M~ = 1 with chance a + (1 - a) M, else 0           the pixels of a step; a falls from 1 to 0 (equation 14)
//! ```
//!
//! The masks `M`: [`crate::cloud_occluders`]. What differs, and why: `docs/decisions/0064-spotless.md`.

use super::photos::PhotoParts;
use super::recipe::Recipe;
use super::start::StartKind;
use super::{splat, wild_gaussians};
use crate::claims::Claim;
use crate::cloud_appearance::CloudAppearance;
use crate::cloud_occluders::CloudOccluders;
use crate::plan::{Ask, Built};
use crate::views::{L1DssimConfig, PlannedDensity, SplitConfig};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "spotless",
    paper: "Sabour et al., 2024",
    what: "A cloud of Gaussians; pixels that are far from their renders, or have features like those, are left out",
    take: "to compare; better with feature files beside the photos",
    differs: "The cloud is that of `splat` here, opacities neither fade nor are reset. Masks are those of a network on features in files \
              beside the photos (SLS-mlp), without files those of errors alone (RobustFilter); not those of clusters of features. \
              Gaussians are not pruned by their use, rates of the schedule are shares of the run.",
    mark: "cloud of splat, no pruning by use",
};

/// Gaussians come as in `splat`; opacities do not fade: what fades has errors, which masks take for occluders.
const CONTROL: PlannedDensity =
    PlannedDensity { split: SplitConfig { opacity_decay: 1.0, ..splat::CONTROL.split }, ..splat::CONTROL };

static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Points,
    cloud: splat::CLOUD,
    rates: splat::RATES,
    density: CONTROL,
    pictures: splat::PICTURES,
    loss: Some(L1DssimConfig { dssim: 0.0 }),
    motion: None,
    photos: Some(PhotoParts {
        appearance: CloudAppearance::None,
        occluders: CloudOccluders::Auto,
        ..wild_gaussians::PHOTOS
    }),
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}
