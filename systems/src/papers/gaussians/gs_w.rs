//! GS-W: one cloud from photos of many people, whose colours come from feature maps of a reference photo.
//!
//! Zhang, Wang, Wang, Yang, Ma, Wang, "Gaussian in the Wild: 3D Gaussian Splatting for Unconstrained Image Collections", 2024.
//!
//! ```text
//! F^P, F^1 .. F^K = U(I_j)                           feature maps of the reference photo, of one network
//! f^P_i = F^P(P_j p_i)                               read where Gaussian i lies in that photo; 0 outside of it, and behind
//! f^k_i = F^k(x_i^k)                                 read at coordinates that the Gaussian learns
//! a_i = M([g(p_i), f^P_i, f^1_i .. f^K_i, s_i])      fused with what it is by itself, s_i, and the waves of its place
//! c_i = D(a_i, d)                                    its colour, seen along d
//! L_c = 0.8 |V C - V C^| + 0.2 (1 - SSIM(V C, V C^)) of the pixels that show the scene, as a map V says
//! L = L_c + l_x mean max(0, |x| - 1) + l_v mean (1 - V)^2,  l_x = 0.001, l_v = 0.15
//! ```
//!
//! Here `M` and `D` are one network that gives a factor and a summand for the colour `c_i(d)` of the spherical harmonics, which are thus
//! what a Gaussian is by itself: [`crate::cloud_maps`]; it sees `d` itself where that is asked for. `V` is learnt by a network of its own, or
//! is what costs least for each pixel, in closed form: [`crate::cloud_occluders`]. What differs, and why: `docs/decisions/0063-gs-w.md`.

use super::photos::PhotoParts;
use super::recipe::Recipe;
use super::splat;
use super::start::StartKind;
use super::wild_gaussians;
use crate::claims::Claim;
use crate::cloud_appearance::CloudAppearance;
use crate::cloud_maps::MapSettings;
use crate::cloud_occluders::{HeadSettings, VisibilitySettings};
use crate::plan::{Ask, Built};
use crate::views::{L1DssimConfig, Structure};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "gs-w",
    paper: "Zhang et al., 2024",
    what: "A cloud of Gaussians that reads its colours in feature maps of a reference photo",
    take: "photos of many people, to look around in the appearance of any photo, without a fit",
    differs: "The cloud is that of `splat` here. Maps are 32 pixels wide, of a small network that nothing was learnt before; one \
              network of two layers turns colours of spherical harmonics of degree 1 instead of making them. Occluders are masks found \
              in whole photos, as `wild-gaussians` here has them; `--set occluders=visibility_head` learns the paper's map, by a network \
              of its own.",
    mark: "small networks, tones instead of colours, own masks",
};

/// Released: photos of half their size and more, 16 channels of 3 maps, layers of 128 and 48 units; rates of 2e-3 (encoder), 5e-4
/// (fusion), 1 to 0.01 (coordinates), for 70 000 steps.
pub(super) const MAPS: MapSettings = MapSettings {
    encoder_side: 64,
    sampled_maps: 2,
    map_channels: 8,
    tone_width: 32,
    tone_scale: 0.1,
    tone_direction: false,
    sample_weight: 1e-3,
    place_code_lr: 5e-3,
    tone_lr: 6e-3,
    encoder_lr: 2e-3,
};

/// The weight is as released; the map counts from step 2 500 of 70 000 on there, 0.036 of them. Runs here have hundreds of steps: there is
/// less to compare with after as small a share.
pub(super) const VISIBILITY: VisibilitySettings =
    VisibilitySettings { judge_from: 0.15, visibility_weight: 0.15, visibility_left: 1.0 };

/// Released: a head of the encoder, with its rate, 2e-3.
pub(super) const HEAD: HeadSettings = HeadSettings { head_side: 64, head_lr: 2e-3 };

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
        appearance: CloudAppearance::Maps,
        structure: Structure::Picture,
        ..wild_gaussians::PHOTOS
    }),
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}
