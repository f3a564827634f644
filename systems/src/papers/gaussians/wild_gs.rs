//! Wild-GS: one cloud from photos of many people, whose colours come from a reference photo that is projected back into the scene.
//!
//! Xu, Mei, Patel, "Wild-GS: Real-Time Novel View Synthesis from Unconstrained Photo Collections", 2024.
//!
//! ```text
//! X = R^T (D K^-1 [u, v, 1] - t)                     pixels of the reference photo as points, by its rendered depth D
//! P_xy, P_yz, P_zx                                   three planes over a box about them: their colours, as either side of a plane sees them
//! l_i = U(P_xy)(p_i) + U(P_yz)(p_i) + U(P_zx)(p_i)   what Gaussian i reads at its place; U: one network for all planes
//! g = E(I_j)                                         the photo as a whole
//! c_i = F(g, l_i, s_i)                               its colour; s_i: what it is by itself
//! L_I = 0.8 |M I - M I^| + 0.2 (1 - SSIM(M I, M I^)) of the pixels that show the scene, as a mask M says
//! L_M = mean (1 - M)^2                               how much is left out
//! L_D = 1 - r(D, D*)                                 correlation with depth that another program estimated
//! L = L_I + l_M L_M + l_D L_D,  l_M from 0.4 to 0.1, l_D = 0.05
//! ```
//!
//! Printed are `SSIM` and `r` where `1 - SSIM` and `1 - r` are meant. Here `F` is a network that gives a factor and a summand for the
//! colour `c_i(d)` of the spherical harmonics, which is thus what a Gaussian is by itself: [`crate::cloud_triplane`]. The mask is learnt by a
//! network of its own, or is what costs least for each pixel, in closed form: [`crate::cloud_occluders`]. What differs, and why:
//! `docs/decisions/0067-wild-gs.md`.

use super::photos::{DepthSettings, PhotoParts};
use super::recipe::Recipe;
use super::splat;
use super::start::StartKind;
use super::wild_gaussians;
use crate::claims::Claim;
use crate::cloud_appearance::CloudAppearance;
use crate::cloud_occluders::VisibilitySettings;
use crate::plan::{Ask, Built};
use crate::views::{L1DssimConfig, Structure};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "wild-gs",
    paper: "Xu et al., 2024",
    what: "A cloud of Gaussians that reads its colours in a reference photo projected back into the scene",
    take: "photos of many people, better with depth files; the appearance of any photo without a fit",
    differs: "The cloud is that of `splat` here. Planes have 64 cells a side, networks are small and nothing was learnt before; one network \
              turns colours of spherical harmonics of degree 1 instead of making them. Occluders are masks found in whole photos, as \
              `wild-gaussians` here has them; `--set occluders=visibility_head` learns the paper's mask, by a network of its own.",
    mark: "small networks, tones instead of colours, own masks",
};

/// Published: from 0.4 to 0.1 over training, from the first step on.
const VISIBILITY: VisibilitySettings =
    VisibilitySettings { judge_from: 0.0, visibility_weight: 0.4, visibility_left: 0.25 };

static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Points,
    cloud: splat::CLOUD,
    rates: splat::RATES,
    density: splat::CONTROL,
    pictures: splat::PICTURES,
    loss: Some(L1DssimConfig { dssim: 0.2 }),
    motion: None,
    photos: Some(PhotoParts {
        appearance: CloudAppearance::Triplane,
        structure: Structure::Picture,
        visibility: VISIBILITY,
        depth: Some(DepthSettings { depth_weight: 0.05 }),
        ..wild_gaussians::PHOTOS
    }),
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}
